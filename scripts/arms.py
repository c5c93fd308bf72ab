"""Generates docs/arms.md: how well each arm that comes with the project tracks, by rollouts.

./pidtsm shell -c "python scripts/arms.py"
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pidtsm_core.experiment import PRACTICAL, make_experiment
from pidtsm_core.laws import LAWS
from pidtsm_core.robots import find_robot
from pidtsm_core.robots.source import ARMS, rated_payload
from pidtsm_core.rollouts.closed_loop import rollout

PAGE = Path(__file__).resolve().parents[1] / "docs" / "arms.md"

PICK_UP = 5.0
"""Time at which the payload is picked up, s."""
SHARE = 0.4
"""Its mass, as a share of the rated payload."""
SENSORS = ("simulator.encoder.bits=14", "simulator.delay.samples=1")
REAL = (*SENSORS, "simulator.model_error.mass=0.2", "simulator.model_error.inertia=0.2")
"""Real hardware, besides the friction of the description."""
IDEAL = tuple(
    f"{node}={0.0}"
    for node in (
        "simulator.friction.coulomb",
        "simulator.friction.viscous",
        "controller.compensation.coulomb",
        "controller.compensation.viscous",
    )
)
_HEAD = """# The arms

`scripts/arms.py` generates this page. Every joint swings about its middle for 10 s
([default motion](own-robot.md#an-arm-with-a-urdf)), controlled by `piddtsm` with `--params practical`, at 1 kHz, in
rollouts.

* *ideal*: perfect sensors and drives, no friction, an exact model.
* *real*: 14-bit encoders, 1 ms of delay, the friction of the description, masses and inertias 20 % larger than
  modelled.
* *payload*: the same; at 5 s the arm picks up 40 % of its rated payload, which the controller does not know.

The errors are the largest of all joints: from 4 s on, or for the payload from 2 s after the pick-up on. The torque
variation is the mean change of the torque from sample to sample, of the joint with the largest one. The last column is
the largest torque as a share of its limit.

| arm | joints | condition | error (mrad or mm) | effort variation (N m) | torque / limit |
| --- | --- | --- | --- | --- | --- |
"""


_LAWS = """
## Every law

`--params practical` has gains for every law, by the same rule from inertias and sensors; `./pidtsm gains --law NAME`
shows them with their reasons. Largest error from 4 s on in the same motion (mrad or mm), with 14-bit encoders, 1 ms of
delay and the friction of the description:

"""


def judge(arm: str, overrides: tuple[str, ...], since: float, law: str | None = None) -> tuple[float, float, float]:
    """Largest error (rad or m) and effort variation (N m or N) from `since` (s) on; largest torque / limit."""
    experiment = make_experiment(None, law, params=[PRACTICAL], overrides=overrides, robot=arm)
    run = rollout(experiment)
    late = run.time >= since
    error = np.abs(run.position - run.reference[:, 0])[late].max()
    variation = np.abs(np.diff(run.effort[late], axis=0)).mean(axis=0).max()
    limits = np.array(find_robot({"robot.description": arm}).effort_limit)
    return float(error), float(variation), float((np.abs(run.effort) / limits).max())


def conditions(arm: str) -> dict[str, tuple[tuple[str, ...], float]]:
    """By condition: overrides, and the time from which on the error counts (s)."""
    payload = (f"simulator.payload.mass={SHARE * rated_payload(arm)}", f"simulator.payload.time={PICK_UP}")
    return {"ideal": (IDEAL, 4.0), "real": (REAL, 4.0), "payload": ((*REAL, *payload), PICK_UP + 2.0)}


def page() -> str:
    """Content of the page."""
    parts = [_HEAD]
    for arm in ARMS:
        joints = len(find_robot({"robot.description": arm}).joints)
        for condition, (overrides, since) in conditions(arm).items():
            error, variation, share = judge(arm, overrides, since)
            parts.append(f"| {arm} | {joints} | {condition} | {1e3 * error:.2f} | {variation:.3f} | {share:.2f} |\n")
    return "".join((*parts, *laws()))


def laws() -> Iterator[str]:
    """The section about every law."""
    yield _LAWS
    yield f"| law | {' | '.join(ARMS)} |\n|{' --- |' * (1 + len(ARMS))}\n"
    for law in LAWS.names:
        errors = (1e3 * judge(arm, SENSORS, 4.0, law)[0] for arm in ARMS)
        yield f"| `{law}` | {' | '.join(f'{error:.2f}' for error in errors)} |\n"
    yield "\nThe errors of `pid` are friction, which it does not know; the other laws compensate that of the model.\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
