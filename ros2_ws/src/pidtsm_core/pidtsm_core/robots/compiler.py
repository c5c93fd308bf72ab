"""MuJoCo's compiler: from the text of a URDF or MJCF to bodies, joints and inertias."""

import math
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.robots.bounds import LONGEST, check_bounds, read_text
from pidtsm_core.robots.errors import DescriptionError
from pidtsm_core.robots.urdf import check_urdf, joint_limits, keep_shapes, rotor_inertias, strip

SLIDE, HINGE = 2, 3
"""Types of joints that the tree can represent, of mjtJoint; MuJoCo, which is slow to import, is not needed for them."""
ON_JOINT = 0
"""A motor that acts on a joint, of mjtTrn."""
CONNECT, WELD, COUPLE = 0, 1, 2
"""Constraints between bodies or joints, of mjtEq."""
_FIXED, _NO_BIAS = 0, 0  # mjtGain, mjtBias
_WORDS = {
    "mass and inertia of moving bodies must be larger than mjMINVAL": (
        "a joint moves it, and it has no mass or no inertia; give it both"
    ),
    "inertia must satisfy A + B >= C; use 'balanceinertia' to fix": (
        "no body has its inertia: the largest principal inertia exceeds the sum of the others; correct the figures"
    ),
    "error 'inertia must have positive eigenvalues' in fullinertia": (
        "no body has its inertia: a principal inertia is not positive; correct the figures"
    ),
}
"""Errors of MuJoCo's compiler in the words of the project."""


@dataclass(frozen=True)
class Parsed:
    """A description as MuJoCo's compiler reads it, and what it does not read from a URDF.

    Attributes:
        spec: of type ``mujoco.MjSpec``.
        base: body that is the base: 0, the world, in an MJCF; 1 in a URDF, unless its base is called world.
        limits: by joint of a URDF, the attributes of its element ``limit``.
        rotors: inertia of the rotors that a URDF has as transmissions, by joint, kg m^2 or kg.
        is_urdf: whether it is a URDF.
    """

    spec: Any
    base: int
    limits: Mapping[str, Mapping[str, float]]
    rotors: Mapping[str, float]
    is_urdf: bool


def parse(text: str, geometry: bool = False) -> Parsed:
    """Parse the text of a URDF or MJCF.

    Args:
        text: the text.
        geometry: keep that of a URDF, see `keep_shapes`; an MJCF keeps its own.

    Raises:
        DescriptionError: the text is neither, or it is broken.
    """
    if len(text) > LONGEST:
        raise DescriptionError(
            f"the description has {len(text) / 2**20:.0f} MB; at most {LONGEST // 2**20} MB are read"
        )
    try:
        root = ElementTree.fromstring(text)  # noqa: S314  A robot's own description; expat limits expansion.
    except (ElementTree.ParseError, UnicodeEncodeError) as error:
        raise DescriptionError(f"the description is not XML: {error}") from None
    if root.tag not in ("robot", "mujoco"):
        raise DescriptionError(f"the description is neither URDF nor MJCF: its root element is <{root.tag}>")
    check_bounds(root)
    limits: Mapping[str, Mapping[str, float]] = {}
    rotors: Mapping[str, float] = {}
    base = 0
    if root.tag == "robot":
        check_urdf(root)
        base = 0 if "world" in {link.get("name") for link in root.findall("link")} else 1
        limits, rotors = joint_limits(root), rotor_inertias(root)
        if geometry:
            keep_shapes(root)
        strip(root, geometry)
    try:
        spec = load_mujoco().MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    except ValueError as error:
        raise DescriptionError(_cause(str(error))) from None
    return Parsed(spec, base, limits, rotors, root.tag == "robot")


def load_spec(file: Path) -> Any:
    """The ``mujoco.MjSpec`` of an MJCF file.

    Raises:
        DescriptionError: it cannot be read.
    """
    if not file.is_file():
        raise DescriptionError("no such file")
    with suppress(ElementTree.ParseError, UnicodeDecodeError):  # The compiler reports what is wrong.
        check_bounds(ElementTree.fromstring(read_text(file)), file.parent)  # noqa: S314  As above.
    try:
        return load_mujoco().MjSpec.from_file(str(file))
    except ValueError as error:
        raise DescriptionError(_cause(str(error))) from None


def compile_spec(spec: Any) -> Any:
    """The ``mujoco.MjModel`` of a ``mujoco.MjSpec``.

    Raises:
        DescriptionError: it cannot be compiled; the message begins with the link or joint.
    """
    try:
        return spec.compile()
    except ValueError as error:
        raise DescriptionError(_cause(str(error))) from None


def motor_limits(model: Any) -> Array:
    """Largest effort of the motors on each joint of an MJCF, shape (njnt,), N m or N; infinite without one."""
    limits = np.full(model.njnt, math.inf)
    for i in range(model.nu):
        force = model.actuator_gainprm[i, 0] * model.actuator_gear[i, 0]
        is_motor = (model.actuator_gaintype[i], model.actuator_biastype[i]) == (_FIXED, _NO_BIAS)
        if is_motor and model.actuator_trntype[i] == ON_JOINT and model.actuator_ctrllimited[i]:
            limits[model.actuator_trnid[i, 0]] = abs(force) * model.actuator_ctrlrange[i, 1]
    return limits


def load_mujoco() -> Any:
    """The module ``mujoco``, which takes long to import, without its warnings.

    Raises:
        DescriptionError: it is not installed.
    """
    try:
        import mujoco
    except ImportError:
        raise DescriptionError("reading a robot description needs MuJoCo: pip install mujoco") from None
    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(_ignore)
    return mujoco


def _ignore(_message: str) -> None:
    """MuJoCo would print its warnings, and write them to a file in the working folder."""


def _cause(message: str) -> str:
    """An error of MuJoCo's compiler on one line, with the name of the link or joint in front."""
    text = " ".join(message.split()).removeprefix("Error: ")
    named = re.fullmatch(r"(.*?)[,;]? Element name '(.*)', id -?\d+.*", text)
    if not named:
        return f"the description cannot be read: {text}"
    name = named[2] or "an element without name"
    return f"link {name}: {_WORDS[named[1]]}" if named[1] in _WORDS else f"{name}: {named[1]}"
