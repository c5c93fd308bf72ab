"""The state of a system in plain words."""

from dataclasses import dataclass
from html import escape

from pidtsm_core.control.report import cause
from pidtsm_core.signals import Mode
from pidtsm_msgs.msg import ControllerState

GREEN, AMBER, RED, GREY = "#2f9e44", "#e8890c", "#d6336c", "#868e96"
_FINE = "running"
"""What a node reports whose loop ran in the last second."""
LATE = 0.5
"""s without a state of the controller, which then does not run, or is not active."""
OLD = 1.0
"""s without a state of the controller, after which its figures no longer hold."""


@dataclass(frozen=True)
class Sentence:
    """One sentence, and how much it matters.

    Attributes:
        text: the sentence.
        color: `GREEN`, `AMBER`, `RED` or `GREY`.
    """

    text: str
    color: str


@dataclass(frozen=True)
class Known:
    """What is known of the controller and of the source of its joint states.

    Attributes:
        newest: last state of the controller; None: none has arrived.
        silence: time since then, s.
        since: time of day of the last state.
        report: what the controller has reported on /diagnostics since then; empty: nothing.
        alive: whether the controller has sent something lately.
        ended: how its process has ended; empty: it runs, or is not known.
        missing: why there are no joint states; empty: not known.
        held: whether the controller holds the arm on request; None: not known.
    """

    newest: ControllerState | None
    silence: float = 0.0
    since: str = ""
    report: str = ""
    alive: bool = False
    ended: str = ""
    missing: str = ""
    held: bool | None = False


def mode(known: Known) -> Sentence:
    """What the controller does, and why it has stopped if it has."""
    newest = known.newest
    if known.ended:
        return Sentence(f"The controller {known.ended}", RED)
    if newest is None or known.silence > LATE:
        return _silent(known)
    if reason := fault(newest):
        return Sentence(f"Stopped: {reason}. It holds the arm until the fault is reset", RED)
    reasons = {True: " on request", False: ": the reference is missing or too old", None: ""}
    sentences = {
        Mode.FOLLOWING: Sentence("Following the reference", GREEN),
        Mode.HOLDING: Sentence(f"Holding its position{reasons[known.held]}", AMBER),
        Mode.FREEDRIVE: Sentence("Freedrive: the arm can be moved by hand", AMBER),
    }
    return sentences.get(newest.mode, Sentence(f"In mode {newest.mode}", AMBER))


def fault(newest: ControllerState) -> str:
    """Why the controller has stopped; empty: it has not."""
    if not newest.fault:
        return ""
    try:
        return cause(newest.fault, newest.fault_joint, newest.name)
    except (ValueError, IndexError, KeyError):  # of another version
        return f"fault {newest.fault}"


def _silent(known: Known) -> Sentence:
    if known.report.startswith("inactive"):
        return Sentence(f"The controller is {known.report}{_because(known.missing)}", AMBER)
    if known.newest is None and not known.missing:
        return Sentence("Waiting for the controller", GREY)
    text = (
        f"No state of the controller since {known.since}" if known.newest is not None else "No state of the controller"
    )
    if known.report not in ("", _FINE):
        return Sentence(f'{text}: it runs, and reports "{known.report}"{_because(known.missing)}', RED)
    if known.alive:
        return Sentence(f"{text}{_because(known.missing)}", RED)
    return Sentence(f"{text}: it does not run, or does not answer", RED)


def _because(missing: str) -> str:
    return f"; {missing}" if missing else ""


def loop(known: Known) -> str:
    """Rate, age and missed deadlines as they are now."""
    newest = known.newest
    if newest is None:
        return ""
    if known.silence > OLD:
        return f"0 commands per second · no data since {known.since}"
    return (
        f"{newest.rate:.0f} commands per second · age of the last joint state {newest.state_age * 1e3:.2f} ms · "
        f"{newest.missed_deadlines:.0f} missed deadlines"
    )


def badge(text: str, color: str) -> str:
    """A coloured label as HTML."""
    return (
        f'<span style="background:{color};color:white;border-radius:4px;padding:2px 8px;font-weight:600">'
        f"{escape(text)}</span>"
    )
