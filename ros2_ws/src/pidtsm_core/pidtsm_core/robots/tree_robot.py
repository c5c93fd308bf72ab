"""An arm whose model is data: read from a URDF or MJCF."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import Parameter, Value, joint_array
from pidtsm_core.robots import tree
from pidtsm_core.robots.base import Dynamics, Robot, Tool
from pidtsm_core.robots.description import Description, read_description
from pidtsm_core.robots.payload import Payload
from pidtsm_core.robots.tree.layout import Column, inertia_matrix, rows, set_inertia, steiner

TREE = Dynamics(tree.inverse_dynamics, tree.forward_dynamics, tree.energy, tree.effort_spread)

_ARMATURE = "armature"


@dataclass(frozen=True, eq=False, kw_only=True)
class TreeRobot(Robot):
    """A robot whose model is a tree of joints.

    Attributes:
        description: the model, and what else its file contains.
    """

    description: Description = field(repr=False)

    def pack_model(
        self, values: Mapping[str, Value], group: str = "robot", factors: Mapping[str, float] | None = None
    ) -> Array:
        """The tree, with scratch of its own, see `tree.layout`.

        Args:
            values: parameter values by full name.
            group: group of the parameters.
            factors: by quantity: ``mass`` multiplies masses and inertias, as a density would; ``inertia`` the inertias
                about the centres of mass, and the armature; ``length`` the distances of joints and centres of mass.
        """
        packed = self.description.tree.copy()
        armature = joint_array(values[f"{group}.{_ARMATURE}"], len(self.joints))
        for row in rows(packed):
            row[Column.ARMATURE] = armature[int(row[Column.PLACE])]
            _scale(row, {"mass": 1.0, "inertia": 1.0, "length": 1.0, **(factors or {})})
        return packed

    def rotors(self, model: Array) -> Array:
        """See `Robot.rotors`."""
        table = rows(model)
        return np.asarray(table[np.argsort(table[:, Column.PLACE]), Column.ARMATURE])

    def joint_inertia(self, model: Array, q: Array) -> Array:
        """See `Robot.joint_inertia`."""
        inertia = np.zeros((q.size, q.size))
        tree.inertia_matrix(q, model, inertia)
        return np.asarray(1.0 / np.diag(np.linalg.inv(inertia)))


def _scale(row: Array, factors: Mapping[str, float]) -> None:
    """Multiply the quantities of a link by their factors; factors of 1 change no bit."""
    mass, inertia, length = factors["mass"], factors["inertia"], factors["length"]
    if mass == inertia == length == 1.0:
        return
    weight, centre = row[Column.MASS], row[Column.MOMENT : Column.INERTIA] / row[Column.MASS]
    about = inertia_matrix(row) - weight * steiner(centre)
    row[Column.MASS] = mass * weight
    row[Column.MOMENT : Column.INERTIA] = mass * weight * length * centre
    set_inertia(row, mass * (inertia * about + weight * steiner(length * centre)))
    row[Column.TRANSLATION : Column.MASS] *= length
    row[Column.ARMATURE] *= inertia


def add_load(description: Description, p: Array, payload: Payload) -> None:
    """Add a payload at the tool of a description to its tree `p`, shape (n,)."""
    row, axes = rows(p)[description.tool_row], description.tool_rotation
    center = description.tool + axes @ payload.center_of_mass
    row[Column.MASS] += payload.mass
    row[Column.MOMENT : Column.INERTIA] += payload.mass * center
    about = axes @ payload.inertia @ axes.T
    set_inertia(row, inertia_matrix(row) + about + payload.mass * steiner(center))


@lru_cache(maxsize=64)
def tree_robot(
    name: str, text: str, joints: tuple[str, ...] | None = None, locked: tuple[tuple[str, float], ...] = ()
) -> TreeRobot:
    """The robot of a description.

    Args:
        name: name of the robot, for messages.
        text: see `read_description`.
        joints: likewise.
        locked: likewise, as pairs.

    Raises:
        DescriptionError: see `read_description`.
    """
    found = read_description(text, joints, dict(locked))
    half = 0.5 * (found.upper - found.lower)
    middle = np.where(np.isfinite(half), found.upper - np.where(np.isfinite(half), half, 0.0), 0.0)
    armature = np.empty(len(found.joints))
    for row in rows(found.tree):
        armature[int(row[Column.PLACE])] = row[Column.ARMATURE]
    return TreeRobot(
        name=name,
        summary=f"{len(found.joints)} joints, read from a description",
        parameters=(
            Parameter(
                _ARMATURE,
                tuple(armature.tolist()),
                "inertia of the rotor as the joint sees it",
                "kg m^2",
                minimum=0.0,
                per_joint=True,
            ),
        ),
        joints=found.joints,
        effort_limit=tuple(found.effort.tolist()),
        initial_position=tuple(middle.tolist()),
        quantities={},
        dynamics=TREE,
        load=lambda p, payload: add_load(found, p, payload),
        tool=lambda p: Tool(p.copy(), found.tool_row, found.tool),
        position_limits=tuple(zip(found.lower.tolist(), found.upper.tolist(), strict=True)),
        velocity_limit=tuple(found.velocity.tolist()),
        slides=tuple(found.slides.tolist()),
        continuous=tuple((~(found.slides | np.isfinite(half))).tolist()),
        friction=tuple(found.friction.tolist()),
        damping=tuple(found.damping.tolist()),
        base=found.links.names[0],
        description=found,
    )
