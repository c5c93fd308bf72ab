"""The planar two-link arm of the article, eqs. (48)-(50), after Feng, Yu and Man (2002)."""

import math

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined, njit
from pidtsm_core.parameters import Parameter
from pidtsm_core.robots.base import Dynamics, Robot, Tool
from pidtsm_core.robots.payload import Payload
from pidtsm_core.robots.tree.layout import GRAVITY, Column, rotation, rows, size

# Order of the packed parameters: m1, m2, r1, r2, j1, j2, g, coriolis (0 paper, 1 lagrange).
_M2, _R1, _R2, _J1, _G = 1, 2, 3, 4, 6
_LAGRANGE = 1.0


@njit
def _terms(q: Array, dq: Array, p: Array) -> tuple[float, float, float, float, float]:
    """H11, H12, H22 (kg m^2) of (48), and both elements of C q' + G (N m) of (49), (50).

    Compared with Lagrange's equations of this arm, (49) swaps q1' and q2' in the velocity-squared terms. With the
    choice `lagrange`, H' - 2C is skew-symmetric.
    """
    m1, m2, r1, r2, j1, j2, g, coriolis = p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7]
    p1 = (m1 + m2) * r1 * r1 + m2 * r2 * r2 + j1
    p2 = m2 * r1 * r2
    p3 = m2 * r2 * r2
    p4 = p3 + j2
    p5 = (m1 + m2) * r1 * g
    p6 = m2 * r2 * g

    c2 = math.cos(q[1])
    c12 = math.cos(q[0] + q[1])
    h = p2 * math.sin(q[1])
    if coriolis == _LAGRANGE:
        coriolis1 = -h * (2.0 * dq[0] + dq[1]) * dq[1]
        coriolis2 = h * dq[0] * dq[0]
    else:
        coriolis1 = -h * (dq[0] + 2.0 * dq[1]) * dq[0]
        coriolis2 = h * dq[1] * dq[1]
    bias1 = coriolis1 + p5 * math.cos(q[0]) + p6 * c12
    bias2 = coriolis2 + p6 * c12
    return p1 + 2.0 * p2 * c2, p3 + p2 * c2, p4, bias1, bias2


@njit
def inverse_dynamics(q: Array, dq: Array, ddq: Array, p: Array, effort: Array) -> None:
    """effort = H ddq + C dq + G, row by row."""
    h11, h12, h22, bias1, bias2 = _terms(q, dq, p)
    for i in range(ddq.shape[0]):
        effort[i, 0] = h11 * ddq[i, 0] + h12 * ddq[i, 1] + bias1
        effort[i, 1] = h12 * ddq[i, 0] + h22 * ddq[i, 1] + bias2


@njit
def forward_dynamics(q: Array, dq: Array, effort: Array, p: Array, ddq: Array) -> None:
    """ddq = H^-1 (effort - C dq - G), by Cramer's rule."""
    h11, h12, h22, bias1, bias2 = _terms(q, dq, p)
    net1 = effort[0] - bias1
    net2 = effort[1] - bias2
    determinant = h11 * h22 - h12 * h12
    ddq[0] = (h22 * net1 - h12 * net2) / determinant
    ddq[1] = (h11 * net2 - h12 * net1) / determinant


@inlined
def _of_product(a: float, da: float, b: float, db: float) -> float:
    """Largest change of a product."""
    return abs(a) * db + abs(b) * da + da * db


@njit
def effort_spread(q: Array, dq: Array, ddq: Array, box: Array, p: Array, spread: Array) -> None:
    """See `Dynamics.effort_spread`. Sine and cosine change by no more than their angle."""
    m1, m2, r1, r2, g = p[0], p[1], p[2], p[3], p[6]
    h11, h12, h22, _, _ = _terms(q, dq, p)
    p2, sine = m2 * r1 * r2, math.sin(q[1])
    turn = p2 * box[0, 1]
    if p[7] == _LAGRANGE:
        a, da, b, db, c = 2.0 * dq[0] + dq[1], 2.0 * box[1, 0] + box[1, 1], dq[1], box[1, 1], 0
    else:
        a, da, b, db, c = dq[0] + 2.0 * dq[1], box[1, 0] + 2.0 * box[1, 1], dq[0], box[1, 0], 1
    coriolis1 = _of_product(p2 * sine, turn, a * b, _of_product(a, da, b, db))
    coriolis2 = _of_product(p2 * sine, turn, dq[c] * dq[c], _of_product(dq[c], box[1, c], dq[c], box[1, c]))
    gravity2 = abs(m2 * r2 * g) * (box[0, 0] + box[0, 1])
    gravity1 = abs((m1 + m2) * r1 * g) * box[0, 0] + gravity2
    coupled1 = _of_product(h12, turn, ddq[1], box[2, 1])
    coupled2 = _of_product(h12, turn, ddq[0], box[2, 0])
    spread[0, 0] = _of_product(h11, 2.0 * turn, ddq[0], box[2, 0]) + coupled1 + coriolis1 + gravity1
    spread[0, 1] = _of_product(h22, 0.0, ddq[1], box[2, 1]) + coupled2 + coriolis2 + gravity2


@njit
def energy(q: Array, dq: Array, p: Array) -> float:
    """0.5 dq' H dq + V(q) with dV/dq = G, in J."""
    h11, h12, h22, _, _ = _terms(q, dq, p)
    m1, m2, r1, r2, _, _, g, _ = p
    kinetic = 0.5 * (h11 * dq[0] * dq[0] + 2.0 * h12 * dq[0] * dq[1] + h22 * dq[1] * dq[1])
    return kinetic + (m1 + m2) * r1 * g * math.sin(q[0]) + m2 * r2 * g * math.sin(q[0] + q[1])


def load(p: Array, payload: Payload) -> None:
    """Add the payload, a point mass, to m2, as in the article's Case 2."""
    p[_M2] += payload.mass


def tool(p: Array) -> Tool:
    """The end of the second link, in the vertical plane x-z as in the URDF."""
    tree = np.zeros(size(2))
    first, second = rows(tree)
    tree[:GRAVITY] = 0.0, 0.0, -p[_G]
    # The first joint turns about -y.
    rotation(first)[:], rotation(second)[:] = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]], np.eye(3)
    first[Column.PARENT], second[Column.PLACE] = -1.0, 1.0
    second[Column.TRANSLATION] = p[_R1]
    return Tool(tree, 1, np.array([p[_R2], 0.0, 0.0]))


def mjcf(p: Array) -> str:
    """The arm as rigid bodies, in the vertical plane x-z as in its URDF; points have 1e-12 kg m^2 instead of 0."""
    m1, m2, r1, r2, j1, j2, g, _ = p
    joint = '<joint name="{}" axis="0 -1 0" armature="{!r}"/>'
    shape = '<geom type="capsule" fromto="0 0 0 {!r} 0 0" size="0.05" conaffinity="0"/>'
    inertial = '<inertial pos="{!r} 0 0" mass="{!r}" diaginertia="1e-12 1e-12 1e-12"/>'
    first = joint.format("joint1", float(j1)) + inertial.format(float(r1), float(m1)) + shape.format(float(r1))
    second = joint.format("joint2", float(j2)) + inertial.format(float(r2), float(m2)) + shape.format(float(r2))
    return (
        f'<mujoco><option gravity="0 0 {float(-g)!r}"/><worldbody><body name="link1">{first}'
        f'<body name="link2" pos="{float(r1)!r} 0 0">{second}<body name="tool" pos="{float(r2)!r} 0 0"/></body></body>'
        "</worldbody></mujoco>"
    )


TWO_LINK = Robot(
    name="two_link",
    summary="planar two-link arm of the article, eqs. (48)-(50)",
    # The article's values, section 4.
    parameters=(
        Parameter("m1", 0.5, "mass of the first link", "kg", minimum=0.0),
        Parameter("m2", 1.5, "mass of the second link", "kg", minimum=0.0),
        Parameter("r1", 1.0, "length of the first link", "m", minimum=0.0, exclusive=True),
        Parameter("r2", 0.85, "length of the second link", "m", minimum=0.0, exclusive=True),
        Parameter("j1", 5.0, "rotor inertia of the first joint", "kg m^2", minimum=0.0, exclusive=True),
        Parameter("j2", 5.0, "rotor inertia of the second joint", "kg m^2", minimum=0.0, exclusive=True),
        Parameter("g", 9.8, "gravity", "m/s^2"),
        Parameter(
            "coriolis",
            "paper",
            "Coriolis matrix: (49) as the article prints it, or as it follows from Lagrange's equations",
            choices=("paper", "lagrange"),
        ),
    ),
    joints=("joint1", "joint2"),
    effort_limit=(100.0, 50.0),  # Remark 8
    initial_position=(0.0, -0.1),
    quantities={"mass": ("m1", "m2"), "inertia": ("j1", "j2"), "length": ("r1", "r2")},
    dynamics=Dynamics(inverse_dynamics, forward_dynamics, energy, effort_spread=effort_spread),
    load=load,
    disturbance="article",
    tool=tool,
    rotor=lambda p: p[_J1 : _J1 + 2].copy(),
    mjcf=mjcf,
    rigid={"coriolis": "lagrange"},
    urdf="package://two_link_sim/urdf/two_link.urdf",
)
