"""`gcs doctor ros2`: topics of programs and vehicles that do not meet are named."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from gcs_server.ros2.diagnosis import OFFBOARD, report, versions_with
from gcs_server.ros2.formats import USED, VehicleFormats
from gcs_server.ros2.inspection import Announcement, TopicKey
from gcs_server.ros2.message_types import MESSAGES
from gcs_server.ros2.topics import wire_name, wire_type
from tests.support.px4_formats import VERSIONED, ask_everything, formats_of_version, px4_topics

SETPOINT, BATTERY = "/fmu/in/trajectory_setpoint", "/fmu/out/battery_status"


def endpoint(
    topic: str, namespace: str, participant: str, *, publishes: bool, kind: str = ""
) -> Announcement:
    name = wire_name(topic, namespace)
    base = topic.removesuffix("_v1")
    key = TopicKey(name, wire_type(MESSAGES[kind or USED[base].type]))
    return Announcement(f"{participant} {name} {publishes}", publishes, key, participant)


def vehicle(version: str, namespace: str = "px4_1") -> Iterator[Announcement]:
    for each in px4_topics(version):
        yield endpoint(each.name, namespace, "agent", publishes=each.base.startswith("/fmu/out/"))


@pytest.mark.parametrize("version", sorted(VERSIONED))
def test_a_vehicle_and_a_program_that_meet_are_no_problem(version: str) -> None:
    formats = formats_of_version(version)
    program = endpoint(SETPOINT, "px4_1", "program", publishes=True)
    facts, problems = report([*vehicle(version), program], {"px4_1": formats})
    assert facts[0].startswith("2 programs, ")
    expected = len(USED) - (version == "1.15")
    assert facts[1] == f"vehicle /px4_1: {expected} topics with confirmed layouts, those of PX4 v{version}"
    assert len(problems) == (version == "1.15"), "v1.15's attitude setpoint is not known"
    assert versions_with(formats.usable.values()) == f"v{version}"


def test_a_setpoint_in_the_wrong_namespace_is_named_with_the_vehicles_name() -> None:
    program = endpoint(SETPOINT, "", "program", publishes=True)
    _, (problem,) = report([*vehicle("1.17"), program], {"px4_1": formats_of_version("1.17")})
    assert problem == (
        f"a program publishes {SETPOINT}, but no vehicle subscribes to it; use /px4_1{SETPOINT}. "
        "Namespaces of vehicles in this domain: /px4_1."
    )


def test_a_topic_of_another_version_or_type_is_named() -> None:
    formats = {"": formats_of_version("1.17", "")}
    old = endpoint(BATTERY, "", "program", publishes=False)
    _, (problem,) = report([*vehicle("1.17", ""), old], formats)
    assert f"subscribes to {BATTERY}, but no vehicle publishes it; use {BATTERY}_v1." in problem
    wrong_type = endpoint(SETPOINT, "", "program", publishes=True, kind="GotoSetpoint")
    _, (problem,) = report([*vehicle("1.17", ""), wrong_type], formats)
    assert "GotoSetpoint_ instead of px4_msgs::msg::dds_::TrajectorySetpoint_" in problem


def test_two_programs_that_fly_one_vehicle_in_offboard_are_named_and_modes_of_their_own_are_not() -> None:
    formats = {"px4_1": formats_of_version("1.17")}
    offboard = [endpoint(OFFBOARD, "px4_1", name, publishes=True) for name in ("a", "b")]
    modes = [endpoint(SETPOINT, "px4_1", name, publishes=True) for name in ("c", "d")]
    assert report([*vehicle("1.17"), offboard[0], *modes], formats)[1] == []
    other_vehicle = endpoint(OFFBOARD, "px4_2", "b", publishes=True)
    both = {**formats, "px4_2": formats["px4_1"]}
    assert report([*vehicle("1.17"), *vehicle("1.17", "px4_2"), offboard[0], other_vehicle], both)[1] == []
    (problem,) = report([*vehicle("1.17"), *offboard, *modes], formats)[1]
    assert problem.startswith("2 programs publish /px4_1/fmu/in/offboard_control_mode: PX4 follows whichever")


def test_a_program_without_a_vehicle_and_a_silent_vehicle_are_problems() -> None:
    program = endpoint(SETPOINT, "px4_2", "program", publishes=True)
    _, (problem,) = report([program], {})
    assert problem.endswith("no vehicle subscribes to it. Namespaces of vehicles in this domain: none.")
    silent = VehicleFormats("px4_1")
    silent.announce(px4_topics("1.16"))
    ask_everything(silent, {})
    facts, (problem,) = report(vehicle("1.16"), {"px4_1": silent})
    assert facts[1] == "vehicle /px4_1: 0 topics with confirmed layouts"
    assert "PX4 v1.14 and older cannot answer" in problem
    assert versions_with(silent.usable.values()) == ""
