"""What a step has: the arm, what is known of it so far, and the controllers it may use; and what it returns."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.experiment.gains import first_gains, rotors
from pidtsm_core.experiment.hardware_gains import PRESSES, Drivetrain, error_gain, make_drives
from pidtsm_core.experiment.law_gains import Gain, Known, gains_of_law, rounded
from pidtsm_core.experiment.loop_margin import Drives
from pidtsm_core.robots import Description, robot_schema
from pidtsm_studies.commissioning.arm import StoppedError
from pidtsm_studies.commissioning.elastic_joints import Side
from pidtsm_studies.commissioning.loop import Samples
from pidtsm_studies.commissioning.model import ArmModel
from pidtsm_studies.commissioning.motions import Motion
from pidtsm_studies.commissioning.room import Room

CAUTIOUS_BITS, CAUTIOUS_DELAY = 12, 0.008
"""Resolution and delay (s) that are assumed until they are measured: gains for them are low."""
FIRMNESS, ASSUMED = "firmness", "assumes_rotors"
"""Names of figures of each step: see `Bench`."""
CAUTION = 0.7
"""Share of the bandwidth of the rule that the first step begins with."""
FIRMEST = 1.4
"""The largest share that is tried if no other has followed."""
_OTHERS = (1.0, FIRMEST, 0.5, 0.35)
"""Shares that are tried, in this order, when the controller has stopped the arm: friction needs a firm one most often.
"""
_SURELY = 0.8
"""Share of the friction of the sweeps that is compensated until the arm is identified."""
_NUDGED = 0.4
"""Share of the torque of a nudge that is compensated until then: it takes more to break away than to slide."""
ERROR, _ROOM = 0.3, 3.0
"""The arm is stopped at this tracking error, rad, and at this multiple of the velocity that a step needs."""
_SLIDING, _INSIDE = 0.3, 0.85
"""m of a joint that slides that count as much as 1 rad; and share of the way to its nearest limit that a joint may go:
what sticks overshoots.
"""
ARMATURE, _HEAVIER = "robot.armature", 1.4
"""Parameter of the rotors, and ratio of shown and described inertia from which on they are taken for not described."""
_QUICKEST = 2000.0
"""rad/s^2; the torque limit of a joint that turns accelerates it by less, because motors have rotors."""
_BARE = 150.0
"""rad/s^2, by which the torque limit accelerates a rotor that is assumed; hardware of the class geared has 200."""
_BANDWIDTH = "estimator.bandwidth"
_SURE = 0.0005
"""s; the delay that a whole motion shows counts if its standard deviation is smaller."""


@dataclass(frozen=True)
class Plan:
    """What a step will do, for the consent of a person.

    Attributes:
        text: what moves and why, a sentence.
        travel: farthest way of each joint from where the arm is now, shape (joints,), rad or m.
        effort: largest torque of each joint, likewise, N m or N.
        duration: s.
    """

    text: str
    travel: Array
    effort: Array
    duration: float


@dataclass(frozen=True)
class Outcome:
    """What a step has found.

    Attributes:
        verdict: a sentence.
        figures: plain data, which later steps and reports read.
        problems: sentences, each about something that a person should look at.
        parameters: values for the controller, by name, with the reason.
        samples: recordings, by name.
    """

    verdict: str
    figures: dict[str, Any]
    problems: Sequence[str] = ()
    parameters: Mapping[str, tuple[Any, str]] = field(default_factory=dict)
    samples: Mapping[str, Samples] = field(default_factory=dict)


class Follower(Protocol):
    """What moves the arm, see `Loop`."""

    @property
    def period(self) -> float:
        """Nominal time between joint states, s."""

    def follow(self, settings: Mapping[str, Any], motion: Motion) -> Samples:
        """See `Loop.follow`."""


@dataclass
class Bench:
    """An arm under commission.

    Attributes:
        arm: parameters of the controller that choose the arm as its user describes it.
        before: parameters of the controller that the user had before, with the arm.
        motion: what the arm is for, relative to nothing: it begins and ends at rest; None: one about its home.
        home: posture in which the arm is now, shape (joints,).
        loop: runs controllers.
        found: figures of the steps that are done, by name.
        tell: called with what a step finds on its way.
        described: the description of the arm as its user has it.
        room: where the arm may move.
        firmness: share of the bandwidth of the rule with which the arm has followed so far.
        assumes_rotors: whether the arm has followed only with rotors assumed where none are known.
    """

    arm: Mapping[str, Any]
    before: Mapping[str, Any]
    motion: Motion | None
    home: Array
    loop: Follower
    found: Mapping[str, Mapping[str, Any]]
    tell: Callable[[str], None]
    described: Callable[[], Description]
    room: Room
    firmness: float = CAUTION
    assumes_rotors: bool = False
    _rules: dict[bool, tuple[Gain, ...]] = field(default_factory=dict, init=False)

    def follow(self, motion: Motion, velocity: float = 1.0, error: float = ERROR, again: float = ERROR) -> Samples:
        """Follow a motion; if the controller stops the arm, from its begin again with firmer and softer ones.

        If none of them follows, once more with rotors assumed: some arms have joints that nearly undo each other, and
        their description without rotors accelerates by a fraction of the torque that it takes.

        Args:
            motion: the motion.
            velocity: largest one that it needs, rad/s.
            error: tracking error at which the arm is stopped, rad.
            again: the same, when it is tried again.

        Raises:
            CommissionError: the arm cannot be followed, or would touch something.
        """
        self.room.check(self.home, motion)
        try:
            return self._follow(motion, velocity, error, again)
        except StoppedError as reason:
            if self.assumes_rotors or self._is_identified or not self._lack_rotors.any():
                raise
            self.tell(f"{reason}; once more with rotors assumed that the description lacks")
            self.assumes_rotors = True
            return self._follow(motion, velocity, again, again)

    def _follow(self, motion: Motion, velocity: float, error: float, again: float) -> Samples:
        """See `follow`."""
        others = [share for share in _OTHERS if share != self.firmness]
        for share in others:
            try:
                return self.loop.follow(self.controller(velocity=velocity, error=error), motion)
            except StoppedError as reason:
                word = "firmer" if share > self.firmness else "softer"
                self.tell(f"{reason}; once more with a {word} controller ({share:g} times the rule's bandwidth)")
                self.firmness, error = share, again
        return self.loop.follow(self.controller(velocity=velocity, error=error), motion)

    @property
    def identified(self) -> dict[str, Any]:
        """Parameters of the controller that choose the arm as far as it is identified."""
        found = self.found.get("identify", {}).get("parameters", {})
        return {**self.arm, **found} if found else {**self.arm, **self._rotors()}

    @property
    def _is_identified(self) -> bool:
        """Whether the bodies of the arm are identified, and not as described."""
        return "parameters" in self.found.get("identify", {})

    @property
    def rotors(self) -> Array:
        """Inertias of the rotors as the joints see them, as far as they are known, shape (joints,), kg m^2 or kg."""
        return rotors(self.identified)

    @property
    def swung(self) -> Array | None:
        """Inertias of the rotors that were seen to swing on their springs, shape (joints,), kg m^2; None: none were."""
        swung = self.found.get("springs", {}).get("rotor")
        return None if swung is None else np.array(swung)

    @property
    def takes_rotors(self) -> bool:
        """Whether the arm has a parameter for its rotors."""
        return any(parameter.name == ARMATURE for parameter in robot_schema(self.arm))

    def _rotors(self) -> dict[str, Any]:
        """Inertias of the rotors that were found or are assumed and the description lacks, if it can have them."""
        if not self.takes_rotors:
            return {}
        if self.swung is not None:
            return {ARMATURE: self.swung.tolist()}
        more, own = self._shown_rotors, rotors(self.arm)
        if self.assumes_rotors:
            more = more + np.where(self._lack_rotors, ArmModel(self.arm).effort / _BARE, 0.0)
        return {ARMATURE: (own + more).tolist()} if more.any() else {}

    def rotors_by_reason(self) -> dict[str, tuple[Any, str]]:
        """The parameter for rotors that neither a step has measured nor the identified arm has, with its reason."""
        if self.swung is not None or self._is_identified:
            return {}
        shown = ["shown by joints in the first step"] if self._shown_rotors.any() else []
        assumed = ["assumed, because no controller followed without"] if self.assumes_rotors else []
        reason = f"rotors {' or '.join([*shown, *assumed])}"
        return {name: (value, reason) for name, value in self._rotors().items()}

    @property
    def _shown_rotors(self) -> Array:
        """Inertias by which joints were heavier in the first step than described, shape (joints,), kg m^2 or kg."""
        described = np.diag(ArmModel(self.arm).inertia(self.home))
        shown = np.array([each or 0.0 for each in self.found.get("signs", {}).get("inertia", [0.0] * described.size)])
        return np.asarray(np.where(shown > _HEAVIER * described, shown - described, 0.0))

    @property
    def _lack_rotors(self) -> NDArray[np.bool_]:
        """Joints that turn and of whose rotors nothing is known, shape (joints,)."""
        model = ArmModel(self.arm)
        shown = self.found.get("signs", {}).get("inertia", [None] * len(model.joints))
        unknown = np.array([each is None for each in shown]) & (rotors(self.arm) == 0.0) & ~model.slides
        return np.asarray(unknown & self.takes_rotors & (self.swung is None))

    def too_light(self) -> str:
        """Why no controller may move the arm: joints that lack the rotors of their motors; empty: it may."""
        if not self.takes_rotors:
            return ""
        model = self.model()
        quick = np.where(model.slides, 0.0, model.effort / np.diag(model.inertia(self.home)))
        shown = self.found.get("signs", {}).get("inertia", [None] * quick.size)
        light = [
            f"{model.joints[j]} by {quick[j]:.2g} rad/s^2"
            for j in np.flatnonzero(quick > _QUICKEST)
            if shown[j] is None
        ]
        cure = (
            f"which surely lacks rotors, and the first step has not found them: begin a new session with --set "
            f"controller.{ARMATURE}=... (kg m^2)"
        )
        return f"torque limits accelerate {', '.join(light)} by the description, {cure}" if light else ""

    def model(self, identified: bool = True) -> ArmModel:
        """The bodies of the arm, as far as they are identified or as its user describes them."""
        return ArmModel(self.identified if identified else self.arm)

    @property
    def rate(self) -> float:
        """Joint states per second."""
        return float(self.found.get("rest", {}).get("rate", 1.0 / self.loop.period))

    def reach(self, model: ArmModel, most: float) -> Array:
        """How far each joint may move to either side of home, shape (joints,), rad or m.

        Args:
            model: the arm.
            most: no joint that turns moves farther, rad.

        Raises:
            CommissionError: see `Room.reach`.
        """
        inside = _INSIDE * np.minimum(model.upper - self.home, self.home - model.lower)
        return self.room.reach(self.home, np.clip(inside, 0.0, np.where(model.slides, _SLIDING * most, most)))

    def bandwidth(self) -> Array:
        """Bandwidth of the observer by the rule, for what was measured so far, shape (joints,), rad/s."""
        return np.array(next(gain.value for gain in self._rule if gain.name == _BANDWIDTH), dtype=float)

    @property
    def _rule(self) -> tuple[Gain, ...]:
        """The gains of the rule for what was measured so far."""
        if self.assumes_rotors not in self._rules:
            known = (self.identified, self.bits, self.delay, self.rate)
            self._rules[self.assumes_rotors] = first_gains(*known, drives=self._drives)
        return self._rules[self.assumes_rotors]

    @property
    def knows_springs(self) -> bool:
        """Whether the observer knows the springs of the gears."""
        return any(gain.name == "estimator.stiffness" for gain in self._rule)

    @property
    def _drives(self) -> Drives | None:
        """The drives with their springs; None: no springs are known."""
        springs = self.found.get("springs", {})
        stiffness = np.where(self.rotors > 0.0, springs.get("stiffness", 0.0), 0.0)
        if not stiffness.any():
            return None
        whole, on_motor = int(self.delay * self.rate), springs["encoder"] == Side.MOTOR.value
        train = Drivetrain(self.rotors, stiffness, np.array(springs["damping"]), on_motor)
        return make_drives(self.rate, whole, self.delay - whole / self.rate, train, observed=True)

    @property
    def bits(self) -> int:
        """Resolution of the positions, see `first_gains`."""
        return int(self.found.get("rest", {}).get("bits", CAUTIOUS_BITS))

    @property
    def delay(self) -> float:
        """From a position to the torque that answers it, s."""
        if "delay" in (springs := self.found.get("springs", {})):
            return float(springs["delay"])
        moved = self.found.get("identify", {})
        if moved.get("delay_deviation", np.inf) < _SURE:
            return max(0.0, float(moved["delay"]) - 0.5 / self.rate)
        return float(self.found.get("lateness", {}).get("delay", CAUTIOUS_DELAY))

    def controller(self, bandwidth: Array | None = None, velocity: float = 1.0, error: float = ERROR) -> dict[str, Any]:
        """Parameters of the controller for a step.

        Args:
            bandwidth: of the observer, shape (joints,), rad/s; None: `firmness` times that of the rule.
            velocity: largest one that the step needs, rad/s.
            error: tracking error at which the arm is stopped, rad.
        """
        bandwidth = self.firmness * self.bandwidth() if bandwidth is None else bandwidth
        gains = {gain.name: gain.value for gain in self.gains(bandwidth)}
        return {**self.identified, **gains, **self.compensation, **self.safeguards(velocity, error)}

    def safeguards(self, velocity: float, error: float = ERROR) -> dict[str, Any]:
        """Limits for a step, see `limits`; as long as the model is in doubt, measurements are not: stops must see."""
        return {**self.limits(velocity, error), "plausibility.velocity": 0.0}

    def limits(self, velocity: float, error: float = ERROR) -> dict[str, Any]:
        """Limits at which the controller stops, for a motion that needs this velocity, rad/s, and error, rad."""
        errors = np.where(self.model().slides, _SLIDING * error, error)
        return {"limits.tracking_error": errors.tolist(), "limits.velocity": _ROOM * velocity}

    @property
    def compensation(self) -> dict[str, Any]:
        """Friction that the controller may compensate, as far as it is known."""
        identified = self.found.get("identify", {}).get("parameters", {})
        if identified:
            return {name: value for name, value in identified.items() if name.startswith("compensation.")}
        if swept := self.found.get("friction"):
            return {"compensation.coulomb": [_SURELY * each for each in swept["coulomb"]]}
        nudged = self.found.get("signs", {}).get("breakaway", [])
        return {"compensation.coulomb": [_NUDGED * (each or 0.0) for each in nudged]} if nudged else {}

    def gains(self, bandwidth: Array) -> tuple[Any, ...]:
        """The gains of the rule for a bandwidth, shape (joints,), rad/s, as `Gain`s."""
        chosen = np.array(rounded(bandwidth))
        observer = next(gain for gain in self._rule if gain.name == _BANDWIDTH)
        model = self.model()
        steps = np.where(model.slides, 1.0, 2.0 * np.pi) / 2.0**self.bits
        known = Known(bandwidth=chosen, steps=steps, inertia=np.diag(model.inertia(self.home)))
        law = str(next(gain.value for gain in self._rule if gain.name == "law.name"))
        own = gains_of_law(law, known)
        changed = {_BANDWIDTH, *(gain.name for gain in own)}
        fixed = [gain for gain in self._rule if gain.name not in changed]
        return (*fixed, Gain(observer.name, tuple(chosen.tolist()), observer.reason), *own, *self._pressing(steps))

    def _pressing(self, steps: Array) -> tuple[Gain, ...]:
        """How the error presses joints that stick, once their friction is identified; steps: of the encoders."""
        friction = self.compensation.get("compensation.coulomb")
        if friction is None or "identify" not in self.found:
            return ()
        model = self.model()
        presses = error_gain(np.array(friction), model.effort, float(steps.max()))
        return (Gain("compensation.error_gain", rounded(presses), PRESSES),) if presses.any() else ()

    def plan(self, text: str, motion: Motion, model: ArmModel) -> Plan:
        """The plan of a step that follows a motion."""
        few = motion.states[:, :: max(1, motion.states.shape[1] // 60)]
        needed = np.abs(model.torque(*few)).max(axis=0)
        travel = np.abs(motion.states[0] - self.home).max(axis=0)
        return Plan(text, travel, np.minimum(1.3 * needed + 0.1 * model.effort, model.effort), motion.duration)
