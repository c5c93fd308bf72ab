"""Dynamics of any tree of revolute and prismatic joints."""

from pidtsm_core.robots.tree.articulated_body import forward_dynamics
from pidtsm_core.robots.tree.composite_body import inertia_matrix
from pidtsm_core.robots.tree.effort_spread import effort_spread
from pidtsm_core.robots.tree.jacobian import add_wrench
from pidtsm_core.robots.tree.kinematics import energy, forward_kinematics
from pidtsm_core.robots.tree.newton_euler import inverse_dynamics

__all__ = [
    "add_wrench",
    "effort_spread",
    "energy",
    "forward_dynamics",
    "forward_kinematics",
    "inertia_matrix",
    "inverse_dynamics",
]
