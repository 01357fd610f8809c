"""The ULog of a simulated flight of a waypoint plan, for what is done with logs of missions."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path

from gcs_server.logbook import columns, overview
from gcs_server.logbook.ulog import read_ulog
from missions.dry_run.waypoints import StoredPlan
from missions.geodesy import LocalOrigin
from missions.plan import Plan
from tests.unit.vehicle_sim.sim_station import Station
from vehicle_sim.parameters import Parameters
from vehicle_sim.simulation import SimulationOrigin
from vehicle_sim.storage.files import VehicleFiles

MISSION_START = 300
_ORIGIN = SimulationOrigin()
HOME = LocalOrigin(_ORIGIN.lat_deg, _ORIGIN.lon_deg, _ORIGIN.alt_amsl_m)
CORNERS_NE_M = ((40.0, 0.0), (40.0, 40.0), (0.0, 40.0))
ALTITUDE_M = 12.0


def square() -> Plan:
    """Take-off, three corners of a square of 40 m at 12 m, and Return: items 1 to 5."""

    def at(north_m: float, east_m: float) -> dict[str, object]:
        lat_deg, lon_deg, _ = HOME.to_geodetic((north_m, east_m, 0.0))
        altitude = {"value_m": ALTITUDE_M, "reference": "home"}
        return {"lat_deg": lat_deg, "lon_deg": lon_deg, "altitude": altitude}

    corners = [{"kind": "waypoint", **at(*corner)} for corner in CORNERS_NE_M]
    items = [{"kind": "takeoff", **at(0.0, 0.0)}, *corners, {"kind": "return_home"}]
    return Plan.model_validate_json(json.dumps({"items": items}))


def flown_mission(
    folder: Path,
    plan: Plan,
    *,
    until_item: int,
    then: Callable[[Station], None] = lambda _: None,
    fly_on_s: float,
    parameters: Mapping[str, float] | None = None,
    sensor_noise: bool = False,
) -> tuple[Path, float]:
    """A vehicle flies a plan to an item, and on; equal flights are equal until `then`.

    Args:
        folder: empty; gets the vehicle's files, and the columns of its log.
        plan: the plan.
        until_item: index of the item, in the order of the upload.
        then: called 2 s after the vehicle turned to it: the moment.
        fly_on_s: how long it is logged from then on.
        parameters: with other values than PX4's.
        sensor_noise: whether its sensors have noise, and with them the logged estimates.

    Returns:
        The folder of the log's columns, and the moment [s since the log's start].
    """
    store = Parameters({"RTL_RETURN_ALT": 20.0, **(parameters or {})})
    files = [VehicleFiles(folder / "vehicle")]
    station = Station(log=True, files=files, stores=[store], sensor_noise=sensor_noise)
    station.run_until(lambda: station.can_be_armed, 15)
    autopilot = station.sim.autopilots[0]
    for mission_type, items in StoredPlan.from_plan(plan).parts:
        autopilot.plans.store(mission_type, items)
    station.run(1.0)
    station.command(MISSION_START)
    station.run_until(lambda: autopilot.navigator.mission.current == until_item, 120)
    station.run(2.0)
    logger = station.sim.loggers[0]
    moment_s = station.now_s - logger.started_at_us / 1e6
    then(station)
    station.run(fly_on_s)
    assert logger.path is not None
    log = read_ulog(folder / "vehicle" / logger.path)
    columns.write(log, overview.encode(log), folder / "columns")
    return folder / "columns", moment_s
