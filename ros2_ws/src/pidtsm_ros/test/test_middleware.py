"""Processes limited to this machine bind their sockets to it, unless the user has chosen profiles or transports."""

import os
from pathlib import Path
from xml.etree import ElementTree

import pytest

from pidtsm_ros import middleware
from pidtsm_ros.middleware import on_this_machine, set_defaults

FOLDER = Path(middleware.__file__).parent
RANGE, PROFILES = "ROS_AUTOMATIC_DISCOVERY_RANGE", "FASTRTPS_DEFAULT_PROFILES_FILE"


@pytest.mark.parametrize("profiles", ["fastdds.xml", "fastdds_recorder.xml"])
@pytest.mark.parametrize(
    "given",
    [
        {},
        {"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp", RANGE: "SUBNET"},
        {"ROS_STATIC_PEERS": "10.0.0.2", "ROS_LOCALHOST_ONLY": "1"},
        {PROFILES: str(FOLDER / "fastdds.xml"), "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"},
    ],
    ids=["nothing set", "network", "peers", "as a node of ours sets it"],
)
def test_with_fast_dds_the_profile_binds_to_loopback(given: dict[str, str], profiles: str) -> None:
    environment = on_this_machine(given, profiles)
    assert not {"ROS_STATIC_PEERS", "ROS_LOCALHOST_ONLY"} & environment.keys()
    assert environment[RANGE] == "SYSTEM_DEFAULT"
    assert Path(environment[PROFILES]).samefile(FOLDER / profiles.replace(".xml", "_loopback.xml"))


@pytest.mark.parametrize(
    ("name", "value"),
    [(PROFILES, "/my.xml"), ("FASTDDS_BUILTIN_TRANSPORTS", "LARGE_DATA"), ("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")],
)
def test_settings_of_the_environment_are_kept_and_discovery_is_limited(name: str, value: str) -> None:
    assert on_this_machine({name: value, RANGE: "SUBNET"}) == {name: value, RANGE: "LOCALHOST"}


@pytest.mark.parametrize(
    ("given", "then"),
    [
        ({}, "SYSTEM_DEFAULT"),
        ({RANGE: "LOCALHOST"}, "SYSTEM_DEFAULT"),
        ({RANGE: "SUBNET"}, "SUBNET"),
        ({RANGE: "OFF"}, "OFF"),
        ({"ROS_STATIC_PEERS": "10.0.0.2"}, "LOCALHOST"),
        ({RANGE: "LOCALHOST", PROFILES: "/my.xml"}, "LOCALHOST"),
    ],
)
def test_a_node_stays_on_this_machine_unless_the_user_chooses_a_wider_range(
    monkeypatch: pytest.MonkeyPatch, given: dict[str, str], then: str
) -> None:
    environment = dict(given)
    monkeypatch.setattr(os, "environ", environment)
    set_defaults()
    assert environment[RANGE] == then
    assert ("loopback" in environment[PROFILES]) == (then == "SYSTEM_DEFAULT")
    set_defaults()
    assert environment[RANGE] == then


def settings(profiles: str) -> list[str]:
    """Elements of a file other than the participant and its transports."""
    namespace = "{http://www.eprosima.com}"
    (content,) = ElementTree.parse(FOLDER / profiles).getroot()
    return [
        ElementTree.tostring(element, encoding="unicode")
        for element in content
        if element.tag not in (f"{namespace}participant", f"{namespace}transport_descriptors")
    ]


@pytest.mark.parametrize("name", ["fastdds", "fastdds_recorder"])
def test_a_loopback_profile_differs_in_the_transport_alone(name: str) -> None:
    assert settings(f"{name}.xml") == settings(f"{name}_loopback.xml")
    assert settings(f"{name}.xml")


@pytest.mark.parametrize("file", sorted(FOLDER.glob("fastdds*.xml")), ids=lambda file: file.stem)
def test_nodes_announce_themselves_so_often_that_a_command_finds_them_at_once(file: Path) -> None:
    (period,) = ElementTree.parse(file).getroot().iter("{http://www.eprosima.com}leaseAnnouncement")
    assert [int(each.text or "") for each in period] == [0, 500_000_000]
