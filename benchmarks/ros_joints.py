"""The loop over ROS with seven joints, next to two: round trips and missed deadlines, in turns in the same run."""

from collections.abc import Iterator

from ros_loop import ANSWERERS, Parameters, round_trips

from pidtsm_core.experiment.default_motion import default_motion
from pidtsm_core.robots import find_robot
from pidtsm_experiments.commands.bench import Row

ARM = "panda"


def _parameters() -> Parameters:
    """Parameters of controller and trajectory for the arm; both arms use the same law and estimator."""
    robot = find_robot({"robot.description": ARM})
    motion = {"joints": list(robot.joints), **default_motion(robot)["trajectory"]}
    return {"controller": {"robot.description": ARM}, "trajectory": motion}


TAKES = 150.0  # s


def run(quick: bool) -> Iterator[Row]:
    """Nodes in separate processes."""
    ANSWERERS[ARM] = (*ANSWERERS["law"][:2], _parameters())
    result = round_trips(1.0 if quick else 60.0, names=("law", ARM), robots=("two_link", ARM))
    two, seven = result["law"], result[ARM]
    note = f"{seven['samples']} samples each in turns; {seven['lost']} lost"
    for p in ("p50", "p99"):
        ours, theirs = seven["round_trip_us"][p], two["round_trip_us"][p]
        target = "<= 1.1" if p == "p50" else None
        yield Row(f"round trip, 7 joints, {p}", ours, "us", "2 joints", theirs, ours / theirs, target, note)
    ours, theirs = 100 * seven["missed"], 100 * two["missed"]
    # At most 0.1 %, or 1.2 times the share of the two joints if they miss more.
    ratio, note = ours / max(0.1, 1.2 * theirs), "ratio to the allowed share"
    yield Row("missed deadlines, 7 joints", ours, "%", "2 joints", theirs, ratio, "<= 1", note)
