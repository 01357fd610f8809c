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
from tests.protocol.mission_modes_world import MISSION, Modes, NoWork, SlowWork, fly
from tests.protocol.offboard_world import seconds
from tests.protocol.simulated_world import until
from vehicle_sim.mavlink import generated_dialect as sim

TAKE_OFF = {"step": "take_off", "height_m": 6}
FLY = {"step": "fly", "points": [{"offset_ned_m": [8, 0, -6]}], "speed_m_s": 3}
CLIMBS: dict[str, Any] = {**MISSION, "steps": [TAKE_OFF, FLY, {"step": "land"}]}
SET_NAV_STATE, NAV_TAKEOFF = 100_001, 22
HOLD, MISSION_MODE, LAND = 3, "external_1", 18


def executor_commands(at: Modes) -> list[int]:
    """Numbers of the commands that the executor has sent."""
    return [MESSAGES["VehicleCommand"].decode(data)["command"] for data in at.sent(EXECUTOR_COMMAND)]


def drop(at: Modes, *topics: str) -> None:
    """Drops PX4's messages on these topics before they reach the process that sends the setpoints."""
    topics_of = at.world.topics[0]
    publish = topics_of.publish

    def publish_others(topic: str, data: bytes) -> None:
        if topic not in topics:
            publish(topic, data)

    topics_of.publish = publish_others  # type: ignore[method-assign]


async def arm(at: Modes) -> None:
    """Another station arms the vehicle, as a pilot does."""
    at.other.command(sim.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    await until(lambda: at.vehicle.status.armed, 3)


async def register_and_select(at: Modes, mission: dict[str, Any] = CLIMBS) -> None:
    """Registers the mission's mode, and selects it from another station on the ground."""
    mode = await at.register(mission=mission)
    assert (mode["mode"], mode["takes_off"]) == (MISSION_MODE, True)
    at.other.choose(MISSION_MODE)
    await at.mode(MISSION_MODE)


def height_m(at: Modes) -> float:
    return -at.vehicle.topic("local_position").value.position_ned_m[2]


def test_a_mission_selected_on_the_ground_takes_off_flies_and_lands_when_armed(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        await register_and_select(at)
        at.station.authority.control("1").lease.release(ANNA)
        await seconds(2)
        assert not at.vehicle.status.armed
        assert at.mission is None
        assert executor_commands(at) == []
        ground_m, start_x_m = height_m(at), at.x_m()
        await arm(at)
        await at.mode("takeoff")
        assert at.mission == "taking_off"
        assert at.station.missions.status("1").mode == MISSION_MODE
        assert at.station.missions.status("1").executor_in_charge is True
        assert "holds after a take-off" in at.station.missions.status("1").if_stream_stops
        await at.mode(MISSION_MODE, 30)
        assert height_m(at) - ground_m == pytest.approx(6, abs=1)
        await until(lambda: at.x_m() > start_x_m + 7, 20)
        await at.mode("land", 15)
        await until(lambda: not at.vehicle.status.armed, 40)
        await until(lambda: at.mission == "done", 2)
        assert executor_commands(at) == [NAV_TAKEOFF, SET_NAV_STATE, SET_NAV_STATE]
        assert all(MESSAGES["VehicleCommand"].decode(data)["source_component"] == 1001
                   for data in at.sent(EXECUTOR_COMMAND))  # fmt: skip
        completed = [MESSAGES["ModeCompleted"].decode(data) for data in at.sent(COMPLETED)]
        assert [(each["result"], each["nav_state"]) for each in completed] == [(0, 23)]
        assert at.warnings() == []
        await at.mode("hold")
        await seconds(3)
        await arm(at)
        await seconds(2)
        assert at.vehicle.status.mode == "hold"
        assert at.vehicle.status.landed_state == "on_ground"

    fly(jump, scenario, in_air=False)


@pytest.mark.story
def test_a_mission_with_a_take_off_can_be_flown_again_when_its_mode_is_selected_again(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        await register_and_select(at, {**MISSION, "steps": [TAKE_OFF, {"step": "land"}]})
        at.station.authority.control("1").lease.release(ANNA)
        for _ in range(2):
            at.other.choose(MISSION_MODE)
            await at.mode(MISSION_MODE)
            await arm(at)
            await until(lambda: at.mission == "taking_off", 5)
            await until(lambda: at.mission == "done", 90)
            await at.mode("hold")

    fly(jump, scenario, in_air=False)


@pytest.mark.story
def test_a_mission_with_a_take_off_that_ends_in_the_air_hands_over_to_hold(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        await register_and_select(at, {**MISSION, "steps": [TAKE_OFF, FLY]})
        await arm(at)
        await until(lambda: at.mission == "done", 90)
        await at.mode("hold")
        assert at.vehicle.status.armed
        await until(lambda: not at.station.missions.flight("1")._executor.in_charge, 2)
        assert executor_commands(at) == [NAV_TAKEOFF, SET_NAV_STATE]

    fly(jump, scenario, in_air=False)


@pytest.mark.broad
@pytest.mark.parametrize("when", ["takeoff", "flying", "land"])
def test_after_a_takeover_the_executor_sends_nothing_more(jump: Any, when: str) -> None:
    async def scenario(at: Modes) -> None:
        await register_and_select(at)
        await arm(at)
        if when == "flying":
            await at.mode(MISSION_MODE, 30)
            await seconds(2)
        else:
            await at.mode(when, 60)
            await seconds(1)
        at.other.command(sim.MAV_CMD_DO_SET_MODE, 1, 4, HOLD)
        await at.mode("hold")
        await until(lambda: at.mission == "suspended", 2)
        assert at.station.missions.status("1").executor_in_charge is False
        before = len(at.world.topics[0].sent)
        await seconds(8)
        sent = at.world.topics[0].sent[before:]
        assert {topic for topic, _ in sent} <= {CHECK_REPLY, COMMAND}
        commands = {
            MESSAGES["VehicleCommand"].decode(data)["command"] for topic, data in sent if topic == COMMAND
        }
        assert commands <= {sim.MAV_CMD_RUN_PREARM_CHECKS}
        assert at.vehicle.status.mode == "hold"
        at.other.choose(MISSION_MODE)
        await until(lambda: at.mission == "done", 90)
        assert not at.vehicle.status.armed

    fly(jump, scenario, in_air=False)


def test_a_takeover_that_does_not_change_the_mode_suspends_the_mission(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        await register_and_select(at)
        await arm(at)
        await at.mode("takeoff")
        await seconds(1)
        at.other.command(sim.MAV_CMD_NAV_TAKEOFF, -1, 0, 0, *(float("nan"),) * 4)
        await until(lambda: at.mission == "suspended", 5)
        assert "Another party commands the vehicle" in at.station.missions.status("1").reason
        assert executor_commands(at) == [NAV_TAKEOFF]
        await at.mode("hold", 30)
        await seconds(3)
        assert executor_commands(at) == [NAV_TAKEOFF]

    fly(jump, scenario, in_air=False)


def test_after_the_operators_hold_during_the_take_off_the_executor_is_not_in_charge(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        await register_and_select(at)
        await arm(at)
        await at.mode("takeoff")
        await at.vehicle.command.hold()
        await until(lambda: at.mission == "suspended", 2)
        await seconds(5)
        assert at.vehicle.status.mode == "hold"
        assert executor_commands(at) == [NAV_TAKEOFF]

    fly(jump, scenario, in_air=False)


def test_refused_arming_does_not_start_the_mission(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        await register_and_select(at)
        at.world.streamer._streams._record_loop_message, record = (
            lambda _: None,
            at.world.streamer._streams._record_loop_message,
        )
        await seconds(3)
        with pytest.raises(GcsError):
            await at.vehicle.command.arm()
        assert not at.vehicle.status.armed
        assert at.mission is None
        assert executor_commands(at) == []
        at.world.streamer._streams._record_loop_message = record

    fly(jump, scenario, in_air=False)


def test_a_mission_with_a_take_off_that_is_selected_in_the_air_holds_and_states_why(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        await register_and_select(at)
        at.other.command(sim.MAV_CMD_DO_SET_MODE, 1, 4, HOLD)
        await at.mode("hold")
        await at.vehicle.command.takeoff(8)
        await at.mode("hold", 40)
        at.other.choose(MISSION_MODE)
        await until(lambda: any("cannot be flown" in text for text in at.warnings()), 5)
        await at.mode("hold")
        assert "already flying" in "".join(at.warnings())
        assert at.mission is None
        assert executor_commands(at) == []

    fly(jump, scenario, in_air=False)


async def change_settings(at: Modes) -> None:
    """The operator sets a limit, so that the mission must be compiled again."""
    await at.station.offboard("1").operator_limits.set(OperatorLimits(height_max_m=50.0), by="anna")


async def mode_is_ready(at: Modes, ready: bool) -> dict[str, Any]:
    """Waits until the mode shows this, and PX4 has received an answer with it."""
    for _ in range(60):
        if (await at.shown())["modes"][0]["ready"] == ready:
            await seconds(1)
            return (await at.shown())["modes"][0]
        await seconds(0.25)
    raise AssertionError(f"ready did not become {ready}")


def test_slow_plan_work_does_not_delay_the_take_off_after_arming(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        await register_and_select(at)
        at.station.plan_work = SlowWork(12.0)
        await arm(at)
        await at.mode("takeoff", 1.5)
        assert at.warnings() == []

    fly(jump, scenario, in_air=False)


def test_a_mission_is_compiled_again_and_takes_off_if_px4_arms_before_it_knows_of_the_change(
    jump: Any,
) -> None:
    async def scenario(at: Modes) -> None:
        await register_and_select(at)
        await mode_is_ready(at, True)
        at.station.plan_work = SlowWork(2.0)
        await change_settings(at)
        await seconds(0.15)
        assert not (await at.shown())["modes"][0]["ready"]
        await arm(at)
        await at.mode("takeoff", 5)
        assert at.warnings() == []

    fly(jump, scenario, in_air=False)


def test_a_vehicle_is_not_armed_in_a_mode_whose_mission_is_not_compiled(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        await register_and_select(at)
        at.station.plan_work, plan_work = NoWork(), at.station.plan_work
        await change_settings(at)
        await mode_is_ready(at, False)
        await until(lambda: any("PX4 does not arm in this mode" in text for text in at.warnings()), 10)
        assert "No worker." in (await at.shown())["modes"][0]["reason"]
        with pytest.raises(GcsError):
            await at.vehicle.command.arm()
        at.station.plan_work = plan_work
        assert (await mode_is_ready(at, True))["reason"] == ""
        await arm(at)
        await at.mode("takeoff", 1.5)

    fly(jump, scenario, in_air=False)


@pytest.mark.story
@pytest.mark.parametrize("lost", [COMMAND_ACK, MODE_COMPLETED])
def test_lost_answers_do_not_stop_the_mission(jump: Any, lost: str) -> None:
    async def scenario(at: Modes) -> None:
        await register_and_select(at)
        drop(at, lost)
        await arm(at)
        await until(lambda: at.mission == "done", 120)
        assert not at.vehicle.status.armed

    fly(jump, scenario, in_air=False)


def test_a_take_off_that_px4_never_receives_leaves_the_vehicle_on_the_ground(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        await register_and_select(at)
        topics = at.world.topics[0]
        send = topics.send
        lost: list[str] = []

        def send_others(topic: str, data: bytes) -> None:
            lost.append(topic) if topic == EXECUTOR_COMMAND else send(topic, data)

        topics.send = send_others  # type: ignore[method-assign]
        await arm(at)
        await until(lambda: at.mission == "suspended", 8)
        assert len(lost) == 3
        assert "The take-off failed" in at.station.missions.status("1").reason
        assert at.vehicle.status.landed_state == "on_ground"
        topics.send = send  # type: ignore[method-assign]
        await until(lambda: not at.vehicle.status.armed, 20)
        await at.mode("hold")
        at.other.choose(MISSION_MODE)
        await at.mode(MISSION_MODE)
        await mode_is_ready(at, True)  # PX4 moved its local origin when it armed
        await arm(at)
        await at.mode("takeoff")
        assert at.mission == "taking_off"

    fly(jump, scenario, in_air=False)


def test_px4_removes_a_mode_that_stops_answering_during_its_take_off_and_holds(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        await register_and_select(at)
        await arm(at)
        await at.mode("takeoff")
        at.world.streamer._streams.mode_ports[-1].working = False
        await at.mode("hold", 30)
        await until(lambda: any("is no longer registered" in text for text in at.warnings()), 5)
        await seconds(3)
        assert at.vehicle.status.mode == "hold"
        assert at.vehicle.status.armed
        assert COMMAND in {topic for topic, _ in at.world.topics[0].sent}

    fly(jump, scenario, in_air=False)
