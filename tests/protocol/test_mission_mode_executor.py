"""Offboard missions that begin with a take-off, as flight modes of PX4, on simulated time."""

from __future__ import annotations

from typing import Any

import pytest

from gcs_server.errors import GcsError
from gcs_server.ros2.external_mode import CHECK_REPLY, COMPLETED
from gcs_server.ros2.message_types import MESSAGES
from gcs_server.ros2.mode_executor import COMMAND as EXECUTOR_COMMAND
from gcs_server.ros2.mode_executor import MODE_COMPLETED
from gcs_server.ros2.topics import COMMAND, COMMAND_ACK
from gcs_server.streamer.values.limit_values import OperatorLimits
from tests.protocol.api_calls import ANNA
from tests.protocol.mission_modes_testbed import (
    MISSION,
    MissionModesTestbed,
    SlowPlanWork,
    UnavailablePlanWork,
    run_with_mission_modes,
)
from tests.protocol.offboard_testbed import sleep
from tests.protocol.simulated_testbed import both_versions, until
from vehicle_sim.mavlink import generated_dialect as sim
from vehicle_sim.px4_version import Px4Version

TAKE_OFF = {"step": "take_off", "height_m": 6}
FLY = {"step": "fly", "points": [{"offset_ned_m": [8, 0, -6]}], "speed_m_s": 3}
TAKE_OFF_MISSION: dict[str, Any] = {**MISSION, "steps": [TAKE_OFF, FLY, {"step": "land"}]}
SET_NAV_STATE, NAV_TAKEOFF = 100_001, 22
"""Commands of the executor."""
SELECT_HOLD = (sim.MAV_CMD_DO_SET_MODE, 1, 4, 3)
MISSION_MODE = "external_1"
EXECUTOR_COMPONENT = 1001
SUCCESS, EXTERNAL_1 = 0, 23
"""result and nav_state of ModeCompleted."""


def executor_commands(rig: MissionModesTestbed) -> list[int]:
    """Numbers of the commands that the executor has sent."""
    return [
        MESSAGES["VehicleCommand"].decode(data)["command"] for data in rig.sent_messages(EXECUTOR_COMMAND)
    ]


def drop_messages(rig: MissionModesTestbed, *topics: str) -> None:
    """Drops PX4's messages on these topics before they reach the process that sends the setpoints."""
    vehicle_topics = rig.testbed.topics[0]
    publish = vehicle_topics.publish

    def publish_others(topic: str, data: bytes) -> None:
        if topic not in topics:
            publish(topic, data)

    vehicle_topics.publish = publish_others  # type: ignore[method-assign]


async def arm(rig: MissionModesTestbed) -> None:
    """Arms the vehicle from another station, as a pilot does."""
    rig.other_station.command(sim.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    await until(lambda: rig.vehicle.status.armed, 3)


async def register_and_select(rig: MissionModesTestbed, mission: dict[str, Any] = TAKE_OFF_MISSION) -> None:
    """Registers the mission's mode, and selects it from another station on the ground."""
    mode = await rig.register(mission=mission)
    assert (mode["mode"], mode["takes_off"]) == (MISSION_MODE, True)
    rig.other_station.select_mode(MISSION_MODE)
    await rig.until_mode(MISSION_MODE)


def altitude_m(rig: MissionModesTestbed) -> float:
    """Altitude above the local origin."""
    return -rig.vehicle.topic("local_position").value.position_ned_m[2]


@both_versions
def test_a_mission_selected_on_the_ground_takes_off_flies_and_lands_when_armed(
    run_simulated: Any, px4: Px4Version
) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        await register_and_select(rig)
        rig.station.authority.control("1").lease.release(ANNA)
        await sleep(2)
        assert not rig.vehicle.status.armed
        assert rig.mission_state is None
        assert executor_commands(rig) == []
        ground_m, start_north_m = altitude_m(rig), rig.north_m()
        await arm(rig)
        await rig.until_mode("takeoff")
        assert rig.mission_state == "taking_off"
        assert rig.station.flights.missions.status("1").mode == MISSION_MODE
        assert rig.station.flights.missions.status("1").executor_in_charge is True
        assert "holds after a take-off" in rig.station.flights.missions.status("1").if_stream_stops
        await rig.until_mode(MISSION_MODE, 30)
        assert altitude_m(rig) - ground_m == pytest.approx(6, abs=1)
        await until(lambda: rig.north_m() > start_north_m + 7, 20)
        await rig.until_mode("land", 15)
        await until(lambda: not rig.vehicle.status.armed, 40)
        await until(lambda: rig.mission_state == "done", 2)
        assert executor_commands(rig) == [NAV_TAKEOFF, SET_NAV_STATE, SET_NAV_STATE]
        assert all(MESSAGES["VehicleCommand"].decode(data)["source_component"] == EXECUTOR_COMPONENT
                   for data in rig.sent_messages(EXECUTOR_COMMAND))  # fmt: skip
        completed = [MESSAGES["ModeCompleted"].decode(data) for data in rig.sent_messages(COMPLETED)]
        assert [(message["result"], message["nav_state"]) for message in completed] == [(SUCCESS, EXTERNAL_1)]
        assert rig.warning_texts() == []
        await rig.until_mode("hold")
        await sleep(3)
        await arm(rig)
        await sleep(2)
        assert rig.vehicle.status.mode == "hold"
        assert rig.vehicle.status.landed_state == "on_ground"

    run_with_mission_modes(run_simulated, scenario, in_air=False, px4=px4)


@pytest.mark.story
def test_a_mission_with_a_take_off_can_be_flown_again_when_its_mode_is_selected_again(
    run_simulated: Any,
) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        await register_and_select(rig, {**MISSION, "steps": [TAKE_OFF, {"step": "land"}]})
        rig.station.authority.control("1").lease.release(ANNA)
        for _ in range(2):
            rig.other_station.select_mode(MISSION_MODE)
            await rig.until_mode(MISSION_MODE)
            await arm(rig)
            await until(lambda: rig.mission_state == "taking_off", 5)
            await until(lambda: rig.mission_state == "done", 90)
            await rig.until_mode("hold")

    run_with_mission_modes(run_simulated, scenario, in_air=False)


@pytest.mark.story
def test_a_mission_with_a_take_off_that_ends_in_the_air_hands_over_to_hold(run_simulated: Any) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        await register_and_select(rig, {**MISSION, "steps": [TAKE_OFF, FLY]})
        await arm(rig)
        await until(lambda: rig.mission_state == "done", 90)
        await rig.until_mode("hold")
        assert rig.vehicle.status.armed
        await until(lambda: not rig.station.flights.missions.flight("1")._executor.in_charge, 2)
        assert executor_commands(rig) == [NAV_TAKEOFF, SET_NAV_STATE]

    run_with_mission_modes(run_simulated, scenario, in_air=False)


@pytest.mark.broad
@pytest.mark.parametrize("phase", ["takeoff", "flying", "land"])
def test_after_a_takeover_the_executor_sends_no_commands(run_simulated: Any, phase: str) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        await register_and_select(rig)
        await arm(rig)
        if phase == "flying":
            await rig.until_mode(MISSION_MODE, 30)
            await sleep(2)
        else:
            await rig.until_mode(phase, 60)
            await sleep(1)
        rig.other_station.command(*SELECT_HOLD)
        await rig.until_mode("hold")
        await until(lambda: rig.mission_state == "suspended", 2)
        assert rig.station.flights.missions.status("1").executor_in_charge is False
        before = len(rig.testbed.topics[0].sent_messages)
        await sleep(8)
        sent = rig.testbed.topics[0].sent_messages[before:]
        assert {topic for topic, _ in sent} <= {CHECK_REPLY, COMMAND}
        commands = {
            MESSAGES["VehicleCommand"].decode(data)["command"] for topic, data in sent if topic == COMMAND
        }
        assert commands <= {sim.MAV_CMD_RUN_PREARM_CHECKS}
        assert rig.vehicle.status.mode == "hold"
        rig.other_station.select_mode(MISSION_MODE)
        await until(lambda: rig.mission_state == "done", 90)
        assert not rig.vehicle.status.armed

    run_with_mission_modes(run_simulated, scenario, in_air=False)


def test_a_takeover_that_does_not_change_the_mode_suspends_the_mission(run_simulated: Any) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        await register_and_select(rig)
        await arm(rig)
        await rig.until_mode("takeoff")
        await sleep(1)
        rig.other_station.command(sim.MAV_CMD_NAV_TAKEOFF, -1, 0, 0, *(float("nan"),) * 4)
        await until(lambda: rig.mission_state == "suspended", 5)
        assert "Another party commands the vehicle" in rig.station.flights.missions.status("1").reason
        assert executor_commands(rig) == [NAV_TAKEOFF]
        await rig.until_mode("hold", 30)
        await sleep(3)
        assert executor_commands(rig) == [NAV_TAKEOFF]

    run_with_mission_modes(run_simulated, scenario, in_air=False)


def test_after_the_operators_hold_during_the_take_off_the_executor_is_not_in_charge(
    run_simulated: Any,
) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        await register_and_select(rig)
        await arm(rig)
        await rig.until_mode("takeoff")
        await rig.vehicle.command.hold()
        await until(lambda: rig.mission_state == "suspended", 2)
        await sleep(5)
        assert rig.vehicle.status.mode == "hold"
        assert executor_commands(rig) == [NAV_TAKEOFF]

    run_with_mission_modes(run_simulated, scenario, in_air=False)


def test_refused_arming_does_not_start_the_mission(run_simulated: Any) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        await register_and_select(rig)
        streams = rig.testbed.streamer._streams
        # As if the event loop stalled: the mode then refuses arming.
        record_loop_message, streams._record_loop_message = streams._record_loop_message, lambda _: None
        await sleep(3)
        with pytest.raises(GcsError):
            await rig.vehicle.command.arm()
        assert not rig.vehicle.status.armed
        assert rig.mission_state is None
        assert executor_commands(rig) == []
        streams._record_loop_message = record_loop_message

    run_with_mission_modes(run_simulated, scenario, in_air=False)


def test_a_mission_with_a_take_off_that_is_selected_in_the_air_switches_to_hold_and_gives_the_reason(
    run_simulated: Any,
) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        await register_and_select(rig)
        rig.other_station.command(*SELECT_HOLD)
        await rig.until_mode("hold")
        await rig.vehicle.command.takeoff(8)
        await rig.until_mode("hold", 40)
        rig.other_station.select_mode(MISSION_MODE)
        await until(lambda: any("cannot be flown" in text for text in rig.warning_texts()), 5)
        await rig.until_mode("hold")
        assert "already flying" in "".join(rig.warning_texts())
        assert rig.mission_state is None
        assert executor_commands(rig) == []

    run_with_mission_modes(run_simulated, scenario, in_air=False)


async def set_altitude_limit(rig: MissionModesTestbed) -> None:
    """Sets an altitude limit, after which the server must compile the mission again."""
    await rig.station.offboard("1").operator_limits.set(OperatorLimits(height_max_m=50.0), by="anna")


async def until_ready(rig: MissionModesTestbed, ready: bool) -> dict[str, Any]:
    """Waits until the mode has this readiness and PX4 has received it; returns the mode."""
    for _ in range(60):
        if (await rig.list_modes())["modes"][0]["ready"] == ready:
            await sleep(1)
            return (await rig.list_modes())["modes"][0]
        await sleep(0.25)
    raise AssertionError(f"ready did not become {ready}")


def test_slow_plan_work_does_not_delay_the_take_off_after_arming(run_simulated: Any) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        await register_and_select(rig)
        rig.station.flights.plan_work = SlowPlanWork(12.0)
        await arm(rig)
        await rig.until_mode("takeoff", 1.5)
        assert rig.warning_texts() == []

    run_with_mission_modes(run_simulated, scenario, in_air=False)


def test_a_mission_that_px4_arms_while_it_is_compiled_again_takes_off_after_the_compilation(
    run_simulated: Any,
) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        await register_and_select(rig)
        await until_ready(rig, True)
        rig.station.flights.plan_work = SlowPlanWork(2.0)
        replied = len(rig.sent_messages(CHECK_REPLY))
        while len(rig.sent_messages(CHECK_REPLY)) == replied:
            await sleep(0.02)
        await set_altitude_limit(rig)  # PX4 asks 0.3 s later
        await sleep(0.15)
        assert not (await rig.list_modes())["modes"][0]["ready"]
        await arm(rig)
        await rig.until_mode("takeoff", 5)
        assert rig.warning_texts() == []

    run_with_mission_modes(run_simulated, scenario, in_air=False)


def test_a_vehicle_is_not_armed_in_a_mode_whose_mission_is_not_compiled(run_simulated: Any) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        await register_and_select(rig)
        rig.station.flights.plan_work, plan_work = UnavailablePlanWork(), rig.station.flights.plan_work
        await set_altitude_limit(rig)
        await until_ready(rig, False)
        await until(lambda: any("PX4 does not arm in this mode" in text for text in rig.warning_texts()), 10)
        assert "No worker." in (await rig.list_modes())["modes"][0]["reason"]
        with pytest.raises(GcsError):
            await rig.vehicle.command.arm()
        rig.station.flights.plan_work = plan_work
        assert (await until_ready(rig, True))["reason"] == ""
        await arm(rig)
        await rig.until_mode("takeoff", 1.5)

    run_with_mission_modes(run_simulated, scenario, in_air=False)


@pytest.mark.story
@pytest.mark.parametrize("lost_topic", [COMMAND_ACK, MODE_COMPLETED])
def test_lost_replies_do_not_stop_the_mission(run_simulated: Any, lost_topic: str) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        await register_and_select(rig)
        drop_messages(rig, lost_topic)
        await arm(rig)
        await until(lambda: rig.mission_state == "done", 120)
        assert not rig.vehicle.status.armed

    run_with_mission_modes(run_simulated, scenario, in_air=False)


def test_a_take_off_that_px4_never_receives_leaves_the_vehicle_on_the_ground(run_simulated: Any) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        await register_and_select(rig)
        topics = rig.testbed.topics[0]
        send = topics.send
        lost_commands: list[str] = []

        def send_others(topic: str, data: bytes) -> None:
            if topic == EXECUTOR_COMMAND:
                lost_commands.append(topic)
            else:
                send(topic, data)

        topics.send = send_others  # type: ignore[method-assign]
        await arm(rig)
        await until(lambda: rig.mission_state == "suspended", 8)
        assert len(lost_commands) == 3
        assert "The take-off failed" in rig.station.flights.missions.status("1").reason
        assert rig.vehicle.status.landed_state == "on_ground"
        topics.send = send  # type: ignore[method-assign]
        await until(lambda: not rig.vehicle.status.armed, 20)
        await rig.until_mode("hold")
        rig.other_station.select_mode(MISSION_MODE)
        await rig.until_mode(MISSION_MODE)
        await until_ready(rig, True)  # PX4 moved its local origin when it armed
        await arm(rig)
        await rig.until_mode("takeoff")
        assert rig.mission_state == "taking_off"

    run_with_mission_modes(run_simulated, scenario, in_air=False)


@both_versions
def test_px4_removes_a_mode_that_stops_replying_during_its_take_off_and_holds(
    run_simulated: Any, px4: Px4Version
) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        await register_and_select(rig)
        await arm(rig)
        await rig.until_mode("takeoff")
        rig.testbed.streamer._streams.mode_ports[-1].is_working = False
        await rig.until_mode("hold", 30)
        await until(lambda: any("is no longer registered" in text for text in rig.warning_texts()), 5)
        await sleep(3)
        assert rig.vehicle.status.mode == "hold"
        assert rig.vehicle.status.armed
        assert COMMAND in {topic for topic, _ in rig.testbed.topics[0].sent_messages}

    run_with_mission_modes(run_simulated, scenario, in_air=False, px4=px4)
