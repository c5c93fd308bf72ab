"""A page shows what it knows now: who lives, who is silent since when, who died how, and whether the arm is real."""

import time

import pytest

from pidtsm_experiments.live.lives import (
    REPORTS_WITHIN,
    SAMPLES_WITHIN,
    Condition,
    Life,
    Lives,
    Source,
    how_to_start,
    time_of_day,
)
from pidtsm_experiments.live.words import GREEN, RED, Known, loop, mode
from pidtsm_experiments.runs.runner import EXECUTABLES
from pidtsm_msgs.msg import ControllerState

FOLLOWING = ControllerState(mode=ControllerState.FOLLOWING, rate=1000.0, state_age=0.0004)
DIED = "simulator was killed by signal 9 at 12:00:00"


@pytest.mark.parametrize("within", [SAMPLES_WITHIN, REPORTS_WITHIN])
def test_a_node_is_alive_until_its_next_message_is_late(within: float) -> None:
    lives = Lives()
    lives.note_message("controller", within, now=100.0)
    life = lives.of("controller")
    assert life.condition(100.0 + 0.99 * within) is Condition.ALIVE
    assert life.condition(100.0 + 1.01 * within) is Condition.SILENT


def test_the_more_patient_of_two_sources_counts() -> None:
    lives = Lives()
    lives.note_message("controller", REPORTS_WITHIN, now=100.0)
    lives.note_message("controller", SAMPLES_WITHIN, now=100.1)
    assert lives.of("controller").condition(100.0 + 0.99 * REPORTS_WITHIN) is Condition.ALIVE


def test_a_silent_node_is_named_with_the_time_of_its_last_message() -> None:
    lives, now = Lives(), time.monotonic()
    lives.note_message("trajectory", REPORTS_WITHIN, now=now - 7.0)
    assert lives.trouble("trajectory") == f"trajectory is silent since {time_of_day(now - 7.0)} (7 s)"
    lives.see({"controller"})
    assert lives.trouble("trajectory").endswith("(7 s); it has left the network")


def test_a_process_that_ended_is_dead_at_once_and_a_new_one_is_not() -> None:
    lives = Lives()
    lives.note_message("simulator", REPORTS_WITHIN)
    lives.end("simulator", "was killed by signal 9")
    first = lives.of("simulator").found_ended
    assert lives.condition("simulator") is Condition.DEAD
    assert lives.trouble("simulator") == f"simulator was killed by signal 9 at {time_of_day(first)}"
    lives.end("simulator", "was killed by signal 9", now=first + 100.0)
    assert lives.of("simulator").found_ended == first
    lives.begin("simulator")
    assert lives.condition("simulator") is Condition.UNHEARD
    assert not lives.trouble("simulator")


@pytest.mark.parametrize(
    ("life", "word"),
    [
        (Life(), "no message yet"),
        (Life(present=False), "not there"),
        (Life(received=1.0, expected=2.0), "alive, last message"),
        (Life(received=1.0, expected=2.0, suspended=True), "suspended by this page"),
        (Life(received=-9.0, expected=-8.0), "silent since"),
        (Life(received=1.0, expected=2.0, ended="ended with exit code 1"), "dead: ended with exit code 1 at"),
    ],
)
def test_the_line_of_a_node_shows_what_is_known(life: Life, word: str) -> None:
    sentence = life.sentence(1.5)
    assert sentence.text.startswith(word)
    assert (sentence.color == GREEN) == word.startswith("alive")


@pytest.mark.parametrize(
    ("seen", "simulated", "node"),
    [
        ([], False, ""),
        ([(True, ["/left/simulator"])], True, "simulator"),
        ([(True, [])], True, "simulator"),
        ([(True, ["/left/simulator"]), (False, [])], True, "simulator"),
        ([(False, ["/left/driver"])], False, "driver"),
        ([(False, ["/hardware/driver"])], False, "/hardware/driver"),
        ([(False, ["/left/driver"]), (True, ["/left/simulator"])], False, "driver"),
        ([(True, ["/left/simulator"]), (True, ["/left/simulator", "/left/driver"])], False, "driver"),
        ([(False, ["/right/simulator"])], False, "/right/simulator"),
    ],
    ids=["nothing", "simulator", "unheard", "died", "driver", "elsewhere", "both", "joined", "another"],
)
def test_an_arm_is_simulated_only_if_nothing_else_ever_sent_its_joint_states(
    seen: list[tuple[bool, list[str]]], simulated: bool, node: str
) -> None:
    source = Source("/left")
    for simulator, publishers in seen:
        source.see(simulator, publishers)
    assert (source.simulated, source.node) == (simulated, node)


def test_figures_of_the_loop_do_not_outlive_its_messages() -> None:
    assert loop(Known(FOLLOWING)).startswith("1000 commands per second")
    assert loop(Known(FOLLOWING, silence=1.1, since="12:00:00")) == "0 commands per second · no data since 12:00:00"
    assert not loop(Known(None))


@pytest.mark.parametrize(
    ("known", "words"),
    [
        (Known(FOLLOWING, silence=3.0, since="12:00:00"), "since 12:00:00: it does not run, or does not answer"),
        (
            Known(FOLLOWING, 3.0, "12:00:00", "no joint state for a second", True, missing=DIED),
            f'since 12:00:00: it runs, and reports "no joint state for a second"; {DIED}',
        ),
        (Known(FOLLOWING, 3.0, "12:00:00", "running", True, missing=DIED), f"since 12:00:00; {DIED}"),
        (Known(FOLLOWING, ended="was killed by signal 9"), "The controller was killed by signal 9"),
    ],
)
def test_silence_is_explained_and_nothing_old_is_repeated(known: Known, words: str) -> None:
    sentence = mode(known)
    assert sentence.text.endswith(words)
    assert sentence.color == RED
    assert "Following" not in sentence.text


@pytest.mark.parametrize(
    ("number", "held", "words"),
    [
        (ControllerState.FREEDRIVE, False, "Freedrive: the arm can be moved by hand"),
        (ControllerState.HOLDING, True, "Holding its position on request"),
        (ControllerState.HOLDING, False, "Holding its position: the reference is missing or too old"),
        (ControllerState.HOLDING, None, "Holding its position"),
    ],
)
def test_why_the_arm_is_held_is_shown_once_it_is_known(number: int, held: bool | None, words: str) -> None:
    assert mode(Known(ControllerState(mode=number), held=held)).text == words


def test_the_command_that_starts_a_node_has_its_namespace() -> None:
    assert "ros2 run pidtsm_controller trajectory --ros-args -r __ns:=/left" in how_to_start(
        "trajectory", EXECUTABLES, "/left"
    )
    assert how_to_start("/driver", EXECUTABLES, "/left") == "start it again as it was started"
