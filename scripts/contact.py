"""Generates docs/contact.md and its figures: what contact does to a controller, by rollouts on MuJoCo.

./pidtsm shell -c "python scripts/contact.py"
"""

import math
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from pidtsm_core.experiment import ADAPTIVE, PRACTICAL, Experiment, make_experiment
from pidtsm_core.recording import Recording
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Fault, Status
from pidtsm_studies.reports.figures import STYLE, finished, line, panels

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE = DOCS / "contact.md"

START = (0.0, 0.3, 0.0, -2.0, 0.0, 2.3, 0.8)
SWING = 0.083
"""Amplitude of the first joint, rad: the tool, 0.6 m from its axis, moves 0.1 m to the side and back."""
PERIOD = 8.0
"""s; the reference is beyond the wall from a quarter to three quarters of it, by at most 5 cm."""
WALL = '<mujoco><worldbody><geom type="box" size="0.5 0.05 1" pos="0.6 0.16 0.5"/></worldbody></mujoco>'
"""A wall 5 cm beside the last link."""
NO_WALL = "<mujoco/>"
LEFT = 0.75 * PERIOD
"""Time at which the reference has left the wall, s."""
LOW = (6.0, 36.0, 6.0, 24.0, 3.0, 4.0, 1.0)
"""Effort limits a little above what the motion needs, N m."""
STOP = 0.05
"""Tracking limit, rad."""
PUSH, PUSHED_AT, PUSHED_FOR = 30.0, 4.0, 0.5  # N, s, s
LAWS = ("piddtsm", "pidnftsm", "dtsm", "pid", "computed_torque", "super_twisting")
CONTENDERS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    **{law: (law, ()) for law in LAWS},
    "piddtsm, practical": ("piddtsm", (PRACTICAL,)),
    "piddtsm, adaptive": ("piddtsm", (ADAPTIVE,)),
}
"""By name: law and parameter sets."""
LIMITS: Mapping[str, Mapping[str, Any]] = {
    "of the arm": {},
    "low": {"limits.effort": LOW},
    "of the arm, tracking limit": {"limits.tracking_error": STOP},
}
CARELESS = {"limits.external_effort": 0.0}
"""By name: parameters of the controller; the effort limits are also those of the arm."""

_HEAD = f"""# Contact

`scripts/contact.py` generates this page, from rollouts of the Panda on [MuJoCo](engines.md) with perfect sensors. The
laws have their default gains, which are those of the two-link arm; *practical* and *adaptive* have those of `--params`.

## Into a wall

The first joint swings, and the reference leads the tool up to 5 cm into a wall for {PERIOD / 2:g} s. The effort limits
are those of the arm, or *low*, a little above what the motion needs:
{", ".join(f"{limit:g}" for limit in LOW)} N m.

* *torque / limit*: the largest one of all joints.
* *gain*: the largest adaptive gain of all joints.
* *error*: the largest one of all joints in contact, from 1 s after the reference has left the wall on, and in the
  same time without a wall.

| controller | effort limits | torque / limit | gain | error in contact (mrad) | 1 s after (mrad) | no wall (mrad) |
| --- | --- | --- | --- | --- | --- | --- |
"""
_BETWEEN = f"""
![First joint, its torque and its adaptive gain](images/contact.png)

No torque exceeds its limit. The controller recognises contact by the effort that acts on the arm from outside: what the
estimated motion needs by the model, less the applied effort. The arm is taken to be in contact while this effort has
changed by more than `limits.external_effort` since the arm was last within 10 mrad of its reference. (After a joint has
reversed, the same effort with the other sign is no change, because that is what friction does.) Meanwhile, all
integrals and the adaptation pause, and the disturbance that the law rejects may only decrease (with
`law.anti_windup: conditional`, the default). Afterwards `piddtsm` returns to its reference, with the gains of Table 1
and with `practical`. Without it (`limits.external_effort: 0`), see the last rows, its gain runs away.

The other laws need longer with these gains, also without windup: `super_twisting` unlearns by at most `integral_gain`
per second, `dtsm` returns from any error slowly, and `pidnftsm` has its singularity. A lower `limits.external_effort`
helps them. `pid` has no model, and so does not recognise contact.

The default of `limits.external_effort` is a quarter of `limits.effort`. Errors of the model and payloads act from
outside too, but the law has learnt them while the arm tracks, and most of them are smaller: on all arms of the project,
neither an unknown payload of 40 % of the rated one nor a model 60 % off is taken for contact. An unknown payload that
is larger and is picked up suddenly may be: then a tracking error remains, and the controller reports
`a joint is beyond limits.external_effort`. Set the payload (`payload.mass`), or raise the limit. With
`limits.external_effort_action: stop`, contact is a fault, and the arm holds where it was touched.

With a tracking limit (`limits.tracking_error`) of {1e3 * STOP:g} mrad every controller stops in the wall with the fault
`TRACKING_LIMIT`, and holds the arm there.

## A push

A push of {PUSH:g} N on the tool to the side, for {PUSHED_FOR:g} s, in the
[default motion](own-robot.md#an-arm-with-a-urdf). *Error* is the largest one of all joints; *recovery* is the time from
the end of the push until all errors stay below 10 mrad. Both engines give these figures.

| controller | error (mrad) | recovery (s) |
| --- | --- | --- |
"""


@dataclass(frozen=True)
class Press:
    """What a controller does in the wall.

    Attributes:
        torque: largest torque / limit.
        gain: largest adaptive gain.
        within: largest error in contact, rad.
        after: largest error from 1 s after the reference has left the wall on, rad.
        fault: name of the fault; empty if there was none.
    """

    torque: float
    gain: float
    within: float
    after: float
    fault: str


def press(contender: str, limits: str, wall: bool = True, careful: bool = True) -> Recording:
    """The run of a contender into the wall, or where it would be; `careful`: contact is recognised."""
    law, params = CONTENDERS[contender]
    swing = [SWING, *[0.0] * 6]
    settings: dict[str, dict[str, Any]] = {
        "simulator": {"engine": "mujoco", "initial_position": START},
        "controller": {**LIMITS[limits], **({} if careful else CARELESS)},
        "trajectory": {
            "reference.name": "sines",
            "reference.amplitude": swing,
            "reference.offset": np.add(START, swing).tolist(),
            "reference.frequency": 1.0 / PERIOD,
            "reference.phase": -0.5 * math.pi,
        },
    }
    if "limits.effort" in LIMITS[limits]:
        settings["simulator"]["limits.effort"] = LIMITS[limits]["limits.effort"]
    with tempfile.NamedTemporaryFile("w", suffix=".xml") as scene:
        scene.write(WALL if wall else NO_WALL)
        scene.flush()
        settings["simulator"]["scene"] = scene.name
        experiment = Experiment("wall", "", 1.25 * PERIOD, settings)
        return rollout(make_experiment(experiment, law, params=params, robot="panda"))


def judge(run: Recording, limits: str) -> Press:
    """The figures of such a run."""
    error, time = np.abs(run.error).max(axis=1), run.time
    bound = np.array(LIMITS[limits].get("limits.effort", (87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0)))
    fault = int(run.status[:, Status.FAULT].max())
    return Press(
        float((np.abs(run.effort) / bound).max()),
        float(run.adaptive_gain.max()),
        float(error[(time > 0.25 * PERIOD) & (time < LEFT)].max()),
        float(error[time >= LEFT + 1.0].max()),
        Fault(fault).name if fault else "",
    )


def row(contender: str, limits: str, careful: bool = True) -> str:
    """Row of the table."""
    each = judge(press(contender, limits, careful=careful), limits)
    free = judge(press(contender, limits, wall=False), limits)
    after, without = (f"stopped: `{p.fault}`" if p.fault else f"{1e3 * p.after:.1f}" for p in (each, free))
    cells = (f"{each.torque:.2f}", f"{each.gain:.3g}", f"{1e3 * each.within:.0f}", after, without)
    shown = limits if careful else f"{limits}, `limits.external_effort: 0`"
    return f"| {contender} | {shown} | {' | '.join(cells)} |\n"


def push(contender: str, engine: str = "mujoco") -> tuple[float, float | None]:
    """Largest error (rad), and recovery (s) after the end of the push; None: not until the end of the run."""
    law, params = CONTENDERS[contender]
    pushed = {"push.force": [0.0, PUSH, 0.0], "push.time": PUSHED_AT, "push.duration": PUSHED_FOR, "engine": engine}
    run = rollout(None, law, params, "panda", duration=8.0, simulator=pushed)
    error = np.abs(run.error).max(axis=1)[run.time >= PUSHED_AT]
    later = np.flatnonzero(error[round(PUSHED_FOR * 1e3) :] >= 0.01)
    recovery = (later[-1] + 1) * 1e-3 if later.size else 0.0
    return float(error.max()), recovery if PUSHED_AT + PUSHED_FOR + recovery < 7.99 else None


def draw(runs: Mapping[str, Recording]) -> Figure:
    """The first joint, its torque and its adaptive gain, of runs into the wall."""
    first = next(iter(runs.values()))
    figure, table = panels(3)
    position, effort, gain = table[:, 0]
    for style, (name, run) in enumerate(runs.items()):
        line(position, run.time, 1e3 * run.position[:, 0], style, name)
        line(effort, run.time, run.effort[:, 0], style, name)
        line(gain, run.time, run.adaptive_gain[:, 0], style, name)
    line(position, first.time, 1e3 * first.desired[:, 0], len(runs), "reference")
    position.set_ylabel("$q_1$ (mrad)")
    effort.set_ylabel(r"$\tau_1$ (N m)")
    gain.set_ylabel("$Y_1$")
    return finished(figure, table, first, " ")


def page() -> str:
    """Content of the page."""
    parts = [_HEAD]
    for contender in CONTENDERS:
        for limits in LIMITS:
            parts.append(row(contender, limits))
    for contender in ("piddtsm", "piddtsm, practical"):
        parts.append(row(contender, "of the arm", careful=False))
    parts.append(_BETWEEN)
    for contender in CONTENDERS:
        error, recovery = push(contender)
        parts.append(f"| {contender} | {1e3 * error:.0f} | {'> 3.5' if recovery is None else f'{recovery:.2f}'} |\n")
    return "".join(parts)


def main() -> None:
    """Write the page and its figure."""
    runs = {
        "piddtsm": press("piddtsm", "of the arm"),
        "the same, external_effort: 0": press("piddtsm", "of the arm", careful=False),
        "computed_torque": press("computed_torque", "of the arm"),
    }
    with matplotlib.rc_context(STYLE):
        figure = draw(runs)
        figure.savefig(DOCS / "images" / "contact.png", metadata={"Software": None})
    PAGE.write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
