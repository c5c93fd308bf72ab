"""A rollout computes what the nodes do: bit for bit, for every law, whatever limits, faults or imperfections.

The nodes are real, and talk over DDS, but share this process with a witness of what they publish: many short runs.
"""

import gc
from collections.abc import Iterator
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from pidtsm_controller.controller_node import ControllerNode
from pidtsm_controller.trajectory_node import TrajectoryNode
from pidtsm_core.arrays import Array
from pidtsm_core.control.findings import What
from pidtsm_core.control.parameters import LAW_NAME
from pidtsm_core.experiment import ADAPTS, Experiment, make_experiment
from pidtsm_core.experiment.hardware_classes import hardware_settings
from pidtsm_core.experiment.node_parameters import AUTOSTART
from pidtsm_core.laws import LAWS
from pidtsm_core.parameters.files import ros_parameters
from pidtsm_core.recording import Recording
from pidtsm_core.robots import find_robot
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Fault, Limited, Mode, Signal, Status, Violation
from pidtsm_experiments.runs.domain import own_domain
from pidtsm_experiments.runs.runner import node_parameters
from pidtsm_msgs.msg import ControllerState, JointReference
from pidtsm_ros.cdr import serialized_nanoseconds
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.process import run_nodes
from pidtsm_ros.stop import Stop
from two_link_sim.simulator_node import SimulatorNode

SAMPLES = 600
RUBS = {"friction.coulomb": [2.0, 1.0], "initial_position": [0.396, -0.004]}
"""At the start of the reference, because an arm that is away from it is not softened."""
MS = 1_000_000
JUDGED = {"simulator/ground_truth": JointState, "controller/state": ControllerState, "reference": JointReference}
TOPICS = {**JUDGED, "joint_commands": JointState, "joint_states": JointState}
"""As a run's recorder, whom the nodes wait for."""


class Witness(ManagedNode):
    """Hears what the nodes publish, by stamp in samples, and ends the run when it has heard enough."""

    def __init__(self, stop: Stop, samples: int) -> None:
        super().__init__("witness", lambda settings: (AUTOSTART,), lambda settings: 0, stop)
        self._samples = samples
        self.heard: dict[str, dict[int, bytes]] = {topic: {} for topic in TOPICS}

    @property
    def lockstep(self) -> bool:
        return True

    def configure(self) -> None:
        for topic, kind in TOPICS.items():
            self.listen(kind, topic, partial(self._hear, self.heard[topic]), raw=True, while_inactive=True)

    def _hear(self, heard: dict[int, bytes], data: bytes) -> None:
        heard[serialized_nanoseconds(data) // MS] = data
        self.finished = len(self.heard["simulator/ground_truth"]) >= self._samples


class Unsignalled(Stop):
    """Takes no signals: they stay with the tests."""

    def __init__(self) -> None:
        self.requested = False

    def defer(self) -> None:
        """Nothing is to be put off."""

    def finish(self) -> None:
        """The process goes on."""


@pytest.fixture(scope="module", autouse=True)
def domain() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch, own_domain() as domain:
        patch.setenv("ROS_DOMAIN_ID", str(domain))
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        # What belongs to the nodes of a run is collected when it has ended; the rest stays frozen, see conftest.py.
        patch.setattr(gc, "freeze", lambda: None)
        yield


def over_nodes(settings: dict[str, dict[str, Any]], folder: Path, samples: int = SAMPLES) -> dict[str, dict[int, Any]]:
    """Messages of a run by topic and sample."""
    experiment = Experiment("test", settings["controller"]["law.name"], 0.0, settings)
    words = ["--ros-args"]
    for node, values in node_parameters(experiment, "lockstep").items():
        file = folder / f"{node}.yaml"
        file.write_text(ros_parameters(node, values), encoding="utf-8")
        words += ["--params-file", str(file)]
    witnesses: list[Witness] = []

    def witness(stop: Stop) -> Witness:
        witnesses.append(Witness(stop, samples))
        return witnesses[0]

    assert run_nodes([witness, SimulatorNode, TrajectoryNode, ControllerNode], Unsignalled(), ["test", *words]) == 0
    heard = witnesses[0].heard
    return {
        topic: {k: deserialize_message(data, kind) for k, data in sorted(heard[topic].items()) if k < samples}
        for topic, kind in JUDGED.items()
    }


def table(message: Any, fields: list[str], joints: tuple[str, ...]) -> Array:
    """Fields of a message, shape (fields, joints), with its joints in this order."""
    order = [list(message.name).index(joint) for joint in joints]
    return np.array([getattr(message, field) for field in fields])[:, order]


def assert_same_bits(run: dict[str, dict[int, Any]], simulated: Recording, delay: int = 0) -> None:
    """Where `delay` measurements (samples) are still on their way when the rollout ends, the nodes go on."""
    joints, motion = simulated.joints, ["position", "velocity", "acceleration"]
    for k, message in run["simulator/ground_truth"].items():
        row = table(message, ["position", "velocity", "effort"], joints)
        expected = np.array([simulated.position[k], simulated.velocity[k], simulated.effort[k]])
        assert row.tobytes() == expected.tobytes(), f"ground truth of sample {k}"
    states = {k: message for k, message in run["controller/state"].items() if k < len(simulated.time) - delay}
    assert states
    for k, message in states.items():
        signals = table(message, [signal.name.lower() for signal in Signal], joints)
        assert signals.tobytes() == simulated.signals[k].tobytes(), f"signals of sample {k}"
        status = {place: getattr(message, place.name.lower()) for place in Status}
        if status[Status.FAULT_JOINT]:
            status[Status.FAULT_JOINT] = joints.index(message.name[message.fault_joint - 1]) + 1
        assert list(status.values()) == simulated.status[k].tolist(), f"status of sample {k}"
    for k, message in run["reference"].items():
        if message.name:  # Else there is none.
            assert len(message.effort) == len(joints)
            assert (table(message, motion, joints) == simulated.reference[k]).all(), f"reference of sample {k}"


PERMUTED: dict[str, Any] = {
    "controller": {"joints": ["elbow", "shoulder"]},
    "simulator": {"joints": ["shoulder", "elbow"], "initial_position": [0.1, -0.1]},
    "trajectory": {"joints": ["shoulder", "elbow"]},
}
EVERYTHING: dict[str, Any] = {
    "elasticity.stiffness": [3e4, 0.0],
    "elasticity.damping": 20.0,
    "friction.coulomb": 2.0,
    "friction.static": 3.0,
    "friction.bristle_stiffness": 1e5,
    "friction.load": 0.05,
    "friction.asymmetry": 0.1,
    "friction.cold": 0.3,
    "friction.warm_up": 1.0,
    "friction.cogging": 0.5,
    "actuator.frequency": 500.0,
    "actuator.resolution": 0.01,
    "actuator.rate": 400.0,
    "effort_sensor.offset": 0.1,
    "effort_sensor.noise": 0.05,
    "effort_sensor.side": "link",
    "encoder.bits": 16,
    "backlash.gap": 1e-4,
    "delay.samples": 1,
    "payload.mass": 0.3,
    "payload.time": 0.3,
    "push.effort": [20.0, -5.0],
    "push.time": 0.4,
    "push.duration": 0.1,
}
"""Joints and drives as they are; one joint is rigid."""
CONDITIONS: dict[str, Any] = {
    "rate limit of 50 N m/s": {"controller": {"limits.effort_rate": 50.0}},
    "rate limit of 300 N m/s, push": {
        "controller": {"limits.effort_rate": 300.0},
        "simulator": {"push.effort": [150.0, -50.0], "push.time": 0.2, "push.duration": 0.1},
    },
    "rate limit of 1000 N m/s of one joint, blend": {
        "controller": {"limits.effort_rate": [1000.0, 0.0], "activation.blend": 0.2}
    },
    "contact": {
        "controller": {"limits.external_effort": [5.0, 2.0]},
        "simulator": {"push.effort": [60.0, -30.0], "push.time": 0.2, "push.duration": 0.2},
    },
    "blend": {"controller": {"activation.blend": 0.4}},
    "limits that warn": {
        "controller": {
            "limits.tracking_error": 0.1,
            "limits.tracking_error_action": "warn",
            "limits.velocity": 0.5,
            "limits.velocity_action": "warn",
        }
    },
    "tracking limit, reset": {
        "controller": {"limits.tracking_error": 0.15, "activation.blend": 0.4, "rehearsal.reset_fault": 0.2},
        "simulator": {"initial_position": [0.39, 0.0]},
        "trajectory": {"jump.position": 0.2, "jump.time": 0.1},
    },
    "velocity limit": {"controller": {"limits.velocity": 1.0, "limits.effort_rate": 1000.0}},
    "stale reference": {"trajectory": {"dropout.time": 0.1, "dropout.duration": 0.25}},
    "no reference at first, then one that jumps": {
        "controller": {"limits.effort_rate": 300.0},
        "trajectory": {"dropout.duration": 0.1, "jump.position": [0.2, -0.1], "jump.time": 0.3},
    },
    "effort that is fed forward, stale reference": {
        "controller": {"activation.blend": 0.1, "limits.effort_rate": 1000.0},
        "trajectory": {"feedforward.effort": [20.0, -8.0], "dropout.time": 0.2, "dropout.duration": 0.25},
    },
    "freedrive, push": {
        "controller": {"rehearsal.freedrive": 0.1, "rehearsal.hold": 0.35, "rehearsal.follow": 0.5},
        "simulator": {"push.effort": [60.0, -30.0], "push.time": 0.2, "push.duration": 0.1, "encoder.bits": 14},
    },
    "barrier, freedrive, push": {
        "controller": {
            "limits.min_position": [-0.2, -0.2],
            "limits.max_position": [0.25, 0.25],
            "limits.velocity": 2.0,
            "barrier.margin": 0.05,
            "compensation.coulomb": 0.5,
            "rehearsal.freedrive": 0.25,
            "rehearsal.follow": 0.45,
        },
        "simulator": {"push.effort": [60.0, -30.0], "push.time": 0.3, "push.duration": 0.1, "encoder.bits": 14},
    },
    "gap in the joint states that is borne": {"simulator": {"dropout.time": 0.2, "dropout.duration": 0.05}},
    "gap in the joint states that stops, reset": {
        "controller": {"watchdog.state_stop": 0.02, "rehearsal.reset_fault": 0.4},
        "simulator": {"dropout.time": 0.2, "dropout.duration": 0.05},
    },
    "brakes": {"simulator": {"dropout.command_time": 0.2, "dropout.command_duration": 0.1, "command.timeout": 0.02}},
    "brakes, with the effort measured": {
        "controller": {"feedback.effort": "measured"},
        "simulator": {
            "dropout.command_time": 0.2,
            "dropout.command_duration": 0.1,
            "command.timeout": 0.02,
            "delay.samples": 2,
        },
    },
    "delay of 1 sample": {"simulator": {"delay.samples": 1, "encoder.bits": 14}},
    "delays of 40 samples": {"simulator": {"delay.samples": 40, "delay.command_samples": 40}},
    "loss and bursts": {
        "simulator": {
            "dropout.probability": 0.1,
            "dropout.burst_rate": 4.0,
            "dropout.burst": 30,
            "dropout.command_probability": 0.1,
            "dropout.command_burst_rate": 4.0,
            "noise.std": 1e-5,
            "seed": 3,
        }
    },
    "first measurements lost": {"simulator": {"dropout.duration": 0.03, "delay.samples": 3}},
    "payload picked up and dropped": {"simulator": {"payload.mass": 0.5, "payload.time": 0.1, "payload.duration": 0.3}},
    "names in other orders": PERMUTED,
    "names in other orders, tracking limit": {
        **PERMUTED,
        "controller": {**PERMUTED["controller"], "limits.tracking_error": 0.2},
    },
    "friction that is learnt": {
        "controller": {
            "estimator.name": "extended_state_observer",
            "estimator.bandwidth": 200.0,
            "adaptation.friction": "learn",
        },
        "simulator": {"friction.coulomb": [2.0, 1.0], "encoder.bits": 20, "initial_position": 0.0},
        "trajectory": {
            "reference.name": "sines",
            "reference.frequency": [2.0, 3.0],
            "reference.amplitude": 0.05,
        },
    },
    "late drives that are known": {
        "controller": {
            "estimator.name": "extended_state_observer",
            "feedback.effort": "measured",
            "drive.delay": 0.0125,
            "drive.lag": [0.02, 0.0],
            "limits.effort_rate": 4000.0,
        },
        "simulator": {"delay.samples": 5, "delay.command_samples": 7, "actuator.lag": 0.02, "encoder.bits": 18},
    },
    "lateness and friction that are learnt, softened joints": {
        "controller": {"estimator.name": "extended_state_observer", "estimator.bandwidth": 100.0, **ADAPTS},
        "simulator": {"delay.samples": 12, "actuator.lag": 0.02, "noise.std": 2e-3, **RUBS},
    },
    "measurements that cannot be": {"simulator": {"noise.std": 0.015}},
    "elastic joints, encoders on the motors": {
        "simulator": {"elasticity.stiffness": [3e4, 1e4], "elasticity.damping": 20.0, "encoder.bits": 17},
    },
    "elastic joints, whose springs the observer knows": {
        "controller": {
            "estimator.name": "elastic_joint_observer",
            "estimator.stiffness": [3e4, 1e4],
            "estimator.damping": 20.0,
            "drive.delay": 0.0015,
        },
        "simulator": {
            "elasticity.stiffness": [3e4, 1e4],
            "elasticity.damping": 20.0,
            "encoder.bits": 17,
            "delay.samples": 1,
            "dropout.probability": 0.05,
        },
    },
    "elastic joints, all imperfections of joints and drives, brakes": {
        "controller": {"feedback.effort": "measured"},
        "simulator": {
            **EVERYTHING,
            "dropout.command_time": 0.2,
            "dropout.command_duration": 0.1,
            "command.timeout": 0.02,
        },
    },
    "restart of the controller": {
        "controller": {"rehearsal.restart": 0.3, "activation.blend": 0.1, "limits.effort_rate": 1000.0}
    },
}


OTHERS = cycle(law for law in LAWS.names if law != LAW_NAME.default)


@pytest.mark.parametrize(
    ("condition", "law"),
    [(condition, law) for condition in CONDITIONS for law in (LAW_NAME.default, next(OTHERS))],
)
def test_nodes_and_rollout_agree(law: str, condition: str, tmp_path: Path) -> None:
    """Each condition with the default law and with another, whose turn it is."""
    settings = {node: dict(CONDITIONS[condition].get(node, {})) for node in ("simulator", "controller", "trajectory")}
    settings["controller"]["law.name"] = law
    if not LAWS[law].uses_model:  # Such a law recognises no contact and no friction, and predicts nothing.
        for name in ("limits.external_effort", "drive.delay", "drive.lag", "barrier.margin", *ADAPTS):
            settings["controller"].pop(name, None)
    if not LAWS[law].softens:
        settings["controller"].pop("adaptation.softening", None)
        settings["controller"].pop("adaptation.roughness", None)
    simulated = rollout(Experiment("test", "", SAMPLES * 1e-3, settings))
    heard = over_nodes(settings, tmp_path)
    assert list(heard["simulator/ground_truth"]) == list(range(SAMPLES))
    assert_same_bits(heard, simulated, settings["simulator"].get("delay.samples", 0))


@pytest.mark.parametrize(
    ("arm", "engine", "hardware"),
    [
        ("panda", "rigid_body", None),
        ("scara", "rigid_body", None),
        ("panda", "mujoco", None),
        ("panda", "rigid_body", "collaborative"),
        ("panda", "mujoco", "collaborative"),
    ],
)
def test_nodes_and_rollout_agree_for_other_arms(arm: str, engine: str, hardware: str | None, tmp_path: Path) -> None:
    """With seven joints, or one that slides; the simulator has the joints in the opposite order."""
    settings = {node: dict(given) for node, given in make_experiment(None, robot=arm).settings.items()}
    joints = find_robot({"robot.description": arm}).joints
    settings["controller"] |= {
        "law.name": "piddtsm",
        "law.disturbance_rejection": True,
        "estimator.name": "extended_state_observer",
        "limits.effort_rate": 2000.0,
    }
    settings["simulator"] |= {
        "joints": joints[::-1],
        "engine": engine,
        "initial_position": settings["simulator"]["initial_position"][::-1],
        "encoder.bits": 14,
        "model_error.mass": 0.2,
        "payload.mass": 1.0,
        "payload.time": 0.2,
    }
    if hardware is not None:
        settings["simulator"] |= hardware_settings(hardware, settings["simulator"])
    simulated = rollout(Experiment("test", "", SAMPLES * 1e-3, settings))
    assert simulated.joints == joints[::-1]
    assert_same_bits(over_nodes(settings, tmp_path), simulated, settings["simulator"].get("delay.samples", 0))


def test_nodes_and_rollout_agree_where_joints_stick_and_leave_rest(tmp_path: Path) -> None:
    """They stick, and their friction is compensated; with the switch off, the efforts are others."""
    friction = [8.0, 4.0]
    settings: dict[str, dict[str, Any]] = {
        "controller": {
            "law.name": LAW_NAME.default,
            "estimator.name": "extended_state_observer",
            "estimator.bandwidth": 60.0,
            "law.disturbance_rejection": True,
            "compensation.coulomb": friction,
            "compensation.error_gain": 8.0,
        },
        "simulator": {
            "encoder.bits": 16,
            "initial_position": [0.0, 0.0],
            "friction.coulomb": friction,
            "friction.static": [1.3 * each for each in friction],
            "friction.bristle_stiffness": [8e3, 4e3],
        },
        "trajectory": {
            "reference.name": "pick_and_place",
            "reference.from": [0.0, 0.0],
            "reference.to": [0.2, -0.2],
            "reference.duration": 0.3,
            "reference.rest": 0.1,
        },
    }
    simulated = rollout(Experiment("test", "", SAMPLES * 1e-3, settings))
    assert_same_bits(over_nodes(settings, tmp_path), simulated)
    for name, without in (("breakaway", False), ("error_gain", 0.0)):
        controller = {**settings["controller"], f"compensation.{name}": without}
        other = rollout(Experiment("test", "", SAMPLES * 1e-3, {**settings, "controller": controller}))
        assert (other.effort != simulated.effort).any()


@pytest.mark.parametrize("space", ["joint", "tool"])
def test_nodes_and_rollout_agree_while_the_reference_yields(space: str, tmp_path: Path) -> None:
    """It begins to yield after a second; the encoder is coarse, and the arm heavier than its model."""
    settings: dict[str, dict[str, Any]] = {
        "controller": {
            "law.name": LAW_NAME.default,
            "estimator.name": "extended_state_observer",
            "estimator.bandwidth": 100.0,
            "law.disturbance_rejection": True,
            "compliance.space": space,
        },
        "simulator": {
            "encoder.bits": 16,
            "model_error.mass": 0.1,
            "initial_position": [0.396, -0.004],
            "push.effort": [20.0, -10.0],
            "push.time": 1.05,
            "push.duration": 0.2,
        },
        "trajectory": {},
    }
    samples = 1400
    simulated = rollout(Experiment("test", "", samples * 1e-3, settings))
    assert_same_bits(over_nodes(settings, tmp_path, samples), simulated)
    stiff = {**settings, "controller": {**settings["controller"], "compliance.space": "none"}}
    apart = simulated.position - rollout(Experiment("test", "", samples * 1e-3, stiff)).position
    assert not apart[:1050].any()
    assert np.abs(apart[1050:]).max() > 0.01


def test_the_conditions_are_what_they_are_called() -> None:
    """Each of them does something to the default law: else nothing would be compared."""
    runs = {name: rollout(**settings, duration=SAMPLES * 1e-3) for name, settings in CONDITIONS.items()}
    plain = rollout(duration=SAMPLES * 1e-3)
    for name, condition in runs.items():
        assert (condition.effort != plain.effort).any() or (condition.status != plain.status).any(), name

    def status(name: str, place: Status) -> set[int]:
        return set(runs[name].status[:, place].tolist())

    limited = runs["rate limit of 300 N m/s, push"].signals[:, Signal.SATURATED].astype(int)
    assert (limited & Limited.RATE).any()
    kept = runs["barrier, freedrive, push"]
    assert (kept.signals[:, Signal.SATURATED].astype(int) & Limited.BARRIER).any()
    assert Mode.FREEDRIVE in status("barrier, freedrive, push", Status.MODE)
    assert Violation.EXTERNAL_EFFORT in status("contact", Status.VIOLATIONS)
    assert Fault.TRACKING_LIMIT in status("tracking limit, reset", Status.FAULT)
    assert runs["tracking limit, reset"].status[-1, Status.FAULT] == Fault.NO_FAULT
    assert Fault.STATE_STALE in status("gap in the joint states that stops, reset", Status.FAULT)
    assert Mode.HOLDING in status("stale reference", Status.MODE)
    assert {Mode.FREEDRIVE, Mode.HOLDING} <= status("freedrive, push", Status.MODE)
    assert max(status("limits that warn", Status.VIOLATIONS)) > 0
    assert Fault.MEASUREMENT in status("measurements that cannot be", Status.FAULT)
    assert (runs["brakes"].effort[250:290] == 0.0).all()
    softened = {each.what for each in runs["lateness and friction that are learnt, softened joints"].found or ()}
    assert What.PACE in softened
    learns = CONDITIONS["friction that is learnt"]
    warns = {**learns, "controller": {**learns["controller"], "adaptation.friction": "warn"}}
    warned = rollout(**warns, duration=SAMPLES * 1e-3)
    assert (warned.effort != runs["friction that is learnt"].effort).any(axis=0).all(), "nothing is compensated"
