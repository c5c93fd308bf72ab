"""The state of a system in plain words."""

from dataclasses import dataclass
from html import escape

from pidtsm_core.control.report import cause
from pidtsm_core.signals import Mode
from pidtsm_msgs.msg import ControllerState

GREEN, AMBER, RED, GREY = "#2f9e44", "#e8890c", "#d6336c", "#868e96"
LATE = 0.5
"""s without a state of the controller, which then does not run, or is not active."""


@dataclass(frozen=True)
class Sentence:
    """One sentence, and how much it matters.

    Attributes:
        text: the sentence.
        color: `GREEN`, `AMBER`, `RED` or `GREY`.
    """

    text: str
    color: str


def mode(newest: ControllerState | None, silence: float, report: str, ended: str) -> Sentence:
    """What the controller does, and why it has stopped if it has.

    Args:
        newest: its last state; None: none has arrived.
        silence: time since then, s.
        report: what it last reported on /diagnostics.
        ended: how its process has ended; empty: it runs, or is not known.
    """
    if ended:
        return Sentence(f"The controller {ended}", RED)
    if newest is None or silence > LATE:
        return _silent(newest, silence, report)
    if newest.fault:
        try:
            reason = cause(newest.fault, newest.fault_joint, newest.name)
        except (ValueError, IndexError, KeyError):  # of another version
            reason = f"fault {newest.fault}"
        return Sentence(f"Stopped: {reason}. It holds the arm until the fault is reset", RED)
    if newest.mode == Mode.HOLDING:
        return Sentence("Holding its position: the reference is missing or too old", AMBER)
    if newest.mode == Mode.FOLLOWING:
        return Sentence("Following the reference", GREEN)
    return Sentence(f"In mode {newest.mode}", AMBER)


def _silent(newest: ControllerState | None, silence: float, report: str) -> Sentence:
    if report.startswith("inactive"):
        return Sentence(f"The controller is {report}", AMBER)
    if newest is None:
        return Sentence("Waiting for the controller", GREY)
    return Sentence(f"No state of the controller for {silence:.1f} s: it does not run, or is not active", RED)


def loop(newest: ControllerState | None) -> str:
    """Rate, age and missed deadlines."""
    if newest is None:
        return ""
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
