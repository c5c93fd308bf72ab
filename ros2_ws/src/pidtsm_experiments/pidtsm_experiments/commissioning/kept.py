"""What a session leaves in its folder beside its state: bags, parameters, description and report."""

from collections.abc import Callable, Mapping
from typing import TypeAlias

from pidtsm_core.robots import find_robot
from pidtsm_experiments.bags.commissioning_bag import write_commissioning_bag
from pidtsm_studies.commissioning.loop import Samples
from pidtsm_studies.commissioning.report import write_report
from pidtsm_studies.commissioning.result import write_result
from pidtsm_studies.commissioning.session import Session

BAGS = "bags"
"""Name in the folder of a session."""
Keep: TypeAlias = Callable[[Mapping[str, Samples]], None]


def bag_keeper(session: Session) -> Keep:
    """What keeps the recordings of a step as bags."""
    joints = find_robot(session.subject.arm).joints
    place = session.folder / BAGS

    def keep(samples: Mapping[str, Samples]) -> None:
        place.mkdir(parents=True, exist_ok=True)
        for name, each in samples.items():
            write_commissioning_bag(each, joints, place / name)

    return keep


def no_bags(_samples: Mapping[str, Samples]) -> None:
    """Keep no bags."""


def write_results(session: Session, label: str) -> list[str]:
    """Write parameters, description and report, as far as steps are done; `label`: of the arm.

    Returns:
        The names of the first two, as far as they are complete.
    """
    written = write_result(session)
    if session.found:
        write_report(session, label)
    return written
