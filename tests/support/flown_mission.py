"""The ULog of a simulated flight of a waypoint plan or an offboard mission, for what is done with logs of
missions."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from gcs_server.logbook import columns, overview
from gcs_server.logbook.ulog import read_ulog
from missions.dry_run.fleet import Vehicle
from missions.dry_run.offboard import OffboardPilot
from missions.dry_run.waypoints import StoredPlan
from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.offboard.compiler import compile_mission
from missions.offboard.document import OffboardMission
from missions.offboard.positions import Start
from missions.offboard.state import MissionVehicle
from missions.plan import Plan
from missions.runner.runner import Runner
from tests.unit.vehicle_sim.sim_station import Station
from vehicle_sim.parameters import Parameters
from vehicle_sim.simulation import SimulationOrigin
from vehicle_sim.storage.files import VehicleFiles

MISSION_START = 300
_ORIGIN = SimulationOrigin()
HOME = LocalOrigin(_ORIGIN.lat_deg, _ORIGIN.lon_deg, _ORIGIN.alt_amsl_m)
CORNERS_NE_M = ((40.0, 0.0), (40.0, 40.0), (0.0, 40.0))
ALTITUDE_M = 12.0
CALM: Vector3 = (0.0, 0.0, 0.0)


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
    wind_ned_m_s: Vector3 = CALM,
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
        wind_ned_m_s: steady wind.

    Returns:
        The folder of the log's columns, and the moment [s since the log's start].
    """
    station, _ = _station(folder, parameters, sensor_noise, wind_ned_m_s)
    autopilot = station.sim.autopilots[0]
    for mission_type, items in StoredPlan.from_plan(plan).parts:
        autopilot.plans.store(mission_type, items)
    station.run(1.0)
    station.command(MISSION_START)
    station.run_until(lambda: autopilot.navigator.mission.current == until_item, 120)
    station.run(2.0)
    moment_s = station.now_s - station.sim.loggers[0].started_at_us / 1e6
    then(station)
    station.run(fly_on_s)
    return _columns(folder, station), moment_s


def flown_offboard(
    folder: Path,
    mission: OffboardMission,
    *,
    for_s: float,
    before_each_step: Callable[[OffboardPilot, float], None] | None = None,
    parameters: Mapping[str, float] | None = None,
    sensor_noise: bool = False,
    wind_ned_m_s: Vector3 = CALM,
) -> tuple[Path, float]:
    """A vehicle flies an offboard mission; its questions are answered at once.

    Args:
        folder: empty; gets the vehicle's files, and the columns of its log.
        mission: the mission.
        for_s: how long it flies.
        before_each_step: called with the pilot and the time since the mission's start [s].
        parameters: with other values than PX4's.
        sensor_noise: whether its sensors have noise.
        wind_ned_m_s: steady wind.

    Returns:
        The folder of the log's columns, and the mission's start [s since the log's start].
    """
    station, store = _station(folder, parameters, sensor_noise, wind_ned_m_s)
    vehicle = Vehicle(station.sim.autopilots[0], station.sim.nodes[0])
    limits = MissionVehicle.from_parameters({name: float(value) for name, value in store.items()})
    start = Start(
        yaw_ned_rad=vehicle.autopilot.view.estimate.yaw_ned_rad, origin=HOME, home_alt_amsl_m=HOME.alt_amsl_m
    )
    timeline = compile_mission(mission, limits, start)
    pilot = OffboardPilot(vehicle, Runner(timeline, mission.name, limits.motion), (0.0, 0.0, 0.0))
    begin_s = station.now_s

    def step() -> None:
        if before_each_step is not None:
            before_each_step(pilot, station.now_s - begin_s)
        pilot.tick(station.now_s)

    station.run(for_s, step)
    return _columns(folder, station), begin_s - station.sim.loggers[0].started_at_us / 1e6


def _station(
    folder: Path, parameters: Mapping[str, float] | None, sensor_noise: bool, wind_ned_m_s: Vector3
) -> tuple[Station, Parameters]:
    store = Parameters({"RTL_RETURN_ALT": 20.0, **(parameters or {})})
    files = [VehicleFiles(folder / "vehicle")]
    station = Station(log=True, files=files, stores=[store], sensor_noise=sensor_noise)
    station.sim.simulation.set_wind(np.array(wind_ned_m_s), 0)
    station.run_until(lambda: station.can_be_armed, 15)
    return station, store


def _columns(folder: Path, station: Station) -> Path:
    logger = station.sim.loggers[0]
    assert logger.path is not None
    log = read_ulog(folder / "vehicle" / logger.path)
    columns.write(log, overview.encode(log), folder / "columns")
    return folder / "columns"
