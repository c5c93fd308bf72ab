"""Identification of arms whose truth is known: intervals, errors on unseen motion, consistency, payload, time.

    ./pidtsm shell -c "python benchmarks/identification.py --seeds 200 --out identification.json"
    ./pidtsm shell -c "python benchmarks/identification.py --robot panda --seeds 2 --nodes"

Each seed is another arm: its description is up to 30 % wrong, its friction and rotors are unknown. It moves on the
exciting motion with the practical set of the controller, which knows the wrong description only, with encoders of 14
bits, 1 ms of delay and noise of the torque. Even seeds are simulated by our engine, odd ones by MuJoCo. With --nodes,
the motion is not a rollout, but runs over real nodes in lockstep, and what is identified is the bag of the recorder.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.experiment import Experiment, make_experiment
from pidtsm_core.identification.carriers import carriers
from pidtsm_core.identification.corrected_urdf import corrected_urdf
from pidtsm_core.identification.excitation import excitation
from pidtsm_core.identification.identification import Identification, IdentificationError, identify
from pidtsm_core.identification.least_squares import motion_regressor
from pidtsm_core.identification.measurement import Measurement, filtered
from pidtsm_core.identification.payload import identify_payload
from pidtsm_core.identification.pseudo_inertia import is_consistent
from pidtsm_core.identification.regressor import described_parameters
from pidtsm_core.references.polynomials import add_quintic, quintic
from pidtsm_core.robots import Description, find_description
from pidtsm_core.robots.description import read_description
from pidtsm_core.robots.tree.layout import steiner
from pidtsm_core.robots.tree.unit_forces import LINK
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.trajectories.limits import motion_limits
from pidtsm_experiments.bags.measurements import read_measurement
from pidtsm_experiments.runs.runner import run
from pidtsm_studies.score.tasks import find_task

ROBOTS = ("two_link", "ur5", "panda")
EXCITED, CHANGE, UNSEEN = 50.0, 2.0, 13.0
"""s: exciting motion, way to the other motion, and that motion; the last fifth is kept apart by `identify`."""
CARRYING = 10.0
"""s for which the arm moves with a payload."""
SHOWN = 0.02
"""m; half an interval of a coordinate that the motion shows."""
NOISE = 0.005
"""Standard deviation of the torque's noise, as a share of the effort limit."""
WRONG = 0.3
BITS = 14
Measure = Callable[[Experiment, Array, int], Measurement]
"""What is measured of an experiment, of the efforts' limits (N m, shape (joints,)) and of a seed."""


@cache
def motions(robot: str) -> tuple[Array, Array]:
    """Time, and q, q', q'' of the exciting motion followed by one with other frequencies and phases."""
    arm = find_description({"robot.description": robot})
    excited = excitation(arm, motion_limits({"robot.description": robot}), EXCITED)
    step = excited.time[1] - excited.time[0]
    random = np.random.default_rng(1)
    size = 0.5 * np.ptp(excited.motion[0], axis=0)
    middle = 0.5 * (excited.motion[0].max(axis=0) + excited.motion[0].min(axis=0))
    rates = 2.0 * np.pi * random.uniform(0.1, 0.35, (3, 1, len(arm.joints)))
    phases = random.uniform(0.0, 2.0 * np.pi, rates.shape)
    angle = rates * np.arange(0.0, UNSEEN, step)[:, np.newaxis] + phases
    parts = np.stack([np.sin(angle), rates * np.cos(angle), -(rates**2) * np.sin(angle)])
    other = 0.25 * size * parts.sum(axis=1)
    other[0] += middle
    way = np.zeros((6, len(arm.joints)))
    quintic(np.ascontiguousarray(excited.motion[:, -1]), np.ascontiguousarray(other[:, 0]), CHANGE, way)
    between = np.zeros((round(CHANGE / step) - 1, 3, len(arm.joints)))
    for k, state in enumerate(between):
        add_quintic(way, CHANGE, (k + 1) * step, state)
    whole = np.concatenate([excited.motion, between.swapaxes(0, 1), other], axis=1)
    return step * np.arange(whole.shape[1]), whole


def wrong_links(arm: Description, random: np.random.Generator) -> Array:
    """Parameters of the links, up to 30 % off in mass, inertia and centre of mass, as long as bodies can have them."""
    links = described_parameters(arm.tree, arm.damping, arm.friction)[: LINK * len(arm.joints)].reshape(-1, LINK)
    for link, body in zip(links, carriers(arm)[1], strict=True):
        mass, moment, inertia = body[0], body[1:4], _matrix(body)
        about = inertia - mass * steiner(moment / mass)
        factor, center = 1.0 + random.uniform(-WRONG, WRONG), moment / mass * (1.0 + random.uniform(-WRONG, WRONG, 3))
        heavier = mass * (1.0 + random.uniform(-WRONG, WRONG))
        changed = factor * about + heavier * steiner(center)
        link[:] += _vector(heavier, heavier * center, changed) - body
    return links.ravel()


def _matrix(body: Array) -> Array:
    xx, yy, zz, xy, xz, yz = body[4:]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _vector(mass: float, moment: Array, inertia: Array) -> Array:
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = inertia
    return np.array([mass, *moment, xx, yy, zz, xy, xz, yz])


def arms(robot: str, seed: int) -> tuple[Description, Array, Description]:
    """The true arm with its parameters pi, and its wrong description."""
    named, random = find_description({"robot.description": robot}), np.random.default_rng(seed)
    joints, limit = len(named.joints), np.minimum(named.effort, 100.0)
    truth = described_parameters(named.tree, named.damping, named.friction)
    rotors = 5.0 if robot == "two_link" else 0.1 + 0.002 * limit
    described = truth.copy()
    described[: LINK * joints] = wrong_links(named, random)
    described[LINK * joints : (LINK + 1) * joints] = rotors
    truth[LINK * joints :] = np.concatenate(
        [share * random.uniform(0.5, 1.5, joints) for share in (rotors, 0.03 * limit, 0.05 * limit, 0.0 * limit)]
    )
    described[(LINK + 1) * joints :] = 0.0
    return read_description(corrected_urdf(named, truth)), truth, read_description(corrected_urdf(named, described))


def closed_loop(
    folder: Path,
    descriptions: tuple[Description, Description],
    times: Array,
    motion: Array,
    seed: int,
    carried: Mapping[str, Any] | None = None,
) -> Experiment:
    """The closed loop: a true arm, which may carry something, and a controller that knows another description."""
    true, known = descriptions
    file, joints = folder / "motion.csv", list(true.joints)
    header = ",".join(["time", *(f"{kind}_{joint}" for kind in ("q", "dq", "ddq") for joint in joints)])
    np.savetxt(file, np.column_stack([times, *motion]), delimiter=",", header=header, comments="")
    simulator = {
        "robot.description": true.text,
        "engine": ("rigid_body", "mujoco")[seed % 2],
        "initial_position": motion[0, 0].tolist(),
        "encoder.bits": BITS,
        "delay.samples": 1,
        "seed": seed,
        **(carried or {}),
    }
    trajectory = {"joints": joints, "reference.name": "csv", "reference.file": str(file)}
    controller = {"robot.description": known.text, "limits.velocity_action": "warn"}
    settings = {"simulator": simulator, "controller": controller, "trajectory": trajectory}
    return make_experiment(Experiment("excitation", "piddtsm", float(times[-1]), settings), params="practical")


def measurement(experiment: Experiment, limit: Array, seed: int) -> Measurement:
    """What joint states contain: the torque of the last period with noise, and what the encoder reads."""
    recording, step = rollout(experiment), 2.0 * np.pi / 2**BITS
    effort = np.vstack([recording.effort[:1], recording.effort[:-1]])
    position = step * np.round(recording.position / step)
    exact = Measurement(recording.joints, recording.time, position, effort, np.full(limit.size, np.inf))
    return with_noise(exact, limit, seed)


def recorded(experiment: Experiment, limit: Array, seed: int) -> Measurement:
    """The joint states in the bag of a run over real nodes in lockstep, with the same noise of the torque."""
    with tempfile.TemporaryDirectory() as folder:
        bag = run(experiment, "lockstep", Path(folder), lambda _time: None)
        return with_noise(read_measurement(bag)[0], limit, seed)


def with_noise(measured: Measurement, limit: Array, seed: int) -> Measurement:
    """The same with noise of the torque."""
    noise = np.random.default_rng(seed).normal(size=measured.effort.shape)
    return replace(measured, effort=measured.effort + NOISE * limit * noise)


def judge(found: Identification, truth: Array, measured: Measurement) -> dict[str, Any]:
    """Intervals, consistency, and errors on unseen motion relative to those of the truth."""
    error = np.abs(found.fit.beta - found.base.mapping @ truth)
    check, joints = found.check, len(measured.joints)
    pieces = filtered(measured.between(0.8, 1.0), found.cutoff, found.fit.delay)
    matrix = np.concatenate([motion_regressor(found.arm.tree, piece.motion) for piece in pieces])
    floor = check.error(matrix @ truth)
    return {
        "covered": (error < found.fit.half_interval).tolist(),
        "consistent": all(is_consistent(each) for each in found.parameters[: LINK * joints].reshape(joints, LINK)),
        "before": (check.error(check.before) / floor).tolist(),
        "after": (check.error(check.after) / floor).tolist(),
        "delay": 1e3 * found.fit.delay,
        "condition": found.fit.condition,
        "warnings": list(found.warnings),
    }


def tracking(folder: Path, true: Description, known: Description, robot: str, seed: int) -> float:
    """Root mean square error of the unseen motion, all joints."""
    times, motion = motions(robot)
    last = times >= EXCITED + CHANGE
    recording = rollout(closed_loop(folder, (true, known), times[last] - times[last][0], motion[:, last], seed))
    return float(np.sqrt(np.mean(recording.error[recording.time > 2.0] ** 2)))


def payload(
    folder: Path, true: Description, known: Description, robot: str, seed: int, measure: Measure = measurement
) -> dict[str, float]:
    """Errors of mass (relative) and centre (m) of a payload, from ten seconds of motion.

    Coordinates of the centre that no motion of the arm shows have wide intervals, and do not count.
    """
    random = np.random.default_rng([seed, 1])
    mass, center = random.uniform(0.2, 0.6) * find_task(robot).payload, random.uniform(-0.05, 0.05, 3)
    times, motion = motions(robot)
    first = times <= CARRYING
    carried = {"payload.mass": mass, "payload.center_of_mass": center.tolist()}
    experiment = closed_loop(folder, (true, known), times[first], motion[:, first], seed, carried)
    found = identify_payload(known, measure(experiment, np.minimum(true.effort, 100.0), seed))
    shown = found.center_interval < SHOWN
    return {
        "mass": abs(found.mass / mass - 1.0),
        "center": float(np.linalg.norm((found.center_of_mass - center)[shown])),
        "coordinates": int(shown.sum()),
    }


def one(folder: Path, robot: str, seed: int, tracks: bool, measure: Measure = measurement) -> dict[str, Any]:
    """One arm."""
    true, truth, known = arms(robot, seed)
    times, motion = motions(robot)
    measured = measure(closed_loop(folder, (true, known), times, motion, seed), np.minimum(true.effort, 100.0), seed)
    start = time.perf_counter()
    try:
        found = identify(known, [measured])
    except IdentificationError as error:
        return {"robot": robot, "seed": seed, "refused": str(error)}
    result = {"robot": robot, "seed": seed, "seconds": time.perf_counter() - start, **judge(found, truth, measured)}
    if tracks:
        better = read_description(corrected_urdf(known, found.parameters))
        errors = [tracking(folder, true, each, robot, seed) for each in (known, better, true)]
        result["tracking"] = [each / errors[-1] for each in errors]
        result["payload"] = payload(folder, true, better, robot, seed, measure)
    return result


def main() -> None:
    """Measure the requested number of arms, and print a line per robot."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--robot", action="append", choices=ROBOTS)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--nodes", action="store_true", help="measure in bags of runs over real nodes")
    options = parser.parse_args()
    measure = recorded if options.nodes else measurement
    results = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(options.first, options.first + options.seeds):
            for robot in options.robot or ROBOTS:
                results.append(one(Path(folder), robot, seed, seed % 20 < 2, measure))
                if options.out:
                    options.out.write_text(json.dumps(results) + "\n", encoding="utf-8")
    for robot in options.robot or ROBOTS:
        refused = sum(each["robot"] == robot and "refused" in each for each in results)
        of_robot = [each for each in results if each["robot"] == robot and "refused" not in each]
        covered = np.mean([np.mean(each["covered"]) for each in of_robot])
        after, before = (np.array([each[name] for each in of_robot]) for name in ("after", "before"))
        print(
            f"{robot}: {len(of_robot)} arms, refused {refused}, "
            f"covered {100.0 * covered:.1f} %, "
            f"consistent {100.0 * np.mean([each['consistent'] for each in of_robot]):.0f} %, "
            f"torque error relative to the truth's {np.sqrt(np.mean(before**2)):.1f} before, "
            f"{np.sqrt(np.mean(after**2)):.3f} after (worst joint {after.max():.2f}), "
            f"{np.median([each['seconds'] for each in of_robot]):.1f} s, "
            f"tracking error {np.round([each['tracking'] for each in of_robot if 'tracking' in each], 3).tolist()}, "
            f"payload {[each['payload'] for each in of_robot if 'payload' in each]}"
        )


if __name__ == "__main__":
    main()
