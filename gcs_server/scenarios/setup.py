"""The simulation of a scenario's flights: vehicles, conditions, surroundings, faults."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from gcs_server.scenarios.scenario import Cell, Scenario, for_rows
from missions.dry_run.clearance import FenceDistance
from missions.dry_run.fleet import Fleet
from missions.dry_run.setup import Aircraft, AnyObstacle, Conditions, Obstacle, Prism, Site, prisms_of
from missions.offboard.document import OffboardMission
from missions.plan import Plan
from missions.values import HomePosition
from vehicle_sim.parameters import Parameters
from vehicle_sim.px4_version import VERSIONS
from vehicle_sim.script import Script

ROW_SPACING_M = 3.0
"""Distance between the vehicles of a flight at the start, as in the simulator."""
NUMBERS_PER_SEED = 256
"""The vehicles of a flight have noise of their own, the same in any flight with this seed."""


def fleet_of(scenario: Scenario, cells: Sequence[Cell]) -> Fleet:
    """The simulated vehicles of flights in some conditions: those of each cell are consecutive rows."""
    count = len(scenario.vehicle_names)
    aircraft = {px4: aircraft_of(scenario, px4) for px4 in {cell.px4 for cell in cells}}
    events = [
        event
        for index, cell in enumerate(cells)
        for event in for_rows(scenario.events[cell.faults], index * count, count)
    ]
    return Fleet(
        [each for cell in cells for each in aircraft[cell.px4]],
        [conditions_of(scenario, cell) for cell in cells for _ in range(count)],
        noise_numbers=[cell.seed * NUMBERS_PER_SEED + n for cell in cells for n in range(count)],
        site=_site(scenario),
        world=scenario.world,
        script=Script(scenario.document.name, tuple(events)) if events else None,
    )


def aircraft_of(scenario: Scenario, px4: str) -> list[Aircraft]:
    """The vehicles of a flight with this version of PX4."""
    document = scenario.document
    store = Parameters(px4=VERSIONS[px4])
    home = document.home
    first = Aircraft(
        home,
        document.yaw_ned_rad,
        {name: float(value) for name, value in store.items()} | document.parameters,
        body=document.parameters,
        battery_share=document.battery.charge_percent / 100.0,
        endurance_s=document.battery.endurance_s,
        px4=px4,
    )
    aircraft: list[Aircraft] = []
    for number, name in enumerate(scenario.vehicle_names):
        north_m, east_m = _start_ne_m(scenario, number, name)
        lat_deg, lon_deg, _ = first.origin.to_geodetic((north_m, east_m, 0.0))
        own_home = HomePosition(lat_deg=lat_deg, lon_deg=lon_deg, alt_amsl_m=home.alt_amsl_m)
        aircraft.append(replace(first, home=own_home if north_m or east_m else home))
    return aircraft


def _start_ne_m(scenario: Scenario, number: int, name: str) -> tuple[float, float]:
    """North and east of a vehicle's start from home."""
    program, starts = scenario.program, scenario.document.starts_ne_m
    role = program.roles.get(name) if isinstance(program, OffboardMission) else None
    if name in starts:
        return starts[name]
    if role is not None and role.start_ned_m is not None:
        return role.start_ned_m[0], role.start_ned_m[1]
    return 0.0, number * ROW_SPACING_M


def conditions_of(scenario: Scenario, cell: Cell) -> Conditions:
    """Wind of a flight."""
    wind = scenario.matrix.winds[cell.wind]
    return Conditions(wind_ned_m_s=wind.wind_ned_m_s, gusts_m_s=wind.gusts_m_s)


def _site(scenario: Scenario) -> Site:
    program = scenario.program
    planned = program.obstacles if isinstance(program, Plan | OffboardMission) else ()
    return Site(prisms_of(planned, scenario.document.home))


def fence_of(scenario: Scenario, aircraft: Aircraft) -> FenceDistance:
    """The geofence of plan or mission, and of the vehicle's parameters."""
    program, parameters = scenario.program, aircraft.parameters
    zones = program.fence if isinstance(program, Plan | OffboardMission) else ()
    return FenceDistance(zones, aircraft.origin, parameters["GF_MAX_HOR_DIST"], parameters["GF_MAX_VER_DIST"])


def obstacles_of(scenario: Scenario) -> Sequence[AnyObstacle]:
    """The obstacles in the simulation, for judgements."""
    world = scenario.world
    if world is None:
        return _site(scenario).obstacles
    boxes = [
        Obstacle(
            each.name, each.north_m, each.east_m, each.length_m, each.width_m, each.height_m,
            each.base_alt_home_m, math.remainder(each.yaw_ned_rad, math.tau),
        )
        for each in world.boxes
    ]  # fmt: skip
    return [*boxes, *(Prism(each.name, each.corners_ne_m, each.roof_alt_home_m) for each in world.prisms)]
