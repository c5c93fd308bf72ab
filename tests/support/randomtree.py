"""Random trees of joints whose parameters are known, measured and judged by MuJoCo."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.identification.identification import Identification
from pidtsm_core.identification.measurement import Measurement
from pidtsm_core.parameters.files import load_ros_parameters
from pidtsm_core.robots import Description
from pidtsm_core.robots.description import read_description
from support.knownarm import periodic_motion

_REVERSAL = 0.01


@dataclass(frozen=True)
class RandomTree:
    """A description that is up to 20 % off, and what was measured of the arm."""

    described: Description
    measured: Measurement
    noise: Array


@dataclass(frozen=True)
class Joint:
    """A joint of a random tree and the body that it moves: the shape that both descriptions share."""

    kind: str
    axis: str
    parent: str
    origin: Array
    mass: float
    center: Array
    size: Array


def urdf(joints: list[Joint], factors: Array) -> str:
    """The text of a URDF whose masses are multiplied by these factors, shape (joints,)."""
    parts = ['<robot name="tree"><link name="base"/>']
    for j, (joint, factor) in enumerate(zip(joints, factors, strict=True)):
        mass = joint.mass * factor
        xx, yy, zz = (mass / 12.0 * (np.sum(joint.size**2) - side**2) for side in joint.size)
        center, origin = (" ".join(f"{x:.6f}" for x in each) for each in (joint.center, joint.origin))
        effort = 60.0 * sum(each.mass for each in joints)
        parts.append(
            f'<link name="l{j}"><inertial><origin xyz="{center}"/><mass value="{mass:.6f}"/>'
            f'<inertia ixx="{xx:.8f}" iyy="{yy:.8f}" izz="{zz:.8f}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="j{j}" type="{joint.kind}"><parent link="{joint.parent}"/><child link="l{j}"/>'
            f'<origin xyz="{origin}"/><axis xyz="{joint.axis}"/>'
            f'<limit lower="-1" upper="1" effort="{effort:.3f}" velocity="3"/></joint>'
        )
    return "".join([*parts, "</robot>"])


def random_tree(seed: int, kinds: str = "", axes: str = "", duration: float = 20.0) -> RandomTree:
    """A chain of joints, drawn with this seed, excited and measured at 250 Hz.

    Args:
        seed: of everything.
        kinds: a letter for each joint, p (prismatic) or r (revolute); empty: one to six, drawn.
        axes: likewise, x, y or z; empty: drawn. Gravity points along -z.
        duration: s.
    """
    random = np.random.default_rng(seed)
    kinds = kinds or "".join(random.choice(["p", "r"], size=random.integers(1, 7)))
    axes = axes or "".join(random.choice(["x", "y", "z"], size=len(kinds)))
    joints = [
        Joint(
            "prismatic" if kind == "p" else "revolute",
            {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}[axis],
            f"l{j - 1}" if j else "base",
            random.uniform(-0.3, 0.3, 3),
            float(random.uniform(1.0, 10.0)) / (j + 1),
            random.uniform(-0.1, 0.1, 3),
            random.uniform(0.05, 0.3, 3),
        )
        for j, (kind, axis) in enumerate(zip(kinds, axes, strict=True))
    ]
    count = len(joints)
    true, described = urdf(joints, np.ones(count)), urdf(joints, random.uniform(0.8, 1.2, count))
    arm = read_description(described)
    share = 0.01 * arm.effort
    coulomb, viscous, offset = (share * random.uniform(*ends, count) for ends in ((0.3, 3.0), (0.3, 3.0), (-5.0, 5.0)))
    armature = random.uniform(0.0, 1.0, count)
    time = np.arange(0.0, duration, 0.004)
    q = periodic_motion(arm, time, random)
    effort = mujoco_efforts(true, arm.joints, q)
    effort += armature * q[2] + viscous * q[1] + coulomb * np.tanh(q[1] / _REVERSAL) + offset
    noise = 0.05 * share
    effort += noise * random.normal(size=effort.shape)
    position = q[0] + 1e-5 * random.normal(size=effort.shape)
    return RandomTree(arm, Measurement(arm.joints, time, position, effort, np.full(count, np.inf)), noise)


def mujoco_efforts(text: str, joints: tuple[str, ...], motion: Array) -> Array:
    """Efforts of the rigid bodies of a URDF by MuJoCo, without friction and rotors, shape (samples, joints).

    Args:
        text: the URDF.
        joints: names, in the order of the columns.
        motion: q, q', q'', shape (3, samples, joints).
    """
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    model.dof_damping[:] = 0.0
    data = mujoco.MjData(model)
    order = [model.joint(name).dofadr[0] for name in joints]
    efforts = np.empty(motion.shape[1:])
    for sample, state in enumerate(motion.swapaxes(0, 1)):
        data.qpos[order], data.qvel[order], data.qacc[order] = state
        mujoco.mj_inverse(model, data)
        efforts[sample] = data.qfrc_inverse[order]
    return efforts


def judged_errors(found: Identification, folder: Path) -> Array:
    """Root mean square of the torque that the written files do not explain, on the data kept apart, shape (joints,).

    The bodies are those of the description, by MuJoCo, which has the rotors of an MJCF, too; those of a URDF are read
    as text; friction and offsets are those of the parameter file.
    """
    text = (folder / f"identified.{'urdf' if found.arm.is_urdf else 'xml'}").read_text(encoding="utf-8")
    written: dict[str, Any] = load_ros_parameters(folder / "identified.yaml")["controller"]
    joints = found.arm.joints
    rotors = _rotors(text) if found.arm.is_urdf else dict.fromkeys(joints, 0.0)
    motion, check = found.check.motion, found.check
    predicted = mujoco_efforts(text, joints, np.stack([motion.position, motion.velocity, motion.acceleration]))
    predicted += np.array([rotors[joint] for joint in joints]) * motion.acceleration
    coulomb, viscous, offset = (np.array(written[f"compensation.{name}"]) for name in ("coulomb", "viscous", "offset"))
    predicted += coulomb * motion.coulomb + viscous * motion.velocity + offset
    usable = check.usable | ~check.usable.any(axis=0)
    return np.asarray(np.sqrt(np.mean((predicted - check.measured) ** 2, axis=0, where=usable)))


def _rotors(text: str) -> dict[str, float]:
    """Inertia of the rotors of a URDF by joint, kg m^2 or kg."""
    rotors = {}
    for transmission in ElementTree.fromstring(text).iter("transmission"):
        driven, rotor = transmission.find("joint"), transmission.find(".//{*}rotor_inertia")
        assert driven is not None
        assert rotor is not None
        rotors[driven.get("name", "")] = float(rotor.get("value", "nan"))
    return rotors


def as_mjcf(arm: Description) -> Description:
    """The arm of a URDF, described by the MJCF that MuJoCo makes of it."""
    spec = mujoco.MjSpec.from_string(arm.text)
    spec.compile()
    found = read_description(spec.to_xml(), arm.joints)
    return replace(found, effort=arm.effort)
