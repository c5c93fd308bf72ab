"""Which joints of a description are the arm: the chain from the base to the tool, without its gripper."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pidtsm_core.robots.compiler import COUPLE, HINGE, ON_JOINT, SLIDE
from pidtsm_core.robots.errors import DescriptionError

_LIGHT, _TINY = 0.1, 0.03
"""Largest mass of a gripper, and of one that only its place shows, relative to that of the arm before it."""
HAND = 0.2
"""Largest mass of all fingers of a hand, relative to that of the arm before it."""
_STROKE, _OPENING = 0.08, 2.0
"""Largest range of a sliding finger (m), and of a turning one that only its place shows (rad)."""
_WORDS = ("gripper", "finger", "jaw", "knuckle", "claw", "thumb")
_LEAST = 2
"""Joints that an arm has at least before its gripper."""
_SHOWN = 6
"""Chains that a message lists at most."""


@dataclass(frozen=True)
class Chain:
    """The joints of an arm.

    Attributes:
        joints: their names, from the base.
        grippers: joints behind them that look like those of a gripper, and why, in a few words.
    """

    joints: tuple[str, ...]
    grippers: Mapping[str, str] = field(default_factory=dict)


def find_chain(model: Any, names: Sequence[str]) -> Chain:
    """The chain from the base to the first link that has several moving children, or none.

    A gripper or a hand ends it: joints with little mass behind an arm, see `_Tree.gripper`. In a description with
    motors, bodies that no motor moves do not count: they are surroundings.

    Args:
        model: of type ``mujoco.MjModel``.
        names: of its joints.

    Raises:
        DescriptionError: no joint moves, or several chains begin at a link, each as long as the one that leads there.
    """
    tree = _Tree(model, names)
    chains = tree.chains()
    if not chains:
        raise DescriptionError("there is no chain of movable joints from the base: no joint moves")
    if len(chains) == 1:
        return chains[0]
    common = tree.trunk()
    if len(common) <= max(len(chain.joints) for chain in chains) - len(common):
        where = f"behind joint {common[-1]}" if common else "at the base"
        raise DescriptionError(f"several chains of movable joints begin {where}; {_choices(chains)}")
    return Chain(common)


def how_to_choose(model: Any, names: Sequence[str]) -> str:
    """How the user chooses the joints, with the chains that there are."""
    return _choices(_Tree(model, names).chains())


def _choices(chains: Sequence[Chain]) -> str:
    """How to choose one of the chains, the longest first."""
    longest = sorted(chains, key=lambda chain: -len(chain.joints))
    shown = " or ".join(f"--joints {','.join(chain.joints)}" for chain in longest[:_SHOWN])
    more = f" (or {len(chains) - _SHOWN} others)" if len(chains) > _SHOWN else ""
    return f"choose the joints, of a node with its parameter joints: {shown}{more}"


class _Tree:
    """The moving bodies of a compiled model."""

    def __init__(self, model: Any, names: Sequence[str]) -> None:
        self._model, self._names = model, names
        self._driven = _driven(model)
        self._children: dict[int, list[int]] = {}
        for body in range(1, model.nbody):
            self._children.setdefault(int(model.body_parentid[body]), []).append(body)

    def chains(self) -> list[Chain]:
        """All chains from the base to a tool."""
        return [self._without_gripper(path) for path in self._paths([])]

    def trunk(self) -> tuple[str, ...]:
        """Joints from the base to the first link with several moving children, or none."""
        path: list[int] = []
        while len(following := self._moving(path[-1] if path else 0)) == 1:
            path += following
        return self._joints(path)

    def _paths(self, path: list[int]) -> Iterator[list[int]]:
        """All ways on from a path of moving bodies to the ends of the tree, or to a hand."""
        following = self._moving(path[-1] if path else 0)
        if not following or self._is_hand(path, following):
            if path:
                yield path
            return
        for body in following:
            yield from self._paths([*path, body])

    def _moving(self, body: int, undriven: bool = False) -> list[int]:
        """The next moving bodies, without those that no motor moves unless `undriven`."""
        children = self._children.get(body, [])
        below = [child for child in children if undriven or not self._driven or child in self._driven]
        return [
            b for child in below for b in ([child] if self._model.body_jntnum[child] else self._moving(child, undriven))
        ]

    def _joints(self, path: Sequence[int]) -> tuple[str, ...]:
        m = self._model
        first = [int(m.body_jntadr[body]) for body in path]
        return tuple(
            self._names[joint]
            for body, start in zip(path, first, strict=True)
            for joint in range(start, start + int(m.body_jntnum[body]))
        )

    def _mass(self, path: Sequence[int]) -> float:
        """Mass of the moving bodies of a path, with what is fixed to them, kg."""
        below = self._model.body_subtreemass
        return float(sum(below[body] - sum(below[b] for b in self._moving(body, undriven=True)) for body in path))

    def _is_hand(self, path: Sequence[int], following: Sequence[int]) -> bool:
        """Whether the bodies behind a path are the fingers of a hand."""
        fingers = sum(self._model.body_subtreemass[body] for body in following)
        return len(following) > 1 and len(path) >= _LEAST and bool(fingers <= HAND * self._mass(path))

    def _without_gripper(self, path: list[int]) -> Chain:
        """The chain of a path that ends before its gripper."""
        fingers = self._moving(path[-1], undriven=True)
        grippers: dict[str, str] = {}
        for body in fingers if self._is_hand(path, fingers) else ():
            reason = f"side by side behind {self._joints(path)[-1]}"
            grippers |= dict.fromkeys(self._joints(list(self._below(body))), reason)
        while len(path) > _LEAST and (reason := self.gripper(path)):
            *path, last = path
            grippers = {**dict.fromkeys(self._joints([last]), reason), **grippers}
        return Chain(self._joints(path), grippers)

    def _below(self, body: int) -> Iterator[int]:
        """A moving body and all that move with it."""
        yield body
        for child in self._moving(body, undriven=True):
            yield from self._below(child)

    def gripper(self, path: Sequence[int]) -> str:
        """Why the last body of a path is part of a gripper; empty: it is not.

        It is light, and its name shows it, or its joint is coupled to another one, or beside another one with a light
        body, or it slides a few centimetres only, or it is tiny, opens and closes, and is beside a heavier body on
        the same link.
        """
        m, (*before, body) = self._model, path
        moved, arm = float(m.body_subtreemass[body]), self._mass(before)
        if m.body_jntnum[body] != 1 or moved > _LIGHT * arm:
            return ""
        joint = int(m.body_jntadr[body])
        name, link = self._names[joint], str(m.body(body).name)
        extent = float(np.ptp(m.jnt_range[joint])) if m.jnt_limited[joint] else np.inf
        turns, slides = (m.jnt_type[joint] == kind for kind in (HINGE, SLIDE))
        beside = [other for other in self._moving(before[-1], undriven=True) if other != body]
        light = sum(m.body_subtreemass[other] for other in beside) <= _LIGHT * arm
        coupled = self._coupled_to(joint)
        tiny = moved <= _TINY * arm and extent <= _OPENING and self._fixed_beside(body)
        signs = {
            f"beside {', '.join(self._joints(beside[:1]))}": beside and light,
            f"coupled to {coupled}": coupled,
            f"by its name, and it moves only {moved:.2g} kg": any(word in f"{name} {link}".lower() for word in _WORDS),
            f"it slides {1e3 * extent:.0f} mm only": slides and extent <= _STROKE,
            f"it moves only {moved:.2g} kg, beside a fixed part": turns and tiny,
        }
        return next((reason for reason, holds in signs.items() if holds), "")

    def _coupled_to(self, joint: int) -> str:
        """Name of the joint that mimics a joint, or that it mimics; empty: there is none."""
        m = self._model
        for i in np.flatnonzero(m.eq_type == COUPLE):
            pair = [int(m.eq_obj1id[i]), int(m.eq_obj2id[i])]
            if joint in pair:
                other = pair[1 - pair.index(joint)]
                return self._names[other] if other >= 0 else "a constant"
        return ""

    def _fixed_beside(self, body: int) -> bool:
        """Whether the link that carries a body carries also a part without joint that is at least as heavy."""
        m = self._model
        siblings = [each for each in self._children[int(m.body_parentid[body])] if each != body]
        heavy = (m.body_subtreemass[each] >= m.body_subtreemass[body] for each in siblings if not m.body_jntnum[each])
        return any(heavy)


def _driven(model: Any) -> set[int]:
    """The bodies with a motor at one of their joints, and those between them and the base."""
    on_joints = model.actuator_trnid[model.actuator_trntype == ON_JOINT, 0]
    found: set[int] = set()
    for joint in on_joints:
        body = int(model.jnt_bodyid[joint])
        while body:
            found.add(body)
            body = int(model.body_parentid[body])
    return found
