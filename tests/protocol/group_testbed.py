"""Scripted vehicles in flight, the server's routes, and requests that fly the vehicles as a group."""

import math
from types import SimpleNamespace

from gcs_server.api import group_models, group_routes
from gcs_server.control.principal import Principal
from tests.protocol.api_calls import json_of, new_station
from tests.protocol.offboard_testbed import OffboardTestbed, sleep

ANNA, BOB = Principal.from_identity("anna", "anna's tab"), Principal.from_identity("bob", "bob's tab")
METRES_PER_DEGREE = math.radians(1) * 6_371_000.0
STREAM_PERIOD_S = 0.02


def run_with_vehicles(run_simulated, scenario, *, count=3, spacing_m=10.0):
    """Runs a test with vehicles 1, 2, … in flight, in a row to the east; each has its own local origin."""

    async def run():
        testbed = OffboardTestbed()
        autopilots = {}
        for index in range(count):
            autopilot = testbed.offboard_autopilot(
                testbed.link(f"link{index}"), peer=f"peer{index}", system=index + 1, uid=index + 1, seed=index
            )
            autopilot.home = (
                47.0,
                8.0 + index * spacing_m / (METRES_PER_DEGREE * math.cos(math.radians(47.0))),
                489.0,
            )
            autopilot.position = list(autopilot.home)
            autopilot.set_hovering()
            autopilots[str(index + 1)] = autopilot
        try:
            for vehicle_id in autopilots:
                await testbed.wait_for_vehicle(vehicle_id)
            await sleep(2.5)
            station = new_station(testbed)
            vehicles = {v: testbed.fleet.get(v) for v in autopilots}
            await scenario(
                SimpleNamespace(
                    testbed=testbed,
                    station=station,
                    autopilots=autopilots,
                    vehicles=vehicles,
                )
            )
        finally:
            await testbed.close()

    run_simulated(run)


def group_changes(rig):
    """Text, state and whether it is a warning of each event about a group."""
    events = [event for event in rig.testbed.fleet.events.since() if event.kind == "group"]
    return [(each.text, each.data["group"]["state"], each.severity <= 4) for each in events]


def position_setpoint(north_m=0.0, east_m=0.0, down_m=-5.0):
    return {"type": "position", "position_ned_m": [north_m, east_m, down_m]}


def velocity_setpoint(north_m_s=0.0, east_m_s=0.0):
    return {"type": "velocity", "velocity_ned_m_s": [north_m_s, east_m_s, 0.0]}


def path_setpoint(*points):
    return {
        "type": "path",
        "points": [{"t_s": t, "position_ned_m": position_ned_m} for t, position_ned_m in points],
    }


def start_request(setpoints, **fields):
    members = [{"vehicle": v, "setpoint": s} for v, s in setpoints.items()]
    return group_models.StartGroup.model_validate({"members": members, "valid_for_s": 60, **fields})


def setpoints_request(setpoints, **fields):
    members = [{"vehicle": v, "setpoint": s} for v, s in setpoints.items()]
    return group_models.GroupSetpoints.model_validate({"setpoints": members, "valid_for_s": 60, **fields})


async def start_group(rig, setpoints, client=ANNA, **fields):
    return json_of(await group_routes.start(start_request(setpoints, **fields), rig.station, client))


def autopilot_modes(rig):
    return {v: autopilot.mode for v, autopilot in rig.autopilots.items()}


def first_setpoint_s(autopilot, north_m):
    """Time at which the autopilot first received a setpoint with this north position."""
    return next(t for t, m in autopilot.setpoints if abs(m.x - north_m) < 0.01)


def assert_no_vehicle_moved(rig):
    """Checks that no vehicle received a setpoint north or south of its start position."""
    assert not [m for autopilot in rig.autopilots.values() for _, m in autopilot.setpoints if abs(m.x) > 0.01]


SETPOINTS_NORTH = {"1": position_setpoint(4), "2": position_setpoint(4), "3": position_setpoint(4)}
