"""Interruptions of missions: each interruption during every kind of step, on simulated PX4 vehicles."""

import asyncio

import pytest

from tests.protocol.mission_fleet import (
    FLOWN_BY_PX4,
    FLOWN_BY_SETPOINTS,
    STEPS,
    kinds_flown,
    run_with_mission_fleet,
)
from tests.protocol.simulated_testbed import until
from tests.support.mission_steps import all_step_kinds
from vehicle_sim.autopilot.modes import NavState

pytestmark = pytest.mark.flight

SUSPENDED = dict.fromkeys(STEPS, "suspended")


@pytest.mark.broad
def test_a_pause_stops_all_vehicles_and_a_resume_completes_all_missions(run_simulated, tmp_path):
    async def scenario(fleet):
        for flight in fleet.flights.values():
            flight.pause("Alice")
        states = {kind: "suspended" if kind in FLOWN_BY_PX4 else "paused" for kind in STEPS}
        await fleet.reach(states, within_s=15)
        await until(lambda: all(fleet.modes()[kind] == "hold" for kind in FLOWN_BY_PX4), 5)
        assert {fleet.modes()[kind] for kind in FLOWN_BY_SETPOINTS} == {"offboard"}
        await asyncio.sleep(5.0)
        await fleet.check_hover([kind for kind in STEPS if kind != "take_off"])
        for flight in fleet.flights.values():
            flight.resume("Alice")
        await asyncio.sleep(1.0)
        await fleet.end_normally()

    run_with_mission_fleet(run_simulated, tmp_path, scenario)


@pytest.mark.broad
def test_after_an_abort_all_vehicles_hold_and_nothing_is_sent(run_simulated, tmp_path):
    async def scenario(fleet):
        for flight in fleet.flights.values():
            flight.abort("Alice", "hold")
        await until(lambda: set(fleet.modes().values()) == {"hold"}, 5)
        await asyncio.sleep(8.0)
        assert not any(vehicle.offboard.status().streaming for vehicle in fleet.vehicles.values())
        await fleet.check_hover([kind for kind in STEPS if kind != "take_off"])
        assert set(fleet.modes().values()) == {"hold"}

    run_with_mission_fleet(run_simulated, tmp_path, scenario)


@pytest.mark.broad
def test_an_operators_hold_suspends_all_missions_and_each_resumes_at_its_position(run_simulated, tmp_path):
    async def scenario(fleet):
        async with asyncio.TaskGroup() as tasks:
            for vehicle in fleet.vehicles.values():
                tasks.create_task(vehicle.command.hold(by="Bob"))
        await fleet.reach(SUSPENDED, within_s=5)
        assert all("Bob" in reason for reason in fleet.reasons().values())
        await asyncio.sleep(8.0)
        await fleet.check_hover([kind for kind in STEPS if kind != "take_off"])
        for flight in fleet.flights.values():
            flight.resume("Alice")
        await fleet.reach({kind: ("flying", "waiting", "landing", "done") for kind in STEPS})
        await fleet.end_normally()

    run_with_mission_fleet(run_simulated, tmp_path, scenario)


@pytest.mark.broad
@pytest.mark.parametrize("takeover", ["stick", "switch"])
def test_a_pilot_takes_over_every_vehicle_and_the_server_does_not_interfere(
    run_simulated, tmp_path, takeover
):
    async def scenario(fleet):
        for row in range(len(STEPS)):
            fleet.sim.set_parameter(row, "COM_RC_OVERRIDE", 3)
        forward = 0

        async def send_sticks():
            while True:
                fleet.move_sticks(forward)
                await asyncio.sleep(0.1)

        sending = asyncio.ensure_future(send_sticks())
        try:
            await asyncio.sleep(1.0)
            if takeover == "stick":
                forward = 600
            else:
                for kind in STEPS:
                    assert fleet.commander(kind).set_mode(NavState.POSITION)
            await until(lambda: set(fleet.modes().values()) == {"position"}, 3)
            forward = 0
            await fleet.reach(SUSPENDED, within_s=3)
            await asyncio.sleep(6.0)
            assert set(fleet.modes().values()) == {"position"}
            assert not any(vehicle.offboard.status().streaming for vehicle in fleet.vehicles.values())
        finally:
            sending.cancel()

    run_with_mission_fleet(
        run_simulated, tmp_path, scenario, link_loss="continue", low_battery="return", failure="return"
    )


@pytest.mark.broad
def test_after_a_lost_link_px4_completes_take_off_and_landing_and_ends_offboard_by_its_failsafe(
    run_simulated, tmp_path
):
    async def scenario(fleet):
        announced = {kind: fleet.flights[kind].status().if_stream_stops for kind in FLOWN_BY_SETPOINTS}
        assert all(announced.values())
        for row in range(len(STEPS)):
            fleet.sim.set_link_up(row, "gcs", False)
        await asyncio.sleep(8.0)
        failsafe_modes = {fleet.modes()[kind] for kind in FLOWN_BY_SETPOINTS}
        assert "offboard" not in failsafe_modes
        for row in range(len(STEPS)):
            fleet.sim.set_link_up(row, "gcs", True)
        await fleet.reach(dict.fromkeys(FLOWN_BY_SETPOINTS, "suspended"), within_s=15)
        await fleet.reach(dict.fromkeys(FLOWN_BY_PX4, "done"), within_s=40)
        # A vehicle may also be in Hold, which the stream requested last.
        assert {fleet.modes()[kind] for kind in FLOWN_BY_SETPOINTS} <= {*failsafe_modes, "hold"}

    run_with_mission_fleet(run_simulated, tmp_path, scenario, link_loss="continue")


@pytest.mark.broad
def test_a_low_battery_makes_all_vehicles_return_except_a_landing_vehicle(run_simulated, tmp_path):
    async def scenario(fleet):
        for row in range(len(STEPS)):
            fleet.sim.simulation.set_battery_remaining(row, 0.12)
        not_landing = [kind for kind in STEPS if kind != "land"]
        await fleet.reach(dict.fromkeys(not_landing, "suspended"), within_s=10)
        await until(lambda: {fleet.modes()[kind] for kind in not_landing} == {"rtl"}, 5)
        assert all("Battery" in fleet.reasons()[kind] for kind in not_landing)
        await fleet.reach({"land": "done"}, within_s=40)

    run_with_mission_fleet(run_simulated, tmp_path, scenario)


@pytest.mark.broad
def test_a_lost_position_makes_all_vehicles_descend(run_simulated, tmp_path):
    async def scenario(fleet):
        for row in range(len(STEPS)):
            fleet.sim.simulation.set_gps_enabled(row, False)
        await fleet.reach({kind: ("suspended", "done", "stopped") for kind in STEPS}, within_s=60)
        altitudes_m = {kind: -fleet.position(kind)[2] for kind in STEPS}
        await asyncio.sleep(5.0)
        descents_m = {kind: before + fleet.position(kind)[2] for kind, before in altitudes_m.items()}
        assert all(descents_m[kind] > 1.0 or -fleet.position(kind)[2] < 0.5 for kind in STEPS), descents_m

    run_with_mission_fleet(run_simulated, tmp_path, scenario)


@pytest.mark.broad
def test_after_a_killed_server_each_vehicle_continues_its_mode_or_executes_its_failsafe(
    run_simulated, tmp_path
):
    async def scenario(fleet):
        announced = {fleet.flights[kind].status().if_stream_stops for kind in FLOWN_BY_SETPOINTS}
        assert all("without" in text or "lands" in text for text in announced), announced
        await fleet.testbed.supervisor.close()
        for _ in range(300):
            fleet.sim.step(0.02)
        modes = fleet.modes()
        assert "offboard" not in modes.values()
        assert modes["take_off"] in ("takeoff", "hold")
        assert modes["land"] == "land"

    run_with_mission_fleet(run_simulated, tmp_path, scenario)


def test_each_kind_of_step_is_flown_by_one_of_the_vehicles():
    assert kinds_flown() == all_step_kinds()
