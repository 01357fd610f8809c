"""The simulated vehicles of a dry run: one for each set of conditions, on one clock, without links."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from missions.dry_run.setup import LEVEL_SITE, Aircraft, Conditions, Obstacle, Prism, Site
from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.values import HomePosition
from vehicle_sim.autopilot.announcer import EVENTS, Event, StatusText
from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.mavlink.node import Node
from vehicle_sim.parameters import Parameters, ParameterValue
from vehicle_sim.px4_version import VERSIONS
from vehicle_sim.script import Script
from vehicle_sim.simulation import SimulationOrigin
from vehicle_sim.world import prism
from vehicle_sim.world.terrain import HeightGrid, Terrain
from vehicle_sim.world.world import Box, World

TICK_S = 0.02
"""Time step of the autopilots [s]. Commands are executed between two steps."""
SEVERITY_WARNING = 4
DRAIN_EXPONENT = 1.5
"""Hover power is proportional to mass to this power (momentum theory, `missions.vehicle.hover_power_w`)."""


class Fleet:
    """N simulated vehicles.

    Args:
        aircraft: one for each vehicle; all vehicles start on the ground. Positions are relative to the home
            of the first one.
        conditions: one for each vehicle.
        seed: seed of noise and gusts.
        first: number of the first flight. The noise of a flight depends on this number, not on the batch.
        noise_numbers: one for each vehicle, instead of `first` and those after it.
        site: ground and obstacles around the start.
        world: a world of the simulator, instead of `site`.
        script: what fails, and when.
    """

    def __init__(
        self,
        aircraft: Sequence[Aircraft],
        conditions: Sequence[Conditions],
        *,
        seed: int = 0,
        first: int = 0,
        noise_numbers: Sequence[int] | None = None,
        site: Site = LEVEL_SITE,
        world: World | None = None,
        script: Script | None = None,
    ) -> None:
        home, world = aircraft[0].home, world or _world(site)
        start_ned_m = np.array([_from_home(home, each.home) for each in aircraft])
        if world is not None:
            start_ned_m[:, 2] = -world.terrain.alt_home_m(start_ned_m[:, 0], start_ned_m[:, 1])
        self.sim = SimulatedFleet(
            len(conditions), links=(), seed=seed,
            noise_numbers=noise_numbers or range(first, first + len(conditions)),
            stores=[_parameters_for(*each) for each in zip(aircraft, conditions, strict=True)],
            origin=SimulationOrigin(home.lat_deg, home.lon_deg, home.alt_amsl_m),
            start_ned_m=start_ned_m,
            start_yaw_ned_rad=np.array([each.yaw_ned_rad for each in aircraft]), world=world, script=script,
        )  # fmt: skip
        simulation = self.sim.simulation
        for row, each in enumerate(conditions):
            simulation.set_wind(np.array(each.wind_ned_m_s), row)
            if each.gusts_m_s > 0.0:
                simulation.set_gusts(each.gusts_m_s, row)
            if each.sensor_noise != 1.0:
                simulation.set_sensor_noise(row, each.sensor_noise)
            simulation.set_battery_remaining(row, aircraft[row].battery_share)
        self.vehicles = [
            Vehicle(autopilot, node)
            for autopilot, node in zip(self.sim.autopilots, self.sim.nodes, strict=True)
        ]

    @property
    def time_s(self) -> float:
        """Simulated time since boot."""
        return self.sim.time_s

    def tick(self) -> None:
        """Advances the simulation by one tick."""
        self.sim.step(TICK_S)

    def collided(self, row: int) -> bool:
        """Whether a vehicle hit an obstacle, which stopped its motors."""
        return bool((self.sim.simulation.motor_health[row] == 0.0).all())

    def retire(self, row: int) -> None:
        """Stops simulating a vehicle whose flight has ended."""
        self.sim.deactivate(row)


MISSION_REFUSALS = {
    "navigator_mis_unsup_cmd": "an item has a command that multicopters do not fly",
    "navigator_mis_vtol_items": "an item is for VTOL aircraft",
    "navigator_mis_takeoff_not_first": "the take-off is not the first item",
    "navigator_mis_takeoff_too_low": "the take-off is too low",
    "navigator_mis_takeoff_missing": "the mission has no take-off",
    "navigator_mis_land_missing": "the mission has no landing",
    "navigator_mis_takeoff_or_land_missing": "the mission needs a take-off and a landing",
    "navigator_mis_add_land_or_rm_to": "the mission has a take-off but no landing",
    "navigator_mis_add_to_or_rm_land": "the mission has a landing but no take-off",
    "navigator_mis_geofence_violation": "an item lies outside the geofence",
    "navigator_geofence_invalid_against_home": "home lies outside the geofence",
}
"""Texts for events that PX4 sends without a text."""
_REFUSAL_BY_EVENT_ID = {EVENTS[name][0]: text for name, text in MISSION_REFUSALS.items()}


class Vehicle:
    """One vehicle of the fleet, with the warnings that it sent."""

    def __init__(self, autopilot: Autopilot, node: Node) -> None:
        self.autopilot = autopilot
        self.node = node
        self.warnings: list[str] = []
        """Status texts of the vehicle with severity warning and above."""
        autopilot.announcer.add_listener(self._on_message)

    def _on_message(self, message: StatusText | Event) -> None:
        if isinstance(message, StatusText) and message.severity <= SEVERITY_WARNING:
            self.warnings.append(message.text.strip())
        elif isinstance(message, Event) and message.id in _REFUSAL_BY_EVENT_ID:
            self.warnings.append(f"PX4 refuses the mission: {_REFUSAL_BY_EVENT_ID[message.id]}")

    @property
    def armed(self) -> bool:
        """Whether the vehicle is armed."""
        return self.autopilot.commander.armed

    @property
    def last_warning(self) -> str:
        """The vehicle's last warning, without a full stop."""
        return self.warnings[-1].rstrip(".") if self.warnings else "the vehicle reported no reason"


def _from_home(home: HomePosition, other: HomePosition) -> Vector3:
    """Position of another home relative to the first home, on level ground (NED) [m]."""
    if other == home:
        return (0.0, 0.0, 0.0)
    origin = LocalOrigin(home.lat_deg, home.lon_deg, home.alt_amsl_m)
    north_m, east_m, _ = origin.to_ned(other.lat_deg, other.lon_deg, home.alt_amsl_m)
    return (north_m, east_m, 0.0)


def _parameters_for(aircraft: Aircraft, conditions: Conditions) -> Parameters:
    store = Parameters(px4=VERSIONS[aircraft.px4])
    for name, value in aircraft.simulated_parameters().items():
        if name in store:
            store.set(name, _as_type_of(store, name, value))
    store.set("SIH_MASS", float(store.get("SIH_MASS")) * conditions.mass_scale)
    if aircraft.endurance_s is not None:
        store.set("SIM_BAT_ENABLE", 1)
        store.set("SIM_BAT_MIN_PCT", 0.0)
        store.set("SIM_BAT_DRAIN", aircraft.endurance_s)
    elif not aircraft.battery_is_known:
        store.set("SIM_BAT_ENABLE", 0)
    drain_s = float(store.get("SIM_BAT_DRAIN"))
    scale = conditions.battery_scale / conditions.mass_scale**DRAIN_EXPONENT
    store.set("SIM_BAT_DRAIN", drain_s * scale)
    return store


def _as_type_of(store: Parameters, name: str, value: float) -> ParameterValue:
    """The value in the type of the parameter."""
    return round(value) if store.type_of(name) == "INT32" else value


def _world(site: Site) -> World | None:
    ground = site.ground
    if site.is_empty:
        return None
    boxes = tuple(
        Box(
            each.name, each.north_m, each.east_m, each.length_m, each.width_m, each.height_m,
            each.base_alt_home_m, math.remainder(each.yaw_ned_rad, math.tau),
        )
        for each in site.obstacles
        if isinstance(each, Obstacle)
    )  # fmt: skip
    prisms = tuple(
        prism.Prism(each.name, each.corners_ne_m, each.top_alt_home_m)
        for each in site.obstacles
        if isinstance(each, Prism)
    )
    grid = None
    if ground is not None:
        grid = HeightGrid(ground.north_m, ground.east_m, ground.spacing_m, ground.altitudes_home_m)
    return World(name="dry run", boxes=boxes, prisms=prisms, terrain=Terrain(grid=grid))
