"""Where the links of a tree are, and the energy that they have."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import subroutine
from pidtsm_core.robots.tree.layout import SPACE, Column, Scratch, parent_of, place_of, row_of, scratch
from pidtsm_core.robots.tree.motion import move_links, multiply_inertia, out, place_link


@subroutine
def forward_kinematics(q: Array, p: Array, placements: Array) -> None:
    """Placements of the links.

    Args:
        q: shape (joints,), rad or m.
        p: the tree, shape (size(joints),), see `layout`; its scratch is overwritten.
        placements: result, shape (joints, 3, 4), in the order of the rows of the tree: from the frame of each link to
            the base, rotation and, in the last column, translation (m).
    """
    y = p[scratch(q.size) :]
    for i in range(q.size):
        k, t, parent = i * SPACE, i * SPACE + Scratch.TRANSLATION, parent_of(p, i)
        place_link(p, y, i, q[place_of(p, i)])
        for row in range(3):
            if parent < 0:
                for column in range(3):
                    placements[i, row, column] = y[k + 3 * row + column]
                placements[i, row, 3] = y[t + row]
                continue
            a, b, c = placements[parent, row, 0], placements[parent, row, 1], placements[parent, row, 2]
            for column in range(3):
                placements[i, row, column] = a * y[k + column] + b * y[k + 3 + column] + c * y[k + 6 + column]
            placements[i, row, 3] = placements[parent, row, 3] + a * y[t] + b * y[t + 1] + c * y[t + 2]


@subroutine
def energy(q: Array, dq: Array, p: Array) -> float:
    """Kinetic plus potential energy, J; the potential energy is zero with all centres of mass at the base's origin.

    Args:
        q: shape (joints,), rad or m.
        dq: shape (joints,), rad/s or m/s.
        p: the tree, shape (size(joints),), see `layout`; its scratch is overwritten.
    """
    y = p[scratch(q.size) :]
    move_links(q, dq, p, y)
    total = 0.0
    for i in range(q.size):
        r, k = row_of(i), i * SPACE
        v, f = k + Scratch.VELOCITY, k + Scratch.FORCE
        multiply_inertia(p, r, y, v, f)
        rate = dq[place_of(p, i)]
        total += 0.5 * p[r + Column.ARMATURE] * rate * rate
        for j in range(6):
            total += 0.5 * y[v + j] * y[f + j]
        # The first moment of mass in the frame of the base.
        h, mass = r + Column.MOMENT, p[r + Column.MASS]
        h0, h1, h2 = p[h], p[h + 1], p[h + 2]
        link = i
        while link >= 0:
            s = link * SPACE
            h0, h1, h2 = out(y, s, h0, h1, h2)
            h0 += mass * y[s + Scratch.TRANSLATION]
            h1 += mass * y[s + Scratch.TRANSLATION + 1]
            h2 += mass * y[s + Scratch.TRANSLATION + 2]
            link = parent_of(p, link)
        total -= p[0] * h0 + p[1] * h1 + p[2] * h2
    return total
