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
class Heard:
    """What is known of the controller and of the source of its joint states.

    Attributes:
        newest: last state of the controller; None: none has arrived.
        silence: time since then, s.
        since: time of day of the last state.
        report: what the controller has reported on /diagnostics since then; empty: nothing.
        alive: whether the controller was heard lately.
        ended: how its process has ended; empty: it runs, or is not known.
        missing: why there are no joint states; empty: not known.
        held: whether the controller was told to hold the arm; None: not known.
    """

    newest: ControllerState | None
    silence: float = 0.0
    since: str = ""
    report: str = ""
    alive: bool = False
    ended: str = ""
    missing: str = ""
    held: bool | None = False


def mode(heard: Heard) -> Sentence:
    """What the controller does, and why it has stopped if it has."""
    newest = heard.newest
    if heard.ended:
        return Sentence(f"The controller {heard.ended}", RED)
    if newest is None or heard.silence > LATE:
        return _silent(heard)
    if reason := fault(newest):
        return Sentence(f"Stopped: {reason}. It holds the arm until the fault is reset", RED)
    reasons = {True: ", as it was told to", False: ": the reference is missing or too old", None: ""}
    sentences = {
        Mode.FOLLOWING: Sentence("Following the reference", GREEN),
        Mode.HOLDING: Sentence(f"Holding its position{reasons[heard.held]}", AMBER),
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


def _silent(heard: Heard) -> Sentence:
    if heard.report.startswith("inactive"):
        return Sentence(f"The controller is {heard.report}{_because(heard.missing)}", AMBER)
    if heard.newest is None and not heard.missing:
        return Sentence("Waiting for the controller", GREY)
    text = (
        f"No state of the controller since {heard.since}" if heard.newest is not None else "No state of the controller"
    )
    if heard.report not in ("", _FINE):
        return Sentence(f'{text}: it runs, and reports "{heard.report}"{_because(heard.missing)}', RED)
    if heard.alive:
        return Sentence(f"{text}{_because(heard.missing)}", RED)
    return Sentence(f"{text}: it does not run, or does not answer", RED)


def _because(missing: str) -> str:
    return f"; {missing}" if missing else ""


def loop(heard: Heard) -> str:
    """Rate, age and missed deadlines as they are now."""
    newest = heard.newest
    if newest is None:
        return ""
    if heard.silence > OLD:
        return f"0 commands per second · no data since {heard.since}"
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
