"""Flies plans and missions of scenarios: many flights in one simulation, faster than real time."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace

from gcs_server.scenarios.flown import FlightRecorder, Flown
from gcs_server.scenarios.scenario import Cell, Scenario, for_rows
from missions.dry_run.fleet import Fleet, Vehicle
from missions.dry_run.flight import Flight, fly_fleet
from missions.dry_run.group import GroupPilots
from missions.dry_run.offboard import OffboardPilot
from missions.dry_run.pilot import Pilot
from missions.dry_run.plans import FlyableMission, FlyablePlan, max_duration_s
from missions.dry_run.result import effective_fence
from missions.dry_run.setup import Aircraft, AnyObstacle, Conditions, Obstacle, Prism, Site, prisms_of
from missions.dry_run.track import SAMPLE_EVERY_TICKS, Recorder
from missions.offboard.document import OffboardMission
from missions.values import HomePosition
from vehicle_sim.fleet import DEFAULT_BOOT_TIME_UNIX_S
from vehicle_sim.parameters import Parameters
from vehicle_sim.px4_version import VERSIONS
from vehicle_sim.script import Script
from vehicle_sim.world.world import World

ROW_SPACING_M = 3.0
"""Distance between the vehicles of a mission with roles at the start, as in the simulator."""
LINK = "gcs"
RECORDING_TIME = struct.Struct(">Q")


@dataclass(frozen=True, slots=True)
class FlownCell:
    """A flight and its conditions."""

    cell: Cell
    flown: Flown
    recording: bytes | None = None
    """What the vehicles sent, as a tlog."""


def fly(scenario: Scenario, cells: Sequence[Cell], *, record: bool = False) -> list[FlownCell]:
    """Flies a scenario in some of its conditions. A flight is the same in any company.

    Args:
        scenario: a scenario with a plan or mission.
        cells: the conditions.
        record: whether to record what the vehicles send.

    Raises:
        PlanError: PX4 refuses the plan, or the mission cannot be flown.
    """
    batch = _Batch(scenario, cells, record=record)
    return batch.fly()


class _Batch:
    """Flights of one scenario in one simulation: the vehicles of each cell are consecutive rows."""

    def __init__(self, scenario: Scenario, cells: Sequence[Cell], *, record: bool) -> None:
        self._scenario, self._cells = scenario, cells
        self._names = scenario.vehicle_names
        self._aircraft = {px4: self._aircraft_of(px4) for px4 in {cell.px4 for cell in cells}}
        self._site = _site(scenario)
        rows = [aircraft for cell in cells for aircraft in self._aircraft[cell.px4]]
        self._conditions = [self._conditions_of(cell) for cell in cells for _ in self._names]
        events = [
            event
            for index, cell in enumerate(cells)
            for event in for_rows(scenario.events[cell.faults], index * len(self._names), len(self._names))
        ]
        self._fleet = Fleet(
            rows,
            self._conditions,
            # The vehicles of a flight have numbers of their own, as in any other flight of this seed.
            noise_numbers=[cell.seed * 256 + n for cell in cells for n in range(len(self._names))],
            site=self._site,
            world=scenario.world,
            script=Script(scenario.document.name, tuple(events)) if events else None,
        )
        self._flyable = {px4: self._flyable_of(aircraft) for px4, aircraft in self._aircraft.items()}
        self._recorder = FlightRecorder(self._fleet.sim)
        self._recordings: list[list[bytes]] | None = [[] for _ in cells] if record else None
        if record:
            for row in range(len(rows)):
                self._fleet.sim.add_link(row, LINK, LINK)

    def fly(self) -> list[FlownCell]:
        """Flies all until the last flight has ended."""
        pilots, groups = self._pilots()
        ticks = 0

        def after_pilots(now_s: float) -> None:
            nonlocal ticks
            ticks += 1
            for group in groups:
                group.tick(now_s)
            self._recorder.tick(ticks % SAMPLE_EVERY_TICKS == 0)
            for row, pilot in enumerate(pilots):
                if pilot.ended:
                    self._recorder.end(row)
            self._record(now_s)

        flights = fly_fleet(
            self._fleet,
            pilots,
            self._conditions,
            Recorder(self._fleet, pilots, detailed=0),
            max_duration_s=self._time_limit_s(),
            after_pilots=after_pilots,
        )
        return [self._flown(index, flights) for index in range(len(self._cells))]

    def _aircraft_of(self, px4: str) -> list[Aircraft]:
        """The vehicles of a flight with this version of PX4."""
        document = self._scenario.document
        store = Parameters(px4=VERSIONS[px4])
        parameters = {name: float(value) for name, value in store.items()} | document.parameters
        home = document.home
        first = Aircraft(
            home,
            document.yaw_ned_rad,
            parameters,
            body=document.parameters,
            battery_share=document.battery.charge_percent / 100.0,
            endurance_s=document.battery.endurance_s,
            px4=px4,
        )
        aircraft: list[Aircraft] = []
        for number, name in enumerate(self._names):
            north_m, east_m = self._start_ne_m(number, name)
            lat_deg, lon_deg, _ = first.origin.to_geodetic((north_m, east_m, 0.0))
            own_home = HomePosition(lat_deg=lat_deg, lon_deg=lon_deg, alt_amsl_m=home.alt_amsl_m)
            aircraft.append(replace(first, home=own_home if north_m or east_m else home))
        return aircraft

    def _start_ne_m(self, number: int, name: str) -> tuple[float, float]:
        """North and east of a vehicle's start from home."""
        program, starts = self._scenario.program, self._scenario.document.starts_ne_m
        role = program.roles.get(name) if isinstance(program, OffboardMission) else None
        if name in starts:
            return starts[name]
        if role is not None and role.start_ned_m is not None:
            return role.start_ned_m[0], role.start_ned_m[1]
        return 0.0, number * ROW_SPACING_M

    def _conditions_of(self, cell: Cell) -> Conditions:
        wind = self._scenario.matrix.winds[cell.wind]
        return Conditions(wind_ned_m_s=wind.wind_ned_m_s, gusts_m_s=wind.gusts_m_s)

    def _flyable_of(self, aircraft: Sequence[Aircraft]) -> list[FlyablePlan] | list[FlyableMission]:
        program = self._scenario.program
        if not isinstance(program, OffboardMission):
            return [FlyablePlan.from_plan(program, aircraft[0])]
        roles = self._names if program.roles else (None,)
        return [
            FlyableMission.from_mission(program, each, role=role)
            for each, role in zip(aircraft, roles, strict=True)
        ]

    def _pilots(self) -> tuple[list[Pilot], list[GroupPilots]]:
        vehicles = iter(self._fleet.vehicles)
        pilots: list[Pilot] = []
        groups: list[GroupPilots] = []
        for cell in self._cells:
            flyable = self._flyable[cell.px4]
            if len(self._names) == 1:
                pilots.append(flyable[0].make_pilot(next(vehicles)))
                continue
            group = self._group(flyable, [next(vehicles) for _ in self._names])
            pilots += group.values()
            groups.append(GroupPilots(group))
        return pilots, groups

    def _group(self, flyable: Sequence[object], vehicles: Sequence[Vehicle]) -> dict[str, OffboardPilot]:
        return {
            name: each.make_pilot(vehicle, alone=False)
            for name, each, vehicle in zip(self._names, flyable, vehicles, strict=True)
            if isinstance(each, FlyableMission)
        }

    def _time_limit_s(self) -> float:
        limit_s = self._scenario.document.time_limit_s
        if limit_s is not None:
            return limit_s
        expected_s = [sum(each.expected_s for each in flyable) for flyable in self._flyable.values()]
        return max_duration_s(max(expected_s))

    def _record(self, now_s: float) -> None:
        if self._recordings is None:
            return
        stamp = RECORDING_TIME.pack(round((DEFAULT_BOOT_TIME_UNIX_S + now_s) * 1e6))
        count = len(self._names)
        for row in range(len(self._conditions)):
            for frame in self._fleet.sim.frames(row, LINK):
                self._recordings[row // count].append(stamp + frame)

    def _flown(self, index: int, flights: Sequence[Flight]) -> FlownCell:
        cell, count = self._cells[index], len(self._names)
        first = index * count
        own = flights[first : first + count]
        vehicles = self._recorder.flights(dict(zip(range(first, first + count), self._names, strict=True)))
        findings = [finding for flight in own for finding in flight.findings]
        faults = [each.text for each in findings if each.code in ("start_refused", "obstacle_hit")]
        faults += [each.text for each in findings if each.code == "not_finished"]
        faults += [f"{each.name} never took off." for each in vehicles if not each.armed and not faults]
        reasons = [each.text for each in findings if each.severity == "error"]
        flyable = self._flyable[cell.px4]
        flown = Flown(
            vehicles,
            finished=all(flight.finished for flight in own),
            end_reason=" ".join(reasons) or "the program did not finish",
            faults=tuple(faults),
            fence=effective_fence(flyable[0], self._aircraft[cell.px4][0]),
            obstacles=_obstacles(self._scenario.world, self._site),
        )
        recording = None if self._recordings is None else b"".join(self._recordings[index])
        return FlownCell(cell, flown, recording)


def _site(scenario: Scenario) -> Site:
    return Site(prisms_of(scenario.program.obstacles, scenario.document.home))


def _obstacles(world: World | None, site: Site) -> Sequence[AnyObstacle]:
    """The obstacles in the simulation, for judgements."""
    if world is None:
        return site.obstacles
    boxes = [
        Obstacle(
            each.name, each.north_m, each.east_m, each.length_m, each.width_m, each.height_m,
            each.base_alt_home_m, math.remainder(each.yaw_ned_rad, math.tau),
        )
        for each in world.boxes
    ]  # fmt: skip
    return [*boxes, *(Prism(each.name, each.corners_ne_m, each.roof_alt_home_m) for each in world.prisms)]
