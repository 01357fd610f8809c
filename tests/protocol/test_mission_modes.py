"""Offboard missions as flight modes of PX4, over ROS 2, on simulated time."""

from __future__ import annotations

from typing import Any

import pytest

from gcs_server.api import offboard_mission_routes as mission_routes
from gcs_server.errors import GcsError, NotInControl, PlanFindings, Refused
from gcs_server.ros2.external_mode import CHECK_REPLY, COMPLETED, UNREGISTER
from gcs_server.ros2.message_types import MESSAGES
from tests.protocol.api_calls import ANNA, BOB, lines
from tests.protocol.mission_modes_world import DEFERRAL_S, LOITER, MISSION, NAME, Modes, NoWork, fly
from tests.protocol.offboard_world import seconds
from tests.protocol.simulated_world import until
from vehicle_sim.mavlink import generated_dialect as sim


def test_a_registered_mission_has_its_name_in_every_ground_station(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        assert NAME not in await at.other.modes()
        began_s = at.world.loop.time()
        mode = await at.register()
        assert at.world.loop.time() - began_s < 1.0
        assert (mode["name"], mode["state"], mode["mode"], mode["mission"]) == (
            NAME, "registered", "external_1", "Line",
        )  # fmt: skip
        assert NAME in await at.other.modes()
        assert await at.shown() == {"vehicle": "1", "possible": True, "modes": [mode]}
        assert lines(at.station)[-1] == ("anna", "mission_modes/register", "1", "ok")
        assert await at.unregister() == []
        await seconds(1)
        assert NAME not in await at.other.modes()
        assert not at.warnings()

    fly(jump, scenario, in_air=False)


def test_a_mission_started_by_another_station_completes_in_hold(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        mode = await at.flying()
        assert at.vehicle.status.mode_label == NAME
        assert at.station.missions.status("1").mode == mode
        assert at.station.missions.status("1").executor_in_charge is None
        assert (await at.shown())["modes"][0]["takes_off"] is False
        assert "RTL" in at.station.missions.status("1").if_stream_stops
        await until(lambda: at.mission == "done", 20)
        await at.mode("hold")
        completed = [MESSAGES["ModeCompleted"].decode(data) for data in at.sent(COMPLETED)]
        assert [(each["result"], each["nav_state"]) for each in completed] == [(0, 23)]
        assert f"Mode {NAME}" in at.texts()
        before = len(at.world.topics[0].sent)
        await seconds(2)
        assert {topic for topic, _ in at.world.topics[0].sent[before:]} == {CHECK_REPLY}
        assert (await at.shown())["modes"][0]["state"] == "registered"

    fly(jump, scenario)


@pytest.mark.story
def test_a_mission_mode_can_be_started_repeatedly_by_this_server(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        mode = (await at.register())["mode"]
        for _ in range(2):
            start_x_m = at.x_m()
            await at.vehicle.command.set_mode(mode)
            await until(lambda: at.mission == "flying", 5)
            await until(lambda: at.mission == "done", 20)
            await at.mode("hold")
            assert at.x_m() - start_x_m == pytest.approx(8, abs=1.5)

    fly(jump, scenario)


def test_a_takeover_suspends_the_mission_and_selecting_its_mode_resumes_it(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        mode = await at.flying()
        at.other.command(sim.MAV_CMD_DO_SET_MODE, 1, 4, 3)
        await at.mode("hold")
        await until(lambda: at.mission == "suspended", 2)
        before = len(at.world.topics[0].sent)
        await seconds(2)
        assert {topic for topic, _ in at.world.topics[0].sent[before:]} == {CHECK_REPLY}
        at.other.choose(mode)
        await until(lambda: at.mission == "flying", 5)
        await until(lambda: at.mission == "done", 20)

    fly(jump, scenario)


def test_released_control_suspends_the_mission_and_reports_a_failure_to_px4(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        mode = (await at.register())["mode"]
        await at.vehicle.command.set_mode(mode)
        await until(lambda: at.mission == "flying", 5)
        flight = at.station.missions.flight("1")
        assert flight.runner.flight.actions.control_lost == "hold"
        at.station.authority.control("1").lease.release(ANNA)
        await at.mode("hold")
        assert at.mission == "suspended"
        completed = [MESSAGES["ModeCompleted"].decode(data) for data in at.sent(COMPLETED)]
        assert [each["result"] for each in completed] == [100]

    fly(jump, scenario)


@pytest.mark.story
def test_control_that_expires_does_not_interrupt_a_mission_that_a_pilot_selected(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        mode = (await at.register(mission=LOITER))["mode"]
        at.other.choose(mode)
        await until(lambda: at.mission == "flying", 5)
        lease = at.station.authority.control("1").lease
        lease.take(ANNA, on_expiry="land")
        await until(lambda: lease.holder is None, 40)
        assert (at.mission, at.vehicle.status.mode) == ("flying", mode)
        assert any("No client has control now" in text for text in at.warnings())
        lease.take(BOB)
        await seconds(2)
        assert (at.mission, at.vehicle.status.mode) == ("flying", mode)
        await mission_routes.pause("1", at.station, BOB)
        await until(lambda: at.mission == "paused", 10)
        await mission_routes.resume("1", at.station, BOB)
        await until(lambda: at.mission == "flying", 5)
        lease.release(BOB)
        await at.mode("hold")
        assert at.mission == "suspended"

    fly(jump, scenario)


def test_without_arming_check_answers_px4_returns_and_the_operator_is_informed(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        mode = await at.flying()
        at.world.streamer._streams.mode_ports[-1].working = False
        began_s = at.world.loop.time()
        await at.mode("rtl")
        assert 0.8 < at.world.loop.time() - began_s < 1.8
        await until(lambda: at.mission == "suspended", 2)
        assert at.vehicle.status.mode != mode
        await until(lambda: any("is no longer registered" in text for text in at.warnings()), 5)
        assert at.station.mission_modes.all("1")[0].state == "lost"
        assert at.station.missions.status("1").reason == "The vehicle's failsafe switched to Rtl"

    fly(jump, scenario)


@pytest.mark.story
def test_a_stalled_event_loop_makes_px4_return(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        await at.flying()
        streams = at.world.streamer._streams
        flight = at.station.missions.flight("1")
        record, tick = streams._record_loop_message, flight.tick
        streams._record_loop_message, flight.tick = lambda _: None, lambda: None
        began_s = at.world.loop.time()
        await at.mode("rtl")
        assert 1.0 < at.world.loop.time() - began_s < 2.5
        streams._record_loop_message, flight.tick = record, tick
        await until(lambda: at.mission == "suspended", 2)

    fly(jump, scenario)


def test_a_server_that_ends_holds_the_vehicle_and_removes_the_mode(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        await at.flying()
        (stopped,) = await at.station.streamer.stop_all()
        assert stopped.error is None
        await at.mode("hold")
        at.world.streamer._streams.close()
        await seconds(1)
        assert NAME not in await at.other.modes()
        assert at.vehicle.status.mode == "hold"

    fly(jump, scenario)


def test_a_mission_without_a_take_off_does_not_start_on_the_ground(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        mode = (await at.register())["mode"]
        at.other.choose(mode)
        await at.mode(mode)
        with pytest.raises(GcsError):
            await at.vehicle.command.arm()
        assert not at.vehicle.status.armed
        assert at.mission is None

    fly(jump, scenario, in_air=False)


@pytest.mark.story
def test_a_mode_that_cannot_start_holds_and_reports_the_reason(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        mode = (await at.register())["mode"]
        at.station.plan_work = NoWork()
        at.other.choose(mode)
        await until(lambda: any("cannot be flown" in text for text in at.warnings()), 5)
        await at.mode("hold")
        assert any("No worker. Try later. The vehicle holds." in text for text in at.warnings())
        assert at.mission is None

    fly(jump, scenario)


def test_a_mode_is_registered_and_removed_only_with_control_and_not_in_flight(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        await at.register()
        with pytest.raises(Refused, match="already registered"):
            await at.register()
        with pytest.raises(NotInControl):
            await at.register(by=BOB, name="Other")
        with pytest.raises(NotInControl):
            await at.unregister(by=BOB)
        with pytest.raises(Refused, match="has no mode 'Other'") as unknown:
            await at.unregister("Other")
        assert NAME in (unknown.value.remedy or "")
        climbs = {**MISSION, "steps": [{"step": "take_off", "height_m": 5}]}
        with pytest.raises(PlanFindings):
            await at.register(name="Errors", mission=climbs)
        sent = len(at.sent(UNREGISTER))
        at.other.choose("external_1")
        await until(lambda: at.mission == "flying", 5)
        with pytest.raises(Refused, match="flies in the mode"):
            await at.unregister()
        assert len(at.sent(UNREGISTER)) == sent

    fly(jump, scenario)


def test_over_mavlink_only_a_mode_cannot_be_registered(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        mode = await at.register()
        for endpoint in at.vehicle.endpoints:
            at.vehicle.detach(endpoint)
        assert (await at.shown())["possible"] is False
        with pytest.raises(GcsError):
            await at.register(name="Other")
        assert mode["state"] == "registered"

    fly(jump, scenario, in_air=False)


@pytest.mark.story
def test_resuming_the_mission_selects_its_mode(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        mode = await at.flying()
        await at.vehicle.command.hold()
        await until(lambda: at.mission == "suspended", 2)
        await mission_routes.resume("1", at.station, ANNA)
        await at.mode(mode)
        await until(lambda: at.mission == "done", 20)

    fly(jump, scenario)


def test_with_both_links_the_arming_report_has_the_modes_name(jump: Any) -> None:
    async def scenario(at: Modes) -> None:
        at.world.mavlink_on = True
        await until(lambda: "MAVLink" in at.vehicle.reach.protocols, 10)
        mode = (await at.register())["mode"]
        labels: dict[str, str] = {}

        def named() -> bool:
            labels.update({each.mode: each.label for each in at.vehicle.health.readiness.modes})
            return mode in labels

        await until(named, 15)
        assert labels[mode] == NAME
        assert labels["hold"] == "Hold"

    fly(jump, scenario, in_air=False)


@pytest.mark.story
@pytest.mark.parametrize("deferral_s", [0, DEFERRAL_S])
def test_a_failsafe_is_deferred_for_the_stated_time_and_the_operator_is_informed(
    jump: Any, deferral_s: int
) -> None:
    async def scenario(at: Modes) -> None:
        for name, value in (("NAV_DLL_ACT", 3), ("COM_DL_LOSS_T", 5)):
            at.world.sim.simulation.parameters[0].set(name, value)
        mode = (await at.register(mission=LOITER, defer_failsafes_s=deferral_s))["mode"]
        at.other.choose(mode)
        await at.other.heartbeats(4)
        assert at.vehicle.status.mode == mode
        warning = "defers a failsafe for up to 6 s"
        if deferral_s:
            await until(lambda: at.station.mission_modes.all("1")[0].failsafe_deferred, 12)
            assert at.vehicle.status.mode == mode
        began_s = at.world.loop.time()
        await until(lambda: at.vehicle.status.mode == "hold", 12)
        assert not deferral_s or at.world.loop.time() - began_s == pytest.approx(deferral_s, abs=1)
        await at.mode("land", 12)
        assert any(warning in text for text in at.warnings()) == bool(deferral_s)
        assert not at.station.mission_modes.all("1")[0].failsafe_deferred
        assert at.mission == "suspended"

    fly(jump, scenario)
