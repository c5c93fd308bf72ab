"""The solid arm in a browser: it is painted where its meshes are."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from support.devtools import CHROMIUM, Page
from support.reportpage import LEFT, at_the_end, painted, seen

from pidtsm_core.arrays import Array
from pidtsm_core.experiment import PRACTICAL
from pidtsm_core.robots import find_description
from pidtsm_core.robots.placement import joint_placements
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_studies.reports.meshes import solids
from pidtsm_studies.reports.report import write_report

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium installed (apt-get install chromium)")


def test_the_solid_arm_is_painted_where_its_meshes_are(
    page: Page, described: Callable[..., Path], tmp_path: Path
) -> None:
    urdf = described(tmp_path)
    recording = rollout(robot=str(urdf), params=PRACTICAL, duration=1.0)
    write_report(tmp_path / "report.html", (recording, recording.metrics()))
    page.open(tmp_path / "report.html")
    solid = solids(recording.robot)
    arm_of = find_description(recording.robot)

    def expected(sample: int) -> Array:
        """Left, top, right and bottom of the corners, px."""
        (placement,) = joint_placements(arm_of, recording.position[sample])
        frames = {-1: np.eye(3, 4), 0: placement}
        corners = [each.corners @ frames[each.row][:, :3].T + frames[each.row][:, 3] for each in solid]
        azimuth, elevation = np.degrees(page.evaluate("data.viewer.arm.view"))
        points = seen(page, np.concatenate(corners), azimuth, elevation)
        width, height = page.evaluate("(({clientWidth, clientHeight}) => [clientWidth, clientHeight])(arm)")
        left, top, wide, high = map(float, page.evaluate("arm.getAttribute('viewBox')").split())
        scale = min(width / wide, height / high)
        places = (points - [left + 0.5 * wide, top + 0.5 * high]) * scale + [0.5 * width, 0.5 * height]
        assert np.all((places > 0.0) & (places < [width, height])), "all of it is in view"
        return np.concatenate([places.min(axis=0), places.max(axis=0)])

    first = expected(0)
    np.testing.assert_allclose(painted(page), first, atol=2.0)
    sample = at_the_end(page, recording)
    np.testing.assert_allclose(painted(page), expected(sample), atol=2.0)
    page.focus("#arm")
    page.key("ArrowLeft", LEFT)
    np.testing.assert_allclose(painted(page), expected(sample), atol=2.0)
    violet = "alpha > 128 && blue > green + 40"
    assert painted(page, violet) == []
    page.click('#joints [data-joint="0"]')
    assert painted(page, violet) != [], "the link of the chosen joint"
    assert [each for each in page.complaints if "getImageData" not in each] == [], "this test reads what is painted"
