"""``diagnose`` judges the bag of a stranger: his plant, his controller, standard messages alone."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from pidtsm_core.arrays import Array
from pidtsm_experiments.cli import main

_URDF = """<robot name="planar"><link name="base"/>
<link name="upper"><inertial><origin xyz="0.5 0 0"/><mass value="2"/>
<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="fore"><inertial><origin xyz="0.4 0 0"/><mass value="1.5"/>
<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 -1 0"/>
<limit lower="-3" upper="3" effort="80" velocity="5"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.5 0 0"/>
<axis xyz="0 -1 0"/><limit lower="-3" upper="3" effort="40" velocity="5"/></joint></robot>"""
_PERIOD, _SECONDS = 0.002, 16.0


def _acceleration(q: Array, v: Array, effort: Array, mass: float) -> Array:
    """Two point masses at the ends of two rods, by Lagrange; q from the horizontal; rotors of 0.3 kg m^2."""
    a, b, m, g = 0.5, 0.4, mass, 9.81
    coupled = m * a * b * math.cos(q[1])
    inertia = np.array(
        [[(2.0 + m) * a * a + m * b * b + 2.0 * coupled, m * b * b + coupled], [m * b * b + coupled] * 2]
    )
    inertia[1, 1] = m * b * b
    inertia += 0.3 * np.eye(2)
    h = m * a * b * math.sin(q[1])
    outer = m * g * b * math.cos(q[0] + q[1])
    bias = np.array(
        [-h * v[1] * (2.0 * v[0] + v[1]) + (2.0 + m) * g * a * math.cos(q[0]) + outer, h * v[0] ** 2 + outer]
    )
    return np.asarray(np.linalg.solve(inertia, effort - bias))


def _strangers_bag(folder: Path, sign: float = 1.0, mass: float = 1.5) -> Path:
    """Joint states of a PD controller in another order of joints, and nothing else; elbow with this sign."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types
    signs, gains, damping = np.array([1.0, sign]), np.array([2000.0, 1000.0]), np.array([120.0, 60.0])
    speed, q, v = np.array([0.9, 1.7]), np.zeros(2), np.zeros(2)
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        connection = bag.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        for k in range(round(_SECONDS / _PERIOD)):
            t = k * _PERIOD
            wanted, rate = 0.6 * np.sin(speed * t) ** 2, 0.6 * speed * np.sin(2.0 * speed * t)
            effort = gains * (wanted - q) + damping * (rate - v)
            stamp = types["builtin_interfaces/msg/Time"](*divmod(k * 2_000_000, 10**9))
            header = types["std_msgs/msg/Header"](stamp, "")
            columns = ((signs * q)[::-1], np.empty(0), (signs * effort)[::-1])
            message = types["sensor_msgs/msg/JointState"](header, ["elbow", "shoulder"], *map(np.copy, columns))
            bag.write(connection, k * 2_000_000, store.serialize_cdr(message, "sensor_msgs/msg/JointState"))
            for _ in range(2):
                v = v + 0.5 * _PERIOD * _acceleration(q, v, effort, mass)
                q = q + 0.5 * _PERIOD * v
    return folder


@pytest.mark.parametrize(
    ("sign", "mass", "found"),
    [(1.0, 1.5, []), (-1.0, 1.5, ["wrong_sign"]), (1.0, 3.0, ["unknown_payload", "wrong_gravity"])],
    ids=["good", "wrong sign", "heavier"],
)
def test_a_strangers_bag_is_judged(
    sign: float, mass: float, found: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, urdf, page = _strangers_bag(tmp_path / "bag", sign, mass), tmp_path / "planar.urdf", tmp_path / "page.html"
    urdf.write_text(_URDF, encoding="utf-8")
    code = main(["diagnose", str(bag), "--robot", str(urdf), "--out", str(page), "--json"])
    result = json.loads(capsys.readouterr().out)
    assert code == (1 if found else 0)
    assert result["good"] == (not found)
    # A mass at the end of the last link is a payload, or that link's mass.
    assert result["found"] == found or (len(result["found"]) == 1 and result["found"][0] in found)
    states = {each["cause"]: each["state"] for each in result["verdicts"]}
    assert states["command_jitter"] == states["late_drive"] == "unknown"
    assert "Diagnosis of" in page.read_text(encoding="utf-8")


def test_what_is_no_bag_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["diagnose", str(tmp_path), "--out", str(tmp_path / "page.html")]) == 2
    assert "not a bag" in capsys.readouterr().err
