"""The server flies offboard missions: a whole flight of the simulated PX4, interruptions, and the routes."""

import asyncio
import math

import pytest

from gcs_server.api import offboard_mission_models as models
from gcs_server.api import offboard_mission_routes as routes
from gcs_server.errors import NotInControl, PlanFindings, Refused
from gcs_server.flights.readings import reported_values
from gcs_server.streamer.values.limit_values import OperatorLimits
from tests.protocol.api_calls import ANNA, InlinePlanWork, journal_entries, json_of, run_with_routes
from tests.protocol.api_calls import BOB as ROUTE_BOB
from tests.protocol.fake_autopilot import HOLD_MODE, OFFBOARD_MODE, POSITION_MODE
from tests.protocol.mission_flights import ALICE, BOB, LEASE_S, MissionsTestbed, event_codes, run_in_flight
from tests.protocol.offboard_testbed import assert_nothing_sent, mode_requests, sleep, stream_request
from tests.protocol.simulated_testbed import SimulatedTestbed, until
from tests.support.offboard_missions import mission
from vehicle_sim.mavlink import generated_dialect as sim

YAW_RAD = 0.5
"""Yaw of the scripted vehicle."""
FLIGHT = """
- {step: take_off, height_m: 4}
- {step: gimbal, track: look_at, place: {offset_ned_m: [10, 0, 0]}}
- {step: orbit, center: {offset_ned_m: [6, 0, -4]}, radius_m: 6, speed_m_s: 3, photo_every_m: 9}
- {step: wait, until: person, timeout_s: 60, message: Sharp?}
- {step: land}
"""
HOVER = "- {step: hold, duration_s: 120}\n- {step: hold, duration_s: 120, name: Second}\n"


def hover_mission(**actions):
    document = mission(HOVER)
    return document.model_copy(update={"actions": document.actions.model_copy(update=actions)})


def test_a_mission_takes_off_flies_takes_pictures_waits_for_the_operator_and_lands(run_simulated, tmp_path):
    async def scenario():
        testbed = SimulatedTestbed(camera=True)
        missions = MissionsTestbed(testbed, tmp_path)
        try:
            vehicle = await testbed.wait_for_vehicle_ready_to_arm()
            flight = missions.begin(vehicle, mission(FLIGHT))
            await missions.reach("flying")
            assert flight.status().if_stream_stops
            deviation_max_m, gimbal_pointed_down = 0.0, False
            while missions.state == "flying":
                deviation_max_m = max(deviation_max_m, flight.status().deviation_m or 0.0)
                gimbal = vehicle.topic("gimbal")
                gimbal_pointed_down |= gimbal is not None and gimbal.value.pitch_rad < -0.2
                await sleep(0.1)
            assert deviation_max_m < 3.0  # the reported position is some tenths of a second old
            assert gimbal_pointed_down
            assert (missions.state, flight.status().question) == ("waiting", "Sharp?")
            flight.go_on("Alice")
            await missions.reach("done")
            assert not vehicle.status.armed
            assert event_codes(vehicle) == ["question", "answered", "done"]
        finally:
            await testbed.close()

    run_simulated(scenario)


# --- operator and pilot ---------------------------------------------------------------------------


def test_a_paused_mission_holds_in_offboard_and_resumes(run_simulated, tmp_path):
    async def scenario(missions, vehicle, autopilot):
        missions.flight.pause("Alice")
        await missions.reach("paused", within_s=5)
        remaining_s = missions.flight.status().remaining_s
        await sleep(5)
        assert (autopilot.mode, missions.flight.status().remaining_s) == (OFFBOARD_MODE, remaining_s)
        missions.flight.resume("Alice")
        await sleep(5)
        assert missions.flight.status().remaining_s < remaining_s - 2

    run_in_flight(run_simulated, tmp_path, hover_mission(), scenario)


def test_a_setpoint_stream_or_mission_during_a_mission_is_refused(run_simulated, tmp_path):
    async def scenario(missions, vehicle, autopilot):
        with pytest.raises(Refused, match="flies the mission 'Test'") as refused:
            await vehicle.offboard.setpoint(stream_request())
        assert "Pause or abort" in str(refused.value.remedy)
        with pytest.raises(Refused, match="already has a setpoint stream"):
            await vehicle.offboard.start(stream_request())
        with pytest.raises(Refused, match="has the mission 'Test'"):
            missions.begin(vehicle, hover_mission(), in_air=True)
        assert missions.state == "flying"

    run_in_flight(run_simulated, tmp_path, hover_mission(), scenario)


def test_an_operators_hold_suspends_the_mission_until_it_is_resumed(run_simulated, tmp_path):
    async def scenario(missions, vehicle, autopilot):
        await vehicle.command.hold(by="Bob")
        await missions.reach("suspended", within_s=2)
        assert "Bob" in missions.flight.status().reason
        await assert_nothing_sent(autopilot, None)
        assert autopilot.mode == HOLD_MODE
        missions.flight.resume("Alice")
        await missions.reach("flying", within_s=10)
        assert autopilot.mode == OFFBOARD_MODE

    run_in_flight(run_simulated, tmp_path, hover_mission(), scenario)


def test_a_stop_of_the_stream_suspends_the_mission_like_hold(run_simulated, tmp_path):
    async def scenario(missions, vehicle, autopilot):
        await vehicle.offboard.stop()
        await missions.reach("suspended", within_s=2)
        await assert_nothing_sent(autopilot, None)
        assert autopilot.mode == HOLD_MODE

    run_in_flight(run_simulated, tmp_path, hover_mission(), scenario)


def test_an_aborted_mission_switches_to_hold_and_nothing_more_is_sent(run_simulated, tmp_path):
    async def scenario(missions, vehicle, autopilot):
        missions.flight.abort("Alice", "hold")
        assert missions.state == "aborted"
        await until(lambda: autopilot.mode == HOLD_MODE, 5)
        await assert_nothing_sent(autopilot, None, settle_s=1.0)
        with pytest.raises(Refused, match="has ended"):
            missions.flight.resume("Alice")

    run_in_flight(run_simulated, tmp_path, hover_mission(), scenario)


def test_after_a_pilot_takes_over_nothing_is_sent_until_an_operator_resumes_the_mission(
    run_simulated, tmp_path
):
    async def scenario(missions, vehicle, autopilot):
        autopilot.mode = autopilot.requested_mode = POSITION_MODE
        autopilot.send_current_mode()
        await missions.reach("suspended", within_s=2)
        await assert_nothing_sent(autopilot, None, 10.0, settle_s=0.3)
        assert autopilot.mode == POSITION_MODE
        missions.flight.resume("Alice")
        await missions.reach("flying", within_s=10)

    run_in_flight(
        run_simulated, tmp_path, hover_mission(low_battery="return", link_loss="continue"), scenario
    )


def test_a_pilot_who_takes_over_during_the_resume_keeps_the_vehicle(run_simulated, tmp_path):
    async def scenario(missions, vehicle, autopilot):
        await vehicle.command.hold(by="Bob")
        await missions.reach("suspended", within_s=2)
        request_count = len(mode_requests(autopilot, OFFBOARD_MODE))
        missions.flight.resume("Alice")
        await sleep(0.6)  # setpoints are sent; Offboard is not requested yet
        autopilot.mode = autopilot.requested_mode = POSITION_MODE
        autopilot.send_current_mode()
        await missions.reach("suspended", within_s=2)
        await assert_nothing_sent(autopilot, None, 5.0, settle_s=0.3)
        assert len(mode_requests(autopilot, OFFBOARD_MODE)) == request_count
        assert autopilot.mode == POSITION_MODE

    run_in_flight(run_simulated, tmp_path, hover_mission(), scenario)


def test_a_mission_does_not_resume_while_an_obstacle_is_measured_on_the_way_back(run_simulated, tmp_path):
    async def scenario(missions, vehicle, autopilot):
        await vehicle.command.hold(by="Bob")
        await missions.reach("suspended", within_s=2)
        # 20 m behind the mission's position, so that the path back is straight ahead
        autopilot.position_ned_m = [-20 * math.cos(YAW_RAD), -20 * math.sin(YAW_RAD), -5.0]

        def send_obstacle():
            message = sim.MAVLink_distance_sensor_message(autopilot.boot_ms(), 10, 2000, 300, 0, 0, 0, 0)
            autopilot.send(message)

        autopilot._every(0.2, send_obstacle)
        await sleep(1)
        missions.flight.resume("Alice")
        await sleep(1)
        assert missions.state == "suspended"
        assert "An obstacle is measured 3 m ahead" in missions.flight.status().reason
        assert autopilot.mode == HOLD_MODE
        vehicle.offboard.avoidance.way = "over"
        missions.flight.resume("Alice")
        await missions.reach("flying", within_s=10)

    run_in_flight(run_simulated, tmp_path, hover_mission(), scenario)


def test_conditions_use_the_wind_and_the_distance_of_the_downward_sensor(run_simulated, tmp_path):
    async def scenario(missions, vehicle, autopilot):
        assert missions.flight.reading().wind_speed_m_s is None
        for orientation, centimetres in ((0, 150), (25, 420)):  # forward, downward
            autopilot.send(
                sim.MAVLink_distance_sensor_message(
                    autopilot.boot_ms(), 10, 2000, centimetres, 0, orientation, orientation, 0
                )
            )
        autopilot.send(sim.MAVLink_wind_cov_message(0, 3.0, -4.0, math.nan, 0, 0, 0, 0, 0))
        await sleep(0.3)
        reading = missions.flight.reading()
        assert (reading.distance_m, reading.wind_speed_m_s) == (pytest.approx(4.2), pytest.approx(5.0))
        assert {"distance_m", "wind_speed_m_s"} <= set(reported_values(vehicle))
        await sleep(11)
        reading = missions.flight.reading()
        assert (reading.distance_m, reading.wind_speed_m_s) == (None, None)

    run_in_flight(run_simulated, tmp_path, hover_mission(), scenario)


# --- control --------------------------------------------------------------------------------------


def test_a_change_of_control_pauses_the_mission_in_offboard(run_simulated, tmp_path):
    async def scenario(missions, vehicle, autopilot):
        lease = missions.authority.control("1").lease
        lease.request(BOB)
        lease.grant(ALICE, "bob")
        await missions.reach("paused", within_s=5)
        assert autopilot.mode == OFFBOARD_MODE
        assert "control_taken" in event_codes(vehicle)

    run_in_flight(run_simulated, tmp_path, hover_mission(), scenario)


@pytest.mark.parametrize(
    ("action", "state", "mode"), [("hold", "suspended", HOLD_MODE), ("continue", "flying", OFFBOARD_MODE)]
)
def test_expired_control_triggers_the_control_lost_action(run_simulated, tmp_path, action, state, mode):
    async def scenario(missions, vehicle, autopilot):
        missions.authority.control("1").lease.release(ALICE)
        await sleep(LEASE_S + 3)
        assert (missions.state, autopilot.mode) == (state, mode)
        assert autopilot.failsafe_count == 0

    run_in_flight(run_simulated, tmp_path, hover_mission(control_lost=action), scenario)


# --- faults ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("action", "state"), [("hold", "suspended"), ("continue", "flying")])
def test_a_mission_executes_its_link_loss_action_when_the_link_returns(
    run_simulated, tmp_path, action, state
):
    async def scenario(missions, vehicle, autopilot):
        autopilot.loss = 1.0
        await sleep(8)
        autopilot.loss = 0.0
        autopilot.mode = autopilot.requested_mode = HOLD_MODE  # the stream's last command was received
        await until(lambda: not vehicle.status.link_lost, 10)
        await missions.reach(state, within_s=12)

    run_in_flight(run_simulated, tmp_path, hover_mission(link_loss=action), scenario)


def test_a_mission_without_updates_from_the_server_holds_position_and_then_switches_to_hold(
    run_simulated, tmp_path
):
    async def scenario(missions, vehicle, autopilot):
        missions.offboard.update = lambda: None
        await sleep(4)
        assert vehicle.offboard.status().state == "holding"
        await until(lambda: autopilot.mode == HOLD_MODE, 10)
        assert autopilot.failsafe_count == 0

    run_in_flight(run_simulated, tmp_path, hover_mission(), scenario)


def test_a_stalled_server_leads_to_the_announced_failsafe(run_simulated, tmp_path):
    async def scenario(missions, vehicle, autopilot):
        assert "Position" in missions.flight.status().if_stream_stops
        streamer, update = missions.testbed.streamer, missions.offboard.update
        update_once = streamer.update_once
        streamer.update_once = missions.offboard.update = lambda: None
        await until(lambda: autopilot.mode == POSITION_MODE, 6)
        streamer.update_once, missions.offboard.update = update_once, update
        await missions.reach("suspended", within_s=3)
        await assert_nothing_sent(autopilot, None, settle_s=0.5)
        assert autopilot.failsafe_count == 1

    run_in_flight(run_simulated, tmp_path, hover_mission(link_loss="continue", failure="return"), scenario)


def test_a_server_shutdown_puts_the_vehicle_of_a_mission_into_hold(run_simulated, tmp_path):
    async def scenario(missions, vehicle, autopilot):
        await missions.testbed.streamer.stop_all()
        assert autopilot.mode == HOLD_MODE
        await asyncio.sleep(0.3)
        assert missions.state == "suspended"

    run_in_flight(run_simulated, tmp_path, hover_mission(), scenario)


# --- routes --------------------------------------------------------------------------------------


def run_with_missions(run_simulated, scenario):
    """Runs a test with a scripted vehicle in flight and the routes for offboard missions."""

    async def with_missions(rig):
        rig.station.flights.plan_work = InlinePlanWork()
        rig.station.flights.missions.attach(rig.vehicle)
        rig.station.flights.missions.start()
        await scenario(rig)

    run_with_routes(run_simulated, with_missions)


async def start_mission(rig, document=HOVER, by=ANNA, **fields):
    mission_fields = mission(document).model_dump(mode="json", exclude_none=True)
    body = models.StartMission.model_validate({"mission": mission_fields, **fields})
    return json_of(await routes.start("1", body, rig.station, by))["mission"]


def test_the_client_in_control_starts_pauses_and_aborts_a_mission_and_each_command_is_journaled(
    run_simulated,
):
    async def scenario(rig):
        started_mission = await start_mission(rig)
        assert [started_mission[name] for name in ("state", "client", "plan_id")] == [
            "starting",
            "anna",
            None,
        ]
        assert "Position" in started_mission["if_stream_stops"]
        await until(lambda: rig.vehicle.offboard_mission.status().state == "flying", 10)
        for call in (routes.pause, routes.skip, routes.abort):
            with pytest.raises(NotInControl):
                await call("1", rig.station, ROUTE_BOB)
        paused = json_of(await routes.pause("1", rig.station, ANNA))["mission"]
        assert paused["state"] == "pausing"
        with pytest.raises(Refused, match="not waiting for the operator"):
            await routes.go_on("1", rig.station, ANNA)
        await until(lambda: rig.vehicle.offboard_mission.status().state == "paused", 5)
        await routes.resume("1", rig.station, ANNA)
        await routes.skip("1", rig.station, ANNA)
        await until(lambda: rig.vehicle.offboard_mission.status().place == "step 2", 5)
        ended = json_of(await routes.abort("1", rig.station, ANNA, models.AbortMission(then="land")))[
            "mission"
        ]
        assert (ended["state"], ended["reason"]) == ("aborted", "anna aborted the mission")
        mission_view = json_of(await routes.show_mission(rig.vehicle, rig.station))["mission"]
        assert mission_view["state"] == "aborted"
        commands = [line[1] for line in journal_entries(rig.station) if line[3] == "ok"]
        assert commands == [f"offboard_mission/{a}" for a in ("start", "pause", "resume", "skip", "abort")]

    run_with_missions(run_simulated, scenario)


def test_a_mission_beyond_the_operators_limits_is_not_started(run_simulated):
    far_steps = HOVER + "- {step: fly, points: [{offset_ned_m: [40, 0, -5]}]}\n- {step: land}\n"

    async def scenario(rig):
        await rig.station.offboard("1").operator_limits.set(OperatorLimits(distance_max_m=30.0), by="anna")
        with pytest.raises(PlanFindings, match="your limit is 30 m from home") as refused:
            await start_mission(rig, far_steps)
        assert refused.value.codes == ("limit_exceeded",)
        await rig.station.offboard("1").operator_limits.set(OperatorLimits(distance_max_m=50.0), by="anna")
        await start_mission(rig, far_steps)

    run_with_missions(run_simulated, scenario)


def test_a_mission_with_errors_is_flown_only_if_the_request_names_them(run_simulated):
    fast_steps = HOVER + "- {step: velocity, velocity_ned_m_s: [90, 0, 0], duration_s: 5}\n- {step: land}\n"

    async def scenario(rig):
        with pytest.raises(PlanFindings, match="above the vehicle's limits") as refused:
            await start_mission(rig, fast_steps)
        assert refused.value.codes[0] == "speed_exceeded"
        assert rig.vehicle.offboard_mission.status() is None
        await start_mission(rig, fast_steps, despite=list(refused.value.codes))
        assert rig.vehicle.offboard_mission.status().state != "aborted"

    run_with_missions(run_simulated, scenario)


def test_without_a_position_a_mission_is_refused_before_anything_is_sent(run_simulated):
    async def scenario(rig):
        rig.autopilot.has_estimates = False
        await sleep(2)
        with pytest.raises(Refused, match="no valid position"):
            await start_mission(rig)
        assert rig.autopilot.setpoints == []

    run_with_missions(run_simulated, scenario)


def test_a_vehicle_without_an_offboard_mission_refuses_mission_commands(run_simulated):
    async def scenario(rig):
        assert json_of(await routes.show_mission(rig.vehicle, rig.station))["mission"] is None
        with pytest.raises(Refused, match="no offboard mission"):
            await routes.pause("1", rig.station, ANNA)

    run_with_missions(run_simulated, scenario)
