"""A ROS 2 program flies through a guard, and a MAVLink program flies a vehicle that has only ROS 2."""

from __future__ import annotations

import asyncio
import math
from typing import Any

import pytest

from tests.protocol.api_calls import ANNA, journal_entries
from tests.protocol.fake_autopilot import OFFBOARD_MODE
from tests.protocol.guard_program import GuardedProgram, guarded_link
from tests.protocol.ros2_program import COMMAND, ros2_scene
from tests.protocol.simulated_testbed import both_versions, until
from vehicle_sim.px4_version import DEFAULT, Px4Version

ARM_DISARM, SET_MODE, LAND = 400, 176, 21
ACCEPTED, LATER, IN_PROGRESS = 0, 1, 5
OFFBOARD_STATE = 14
POSITION = "/fmu/out/vehicle_local_position"
STATUS = "/fmu/out/vehicle_status"


def run(
    run_simulated: Any, monkeypatch: Any, scenario: Any, px4: Px4Version = DEFAULT, **options: Any
) -> None:
    async def body() -> None:
        scene = await ros2_scene(monkeypatch, px4, **options)
        try:
            await scenario(scene)
        finally:
            scene.program.hang()
            await scene.testbed.close()

    run_simulated(body)


def view_of(scene: Any) -> Any:
    (guard,) = scene.station.guards.all()
    return guard


def height_m(scene: Any) -> float:
    return -scene.program.newest(POSITION)["z"]


async def climb(scene: Any) -> None:
    """As the example of PX4's guide: Offboard and arming without a setpoint, which comes in Offboard."""
    program = scene.program

    def timer() -> None:
        program.heartbeat()
        if program.newest(STATUS)["nav_state"] == OFFBOARD_STATE:
            program.trajectory(position=(0.0, 0.0, -5.0))

    program.stream(timer)
    await asyncio.sleep(1.0)
    program.command(SET_MODE, 1.0, 6.0)
    program.command(ARM_DISARM, 1.0)
    await until(lambda: height_m(scene) > 4.5, 20.0)


@both_versions
def test_the_program_of_px4s_guide_flies_through_a_guard(
    run_simulated: Any, monkeypatch: pytest.MonkeyPatch, px4: Px4Version
) -> None:
    async def scenario(scene: Any) -> None:
        program = scene.program
        await climb(scene)
        assert program.answers(SET_MODE) == [(ACCEPTED, 1, 1)]
        assert program.answers(ARM_DISARM)[-1] == (ACCEPTED, 1, 1)
        guard = view_of(scene)
        assert guard.flying
        assert guard.problem is None
        assert guard.programs[0].setpoint_rate_hz == pytest.approx(20.0, rel=0.1)
        assert ("Program on guard", "offboard/start", "1", "ok") in journal_entries(scene.station)
        program.hang()
        program.command(LAND)
        await until(lambda: not scene.vehicle.status.armed, 30.0)

    run(run_simulated, monkeypatch, scenario, px4)


def test_a_ros2_program_that_hangs_is_held_and_one_that_ended_is_forgotten(
    run_simulated: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scenario(scene: Any) -> None:
        program = scene.program
        await climb(scene)

        def north() -> None:
            program.heartbeat("velocity")
            program.trajectory(velocity=(2.0, 0.0, 0.0))

        program.stream(north)
        await asyncio.sleep(3.0)
        assert program.newest(POSITION)["x"] > 2.0
        program.hang()
        await asyncio.sleep(3.0)
        stopped_m = program.newest(POSITION)["x"]
        await asyncio.sleep(4.0)
        assert program.newest(POSITION)["x"] == pytest.approx(stopped_m, abs=0.3)
        assert scene.vehicle.status.mode == "hold"
        assert not view_of(scene).flying
        scene.programs.there.clear()
        await asyncio.sleep(2.0)
        assert view_of(scene).programs == ()

    run(run_simulated, monkeypatch, scenario)


def test_a_heartbeat_alone_keeps_a_position_but_not_a_motion(
    run_simulated: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """PX4 flies the last setpoint for as long as OffboardControlMode comes, also of a program that hangs in
    part."""

    async def scenario(scene: Any) -> None:
        program = scene.program
        await climb(scene)
        program.stream(program.heartbeat)
        await asyncio.sleep(15.0)
        assert view_of(scene).flying
        assert height_m(scene) == pytest.approx(5.0, abs=0.5)
        program.trajectory(velocity=(1.0, 0.0, 0.0))
        program.stream(lambda: program.heartbeat("velocity"))
        await asyncio.sleep(8.0)
        assert program.newest(POSITION)["x"] > 4.0
        await asyncio.sleep(12.0)
        assert scene.vehicle.status.mode == "hold"

    run(run_simulated, monkeypatch, scenario)


def test_a_persons_hold_beats_a_ros2_program(run_simulated: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    async def scenario(scene: Any) -> None:
        program = scene.program
        await climb(scene)
        await scene.vehicle.command.hold(by=ANNA.name)
        await asyncio.sleep(1.0)
        program.command(SET_MODE, 1.0, 6.0)
        await asyncio.sleep(3.0)
        assert scene.vehicle.status.mode == "hold"
        assert program.answers(SET_MODE)[-1] == (LATER, 1, 1)
        assert view_of(scene).paused == "anna commanded “hold”."

    run(run_simulated, monkeypatch, scenario)


def test_topics_that_no_limit_acts_on_are_refused_with_words(
    run_simulated: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scenario(scene: Any) -> None:
        program = scene.program
        before = len(scene.vehicle_end.sent)
        program.heartbeat("direct_actuator")
        program.publish("/fmu/in/actuator_motors", control=(0.5,) * 12)
        program.publish("/fmu/in/goto_setpoint", position=(0.0, 0.0, -5.0))
        program.publish("/fmu/in/trajectory_setpoint", position=(math.inf, 0.0, 0.0))
        program.publish("/fmu/in/vehicle_visual_odometry", position=(1.0, 2.0, 3.0))
        await asyncio.sleep(1.0)
        refused = {each.what: each.text for each in view_of(scene).programs[0].refusals}
        assert "no limit, fence or brake" in refused["/fmu/in/actuator_motors"]
        assert "use Offboard" in refused["/fmu/in/goto_setpoint"]
        passed = [topic for topic, _ in scene.vehicle_end.sent[before:]]
        assert passed == ["/fmu/in/vehicle_visual_odometry"], "an estimate passes whoever has control"

    run(run_simulated, monkeypatch, scenario)


def test_on_a_link_that_only_reads_nothing_reaches_the_vehicle(
    run_simulated: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scenario(scene: Any) -> None:
        program = scene.program
        before = len(scene.vehicle_end.sent)
        program.publish("/fmu/in/vehicle_visual_odometry", position=(1.0, 2.0, 3.0))
        program.command(ARM_DISARM, 1.0)
        await asyncio.sleep(2.0)
        assert scene.vehicle_end.sent[before:] == []
        assert program.answers(ARM_DISARM) == [(LATER, 1, 1)]
        assert not scene.vehicle.status.armed
        assert program.newest(STATUS)["system_id"] == 1, "it is told what the vehicle does"

    run(run_simulated, monkeypatch, scenario, control="read")


def test_without_the_vehicles_ros2_link_nothing_is_offered_and_it_says_why(
    run_simulated: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scenario(scene: Any) -> None:
        scene.link.serve(None, 1)
        assert scene.link._run is None
        assert "add a ros2:// link" in scene.link.info().detail
        scene.link.address = scene.vehicle.endpoints[0].peer.dds
        await asyncio.sleep(0.5)
        assert "the vehicle's own topics" in view_of(scene).problem

    run(run_simulated, monkeypatch, scenario)


def test_a_mavlink_program_flies_a_vehicle_that_is_connected_over_ros2_only(
    run_simulated: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scenario(scene: Any) -> None:
        program = GuardedProgram(guarded_link(scene.testbed, "mavlink", control="free"))
        program.heartbeat()
        await asyncio.sleep(1.0)
        program.command(ARM_DISARM, 1.0)
        await until(lambda: scene.vehicle.status.armed, 5.0)
        program.stream(lambda: program.position(0, 0, -5))
        await asyncio.sleep(0.5)
        program.set_mode(OFFBOARD_MODE)
        await until(lambda: height_m(scene) > 4.5, 20.0)
        assert program.acks(ARM_DISARM) == [ACCEPTED]
        assert program.acks(SET_MODE)[-1] == ACCEPTED
        program.hang()

    run(run_simulated, monkeypatch, scenario)


def test_a_command_names_a_place_exactly(run_simulated: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """float32 would move it by up to a metre."""

    async def scenario(scene: Any) -> None:
        place = {"param5": 47.39774219, "param6": 8.54559402, "param7": 500.0}
        scene.program.command(192, -1.0, 1.0, 0.0, math.nan, **place)
        await asyncio.sleep(1.0)
        sent = [data for topic, data in scene.testbed.topics[0].sent_messages if topic == COMMAND][-1]
        values = scene.messages["VehicleCommand"].decode(sent)
        assert (values["command"], values["param7"]) == (192, 500.0)
        assert values["param5"] == pytest.approx(place["param5"], abs=1e-7)
        assert values["param6"] == pytest.approx(place["param6"], abs=1e-7)

    run(run_simulated, monkeypatch, scenario)


def test_arming_directly_after_asking_for_offboard_waits_for_it(
    run_simulated: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Many programs send both at once."""

    async def scenario(scene: Any) -> None:
        program = GuardedProgram(guarded_link(scene.testbed, "mavlink", control="free"))
        program.heartbeat()
        await asyncio.sleep(1.0)
        program.stream(lambda: program.position(0, 0, -5))
        await asyncio.sleep(0.5)
        program.set_mode(OFFBOARD_MODE)
        for _ in range(3):
            program.command(ARM_DISARM, 1.0)
            await asyncio.sleep(0.1)
        await until(lambda: height_m(scene) > 4.5, 20.0)
        assert program.acks(SET_MODE)[-1] == ACCEPTED
        assert program.acks(ARM_DISARM) == [IN_PROGRESS] * 3 + [ACCEPTED]
        program.hang()

    run(run_simulated, monkeypatch, scenario)
