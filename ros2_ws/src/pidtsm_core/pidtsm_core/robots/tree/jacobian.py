"""What a wrench on a link of a tree does at the joints."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import subroutine
from pidtsm_core.robots.tree.kinematics import forward_kinematics
from pidtsm_core.robots.tree.layout import Column, parent_of, place_of, row_of


@subroutine
def add_wrench(q: Array, p: Array, row: int, point: Array, wrench: Array, placements: Array, effort: Array) -> None:
    """Add J' w to the efforts, the transposed Jacobian of a point times a wrench there.

    Args:
        q: shape (joints,), rad or m.
        p: the tree, shape (size(joints),), see `layout`; its scratch is overwritten.
        row: row of the link with the point.
        point: in the frame of that link, shape (3,), m.
        wrench: force (N) and torque (N m) in the axes of the base, shape (6,).
        placements: scratch, shape (joints, 3, 4).
        effort: shape (joints,), N m or N.
    """
    forward_kinematics(q, p, placements)
    f0, f1, f2, m0, m1, m2 = wrench[0], wrench[1], wrench[2], wrench[3], wrench[4], wrench[5]
    link = placements[row]
    at0 = link[0, 0] * point[0] + link[0, 1] * point[1] + link[0, 2] * point[2] + link[0, 3]
    at1 = link[1, 0] * point[0] + link[1, 1] * point[1] + link[1, 2] * point[2] + link[1, 3]
    at2 = link[2, 0] * point[0] + link[2, 1] * point[1] + link[2, 2] * point[2] + link[2, 3]
    i = row
    while i >= 0:
        joint = placements[i]
        z0, z1, z2 = joint[0, 2], joint[1, 2], joint[2, 2]
        if p[row_of(i) + Column.SLIDES] != 0.0:
            along = z0 * f0 + z1 * f1 + z2 * f2
        else:
            r0, r1, r2 = at0 - joint[0, 3], at1 - joint[1, 3], at2 - joint[2, 3]
            along = z0 * (r1 * f2 - r2 * f1 + m0) + z1 * (r2 * f0 - r0 * f2 + m1) + z2 * (r0 * f1 - r1 * f0 + m2)
        effort[place_of(p, i)] += along
        i = parent_of(p, i)
