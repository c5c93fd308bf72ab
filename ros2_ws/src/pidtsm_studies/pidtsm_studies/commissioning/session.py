"""A commissioning: its steps in order, and the folder that keeps what they have found, so that it can go on later."""

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from pidtsm_core.errors import UsageError
from pidtsm_core.robots import Description
from pidtsm_studies.commissioning import compare, excite, friction, gains, gravity, lateness, rest, springs
from pidtsm_studies.commissioning.arm import CommissionError, Wiring
from pidtsm_studies.commissioning.bench import ASSUMED, CAUTION, FIRMNESS, Bench, Follower, Outcome, Plan
from pidtsm_studies.commissioning.catch import FARTHEST
from pidtsm_studies.commissioning.loop import Samples
from pidtsm_studies.commissioning.model import ArmModel
from pidtsm_studies.commissioning.motions import Motion
from pidtsm_studies.commissioning.room import Room, TooNearError
from pidtsm_studies.commissioning.signs import Signs

STATE, SAMPLES = "session.json", "samples"
"""Names in the folder of a session."""
_FORMAT = 2
_FIRST, _OWN = "signs", "compare"
"""Names of the step that needs no controller, and of the one in which the arm makes its user's motion."""
_STUCK = 0.15
"""Share of its torque limit that a joint takes to break away when friction may be why a later step fails."""


@dataclass(frozen=True)
class Step:
    """A step after the first one; the state of the arm does not matter, except that it is held.

    Attributes:
        title: a few words.
        plan: what it will do.
        run: does it.
    """

    title: str
    plan: Callable[[Bench], Plan]
    run: Callable[[Bench], Outcome]


STEPS: Mapping[str, Step] = {
    "rest": Step("Noise, resolution and rate at rest", rest.plan, rest.run),
    "lateness": Step("Delay and lag", lateness.plan, lateness.run),
    "friction": Step("Friction", friction.plan, friction.run),
    "springs": Step("Springs and rotors", springs.plan, springs.run),
    "gravity": Step("Gravity", gravity.plan, gravity.run),
    "identify": Step("Inertias", excite.plan, excite.run),
    "gains": Step("Gains", gains.plan, gains.run),
    "compare": Step("Before against new", compare.plan, compare.run),
}
NAMES = (_FIRST, *STEPS)
"""Names of all steps in their order."""
TITLES = {_FIRST: "Signs", **{name: step.title for name, step in STEPS.items()}}


class Source(Protocol):
    """Where the arm comes from."""

    def signs(self, arm: Mapping[str, Any], /, tell: Callable[[str], None]) -> Signs:
        """Release the arm, see `find_signs`; `arm`: parameters of the controller that choose it."""

    def follower(self, step: int, /, wiring: Wiring) -> Follower:
        """What moves the arm in a later step, given by its place in `NAMES`."""


@dataclass(frozen=True)
class Subject:
    """What is commissioned.

    Attributes:
        arm: parameters of the controller that choose the arm.
        before: all parameters that the user had before.
        motion: what the arm is for; None: one about its home.
        described: its description.
        scene: path of the MJCF file of what is around it; empty: not known.
    """

    arm: Mapping[str, Any]
    before: Mapping[str, Any]
    motion: Motion | None
    described: Callable[[], Description]
    scene: str = ""


class RefusedError(Exception):
    """The person did not agree to a step."""


@dataclass
class Session:
    """A session in its folder.

    Attributes:
        folder: of the session.
        subject: what is commissioned.
        found: by name of the step, what `Outcome` has, as plain data.
        previous: the same of the time before, of steps that were repeated.
    """

    folder: Path
    subject: Subject
    found: dict[str, dict[str, Any]] = field(default_factory=dict)
    previous: dict[str, dict[str, Any]] = field(default_factory=dict)

    @classmethod
    def opened(cls, folder: Path, subject: Subject) -> "Session":
        """The session of a folder, or a new one.

        Raises:
            UsageError: the folder has something else, or a session of another arm.
        """
        file = folder / STATE
        if not file.exists():
            if folder.exists() and any(folder.iterdir()):
                raise UsageError(f"{folder} is not of a commissioning: name another folder")
            session = cls(folder, subject)
            session._keep()
            return session
        try:
            content = json.loads(file.read_text(encoding="utf-8"))
            given, found, previous = content["subject"], content["found"], content["previous"]
            if content["format"] != _FORMAT:
                raise KeyError
        except (ValueError, KeyError, TypeError):
            raise UsageError(f"{file} is damaged or of another version: name another folder") from None
        if given != _plain(subject):
            raise UsageError(f"{folder} is of another arm, or of other parameters: name another folder")
        return cls(folder, subject, found, previous)

    def repeat_from(self, step: str) -> None:
        """Forget what a step and all later ones have found; it is kept to be compared."""
        for name in NAMES[NAMES.index(step) :]:
            if name in self.found:
                self.previous[name] = self.found.pop(name)
        self._keep()

    @property
    def missing(self) -> tuple[str, ...]:
        """Steps that are still to be done."""
        return tuple(name for name in NAMES if name not in self.found)

    def run(
        self,
        source: Source,
        ask: Callable[[str, Plan], bool],
        tell: Callable[[str], None],
        keep: Callable[[Mapping[str, Samples]], None],
    ) -> None:
        """Do the missing steps, and keep the result of each at once.

        Args:
            source: of the arm.
            ask: whether the person agrees to a step (name, plan).
            tell: called with what is found on the way, and with the verdict of each step.
            keep: called with the recordings of each step, before the step counts as done.

        Raises:
            RefusedError: the person does not agree.
            CommissionError: a step cannot be completed; the same call begins with this step again.
        """
        for name in self.missing:
            if name == _FIRST:
                outcome = self._signs(source, ask, tell)
            else:
                bench = self.bench(source.follower(NAMES.index(name), self._wiring()), tell)
                if light := bench.too_light():
                    raise CommissionError(f"no controller moves this arm: {light}")
                plan = STEPS[name].plan(bench)
                if not ask(name, replace(plan, text=f"{plan.text.rstrip('.')}. {bench.room.sentence(bench.home)}")):
                    raise RefusedError
                try:
                    outcome = self._done(name, bench)
                    how = {FIRMNESS: bench.firmness, ASSUMED: bench.assumes_rotors}
                    outcome = replace(outcome, figures={**outcome.figures, **how})
                except CommissionError as reason:
                    raise CommissionError(f"{reason}{self._stuck(bench)}") from None
            keep(outcome.samples)
            self._add(name, outcome)
            tell(outcome.verdict)
            for problem in outcome.problems:
                tell(f"look: {problem}")

    def _done(self, name: str, bench: Bench) -> Outcome:
        """Do a later step; with smaller motions if one would touch something, unless it is the user's own."""
        while True:
            try:
                return STEPS[name].run(bench)
            except TooNearError as reason:
                if name == _OWN and bench.motion is not None:
                    raise CommissionError(f"{reason}: give another --motion") from None
                if not bench.room.narrow():
                    raise CommissionError(f"{reason}: begin at another posture, with --from signs") from None
                bench.tell(f"{reason}; once more with smaller motions")

    def _signs(self, source: Source, ask: Callable[[str, Plan], bool], tell: Callable[[str], None]) -> Outcome:
        model = ArmModel(self.subject.arm)
        text = (
            "The arm is released and carried by the torque of its model; each joint that does not move by itself gets "
            "a nudge. If a joint goes farther than allowed, commands cease, and it is tried again. Something must "
            "carry the arm until the first command and after the last: brakes, gears or a support; until they hold, a "
            "joint can go on: some have moved by 1 rad where brakes close after 0.05 s"
        )
        joints = len(model.joints)
        if not ask(_FIRST, Plan(text, np.full(joints, FARTHEST), 0.8 * model.effort, 2.0 + 1.5 * joints)):
            raise RefusedError
        signs = source.signs(self.subject.arm, tell)
        inverted = [
            f"{model.joints[j]}: {what} is inverted"
            for what, which in (("its position", signs.wiring.position), ("its torque", signs.wiring.effort))
            for j in np.flatnonzero(which < 0.0)
        ]
        figures = {
            "position": signs.wiring.position.tolist(),
            "effort": signs.wiring.effort.tolist(),
            "moved": signs.moved.tolist(),
            "known_by": list(signs.known_by),
            "breakaway": [None if np.isnan(each) else float(each) for each in signs.breakaway],
            "inertia": [None if np.isnan(each) else float(each) for each in signs.inertia],
            "hold": signs.hold.tolist(),
            "home": (signs.wiring.position * signs.position[0]).tolist(),
        }
        stamps = np.round(1e9 * signs.time).astype(np.int64)
        desired = np.stack([np.tile(signs.position[0], (len(stamps), 1)), *[np.zeros_like(signs.position)] * 2], axis=1)
        samples = {_FIRST: Samples(stamps, signs.position, signs.effort, desired, 0)}
        cure = "; correct this in the driver or in the description. This session goes on with it corrected"
        verdict = f"{'; '.join(inverted)}{cure}" if inverted else "all signs are as described"
        return Outcome(verdict, figures, [*inverted, *signs.problems], samples=samples)

    def _stuck(self, bench: Bench) -> str:
        """What to do about joints that took much torque to break away, as the end of a text; empty: there are none."""
        model, needed = bench.model(), self.found[_FIRST]["figures"]["breakaway"]
        stuck = [
            f"{joint} took {100.0 * each / limit:.0f} % of its torque limit to break away"
            for joint, each, limit in zip(model.joints, needed, model.effort, strict=True)
            if each is not None and each > _STUCK * limit
        ]
        cure = "which may be why: see to its brake and its gear, and begin again with --from signs"
        return f". {', '.join(stuck)}, {cure}" if stuck else ""

    def _wiring(self) -> Wiring:
        figures = self.found[_FIRST]["figures"]
        return Wiring(np.array(figures["position"]), np.array(figures["effort"]))

    def bench(self, loop: Follower, tell: Callable[[str], None]) -> Bench:
        """What the steps after the first have, with what is found so far."""
        subject = self.subject
        figures = {name: each["figures"] for name, each in self.found.items()}
        home = np.array(figures[_FIRST]["home"])
        known = [each for each in figures.values() if FIRMNESS in each]
        firmness, assumed = (known[-1][FIRMNESS], known[-1].get(ASSUMED, False)) if known else (CAUTION, False)
        told = (subject.arm, subject.before, subject.motion, home, loop, figures, tell, subject.described, self._room)
        return Bench(*told, float(firmness), assumed)

    @cached_property
    def _room(self) -> Room:
        return Room(self.subject.arm, self.subject.scene)

    def _add(self, name: str, outcome: Outcome) -> None:
        self._keep_samples(outcome.samples)
        self.found[name] = json.loads(
            json.dumps(
                {
                    "verdict": outcome.verdict,
                    "problems": list(outcome.problems),
                    "figures": outcome.figures,
                    "parameters": {key: list(pair) for key, pair in outcome.parameters.items()},
                    "samples": list(outcome.samples),
                },
                allow_nan=False,
            )
        )
        self._keep()

    def _keep_samples(self, samples: Mapping[str, Samples]) -> None:
        place = self.folder / SAMPLES
        place.mkdir(parents=True, exist_ok=True)
        for name, each in samples.items():
            unfinished = place / f".{name}.npz"
            np.savez_compressed(unfinished, **each.as_arrays())
            unfinished.replace(place / f"{name}.npz")

    def _keep(self) -> None:
        """Write the state as a whole: whoever is killed meanwhile leaves the old or the new one."""
        self.folder.mkdir(parents=True, exist_ok=True)
        content = {
            "format": _FORMAT,
            "subject": _plain(self.subject),
            "found": self.found,
            "previous": self.previous,
        }
        unfinished = self.folder / f".{STATE}"
        with unfinished.open("w", encoding="utf-8") as file:
            json.dump(content, file, indent=1, allow_nan=False)
            file.flush()
            os.fsync(file.fileno())
        unfinished.replace(self.folder / STATE)

    def samples(self, name: str) -> Samples:
        """A recording by its name."""
        with np.load(self.folder / SAMPLES / f"{name}.npz") as file:
            return Samples(file["stamps"], file["position"], file["effort"], file["desired"], int(file["begin"]))


def _plain(subject: Subject) -> Any:
    """What must be the same when a session goes on, as JSON has it."""
    motion = None if subject.motion is None else subject.motion.states[0].tolist()
    content = {"arm": dict(subject.arm), "before": dict(subject.before), "motion": motion}
    if subject.scene:
        content["scene"] = subject.scene
    return json.loads(json.dumps(content, default=list))
