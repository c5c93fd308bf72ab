"""Generates docs/hardware.md: the classes of hardware, and how well each arm tracks on each of them, by rollouts.

./pidtsm shell -c "python scripts/hardware.py"
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pidtsm_core.experiment import make_experiment
from pidtsm_core.experiment.hardware_classes import hardware_content, hardware_names
from pidtsm_core.recording.outcome import FOLLOWED
from pidtsm_core.robots.source import ARMS
from pidtsm_core.rollouts.closed_loop import DivergedError, rollout

PAGE = Path(__file__).resolve().parents[1] / "docs" / "hardware.md"
SETS = ("practical", "tuned_14bit")
SINCE = 4.0
"""s; from here on errors count."""

_HEAD = """# Hardware

`scripts/hardware.py` generates this page. `--hardware NAME` gives a simulated arm the sensors, drives and gears of a
kind of arm, in `run`, `rollout`, `score`, `tune` and `live`:

```bash
./pidtsm rollout --robot ur5 --params practical --hardware direct_drive
./pidtsm rollout --robot panda --params practical --hardware collaborative --set simulator.friction.static=0.0
```

`--set` overrides single parameters.

## Gains

Unless `--params` names another set, the gains are those of the [rule](tuning.md) for the class, which is also what
`--params practical` means with `--hardware`; `./pidtsm gains --hardware NAME` shows them:

* The observer of each joint is as fast as the loop allows, by the eigenvalues of the sampled linear loop with elastic
  joints, lag and delay (`pidtsm_core/experiment/loop_margin.py`): it must stay stable with half as much gain again, and
  with one more sample of delay.
* **Where joints are elastic, the observer knows the springs** (`estimator.name: elastic_joint_observer`), of all laws
  that reject disturbances. Stiffness and rotors may be 20 and 15 % wrong. Without, links mostly err by two to six times
  as much ([why](decisions/2026-11-27-the-observer-knows-the-springs.md)). A [commissioning](commissioning.md)
  finds the stiffness of a real arm. It cannot learn lateness.
* Steps of the encoder and delay bound it as for [any arm](own-robot.md).
* 1.3 times the Coulomb friction of half-warm gears is compensated (`compensation.coulomb`), since joints stick. Load,
  asymmetry and temperature are unknown to the controller. Law `pid` compensates nothing.
* **Joints that stick are pressed by their error** (`compensation.error_gain`): what lags gets more of the compensated
  friction, what leads less. Errors at reversals halve
  ([why](decisions/2026-11-29-joints-that-stick-are-pressed-by-their-error.md)).
* **Joints leave rest with what was found in motion** (`compensation.breakaway`). At rest, static friction lets the
  effort wind up; when the reference set off, geared links fell 30 to 80 mrad behind, now 7 to 17
  ([why](decisions/2026-11-28-joints-leave-rest-as-they-moved.md)).

## How an arm moves on such hardware

* **Elastic joints** (`elasticity.*`). Each motor moves its link through a spring with a damper (M. W. Spong, 1987).
  Friction and brakes act on the motor; pushes, contact, payload and disturbances act on the link. `~/ground_truth`,
  metrics and tables are those of the link; the encoders measure the motors, unless `elasticity.encoder` is `link`. At
  the start the springs carry the arm. A joint needs a rotor (`robot.armature`), or it is refused. Joints that slide
  stay rigid in the classes.
* **Friction** (`friction.*`). With `friction.bristle_stiffness`, a joint sticks until its static friction is exceeded
  (elasto-plastic, P. Dupont et al., IEEE Trans. Automat. Contr. 47, 2002), and does not creep. Friction grows with the
  transmitted torque (`load`), differs between the directions (`asymmetry`), and falls as the gears warm up (`cold`,
  `warm_up`; load and temperature: A. C. Bittencourt and S. Gunnarsson, J. Dyn. Sys. Meas. Control 134, 2012). `cogging`
  depends on the position of the motor.
* **Drives** (`actuator.*`, `effort_sensor.*`). A second-order current loop (`frequency`, `damping`), commands in steps
  (`resolution`) that the drives take at a rate of their own (`rate`), and a reported effort with offset and noise,
  measured at motor or link.

Both [engines](engines.md) have all of it. On MuJoCo a motor is a body of its own, which a tendon couples to its link.

"""
_CLASSES = """## Classes

Parameters of the simulator; those *per N m* (N of a joint that slides) are multiplied by the effort limit of each
joint. The files in `pidtsm_core/experiment/hardware/` have the source of each figure; *assumed* ones have none.

"""
_TRACKING = """## How well the arms track

Every joint swings about its middle for 10 s ([default motion](own-robot.md#an-arm-with-a-urdf)), controlled by
`piddtsm` with the sets of `--params`, in rollouts. Largest error of all joints from 4 s on, **on the link side**, in
mrad or mm. *unstable*: an error of more than 100 mrad or mm, or the controller stopped. `./pidtsm tune --hardware NAME`
searches gains for a class.

"""


def error(arm: str, hardware: str, params: str) -> str:
    """Largest error of a link from `SINCE` on, mrad or mm, as text."""
    experiment = make_experiment(None, params=[params], robot=arm, hardware=hardware)
    try:
        run = rollout(experiment)
    except DivergedError:
        return "unstable"
    if run.metrics()["outcome"] != FOLLOWED:
        return "unstable"
    largest = 1e3 * float(np.abs(run.error)[run.time >= SINCE].max())
    return "unstable" if largest > 100.0 else f"{largest:.2f}"


def classes() -> Iterator[str]:
    """The section about the figures of the classes."""
    yield _CLASSES
    contents: Mapping[str, Mapping[str, Any]] = {name: hardware_content(name) for name in hardware_names()}
    for name, content in contents.items():
        yield f"* `{name}`: {content['description']}\n"
    yield f"\n| parameter | {' | '.join(contents)} |\n|{' --- |' * (1 + len(contents))}\n"
    for group, suffix in (("simulator", ""), ("relative", ", per N m")):
        for parameter in dict.fromkeys(each for content in contents.values() for each in content[group]):
            figures = (str(content[group].get(parameter, "")) for content in contents.values())
            yield f"| `{parameter}`{suffix} | {' | '.join(figures)} |\n"
    yield "\n"


def page() -> str:
    """Content of the page."""
    names = hardware_names()
    parts = [_HEAD, *classes(), _TRACKING, f"| arm | params | {' | '.join(names)} |\n|{' --- |' * (2 + len(names))}\n"]
    for arm in ARMS:
        for params in SETS:
            errors = " | ".join(error(arm, hardware, params) for hardware in names)
            parts.append(f"| {arm} | {params} | {errors} |\n")
    return "".join(parts)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
