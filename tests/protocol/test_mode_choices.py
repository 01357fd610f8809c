"""The list of modes to choose from: the vehicle's own, also over a lossy link, with the reasons why one
cannot be entered; simulated vehicles on simulated time."""

import pytest

from gcs_server.api import readiness_routes
from gcs_server.vehicle.px4.modes import MODES
from tests.protocol.api_calls import json_of
from tests.protocol.one_vehicle import run_scenario
from tests.protocol.simulated_testbed import SimulatedTestbed, until
from vehicle_sim.mavlink import generated_dialect as sim
from vehicle_sim.px4_version import V1_16, V1_17

NOT_USER_SELECTABLE = sim.MAV_MODE_PROPERTY_NOT_USER_SELECTABLE


@pytest.mark.parametrize(("px4", "has_altitude_cruise"), [(V1_16, False), (V1_17, True)])
def test_the_vehicles_own_list_is_read_at_loss_with_reasons(run_simulated, px4, has_altitude_cruise):
    async def run():
        testbed = SimulatedTestbed(px4=px4)
        vehicle = await testbed.wait_for_vehicle_ready_to_arm()
        await until(lambda: vehicle.health.readiness.known, 30)
        testbed.loss = 0.2
        view = json_of(await readiness_routes.modes(vehicle))
        assert view["of_vehicle"]
        modes = {each["mode"]: each for each in view["modes"]}
        assert list(modes)[:5] == ["manual", "altitude", "position", "mission", "hold"]  # the vehicle's order
        assert ("altitude_cruise" in modes) == has_altitude_cruise
        assert modes.keys().isdisjoint({"termination", "vtol_takeoff", "ready", "external_1"})
        assert modes["hold"]["settable"]
        assert modes["hold"]["can_run"]
        assert modes["hold"]["reasons"] == []
        assert not modes["position"]["can_run"]
        assert "No RC transmitter" in modes["position"]["reasons"][0]
        assert not modes["orbit"]["settable"]
        assert "needs a centre" in modes["orbit"]["reasons"][0]
        await testbed.close()

    run_simulated(run)


def test_without_a_list_the_modes_that_the_server_can_set_are_offered_and_the_vehicle_is_not_asked_again(
    run_simulated,
):
    async def scenario(testbed, vehicle, autopilot):
        vehicle.mode_names.external["external_3"] = "Survey"
        view = json_of(await readiness_routes.modes(vehicle))
        assert not view["of_vehicle"]
        external = {f"external_{number}" for number in (1, 2, 4, 5, 6, 7, 8)}
        settable = [mode.name for mode in MODES if mode.settable and mode.name not in external]
        assert [each["mode"] for each in view["modes"]] == settable
        assert {each["can_run"] for each in view["modes"]} == {None}
        asked = len(autopilot.received_commands(sim.MAV_CMD_REQUEST_MESSAGE))
        await readiness_routes.modes(vehicle)
        assert len(autopilot.received_commands(sim.MAV_CMD_REQUEST_MESSAGE)) == asked

    run_scenario(run_simulated, scenario)


def send_mode(autopilot, index, custom_mode, name, *, count=2, properties=0):
    autopilot.send(
        sim.MAVLink_available_modes_message(count, index, 0, custom_mode, properties, name.encode())
    )


def test_modes_that_the_server_does_not_know_and_an_external_modes_name_are_listed(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        def answer(m):
            if m.get_type() != "COMMAND_LONG" or m.param1 != sim.MAVLINK_MSG_ID_AVAILABLE_MODES:
                return False
            send_mode(autopilot, 1, 12 << 16, "Glide")
            send_mode(autopilot, 2, 4 << 16 | 11 << 24, "Inspect bridge")
            return True

        autopilot.handlers.append(answer)
        view = json_of(await readiness_routes.modes(vehicle))
        glide, bridge = view["modes"]
        assert (glide["label"], glide["settable"]) == ("Glide", False)
        assert "does not know this mode" in glide["reasons"][0]
        assert (bridge["mode"], bridge["label"], bridge["settable"]) == ("external_1", "Inspect bridge", True)

        autopilot.handlers.clear()
        autopilot.send(sim.MAVLink_available_modes_monitor_message(1))
        autopilot.send(sim.MAVLink_available_modes_monitor_message(2))
        await until(lambda: not vehicle.mode_list.entries, 5)  # the list has changed and is read again
        autopilot.handlers.append(answer)
        await until(lambda: len(vehicle.mode_list.entries) == 2, 10)

    run_scenario(run_simulated, scenario)


def test_an_impossible_list_is_no_list(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        for index in (0, 3, 255):
            send_mode(autopilot, index, 4 << 16 | 3 << 24, "Hold", count=2)
        send_mode(autopilot, 1, 4 << 16 | 3 << 24, "Hold", properties=NOT_USER_SELECTABLE)
        view = json_of(await readiness_routes.modes(vehicle))
        assert not view["of_vehicle"]

    run_scenario(run_simulated, scenario)
