"""`own_domain` returns only domains that no other process on this machine uses or has reserved."""

import random
import socket
import subprocess
import sys
from contextlib import ExitStack

import pytest

from pidtsm_experiments.errors import RunError
from pidtsm_experiments.runs import domain
from pidtsm_experiments.runs.domain import domains_in_use, own_domain


@pytest.fixture
def chosen(monkeypatch: pytest.MonkeyPatch) -> int:
    """A free domain, which `own_domain` tries first."""
    with own_domain() as free:
        pass

    def begin_with_it(domains: list[int]) -> None:
        domains.sort(key=lambda number: number != free)

    monkeypatch.setattr(random, "shuffle", begin_with_it)
    return free


def test_the_chosen_domain_would_be_taken(chosen: int) -> None:
    with own_domain() as own:
        assert own == chosen


@pytest.mark.parametrize("offset", [10, 11], ids=["discovery", "messages"])
@pytest.mark.parametrize("participant", [0, 1, 31, 100])
@pytest.mark.parametrize("address", ["127.0.0.1", "0.0.0.0", "::1", "::"])
def test_a_domain_with_a_participant_is_in_use(chosen: int, address: str, participant: int, offset: int) -> None:
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    try:
        participants = socket.socket(family, socket.SOCK_DGRAM)
    except OSError:
        pytest.skip("this machine has no IPv6")
    with participants:
        participants.bind((address, 7400 + 250 * chosen + offset + 2 * participant))
        assert chosen in domains_in_use()
        with own_domain() as own:
            assert own != chosen
    assert chosen not in domains_in_use()


def test_a_domain_with_only_a_discovery_socket_is_in_use(chosen: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        participant.bind(("", 7400 + 250 * chosen))
        assert chosen in domains_in_use()


def test_each_gets_another_domain() -> None:
    with ExitStack() as stack:
        own = [stack.enter_context(own_domain()) for _ in range(30)]
    assert len(set(own)) == 30


def test_a_domain_is_free_again_after_an_error(chosen: int) -> None:
    with pytest.raises(ZeroDivisionError), own_domain():
        raise ZeroDivisionError
    with own_domain() as own:
        assert own == chosen


HOLD = """
import sys
from pidtsm_experiments.runs import domain
domain.random.shuffle = lambda domains: domains.sort(key=lambda number: number != int(sys.argv[1]))
with domain.own_domain() as own:
    print(own, flush=True)
    sys.stdin.read()
"""


def test_a_domain_stays_reserved_until_its_holder_is_killed(chosen: int) -> None:
    words = [sys.executable, "-c", HOLD, str(chosen)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        assert int(holder.stdout.readline()) == chosen
        with own_domain() as own:
            assert own != chosen
        holder.kill()
    with own_domain() as own:
        assert own == chosen


def test_without_a_free_domain_the_error_contains_a_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(domain, "domains_in_use", lambda: set(range(200)))
    message = "all 100 ROS domains of this machine are in use; end other ROS 2 programs"
    with pytest.raises(RunError, match=message), own_domain():
        pass


def test_domains_are_within_the_range_of_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[int] = []
    monkeypatch.setattr(random, "shuffle", tried.extend)
    with own_domain():
        pass
    assert tried == list(range(1, 101))
