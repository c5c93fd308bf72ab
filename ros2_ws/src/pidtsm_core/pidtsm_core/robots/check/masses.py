"""Masses of the links that move, and doubts about them."""

import math
from collections.abc import Iterator

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.robots.check.result import Doubt, Mass
from pidtsm_core.robots.check.structure import Structure
from pidtsm_core.robots.description import Description
from pidtsm_core.robots.inertials import ROUNDING, Inertial, lack
from pidtsm_core.robots.picture import reach
from pidtsm_core.robots.tree.layout import Column, inertia_matrix, rows, steiner

_LIGHT, _LIGHT_SHARE = 0.02, 0.05
"""Mass (kg), and share of the median of the others, below which a link is probably given in the wrong unit."""
_HEAVY, _HEAVY_SHARE = 100.0, 20.0
"""Mass (kg), and multiple of all others together, beyond which it is."""
_OUTSIDE = 0.5
"""Distance of a centre of mass from the line between its joints, as a share of the reach of the arm; of 465 links of
public arms, the farthest has 0.31."""
_WIDE = 0.5
"""Radius of gyration as a share of the reach; 0.35 at most, where inertias are not mistaken."""
_MATTERS = 0.2
"""Share of the mass or inertia that moves together from which on that of one link matters."""
_LEAD = 11_300.0
"""Density of lead, kg/m^3. A link as dense as a ball of its mass and inertia exceeds it nowhere, but by mistake: the
densest of public arms has 10,000, the others 7,300 at most."""
_NEGLIGIBLE = 0.01
"""Share of the inertia that moves with a link below which its own does not matter."""


def find_masses(arm: Description) -> tuple[Mass, ...]:
    """What moves with each joint, in the order of the joints."""
    found: dict[int, Mass] = {}
    for i, row in enumerate(rows(arm.tree)):
        place, mass = int(row[Column.PLACE]), float(row[Column.MASS])
        center = row[Column.MOMENT : Column.INERTIA] / mass
        principal = np.linalg.eigvalsh(inertia_matrix(row) - mass * steiner(center))
        links = tuple(arm.links.names[k] for k in np.flatnonzero(arm.links.rows == i))
        found[place] = Mass(arm.joints[place], links, mass, tuple(center.tolist()), tuple(principal.tolist()))
    return tuple(found[place] for place in sorted(found))


def mass_doubts(arm: Description, masses: tuple[Mass, ...], structure: Structure) -> Iterator[Doubt]:
    """Doubts about the masses that move with the joints; each names the link that is most probably wrong."""
    size = reach(arm)
    for i, row in enumerate(rows(arm.tree)):
        mass = masses[int(row[Column.PLACE])]
        yield from _amount(mass, masses)
        links = np.flatnonzero(arm.links.rows == i).tolist()
        stated = {k: inertial for k in links for inertial, given in (structure.inertial(k),) if given}
        if not stated:
            continue
        yield from _center(arm, i, mass, size, _name_of_farthest(arm, stated))
        for k, inertial in stated.items():
            if inertial.mass > _MATTERS * mass.mass:
                yield from _dense(arm.links.names[k], inertial)
        widest = max(stated, key=lambda k: float(np.trace(stated[k].inertia)))
        yield from _wide(mass, size, arm.links.names[widest], stated[widest])


def impossible_links(arm: Description, structure: Structure) -> Iterator[tuple[Doubt, bool]]:
    """Inertias that no body has and that did not refuse the arm, each with whether that can matter."""
    for k, (name, row) in enumerate(zip(arm.links.names, arm.links.rows, strict=True)):
        inertial, given = structure.inertial(k)
        missing = lack(inertial.inertia)
        if not given or missing <= ROUNDING or not inertial.mass > 0.0:
            continue
        numbers = ", ".join(f"{value:.3g}" for value in np.linalg.eigvalsh(inertial.inertia))
        text = f"no body has its inertia: the principal inertias are {numbers} kg m^2"
        moved = float(np.trace(inertia_matrix(rows(arm.tree)[row]))) if row >= 0 else math.inf
        if float(np.abs(inertial.inertia).max()) < _NEGLIGIBLE * moved:
            why = "it does not move" if row < 0 else "what it is fixed to has much more"
            yield Doubt("inertia-impossible", "link", name, f"{text}; {why}, so this does not matter", ""), False
        else:
            cure = "none may be negative, or larger than the sum of the others; correct the figures or their units"
            yield Doubt("inertia-impossible", "link", name, text, cure), True


def _amount(mass: Mass, masses: tuple[Mass, ...]) -> Iterator[Doubt]:
    others = [each.mass for each in masses if each is not mass]
    link = mass.links[0]
    if mass.mass < _LIGHT and (not others or mass.mass < _LIGHT_SHARE * float(np.median(others))):
        text = f"what joint {mass.joint} moves with it has only {1e3 * mass.mass:.3g} g"
        yield Doubt("mass-small", "link", link, text, "correct its mass, in kg")
    if mass.mass > _HEAVY * (1.0 if others else 10.0) and mass.mass > _HEAVY_SHARE * sum(others):
        text = f"what joint {mass.joint} moves with it has {mass.mass:.4g} kg"
        yield Doubt("mass-large", "link", link, text, "correct its mass, in kg")


def _center(arm: Description, i: int, mass: Mass, size: float, name: str) -> Iterator[Doubt]:
    """Whether the centre of mass is far from the lines between the joint and what is fixed to its link."""
    center = np.array(mass.center)
    ends = [np.zeros(3)]
    ends += [row[Column.TRANSLATION : Column.MASS] for row in rows(arm.tree) if row[Column.PARENT] == i]
    ends += [arm.links.placements[k, :, 3] for k in np.flatnonzero(arm.links.rows == i)]
    away = min(_distance(center, end) for end in ends)
    # Where nothing shows how long the last link is, it may be as long as the rest.
    ends_here = not any(np.any(end) for end in ends)
    if size > 0.0 and away > (1.0 if ends_here else _OUTSIDE) * size:
        yield Doubt(
            "center-outside",
            "link",
            name,
            f"its centre of mass is {away:.3g} m away from the line between its joints, on an arm of {size:.3g} m",
            "correct the origin of its inertial, in m and in the frame of the link",
        )


def _dense(name: str, inertial: Inertial) -> Iterator[Doubt]:
    """Whether a link has too little inertia for its mass."""
    principal = np.linalg.eigvalsh(inertial.inertia)
    ball = (3.0 * inertial.mass / (4.0 * math.pi * _LEAD)) ** (1.0 / 3.0)
    if 0.0 <= float(principal.sum()) < 2.0 * 0.6 * inertial.mass * ball**2:
        yield Doubt(
            "inertia-small",
            "link",
            name,
            f"its inertia, {principal[2]:.2g} kg m^2, is so small that its {inertial.mass:.3g} kg are denser than lead",
            "correct its inertia, in kg m^2 about the centre of mass, or its mass",
        )


def _wide(mass: Mass, size: float, name: str, inertial: Inertial) -> Iterator[Doubt]:
    """Whether a link, the one with the largest inertia of those that move together, has more than its size allows."""
    largest = float(np.linalg.eigvalsh(inertial.inertia)[2])
    gyration = math.sqrt(max(largest, 0.0) / inertial.mass) if inertial.mass > 0.0 else 0.0
    if size > 0.0 and gyration > _WIDE * size and largest > _MATTERS * mass.principal[2]:
        yield Doubt(
            "inertia-large",
            "link",
            name,
            f"its inertia, {largest:.3g} kg m^2, is that of {inertial.mass:.3g} kg {gyration:.2g} m away from its "
            f"centre, on an arm of {size:.3g} m",
            "correct its inertia, in kg m^2 about the centre of mass, or its mass",
        )


def _name_of_farthest(arm: Description, stated: dict[int, Inertial]) -> str:
    """The link whose mass moves the common centre of mass most."""
    return arm.links.names[max(stated, key=lambda k: stated[k].mass * float(np.linalg.norm(stated[k].center)))]


def _distance(point: Array, end: Array) -> float:
    """From a point to the line between the origin and an end, all of shape (3,), m."""
    length = float(end @ end)
    share = min(max(float(point @ end) / length, 0.0), 1.0) if length > 0.0 else 0.0
    return float(np.linalg.norm(point - share * end))
