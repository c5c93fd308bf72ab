"""The arrow of a force begins at the tool, points as the force does in the base, and is not too long."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pidtsm_experiments.live.tool import force_arrow

TURN = Rotation.from_euler("xyz", [0.4, -1.0, 2.0])
PLACE = np.column_stack([TURN.as_matrix(), [0.3, 0.2, 0.5]])


@pytest.mark.parametrize(("force", "length"), [(10.0, 0.2), (50.0, 1.0), (1e5, 1.6)])
def test_an_arrow_shows_a_force_in_the_axes_of_the_base(force: float, length: float) -> None:
    down = np.array([0.0, 0.0, -1.0])
    ((begin, end),) = force_arrow(PLACE, TURN.inv().apply(force * down), 2.0)
    np.testing.assert_allclose(begin, PLACE[:, 3], atol=1e-6)
    np.testing.assert_allclose(end - begin, length * down, atol=1e-6)


def test_no_force_is_no_arrow() -> None:
    ((begin, end),) = force_arrow(PLACE, np.zeros(3), 2.0)
    np.testing.assert_array_equal(begin, end)
