"""Where an arm under commission has room to move: clear of itself, and of what is around it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import ParameterError
from pidtsm_core.simulation.clearance import Clearance, free_box
from pidtsm_studies.commissioning.arm import CommissionError
from pidtsm_studies.commissioning.motions import STEP, Motion

_CLEAR, _NEAREST = 0.02, 0.005
"""m; kept where a motion is made, and of the motion itself: the former is judged in single postures."""
_NARROWER, _NARROWEST = 0.8, 0.25
"""Shares of the room by which it is narrowed, and that are left at least."""
_EVERY = 10
"""States of a motion from one that is judged to the next."""


class TooNearError(CommissionError):
    """A motion would touch something."""


class Room:
    """Judges postures by the shapes of the arm and of its surroundings.

    Attributes:
        scene: path of the MJCF file of the surroundings; empty: only the arm itself is known.
    """

    def __init__(self, arm: Mapping[str, Any], scene: str) -> None:
        """Args: arm: parameters of the controller that choose it; scene: see the class."""
        self._arm, self.scene = arm, scene
        self._clearance: Clearance | None = None
        self._boxes: dict[bytes, Array] = {}
        self._share = 1.0
        self._cause = ""

    def _at(self, home: Array) -> Clearance | None:
        """The shapes about home, shape (joints,), rad or m; None: the arm has none, and there is no scene.

        Raises:
            CommissionError: the scene cannot be read, or the arm is too near to it at home.
        """
        if self._cause or (self._clearance is not None and (self._clearance.home == home).all()):
            return self._clearance
        try:
            clearance = Clearance(self._arm, self.scene, home, _CLEAR)
        except ParameterError as error:
            if self.scene:
                raise CommissionError(str(error)) from None
            self._cause = str(error)
            return None
        if near := clearance.too_near(home, _CLEAR):
            raise CommissionError(
                f"where the arm is now, {near} are nearer to each other than {100.0 * _CLEAR:g} cm: move the arm away, "
                "and begin again with --from signs"
            )
        self._clearance = clearance
        return clearance

    def reach(self, home: Array, most: Array) -> Array:
        """How far each joint may be from home, shape (joints,), at most `most`, likewise, rad or m.

        Raises:
            CommissionError: see above.
        """
        clearance, key = self._at(home), home.tobytes() + most.tobytes()
        if clearance is None:
            return most
        if key not in self._boxes:
            self._boxes[key] = free_box(clearance, most)
        return self._share * self._boxes[key]

    def narrow(self) -> bool:
        """Make motions smaller from now on, as postures did not show what one touches; returns whether they may be."""
        self._share *= _NARROWER
        return self._share > _NARROWEST

    def check(self, home: Array, motion: Motion) -> None:
        """Check that a motion from home, shape (joints,), rad or m, touches nothing.

        Raises:
            TooNearError: it does.
            CommissionError: see above.
        """
        clearance = self._at(home)
        if clearance is None:
            return
        for k in range(0, motion.states.shape[1], _EVERY):
            if near := clearance.too_near(motion.states[0, k], _NEAREST):
                apart = f"nearer to each other than {1e3 * _NEAREST:g} mm"
                raise TooNearError(f"the motion would bring {near} {apart} after {STEP * k:.1f} s")

    def sentence(self, home: Array) -> str:
        """What is known of collisions about home, shape (joints,), rad or m, for a person who shall agree to a motion.

        Raises:
            CommissionError: see above.
        """
        if self._at(home) is None:
            return f"Nothing is known of collisions ({self._cause}): look that there is room."
        if self.scene:
            return f"The arm keeps clear of itself and of {Path(self.scene).name}; look that nothing else is near."
        return "The arm keeps clear of itself; look that nothing else is near."
