"""The nodes report how their loops run: in the controller's state, and on /diagnostics."""

from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rosbags.highlevel import AnyReader
from support.testbed import Testbed

from pidtsm_core.experiment import make_experiment
from pidtsm_experiments.bags.message_types import typestore
from pidtsm_experiments.runs.runner import run

FIELDS = ("period", "rate", "period_jitter", "state_age", "missed_deadlines", "compute_time")


def test_controller_state_tells_of_its_loop(tmp_path: Path) -> None:
    overrides = ["controller.diagnostics.deadline=1.0e-9", "controller.realtime.priority=0", "simulator.rate=250"]
    bag = run(make_experiment("case1", duration=2.5, overrides=overrides), "realtime", tmp_path, lambda _: None)
    with AnyReader([bag], default_typestore=typestore()) as reader:
        connections = [c for c in reader.connections if c.topic == "/controller/state"]
        states = [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages(connections)]
    values = {name: np.array([getattr(state, name) for state in states]) for name in FIELDS}
    assert all(np.all(np.isfinite(column)) for column in values.values())
    assert values["period"][0] == 0.0
    assert np.all(values["period"][1:] > 0.0)
    np.testing.assert_array_equal(
        values["missed_deadlines"], np.arange(len(states)), "every period is longer than 1 ns"
    )
    assert np.all(values["state_age"] > 0.0)
    assert np.all(values["compute_time"] > 0.0)
    assert values["rate"][0] == 0.0
    # The rate is that of the periods of the second before.
    assert np.unique(values["rate"]).size >= 2
    last = np.flatnonzero(np.diff(values["rate"]))[-1] + 1
    before = np.flatnonzero(np.diff(values["rate"]))[-2] + 1 if np.unique(values["rate"]).size > 2 else 1
    periods = values["period"][before if before == 1 else before + 1 : last + 1]
    np.testing.assert_allclose(values["rate"][last], 1.0 / periods.mean(), rtol=1e-9)
    np.testing.assert_allclose(values["period_jitter"][last], periods.std(), rtol=1e-4)


class Watcher:
    """Keeps the reports on /diagnostics, by the name of the node."""

    def __init__(self, testbed: Testbed) -> None:
        self.testbed = testbed
        self.heard: dict[str, list[DiagnosticStatus]] = {}
        testbed.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_array, 10)

    def _on_array(self, array: DiagnosticArray) -> None:
        assert array.header.stamp.sec > 0
        for status in array.status:
            self.heard.setdefault(status.name.split(":")[0], []).append(status)

    def until(self, node: str, condition: Any, what: str) -> DiagnosticStatus:
        self.testbed.spin_until(lambda: any(map(condition, self.heard.get(node, []))), f"{node}: {what}")
        return next(filter(condition, self.heard[node]))


def values(status: DiagnosticStatus) -> dict[str, float]:
    return {pair.key: float(pair.value) for pair in status.values}


def test_nodes_report_once_a_second(testbed: Testbed) -> None:
    watcher = Watcher(testbed)
    testbed.start("controller", "diagnostics.missed.warn:=2.0", "diagnostics.missed.error:=2.0")
    status = watcher.until("controller", lambda s: True, "speaks before anything arrives")
    assert status.level == DiagnosticStatus.WARN
    assert status.message == "inactive: no joint state received yet"
    status = watcher.until("controller", lambda s: len(watcher.heard["controller"]) > 1, "speaks again")
    testbed.start("simulator")
    status = watcher.until("simulator", lambda s: True, "speaks")
    assert status.message == "waiting for the other nodes"
    testbed.start("trajectory")
    for node in ("simulator", "controller"):
        status = watcher.until(node, lambda s: values(s)["rate (1/s)"] > 0.0, "runs")
        assert values(status)["longest period (s)"] > 0.0
        assert values(status)["compute time, longest (s)"] > 0.0
    assert {f"adaptive gain of joint{j}" for j in (1, 2)} < values(watcher.heard["controller"][-1]).keys()
    assert "state age, longest (s)" in values(watcher.heard["controller"][-1])


def test_thresholds_are_parameters(testbed: Testbed) -> None:
    watcher = Watcher(testbed)
    testbed.start(
        "simulator", "diagnostics.deadline:=1.0e-9", "diagnostics.missed.warn:=0.5", "diagnostics.missed.error:=2.0"
    )
    # On a busy machine the states are late, which must not be the worst that it has to report.
    testbed.start(
        "controller", "diagnostics.age.warn:=0.0", "diagnostics.age.error:=1.0e-9", "watchdog.state_stop:=60.0"
    )
    testbed.start("trajectory")
    status = watcher.until("simulator", lambda s: "missed deadlines" in s.message, "warns")
    assert status.level >= DiagnosticStatus.WARN
    assert "missed deadlines 1 of the periods >= 0.5: lower the rate of the joint states" in status.message
    status = watcher.until("controller", lambda s: "state age" in s.message, "reports an error")
    assert status.level == DiagnosticStatus.ERROR
