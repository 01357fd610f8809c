"""A program flies through a guard: what the vehicle does, and what the program is told."""

from __future__ import annotations

import math

import pytest

from gcs_server.streamer.values.limit_values import OperatorLimits
from gcs_server.vehicle.services import ftp_codec
from tests.protocol.api_calls import ANNA, journal_entries
from tests.protocol.fake_autopilot import HOLD_MODE, OFFBOARD_MODE, POSITION_MODE
from tests.protocol.guard_program import (
    START_S,
    GuardedProgram,
    guarded_link,
    run_with_program,
    scene_with_program,
)
from tests.protocol.offboard_testbed import mode_requests, sleep
from tests.protocol.one_vehicle import PACKET_LOSS_CASES
from tests.protocol.simulated_testbed import SimulatedTestbed
from tests.unit.vehicle_sim.prepared_stations import station_in_hover
from tests.unit.vehicle_sim.sim_station import Station
from vehicle_sim.mavlink import generated_dialect as sim
from vehicle_sim.world.files import load_world

SET_MODE = sim.MAV_CMD_DO_SET_MODE


def view_of(scene):
    (guard,) = scene.station.guards.all()
    return guard


def test_a_program_finds_the_vehicle_and_flies_its_setpoints(run_simulated):
    async def scenario(scene):
        program = scene.program
        assert {(m.get_srcSystem(), m.get_srcComponent()) for m in program.of("HEARTBEAT")} == {(1, 1)}
        await program.fly_offboard()
        assert program.acks(SET_MODE)[-1] == 0
        assert scene.autopilot.mode == OFFBOARD_MODE
        program.stream(lambda: program.position(3, 4, -6))
        await sleep(1.0)
        newest = scene.autopilot.setpoints[-1][1]
        assert (newest.x, newest.y, newest.z) == (3, 4, -6)
        assert newest.get_srcSystem() == 255
        guard = view_of(scene)
        assert guard.flying
        assert guard.programs[0].kind == "onboard controller"
        assert guard.programs[0].commanding
        assert ("Program on guard", "offboard/start", "1", "ok") in journal_entries(scene.station)
        assert scene.autopilot.failsafe_count == 0

    run_with_program(run_simulated, scenario)


def test_a_program_that_hangs_lets_the_vehicle_hold(run_simulated):
    async def scenario(scene):
        program = scene.program
        await program.fly_offboard()
        program.stream(lambda: program.velocity(2, 0, 0))
        await sleep(1.0)
        program.hang()
        await sleep(0.7)
        newest = scene.autopilot.setpoints[-1][1]
        assert newest.type_mask & 0b111 == 0  # a position: the vehicle no longer moves on
        await sleep(8.0)
        assert scene.autopilot.mode == HOLD_MODE
        assert scene.autopilot.failsafe_count == 0
        assert any("expired" in text.lower() or "holds its place" in text for text in program.texts())
        count = len(scene.autopilot.setpoints)
        program.stream(lambda: program.velocity(2, 0, 0))  # it wakes up
        await sleep(2.0)
        assert len(scene.autopilot.setpoints) == count
        assert scene.autopilot.mode == HOLD_MODE

    run_with_program(run_simulated, scenario)


def test_a_moving_setpoint_that_never_changes_is_that_of_a_program_that_hangs(run_simulated):
    async def scenario(scene):
        program, autopilot = scene.program, scene.autopilot
        await program.fly_offboard()
        await sleep(15.0)  # a position may stay the same
        assert autopilot.mode == OFFBOARD_MODE
        program.stream(lambda: program.velocity(1, 0, 0))
        await sleep(9.0)
        assert autopilot.setpoints[-1][1].vx == 1
        await sleep(3.0)
        assert autopilot.setpoints[-1][1].type_mask & 0b111 == 0  # it keeps its place
        assert any("may hang" in text for text in program.texts())
        program.stream(lambda: program.velocity(0, 1, 0))  # it does not hang
        await sleep(1.0)
        assert autopilot.setpoints[-1][1].vy == 1
        await sleep(20.0)
        assert (autopilot.mode, autopilot.failsafe_count) == (HOLD_MODE, 0)

    run_with_program(run_simulated, scenario)


def test_a_link_may_let_a_setpoint_stay_the_same(run_simulated):
    async def scenario(scene):
        await scene.program.fly_offboard()
        scene.program.stream(lambda: scene.program.velocity(1, 0, 0))
        await sleep(40.0)
        assert scene.autopilot.setpoints[-1][1].vx == 1

    run_with_program(run_simulated, scenario, same_for_s=0.0)


def test_the_hold_of_a_person_beats_a_program_that_asks_again(run_simulated):
    async def scenario(scene):
        program, autopilot = scene.program, scene.autopilot
        await program.fly_offboard()
        await scene.vehicle.command.hold(by=ANNA.name)
        await sleep(1.0)
        assert autopilot.mode == HOLD_MODE
        assert any("anna commanded" in text for text in program.texts()), program.texts()
        for _ in range(5):
            program.set_mode(OFFBOARD_MODE)
            await sleep(2.0)
        assert autopilot.mode == HOLD_MODE
        assert set(program.acks(SET_MODE)[2:]) == {sim.MAV_RESULT_TEMPORARILY_REJECTED}
        assert view_of(scene).paused == "anna commanded “hold”."
        scene.station.guards.get("guard").resume()
        program.set_mode(OFFBOARD_MODE)
        await sleep(START_S)
        assert autopilot.mode == OFFBOARD_MODE

    run_with_program(run_simulated, scenario)


def test_a_program_without_control_is_refused_and_asks_for_it(run_simulated):
    async def scenario(scene):
        program, authority = scene.program, scene.station.authority
        with authority.connected(ANNA):
            authority.control("1").lease.take(ANNA)
            await program.fly_offboard()
            assert program.acks(SET_MODE) == [sim.MAV_RESULT_TEMPORARILY_REJECTED]
            assert scene.autopilot.mode == HOLD_MODE
            assert not scene.autopilot.setpoints
            assert any("anna" in text and "asked for control" in text for text in program.texts())
            (request,) = authority.control("1").lease.requests()
            assert request.client == "Program on guard"
            authority.control("1").lease.grant(ANNA, request.key)
            await program.fly_offboard()
        assert scene.autopilot.mode == OFFBOARD_MODE

    run_with_program(run_simulated, scenario)


def test_a_link_that_only_reads_passes_no_command(run_simulated):
    async def scenario(scene):
        program = scene.program
        await program.fly_offboard()
        program.command(sim.MAV_CMD_COMPONENT_ARM_DISARM, 0, 21196)
        program.send(sim.MAVLink_param_set_message(1, 1, b"MPC_XY_VEL_MAX", 3.0, 9))
        program.send(sim.MAVLink_param_request_read_message(1, 1, b"MPC_XY_VEL_MAX", -1))
        await sleep(1.0)
        assert scene.autopilot.armed
        assert scene.autopilot.params["MPC_XY_VEL_MAX"][1] == 12.0
        assert [m.param_id for m in program.of("PARAM_VALUE")] == ["MPC_XY_VEL_MAX"]
        assert any("only reads" in text for text in program.texts())

    run_with_program(run_simulated, scenario, control="read")


def test_setpoints_that_cannot_be_flown_are_refused_and_the_last_good_one_expires(run_simulated):
    async def scenario(scene):
        program, autopilot = scene.program, scene.autopilot
        await program.fly_offboard()
        program.stream(lambda: program.position(math.nan, 0, -5))
        await sleep(0.8)
        newest = autopilot.setpoints[-1][1]
        assert newest.x == autopilot.position_ned_m[0]
        assert all(math.isfinite(value) for value in (newest.x, newest.y, newest.z))
        assert "GCS: x is not a number. Set its ignore bit, or send a number." in program.texts()
        (shown,) = view_of(scene).programs
        assert shown.setpoints_refused > 10
        assert shown.refusals[0].what == "SET_POSITION_TARGET_LOCAL_NED"
        assert shown.refusals[0].repeated > 10
        program.stream(lambda: program.position(0, 0, -6))  # in time: PX4 was never left without setpoints
        await sleep(1.0)
        assert autopilot.setpoints[-1][1].z == -6
        assert (autopilot.mode, autopilot.failsafe_count) == (OFFBOARD_MODE, 0)

    run_with_program(run_simulated, scenario)


def test_setpoints_stay_within_the_operators_limits(run_simulated):
    async def scenario(scene):
        program = scene.program
        limits = OperatorLimits(speed_max_m_s=1.0, distance_max_m=20.0)
        await scene.station.offboard("1").operator_limits.set(limits, by="anna")
        await program.fly_offboard()
        program.stream(lambda: program.velocity(5, 0, 0))
        await sleep(1.0)
        newest = scene.autopilot.setpoints[-1][1]
        assert math.hypot(newest.vx, newest.vy) <= 1.001
        assert view_of(scene).programs[0].limited
        assert len(program.texts()) >= 1
        program.stream(lambda: program.position(100, 0, -5))
        await sleep(1.0)
        assert all(abs(m.x) <= 20.0 for _, m in scene.autopilot.setpoints if m.type_mask & 7 == 0)
        assert view_of(scene).programs[0].setpoints_refused > 0

    run_with_program(run_simulated, scenario)


def test_a_flood_is_flown_at_the_newest_and_other_messages_are_cut(run_simulated):
    async def scenario(scene):
        program, autopilot = scene.program, scene.autopilot
        await program.fly_offboard()
        program.hang()
        sent = len(autopilot.setpoints)
        for n in range(5000):
            program.position(n % 7, 0, -5)
            program.send(sim.MAVLink_param_request_read_message(1, 1, b"MPC_XY_VEL_MAX", -1))
            if n % 50 == 0:
                await sleep(0.01)
        assert len(autopilot.setpoints) - sent <= 160  # 100 Hz and the stream's own
        await sleep(0.1)
        assert len(autopilot.received_messages) < 4000
        assert autopilot.setpoints[-1][1].x == 4999 % 7
        assert any("1000 messages" in text for text in program.texts())
        assert autopilot.failsafe_count == 0

    run_with_program(run_simulated, scenario)


def test_two_programs_cannot_both_fly(run_simulated):
    async def scenario(scene):
        first = scene.program
        second = GuardedProgram(guarded_link(scene.testbed, "other"))
        third = GuardedProgram(scene.link, "third", ids=(200, 1))
        for each in (second, third):
            each.heartbeat()
        await first.fly_offboard()
        try:
            for each in (second, third):
                await each.fly_offboard()
                assert each.acks(SET_MODE) == [sim.MAV_RESULT_TEMPORARILY_REJECTED]
            assert any("has control" in text or "control" in text for text in second.texts())
            assert any("program commands over this link" in text for text in third.texts())
            assert {m.z for _, m in scene.autopilot.setpoints} == {-5}
        finally:
            for each in (second, third):
                each.hang()

    run_with_program(run_simulated, scenario)


def test_a_program_that_was_restarted_elsewhere_takes_the_place_of_a_silent_one(run_simulated):
    async def scenario(scene):
        await scene.program.fly_offboard()
        scene.program.hang()  # killed
        await sleep(9.0)
        assert scene.autopilot.mode == HOLD_MODE
        restarted = GuardedProgram(scene.link, "restarted")
        await restarted.fly_offboard()
        try:
            assert restarted.acks(SET_MODE)[-1] == 0
            assert scene.autopilot.mode == OFFBOARD_MODE
        finally:
            restarted.hang()

    run_with_program(run_simulated, scenario)


def test_a_program_may_hold_while_its_offboard_starts(run_simulated):
    async def scenario(scene):
        program, autopilot = scene.program, scene.autopilot
        program.stream(lambda: program.position(0, 0, -5))
        await sleep(0.5)
        program.set_mode(OFFBOARD_MODE)
        await sleep(0.5)
        program.set_mode(HOLD_MODE)
        await sleep(START_S)
        assert autopilot.mode == HOLD_MODE
        assert not mode_requests(autopilot, OFFBOARD_MODE)
        assert scene.station.guards.get("guard").paused is None

    run_with_program(run_simulated, scenario)


def test_a_landed_vehicle_is_not_armed_by_a_program_that_was_overruled(run_simulated):
    async def scenario(scene):
        program, autopilot = scene.program, scene.autopilot
        guard = scene.station.guards.get("guard")
        await program.fly_offboard()
        await scene.vehicle.command.hold(by=ANNA.name)
        await sleep(1.0)
        autopilot.land_and_disarm()
        for _ in range(5):  # as the loop of many programs does
            program.set_mode(OFFBOARD_MODE)
            program.command(sim.MAV_CMD_COMPONENT_ARM_DISARM, 1)
            await sleep(2.0)
        assert not autopilot.armed
        assert program.acks(sim.MAV_CMD_COMPONENT_ARM_DISARM)[-1] == sim.MAV_RESULT_TEMPORARILY_REJECTED
        program.hang()  # a person ends it
        await sleep(6.0)
        assert guard.paused is None
        program.command(sim.MAV_CMD_COMPONENT_ARM_DISARM, 1)  # and starts it again
        await sleep(1.0)
        assert autopilot.armed

    run_with_program(run_simulated, scenario)


def test_the_pilots_sticks_pause_a_program(run_simulated):
    async def scenario(scene):
        await scene.program.fly_offboard()
        scene.autopilot.mode = scene.autopilot.requested_mode = POSITION_MODE
        scene.autopilot.send_current_mode()
        scene.autopilot.send_heartbeat()
        await sleep(1.5)
        assert "The mode was changed by" in view_of(scene).paused
        assert not view_of(scene).flying

    run_with_program(run_simulated, scenario)


def test_a_command_sent_again_is_one_command_and_the_vehicle_answers_it(run_simulated):
    async def scenario(scene):
        program, autopilot = scene.program, scene.autopilot
        autopilot.silent_commands.add(sim.MAV_CMD_DO_CHANGE_SPEED)
        for _ in range(3):
            program.command(sim.MAV_CMD_DO_CHANGE_SPEED, 1, 3.0)
            await sleep(0.5)
        assert len(autopilot.received_commands(sim.MAV_CMD_DO_CHANGE_SPEED)) == 3
        await sleep(4.0)
        lines = [line for line in journal_entries(scene.station) if line[1] == "speed"]
        assert lines == [("Program on guard", "speed", "1", "no_reply")]
        autopilot.silent_commands.clear()
        program.command(sim.MAV_CMD_DO_CHANGE_SPEED, 1, 4.0)
        await sleep(0.5)
        assert program.acks(sim.MAV_CMD_DO_CHANGE_SPEED) == [0]

    run_with_program(run_simulated, scenario)


def test_a_program_gets_the_rates_that_it_asks_and_the_server_keeps_its_own(run_simulated):
    async def scenario(scene):
        program = scene.program
        await sleep(2.0)
        program.command(sim.MAV_CMD_SET_MESSAGE_INTERVAL, sim.MAVLINK_MSG_ID_ATTITUDE, 500_000)
        program.command(sim.MAV_CMD_SET_MESSAGE_INTERVAL, sim.MAVLINK_MSG_ID_LOCAL_POSITION_NED, -1)
        await sleep(0.1)
        assert program.acks(sim.MAV_CMD_SET_MESSAGE_INTERVAL) == [0, 0]
        assert not scene.autopilot.received_commands(sim.MAV_CMD_SET_MESSAGE_INTERVAL)
        before = {kind: len(program.of(kind)) for kind in ("ATTITUDE", "LOCAL_POSITION_NED")}
        await sleep(10.0)
        assert len(program.of("ATTITUDE")) - before["ATTITUDE"] in (20, 21)
        assert len(program.of("LOCAL_POSITION_NED")) == before["LOCAL_POSITION_NED"]
        program.command(sim.MAV_CMD_SET_MESSAGE_INTERVAL, sim.MAVLINK_MSG_ID_ATTITUDE, 5_000)
        await sleep(0.5)
        assert scene.autopilot.received_commands(sim.MAV_CMD_SET_MESSAGE_INTERVAL)

    run_with_program(run_simulated, scenario)


def test_messages_that_are_not_for_a_guard_are_refused_by_name(run_simulated):
    async def scenario(scene):
        program, autopilot = scene.program, scene.autopilot
        program.send(sim.MAVLink_setup_signing_message(1, 1, list(range(32)), 0))
        program.send(sim.MAVLink_rc_channels_override_message(1, 1, *([1500] * 8)))
        program.target_system = 2
        program.command(sim.MAV_CMD_DO_CHANGE_SPEED, 1, 3.0)  # another vehicle's
        await sleep(1.0)
        kinds = {m.get_type() for m in autopilot.received_messages}
        assert not kinds & {"SETUP_SIGNING", "RC_CHANNELS_OVERRIDE"}
        assert not autopilot.received_commands(sim.MAV_CMD_DO_CHANGE_SPEED)
        refusals = {refusal.what: refusal.text for refusal in view_of(scene).programs[0].refusals}
        assert refusals.keys() == {"SETUP_SIGNING", "RC_CHANNELS_OVERRIDE"}
        assert "signing key" in refusals["SETUP_SIGNING"]

    run_with_program(run_simulated, scenario)


def test_a_program_without_control_may_send_estimates_but_no_files(run_simulated):
    async def scenario(scene):
        program, authority = scene.program, scene.station.authority
        with authority.connected(ANNA):
            authority.control("1").lease.take(ANNA)
            program.send(sim.MAVLink_vision_position_estimate_message(1, 1, 2, 3, 0, 0, 0))
            create = ftp_codec.encode(
                ftp_codec.request(ftp_codec.Opcode.CREATE_FILE, 7, path="/fs/microsd/x")
            )
            program.send(sim.MAVLink_file_transfer_protocol_message(0, 1, 1, list(create)))
            await sleep(0.5)
        kinds = [m.get_type() for m in scene.autopilot.received_messages]
        assert kinds.count("VISION_POSITION_ESTIMATE") == 1
        assert "FILE_TRANSFER_PROTOCOL" not in kinds
        (answer,) = program.of("FILE_TRANSFER_PROTOCOL")
        packet = ftp_codec.decode(bytes(answer.payload))
        assert (packet.opcode, packet.sequence, packet.data[:1]) == (ftp_codec.Opcode.NAK, 8, bytes([9]))

    run_with_program(run_simulated, scenario)


def test_closing_the_link_lets_the_vehicle_hold(run_simulated):
    async def scenario(scene):
        await scene.program.fly_offboard()
        scene.program.hang()
        await scene.testbed.router.remove_link("guard")
        await sleep(8.0)
        assert scene.autopilot.mode == HOLD_MODE
        assert scene.autopilot.failsafe_count == 0
        assert scene.station.guards.all() == []
        assert scene.vehicle.taps == ()

    run_with_program(run_simulated, scenario)


@pytest.mark.parametrize(("loss", "seed"), PACKET_LOSS_CASES)
def test_a_program_flies_over_a_lossy_link_of_the_vehicle(run_simulated, loss, seed):
    async def scenario(scene):
        program = scene.program
        program.stream(lambda: program.position(0, 0, -5))
        for _ in range(5):  # as programs do
            program.set_mode(OFFBOARD_MODE)
            await sleep(START_S)
            if scene.autopilot.mode == OFFBOARD_MODE:
                break
        assert scene.autopilot.mode == OFFBOARD_MODE
        program.stream(lambda: program.velocity(1, 0, 0))
        await sleep(5.0)
        assert scene.autopilot.setpoints[-1][1].vx == 1

    run_with_program(run_simulated, scenario, loss=loss, seed=seed)


@pytest.mark.story
def test_a_program_is_stopped_before_an_obstacle(run_simulated):
    async def run():
        fleet = station_in_hover(Station, 2.0, links=(("gcs", "gcs"),), world=load_world("obstacle-box")).sim
        testbed = SimulatedTestbed(sim=fleet)
        north_m = []
        try:
            scene = await scene_with_program(testbed, await testbed.wait_for_vehicle())
            program = scene.program
            program.stream(lambda: program.position(10, 0, -2))  # behind the box
            await sleep(0.5)
            program.set_mode(OFFBOARD_MODE)
            for _ in range(200):
                await sleep(0.1)
                north_m.append(float(fleet.simulation.truth.position_ned_m[0][0]))
            program.hang()
            await sleep(8.0)
            assert scene.vehicle.status.mode == "hold"
        finally:
            await testbed.close()
        assert 1.0 < max(north_m) < 4.25 - 0.5
        assert any("obstacle" in text.lower() for text in program.texts()), program.texts()
        assert not any("Collision" in event.text for event in scene.vehicle.events.since())

    run_simulated(run)
