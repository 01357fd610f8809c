"""URLs of ROS 2 links, and names of topics."""

from __future__ import annotations

import importlib.util
from functools import partial

import pytest

from gcs_server.errors import InvalidRequest, LinkError
from gcs_server.links.base import DdsAddress, GuardOptions
from gcs_server.links.url import make_link
from gcs_server.ros2.guard_link import Ros2GuardLink
from gcs_server.ros2.link import Ros2Link
from gcs_server.ros2.to_mavlink import BootTime
from gcs_server.ros2.topics import parse_topic, status_namespace, wire_name
from gcs_server.ros2.url import ros2_link


def _link(url: str, name: str | None = None) -> Ros2Link:
    link = make_link(url, name, {"ros2": partial(ros2_link, own_system_id=255)})
    assert isinstance(link, Ros2Link)
    return link


@pytest.mark.parametrize(
    ("url", "domain", "namespace", "interface", "name"),
    [
        ("ros2://0", 0, None, None, "ros2-0"),
        ("ros2://42/px4_1", 42, "px4_1", None, "ros2-42-px4_1"),
        ("ros2://232/a/b?interface=eth0", 232, "a/b", "eth0", "ros2-232-a-b"),
    ],
)
def test_a_url_gives_domain_namespace_and_interface(
    url: str, domain: int, namespace: str | None, interface: str | None, name: str
) -> None:
    link = _link(url)
    assert (link.domain_id, link.namespace, link.interface, link.name) == (domain, namespace, interface, name)


def test_a_guarded_url_leads_to_programs() -> None:
    link = make_link(
        "ros2://3/cell?guard=free&valid_for_s=1", None, {"ros2": partial(ros2_link, own_system_id=255)}
    )
    assert isinstance(link, Ros2GuardLink)
    assert link.address == DdsAddress(3, None, "cell")
    assert link.guard == GuardOptions("free", valid_for_s=1.0)
    assert not link.leads_to_vehicles


@pytest.mark.parametrize(
    ("url", "reason"),
    [
        ("ros2://", "domain must be a number"),
        ("ros2://233", "domain must be a number from 0 to 232"),
        ("ros2://-1", "domain must be a number"),
        ("ros2://host:14550", "domain must be a number"),
        ("ros2://0/1x", "namespace"),
        ("ros2://0/a%20b", "namespace"),
        ("ros2://0/" + "a" * 65, "namespace"),
        ("ros2://0?forward=1", "no option 'forward'"),
        ("ros2://0?vehicle=1", "no option 'vehicle'"),
        ("ros2://3?guard=ask&forward=1", "no option 'forward'"),
        ("ros2://3?guard=maybe", "guard must be one of"),
        ("ros2://0?key=field", "no option 'key'"),
        ("ros2://0?interface=", "interface must be the name"),
        ("ros2://0?interface=<x/>", "interface must be the name"),
    ],
)
def test_an_invalid_url_is_refused_with_the_reason(url: str, reason: str) -> None:
    with pytest.raises(InvalidRequest, match=reason):
        _link(url)


def test_without_cyclone_dds_the_error_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def find_nothing(_name: str) -> None:
        return

    monkeypatch.setattr(importlib.util, "find_spec", find_nothing)
    with pytest.raises(LinkError) as error:
        _link("ros2://0")
    assert "pip install '.[ros2]'" in (error.value.remedy or "")


@pytest.mark.parametrize(
    ("topic", "expected"),
    [
        ("rt/fmu/out/vehicle_status_v1", ""),
        ("rt/px4_1/fmu/out/vehicle_status_v1", "px4_1"),
        ("rt/a/b/fmu/out/vehicle_status", "a/b"),
        ("rt/fmu/out/vehicle_status_v2", ""),
        ("rt/1 x/fmu/out/vehicle_status_v1", None),
        ("rt/fmu/out/vehicle_attitude", None),
        ("rt/fmu/out/vehicle_status_v1/x", None),
        ("rq/fmu/out/vehicle_status_v1", None),
    ],
)
def test_a_vehicle_is_found_by_its_status_topic_of_any_version(topic: str, expected: str | None) -> None:
    assert status_namespace(topic) == expected


@pytest.mark.parametrize(
    ("topic", "expected"),
    [
        ("rt/fmu/out/vehicle_attitude", ("", "/fmu/out/vehicle_attitude", "/fmu/out/vehicle_attitude")),
        ("rt/a/b/fmu/out/home_position_v1", ("a/b", "/fmu/out/home_position", "/fmu/out/home_position_v1")),
        ("rt/fmu/in/vehicle_command_v12", ("", "/fmu/in/vehicle_command", "/fmu/in/vehicle_command_v12")),
        ("rq/fmu/out/vehicle_attitude", None),
        ("rtx/fmu/out/vehicle_attitude", None),
        ("rt/1 x/fmu/out/vehicle_attitude", None),
    ],
)
def test_a_topic_has_a_namespace_and_a_name_without_version(
    topic: str, expected: tuple[str, str, str] | None
) -> None:
    assert parse_topic(topic) == expected


def test_the_dds_name_of_a_topic_contains_its_namespace() -> None:
    assert wire_name("/fmu/out/home_position", "px4_1") == "rt/px4_1/fmu/out/home_position"
    assert wire_name("/fmu/out/home_position", "") == "rt/fmu/out/home_position"


def test_unix_times_are_converted_by_timesync_and_times_since_boot_need_no_conversion() -> None:
    boot = BootTime()
    assert boot.boot_ms(5_000_000, 0.0) == 5000
    assert boot.boot_ms(1_795_229_929_358_197, 0.0) is None
    boot.synchronize(-1_795_229_923_302_197)
    assert boot.boot_ms(1_795_229_929_358_197, 0.1) == 6056


def test_without_timesync_unix_times_count_from_the_first_message() -> None:
    boot = BootTime()
    assert boot.boot_ms(1_795_000_000_000_000, 10.0) is None
    assert boot.boot_ms(1_795_000_003_000_000, 13.0) == 3000
