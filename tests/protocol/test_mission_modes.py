"""Offboard missions as flight modes of PX4, over ROS 2, on simulated time."""

from __future__ import annotations

from typing import Any

import pytest

from gcs_server.api import offboard_mission_routes as mission_routes
from gcs_server.errors import GcsError, NotInControl, PlanFindings, Refused
from gcs_server.ros2.external_mode import CHECK_REPLY, COMPLETED, UNREGISTER
from gcs_server.ros2.message_types import MESSAGES
from tests.protocol.api_calls import ANNA, BOB, journal_entries
from tests.protocol.mission_modes_testbed import (
    DEFERRAL_S,
    LONG_HOLD_MISSION,
    MISSION,
    MODE_NAME,
    MissionModesTestbed,
    UnavailablePlanWork,
    run_with_mission_modes,
)
from tests.protocol.offboard_testbed import sleep
from tests.protocol.simulated_testbed import both_versions, until
from vehicle_sim.mavlink import generated_dialect as sim
from vehicle_sim.px4_version import Px4Version

SUCCESS, OTHER_FAILURE = 0, 100
"""result of ModeCompleted."""
EXTERNAL_1 = 23
"""nav_state of ModeCompleted."""
SELECT_HOLD = (sim.MAV_CMD_DO_SET_MODE, 1, 4, 3)


def test_a_registered_mission_has_its_name_in_every_ground_station(run_simulated: Any) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        assert MODE_NAME not in await rig.other_station.selectable_modes()
        began_s = rig.testbed.loop.time()
        mode = await rig.register()
        assert rig.testbed.loop.time() - began_s < 1.0
        assert (mode["name"], mode["state"], mode["mode"], mode["mission"]) == (
            MODE_NAME, "registered", "external_1", "Line",
        )  # fmt: skip
        assert MODE_NAME in await rig.other_station.selectable_modes()
        assert await rig.list_modes() == {"vehicle": "1", "possible": True, "modes": [mode]}
        assert journal_entries(rig.station)[-1] == ("anna", "mission_modes/register", "1", "ok")
        assert await rig.unregister() == []
        await sleep(1)
        assert MODE_NAME not in await rig.other_station.selectable_modes()
        assert not rig.warning_texts()

    run_with_mission_modes(run_simulated, scenario, in_air=False)


@both_versions
def test_a_mission_started_by_another_station_completes_in_hold(run_simulated: Any, px4: Px4Version) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        mode = await rig.start_in_flight()
        assert rig.vehicle.status.mode_label == MODE_NAME
        assert rig.station.flights.missions.status("1").mode == mode
        assert rig.station.flights.missions.status("1").executor_in_charge is None
        assert (await rig.list_modes())["modes"][0]["takes_off"] is False
        assert "RTL" in rig.station.flights.missions.status("1").if_stream_stops
        await until(lambda: rig.mission_state == "done", 20)
        await rig.until_mode("hold")
        completed = [MESSAGES["ModeCompleted"].decode(data) for data in rig.sent_messages(COMPLETED)]
        assert [(message["result"], message["nav_state"]) for message in completed] == [(SUCCESS, EXTERNAL_1)]
        assert f"Mode {MODE_NAME}" in rig.event_texts()
        before = len(rig.testbed.topics[0].sent_messages)
        await sleep(2)
        assert {topic for topic, _ in rig.testbed.topics[0].sent_messages[before:]} == {CHECK_REPLY}
        assert (await rig.list_modes())["modes"][0]["state"] == "registered"

    run_with_mission_modes(run_simulated, scenario, px4=px4)


@pytest.mark.story
def test_a_mission_mode_can_be_started_repeatedly_by_this_server(run_simulated: Any) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        mode = (await rig.register())["mode"]
        for _ in range(2):
            start_north_m = rig.north_m()
            await rig.vehicle.command.set_mode(mode)
            await until(lambda: rig.mission_state == "flying", 5)
            await until(lambda: rig.mission_state == "done", 20)
            await rig.until_mode("hold")
            assert rig.north_m() - start_north_m == pytest.approx(8, abs=1.5)

    run_with_mission_modes(run_simulated, scenario)


@both_versions
def test_a_takeover_suspends_the_mission_and_selecting_its_mode_resumes_it(
    run_simulated: Any, px4: Px4Version
) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        mode = await rig.start_in_flight()
        rig.other_station.command(*SELECT_HOLD)
        await rig.until_mode("hold")
        await until(lambda: rig.mission_state == "suspended", 2)
        before = len(rig.testbed.topics[0].sent_messages)
        await sleep(2)
        assert {topic for topic, _ in rig.testbed.topics[0].sent_messages[before:]} == {CHECK_REPLY}
        rig.other_station.select_mode(mode)
        await until(lambda: rig.mission_state == "flying", 5)
        await until(lambda: rig.mission_state == "done", 20)

    run_with_mission_modes(run_simulated, scenario, px4=px4)


def test_released_control_suspends_the_mission_and_reports_a_failure_to_px4(run_simulated: Any) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        mode = (await rig.register())["mode"]
        await rig.vehicle.command.set_mode(mode)
        await until(lambda: rig.mission_state == "flying", 5)
        flight = rig.station.flights.missions.flight("1")
        assert flight.runner.flight.actions.control_lost == "hold"
        rig.station.authority.control("1").lease.release(ANNA)
        await rig.until_mode("hold")
        assert rig.mission_state == "suspended"
        completed = [MESSAGES["ModeCompleted"].decode(data) for data in rig.sent_messages(COMPLETED)]
        assert [message["result"] for message in completed] == [OTHER_FAILURE]

    run_with_mission_modes(run_simulated, scenario)


@pytest.mark.story
def test_control_that_expires_does_not_interrupt_a_mission_that_a_pilot_selected(run_simulated: Any) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        mode = (await rig.register(mission=LONG_HOLD_MISSION))["mode"]
        rig.other_station.select_mode(mode)
        await until(lambda: rig.mission_state == "flying", 5)
        lease = rig.station.authority.control("1").lease
        lease.take(ANNA, on_expiry="land")
        await until(lambda: lease.holder is None, 40)
        assert (rig.mission_state, rig.vehicle.status.mode) == ("flying", mode)
        await until(lambda: any("No client has control now" in text for text in rig.warning_texts()), 1)
        lease.take(BOB)
        await sleep(2)
        assert (rig.mission_state, rig.vehicle.status.mode) == ("flying", mode)
        await mission_routes.pause("1", rig.station, BOB)
        await until(lambda: rig.mission_state == "paused", 10)
        await mission_routes.resume("1", rig.station, BOB)
        await until(lambda: rig.mission_state == "flying", 5)
        lease.release(BOB)
        await rig.until_mode("hold")
        assert rig.mission_state == "suspended"

    run_with_mission_modes(run_simulated, scenario)


@both_versions
def test_without_arming_check_replies_px4_returns_and_the_operator_is_informed(
    run_simulated: Any, px4: Px4Version
) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        mode = await rig.start_in_flight()
        rig.testbed.streamer._streams.mode_ports[-1].is_working = False
        began_s = rig.testbed.loop.time()
        await rig.until_mode("rtl")
        assert 0.8 < rig.testbed.loop.time() - began_s < 1.8
        await until(lambda: rig.mission_state == "suspended", 2)
        assert rig.vehicle.status.mode != mode
        await until(lambda: any("is no longer registered" in text for text in rig.warning_texts()), 5)
        assert rig.station.flights.mission_modes.all("1")[0].state == "lost"
        assert rig.station.flights.missions.status("1").reason == "The vehicle's failsafe switched to Rtl"

    run_with_mission_modes(run_simulated, scenario, px4=px4)


@pytest.mark.story
def test_a_stalled_event_loop_makes_px4_return(run_simulated: Any) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        await rig.start_in_flight()
        streams = rig.testbed.streamer._streams
        flight = rig.station.flights.missions.flight("1")
        record_loop_message, update = streams._record_loop_message, flight.update
        streams._record_loop_message, flight.update = lambda _: None, lambda: None
        began_s = rig.testbed.loop.time()
        await rig.until_mode("rtl")
        assert 1.0 < rig.testbed.loop.time() - began_s < 2.5
        streams._record_loop_message, flight.update = record_loop_message, update
        await until(lambda: rig.mission_state == "suspended", 2)

    run_with_mission_modes(run_simulated, scenario)


@both_versions
def test_a_server_shutdown_puts_the_vehicle_into_hold_and_removes_the_mode(
    run_simulated: Any, px4: Px4Version
) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        await rig.start_in_flight()
        (stopped,) = await rig.station.flights.stop_streams()
        assert stopped.error is None
        await rig.until_mode("hold")
        rig.testbed.streamer._streams.close()
        await sleep(1)
        assert MODE_NAME not in await rig.other_station.selectable_modes()
        assert rig.vehicle.status.mode == "hold"

    run_with_mission_modes(run_simulated, scenario, px4=px4)


def test_a_mission_without_a_take_off_does_not_start_on_the_ground(run_simulated: Any) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        mode = (await rig.register())["mode"]
        rig.other_station.select_mode(mode)
        await rig.until_mode(mode)
        with pytest.raises(GcsError):
            await rig.vehicle.command.arm()
        assert not rig.vehicle.status.armed
        assert rig.mission_state is None

    run_with_mission_modes(run_simulated, scenario, in_air=False)


@pytest.mark.story
def test_a_mode_that_cannot_start_switches_to_hold_and_reports_the_reason(run_simulated: Any) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        mode = (await rig.register())["mode"]
        rig.station.flights.plan_work = UnavailablePlanWork()
        rig.other_station.select_mode(mode)
        await until(lambda: any("cannot be flown" in text for text in rig.warning_texts()), 5)
        await rig.until_mode("hold")
        assert any("No worker. Try later. The vehicle holds." in text for text in rig.warning_texts())
        assert rig.mission_state is None

    run_with_mission_modes(run_simulated, scenario)


def test_a_mode_is_registered_and_removed_only_with_control_and_not_in_flight(run_simulated: Any) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        await rig.register()
        with pytest.raises(Refused, match="already registered"):
            await rig.register()
        with pytest.raises(NotInControl):
            await rig.register(by=BOB, name="Other")
        with pytest.raises(NotInControl):
            await rig.unregister(by=BOB)
        with pytest.raises(Refused, match="has no mode 'Other'") as unknown:
            await rig.unregister("Other")
        assert MODE_NAME in (unknown.value.remedy or "")
        with_take_off = {**MISSION, "steps": [{"step": "take_off", "height_m": 5}]}
        with pytest.raises(PlanFindings):
            await rig.register(name="Errors", mission=with_take_off)
        sent_count = len(rig.sent_messages(UNREGISTER))
        rig.other_station.select_mode("external_1")
        await until(lambda: rig.mission_state == "flying", 5)
        with pytest.raises(Refused, match="flies in the mode"):
            await rig.unregister()
        assert len(rig.sent_messages(UNREGISTER)) == sent_count

    run_with_mission_modes(run_simulated, scenario)


def test_a_mode_cannot_be_registered_over_mavlink_only(run_simulated: Any) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        mode = await rig.register()
        for endpoint in rig.vehicle.endpoints:
            rig.vehicle.detach(endpoint)
        assert (await rig.list_modes())["possible"] is False
        with pytest.raises(GcsError):
            await rig.register(name="Other")
        assert mode["state"] == "registered"

    run_with_mission_modes(run_simulated, scenario, in_air=False)


@pytest.mark.story
def test_resuming_the_mission_selects_its_mode(run_simulated: Any) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        mode = await rig.start_in_flight()
        await rig.vehicle.command.hold()
        await until(lambda: rig.mission_state == "suspended", 2)
        await mission_routes.resume("1", rig.station, ANNA)
        await rig.until_mode(mode)
        await until(lambda: rig.mission_state == "done", 20)

    run_with_mission_modes(run_simulated, scenario)


@both_versions
def test_with_mavlink_and_ros_2_the_arming_report_has_the_modes_name(
    run_simulated: Any, px4: Px4Version
) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        rig.testbed.mavlink_on = True
        await until(lambda: "MAVLink" in rig.vehicle.reach.protocols, 10)
        mode = (await rig.register())["mode"]
        labels: dict[str, str] = {}

        def has_label() -> bool:
            labels.update(
                {readiness.mode: readiness.label for readiness in rig.vehicle.health.readiness.modes}
            )
            return mode in labels

        await until(has_label, 15)
        assert labels[mode] == MODE_NAME
        assert labels["hold"] == "Hold"

    run_with_mission_modes(run_simulated, scenario, in_air=False, px4=px4)


@pytest.mark.story
@pytest.mark.parametrize("deferral_s", [0, DEFERRAL_S])
def test_a_failsafe_is_deferred_for_the_stated_time_and_the_operator_is_informed(
    run_simulated: Any, deferral_s: int
) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        for name, value in (("NAV_DLL_ACT", 3), ("COM_DL_LOSS_T", 5)):
            rig.testbed.sim.simulation.parameters[0].set(name, value)
        mode = (await rig.register(mission=LONG_HOLD_MISSION, defer_failsafes_s=deferral_s))["mode"]
        rig.other_station.select_mode(mode)
        await rig.other_station.send_heartbeats(4)
        assert rig.vehicle.status.mode == mode
        warning = "defers a failsafe for up to 6 s"
        if deferral_s:
            await until(lambda: rig.station.flights.mission_modes.all("1")[0].failsafe_deferred, 12)
            assert rig.vehicle.status.mode == mode
        began_s = rig.testbed.loop.time()
        await until(lambda: rig.vehicle.status.mode == "hold", 12)
        assert not deferral_s or rig.testbed.loop.time() - began_s == pytest.approx(deferral_s, abs=1)
        await rig.until_mode("land", 12)
        assert any(warning in text for text in rig.warning_texts()) == bool(deferral_s)
        assert not rig.station.flights.mission_modes.all("1")[0].failsafe_deferred
        await until(lambda: rig.mission_state == "suspended", 1)

    run_with_mission_modes(run_simulated, scenario)
