"""Properties of every reference, and values of each calculated by hand."""

import math
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import ParameterError, resolve
from pidtsm_core.references import (
    REFERENCES,
    Reference,
    ReferenceMotion,
    extrapolate,
    reference_joints,
    reference_schema,
)
from pidtsm_core.references.base import SHORTEST

PROPERTY = settings(deadline=None, max_examples=60)
EACH = pytest.mark.parametrize("reference", REFERENCES.members, ids=lambda r: r.name)
TIMES = st.floats(0.0, 60.0)


CORNERS: dict[str, Iterable[float]] = {"chirp": (20.0,), "minimum_jerk": (0.0, 2.0), "csv": np.arange(0.0, 6.1, 0.2)}
CORNERS["pick_and_place"] = np.ravel([(k, k + 2.0) for k in range(0, 64, 3)])
"""Times at which the acceleration, or its derivative, jumps."""
FILE = "time,q_joint2,q_joint1\n" + "".join(
    f"{t:.1f},{math.sin(t)!r},{math.cos(t)!r}\n" for t in np.arange(0.0, 6.1, 0.2)
)


@pytest.fixture(scope="module", autouse=True)
def _in_a_folder_with_a_file(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    folder = tmp_path_factory.mktemp("motions")
    (folder / "motion.csv").write_text(FILE)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        yield


def motion_of(reference: Reference, **given: object) -> ReferenceMotion:
    given = {"reference.name": reference.name, **{f"reference.{name}": value for name, value in given.items()}}
    if reference.name == "csv":
        given = {"reference.file": "motion.csv", **given}
    return ReferenceMotion(resolve(reference_schema, given, 2))


def away_from_corners(reference: Reference, t: float, distance: float) -> None:
    assume(all(abs(t - corner) > distance for corner in CORNERS.get(reference.name, ())))


def at(motion: ReferenceMotion, t: float) -> Array:
    desired = np.full((3, motion.joints), np.nan)
    motion.evaluate(t, desired)
    return desired


@EACH
@PROPERTY
@given(t=TIMES)
def test_derivatives_are_exact(reference: Reference, t: float) -> None:
    motion = motion_of(reference)
    assert motion.joints == 2
    step = 1e-5
    away_from_corners(reference, t, 2 * step)
    before, now, after = (at(motion, t + d) for d in (-step, 0.0, step))
    assert np.isfinite(now).all()
    np.testing.assert_allclose((after[:2] - before[:2]) / (2 * step), now[1:], atol=1e-7)


def continued(desired: Array, dt: float) -> Array:
    later = np.full_like(desired, np.nan)
    extrapolate(desired, dt, later)
    return later


@EACH
@PROPERTY
@given(t=TIMES)
def test_continuing_over_no_time_gives_the_same_bits(reference: Reference, t: float) -> None:
    desired = at(motion_of(reference), t)
    assert continued(desired, 0.0).tobytes() == desired.tobytes()


@EACH
@PROPERTY
@given(t=st.floats(0.1, 30.0), dt=st.floats(-0.05, 0.05))
def test_continuing_over_a_short_time_is_right_to_third_order(reference: Reference, t: float, dt: float) -> None:
    away_from_corners(reference, t, 0.06)
    motion = motion_of(reference)
    error = np.abs(continued(at(motion, t), dt) - at(motion, t + dt))
    jerk = max(np.abs(np.diff([at(motion, t + d)[2] for d in (-0.05, 0.0, 0.05)], axis=0)).max() / 0.05, 0.1)
    bound = 2.0 * jerk * np.array([abs(dt) ** 3 / 6, dt**2 / 2, abs(dt)]) + 1e-14
    assert (error.max(axis=1) <= bound).all()


def test_continuing_by_hand() -> None:
    desired = np.array([[1.0, -1.0], [2.0, 0.0], [4.0, 8.0]])
    np.testing.assert_allclose(continued(desired, 0.5), [[2.5, 0.0], [4.0, 4.0], [4.0, 8.0]], rtol=1e-15)


def test_the_article_starts_as_worked_out_by_hand() -> None:
    c, s = 0.2 * math.cos(0.2), math.sin(0.2)
    expected = [[0.2 + c, c - 0.2], [0.1 * s, 0.1 * s], [-0.098 - 0.25 * c, 0.098 - 0.25 * c]]
    np.testing.assert_allclose(at(motion_of(REFERENCES["article"]), 0.0), expected, rtol=1e-14)


def test_the_article_later() -> None:
    t = 10.0
    a, b = 0.2 * math.cos(7.0), 0.2 * math.cos(4.8)
    np.testing.assert_allclose(at(motion_of(REFERENCES["article"]), t)[0], [a + b, b - a], rtol=1e-13)


def test_sines_by_hand() -> None:
    motion = motion_of(REFERENCES["sines"], amplitude=[0.2, 0.1], frequency=0.5, phase=[0.0, math.pi / 2], offset=1.0)
    w = math.pi
    np.testing.assert_allclose(at(motion, 0.0), [[1.0, 1.1], [0.2 * w, 0.0], [0.0, -0.1 * w * w]], atol=1e-15)
    np.testing.assert_allclose(at(motion, 1.0)[0], [1.0, 0.9], atol=1e-15)


def test_chirp_has_its_frequencies_at_both_ends_and_then_the_last() -> None:
    motion = motion_of(REFERENCES["chirp"], amplitude=0.1, start_frequency=0.5, end_frequency=1.0, duration=4.0)
    # Three periods: the mean frequency times the duration.
    for t, frequency in ((0.0, 0.5), (4.0, 1.0), (5.0, 1.0)):
        expected = [0.0, 0.1 * 2.0 * math.pi * frequency]
        np.testing.assert_allclose(at(motion, t)[:2], np.transpose([expected, expected]), atol=1e-14)


def test_pick_and_place_goes_forth_and_back_with_rests() -> None:
    motion = motion_of(REFERENCES["pick_and_place"], **{"from": 1.0, "to": [2.0, -1.0], "duration": 2.0, "rest": 0.5})
    for t, place in ((0.0, [1.0, 1.0]), (1.0, [1.5, 0.0]), (2.2, [2.0, -1.0]), (3.5, [1.5, 0.0]), (4.7, [1.0, 1.0])):
        np.testing.assert_allclose(at(motion, t)[0], place, atol=1e-14)
    forth, back = at(motion, 0.5), at(motion, 3.0)
    np.testing.assert_allclose(forth[1], -back[1], atol=1e-14)


def test_minimum_jerk_goes_from_point_to_point_and_holds() -> None:
    motion = motion_of(REFERENCES["minimum_jerk"], **{"from": [0.0, 1.0], "to": [1.0, -1.0], "duration": 2.0})
    for t, position in (
        (-1.0, [0.0, 1.0]),
        (0.0, [0.0, 1.0]),
        (1.0, [0.5, 0.0]),
        (2.0, [1.0, -1.0]),
        (9.0, [1.0, -1.0]),
    ):
        np.testing.assert_allclose(at(motion, t)[0], position, atol=1e-14)
    assert not at(motion, 2.0)[1:].any()
    # The peak velocity is 15/8 distances per duration.
    np.testing.assert_allclose(at(motion, 1.0)[1], [15 / 16, -15 / 8], rtol=1e-13)


def test_any_number_of_joints() -> None:
    given = {"reference.name": "sines", "joints": ["a", "b", "c"], "reference.amplitude": [1.0, 2.0, 3.0]}
    assert reference_joints(given) == 3
    motion = ReferenceMotion(resolve(reference_schema, given, 3))
    np.testing.assert_allclose(at(motion, 1.25)[0], [1.0, 2.0, 3.0])


@pytest.mark.parametrize("kinds", [1, 2, 3])
def test_a_file_is_interpolated_with_all_that_it_holds(tmp_path: Path, kinds: int) -> None:
    times = np.arange(0.0, 2.01, 0.1)
    functions: list[Callable[[float], float]] = [np.sin, np.cos, lambda t: -np.sin(t)]
    functions = functions[:kinds]
    header: list[object] = ["time", *(f"{k}_joint{j}" for k in ("q", "dq", "ddq")[:kinds] for j in (1, 2))]
    rows: list[list[object]] = [[t, *(factor * f(t) for f in functions for factor in (1.0, 2.0))] for t in times]
    file = tmp_path / "sine.csv"
    file.write_text("\n".join(", ".join(map(str, row)) for row in [header, *rows]))
    motion = motion_of(REFERENCES["csv"], file=str(file))
    tolerance = {1: 2e-5, 2: 3e-7, 3: 1e-9}[kinds]
    for t in (0.05, 0.77, 1.95):
        np.testing.assert_allclose(at(motion, t)[0], [math.sin(t), 2.0 * math.sin(t)], atol=tolerance)
    np.testing.assert_allclose(
        at(motion, 7.0), [[math.sin(2.0), 2.0 * math.sin(2.0)], [0.0, 0.0], [0.0, 0.0]], atol=1e-13
    )


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "line 1: the columns are none; wanted are time, q_joint1, q_joint2"),
        ("time,q_joint1\n", "line 1: the columns are time, q_joint1; wanted"),
        ("time,q_joint1,q_joint2,dq_joint1\n", "line 1: the columns are"),
        ("time,q_joint1,q_joint2\n0,1,2\n", "at least two lines"),
        ("time,q_joint1,q_joint2\n0,1,2\n1,2\n", "line 3: 2 values for 3 columns"),
        ("time,q_joint1,q_joint2\n0,1,2\n1,x,2\n", "line 3: not all of 1, x, 2 are numbers"),
        ("time,q_joint1,q_joint2\n0,1,2\n1,inf,2\n", "line 3: not all of 1, inf, 2 are finite"),
        ("time,q_joint1,q_joint2\n0,1,2\n0,1,2\n", "line 3: time must increase"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_with_its_line(tmp_path: Path, text: str, reason: str) -> None:
    file = tmp_path / "bad.csv"
    file.write_text(text)
    with pytest.raises(ParameterError) as refused:
        motion_of(REFERENCES["csv"], file=str(file))
    assert str(refused.value).startswith(f"reference.file: {file}")
    assert reason in str(refused.value)


@pytest.mark.parametrize(
    "content",
    [
        b"\xef\xbb\xbftime,q_joint1,q_joint2\r\n0,0,0\r\n1.5,0.5,1\r\n",
        b'\xef\xbb\xbf"time","q_joint1","q_joint2"\r\n"0","0","0"\r\n"1.5","0.5","1"\r\n',
        b"\xef\xbb\xbftime;q_joint1;q_joint2\r\n0;0;0\r\n1,5;0,5;1\r\n",
        b"sep=;\r\ntime;q_joint1;q_joint2\r\n0;0;0\r\n1.5;0.5;1\r\n",
        b"time\tq_joint1\tq_joint2\n0\t0\t0\n1.5\t0.5\t1\n",
        b"time,q_joint1,q_joint2\n0,0,0\n,,\n1.5,0.5,1\n\n,,\n",
    ],
    ids=["mark", "quotes", "decimal comma", "sep", "tab", "empty lines"],
)
def test_a_file_of_a_spreadsheet_is_read(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "motion.csv"
    file.write_bytes(content)
    motion = motion_of(REFERENCES["csv"], file=str(file))
    np.testing.assert_allclose(at(motion, 1.5)[0], [0.5, 1.0])


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("time,q_joint1,q_joint2\n0,0,0\n1,0,0\n".encode("utf-16"), "is not UTF-8 text; save it as CSV UTF-8"),
        (b"sep=;\ntime;q_joint1;q_joint2\n0;0;0\n1;x;0\n", "line 4: not all of 1, x, 0 are numbers"),
        (b"time,q_joint1,q_joint2\n0,0,0\n1,5,0,5,0\n", "line 3: 5 values for 3 columns"),
    ],
)
def test_another_file_of_a_spreadsheet_is_refused_with_its_line(tmp_path: Path, content: bytes, reason: str) -> None:
    file = tmp_path / "motion.csv"
    file.write_bytes(content)
    with pytest.raises(ParameterError, match=reason):
        motion_of(REFERENCES["csv"], file=str(file))


@pytest.mark.parametrize(
    ("file", "reason"), [("/dev/zero", "is not a file"), ("", "name a file"), ("nowhere.csv", "No such file")]
)
def test_a_file_that_is_not_there_is_refused(file: str, reason: str) -> None:
    with pytest.raises(ParameterError, match=reason):
        motion_of(REFERENCES["csv"], file=file)


@pytest.mark.parametrize("name", ["minimum_jerk", "pick_and_place"])
def test_the_shortest_move_is_finite_and_a_shorter_one_refused(name: str) -> None:
    motion, desired = motion_of(REFERENCES[name], duration=SHORTEST), np.zeros((3, 2))
    for t in (0.0, 0.3e-6, 0.5, 1e9):
        motion.evaluate(t, desired)
        assert np.isfinite(desired).all()
    with pytest.raises(ParameterError, match=r"reference\.duration"):
        motion_of(REFERENCES[name], duration=1e-300)
