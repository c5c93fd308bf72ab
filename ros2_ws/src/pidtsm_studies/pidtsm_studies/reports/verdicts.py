"""Verdicts of runs for people: a sentence, and the answers that every reader wants first."""

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any

from pidtsm_core.recording.metric import RMSE
from pidtsm_core.recording.outcome import FOLLOWED, IN_THE_END, RAN_AWAY, STOPPED, is_rough, verdict, what_happened
from pidtsm_core.written import THIN, enumeration, number, quantity
from pidtsm_studies.reports.events import STOPS, Event
from pidtsm_studies.reports.matrix import units_of, values_of, worst
from pidtsm_studies.reports.page import BAD, GOOD, PLAIN, Answer

_IMPORTANCE = ("fault", "push", "payload", "contact", "limit", "mode")
"""Kinds of events that are unusual, those first that an answer names first."""
_SHOWN = 2
"""Largest number of events in an answer."""


def sentence(text: str) -> str:
    """A text as a sentence."""
    return f"{text[:1].upper()}{text[1:].rstrip('.')}."


def state_of(metrics: Mapping[str, Any]) -> str:
    """Whether a run followed; `PLAIN`: roughly."""
    if metrics["outcome"] != FOLLOWED:
        return BAD
    return PLAIN if is_rough(metrics) else GOOD


def worst_joint(metrics: Mapping[str, Any]) -> int | None:
    """Index of the joint with the largest RMSE; None if the run ran away, or has a single joint."""
    return worst(values_of(metrics, RMSE), [RMSE.unit_of(units) for units in units_of(metrics)])


def run_answers(metrics: Mapping[str, Any], events: Sequence[Event]) -> list[Answer]:
    """The answers of a single run."""
    joint = worst_joint(metrics)
    return [_followed(metrics), _how_well(metrics, joint), _happened(metrics, events), _worst(metrics, joint)]


def _followed(metrics: Mapping[str, Any]) -> Answer:
    away = [
        f"{quantity(metrics[f'time_{state}'], 's')} {text}"
        for state, text in (("holding", "holding"), ("freedrive", "in freedrive"), ("stopped", "stopped"))
        if metrics.get(f"time_{state}")  # Metrics of older versions lack freedrive.
    ]
    whole = quantity(metrics["duration"], "s")
    detail = f"{', '.join(away)} of {whole}" if away else f"all {whole}"
    state = state_of(metrics)
    text = {GOOD: "Yes", PLAIN: "Roughly", BAD: f"No: {metrics['outcome']}"}[state]
    return Answer("Did it follow?", text, detail, state)


def _how_well(metrics: Mapping[str, Any], joint: int | None) -> Answer:
    if metrics["outcome"] == RAN_AWAY:
        return Answer("How well?", "Not at all", "errors of an arm that ran away mean nothing", BAD)
    unit = units_of(metrics)[joint or 0].position
    steady = metrics["steady_state_error"]
    most = max((value for value in steady if value is not None), default=None)
    where = steady.index(most) if most is not None else 0
    text, worst_of = f"RMSE {quantity(metrics['rmse'][joint or 0], unit)}", " at worst" if joint is not None else ""
    if metrics["outcome"] == STOPPED:
        return Answer("How well?", text + worst_of, "including the time after the stop", BAD)
    return Answer(
        "How well?",
        text + worst_of,
        f"within {quantity(most, units_of(metrics)[where].position)} {IN_THE_END}",
        state_of(metrics),
    )


def _happened(metrics: Mapping[str, Any], events: Sequence[Event]) -> Answer:
    unusual = sorted(
        (event for event in events if event.kind in _IMPORTANCE),
        key=lambda event: (_IMPORTANCE.index(event.kind), event.time),
    )
    shown = sorted(unusual[:_SHOWN], key=lambda event: event.time)
    if not unusual:
        others = what_happened(metrics) if metrics["outcome"] == FOLLOWED else []
        detail = " ".join(sentence(other) for other in others[:_SHOWN])
        return Answer("What happened?", "Nothing unusual", detail, PLAIN)
    told = metrics["outcome"] in (STOPPED, RAN_AWAY)  # The verdict has the reason of the stop.
    texts = [event.text if event.kind == "fault" and not told else event.label for event in shown]
    text = "; ".join(f"{each} at {number(event.time)}{THIN}s" for each, event in zip(texts, shown, strict=True))
    rest = len(unusual) - len(shown)
    details = [*(each.effect for each in shown if each.effect), *([f"{rest} more, see the marks"] if rest else [])]
    state = BAD if any(event.kind == "fault" for event in events) else PLAIN
    return Answer("What happened?", sentence(text), "; ".join(details), state)


def _worst(metrics: Mapping[str, Any], joint: int | None) -> Answer:
    if metrics["outcome"] == RAN_AWAY:
        far = max(range(len(metrics["joints"])), key=lambda j: metrics["max_error"][j])
        return Answer("Which joint is worst?", metrics["joints"][far], "farthest from its reference", BAD)
    stopped = [fault["joint"] for fault in metrics["faults"] if fault["joint"]]
    if metrics["outcome"] == STOPPED and stopped:
        return Answer("Which joint is worst?", stopped[-1], "it caused the stop", BAD)
    if joint is None:
        return Answer(
            "Which joint is worst?", metrics["joints"][0] if len(metrics["joints"]) == 1 else "None stands out"
        )
    rmse = [value for value in values_of(metrics, RMSE) if value is not None]
    middle = sorted(rmse)[len(rmse) // 2]
    ratio = f", {number(metrics['rmse'][joint] / middle, 2)} × the median" if middle and len(rmse) > 2 else ""
    unit = units_of(metrics)[joint].position
    detail = f"largest RMSE{ratio}; its largest error is {quantity(metrics['max_error'][joint], unit)}"
    return Answer("Which joint is worst?", metrics["joints"][joint], detail)


def run_verdict(metrics: Mapping[str, Any], events: Sequence[Event] = ()) -> str:
    """The sentence of a single run; of one that does not end well after a stop, why and when it stopped."""
    stops = [event for event in events if event.kind == "fault"]
    if stops and metrics["outcome"] in (STOPPED, RAN_AWAY):
        stop = stops[0] if metrics["outcome"] == RAN_AWAY else stops[-1]
        after = "; ran away afterwards" if metrics["outcome"] == RAN_AWAY else _limited(metrics)
        return sentence(f"stopped after {quantity(stop.time, 's')}: {stop.text.removeprefix(STOPS)}{after}")
    return sentence(verdict(metrics))


def _limited(metrics: Mapping[str, Any]) -> str:
    """Which joints had been at their effort limits before the last fault."""
    limited = metrics["faults"][-1].get("limited")  # Metrics of older versions lack it.
    return f", after {enumeration(limited)} had been at the effort limit" if limited else ""


def extents(metrics: Mapping[Any, Mapping[str, Any]]) -> str:
    """How many runs there are, how long they are, and with which clock."""
    parts = []
    for extent, runs in groupby(_extent(each) for each in metrics.values()):
        count = len(list(runs))
        parts.append(f"{count} {'run' if count == 1 else 'runs'} of {extent}")
    return "; ".join(parts)


def _extent(metrics: Mapping[str, Any]) -> str:
    clock = f", {metrics['clock']} clock" if metrics["clock"] else ", without ROS"
    return f"{metrics['duration']:g} s, {metrics['samples']} samples{clock}"
