"""Flies plans and missions of scenarios: many flights in one simulation, faster than real time."""

from __future__ import annotations

from collections.abc import Sequence

from gcs_server.mavlink.tlog_writer import stamp
from gcs_server.scenarios.flown import FlightRecorder, Flown
from gcs_server.scenarios.results import FlownCell
from gcs_server.scenarios.scenario import Cell, Scenario
from gcs_server.scenarios.setup import aircraft_of, conditions_of, fence_of, fleet_of, obstacles_of
from missions.dry_run.fleet import Vehicle
from missions.dry_run.flight import Flight, fly_fleet
from missions.dry_run.group import GroupPilots
from missions.dry_run.offboard import OffboardPilot
from missions.dry_run.pilot import Pilot
from missions.dry_run.plans import FlyableMission, FlyablePlan, max_duration_s
from missions.dry_run.setup import Aircraft
from missions.dry_run.track import SAMPLE_EVERY_TICKS, Recorder
from missions.offboard.document import OffboardMission
from missions.plan import Plan
from vehicle_sim.fleet import DEFAULT_BOOT_TIME_UNIX_S

LINK = "gcs"


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
        self._conditions = [conditions_of(scenario, cell) for cell in cells for _ in self._names]
        self._fleet = fleet_of(scenario, cells)
        self._aircraft = {px4: aircraft_of(scenario, px4) for px4 in {cell.px4 for cell in cells}}
        self._flyable = {px4: self._flyable_of(aircraft) for px4, aircraft in self._aircraft.items()}
        self._recorder = FlightRecorder(self._fleet.sim)
        self._recordings: list[list[bytes]] | None = [[] for _ in cells] if record else None
        if record:
            for row in range(len(self._conditions)):
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

    def _flyable_of(self, aircraft: Sequence[Aircraft]) -> list[FlyablePlan] | list[FlyableMission]:
        program = self._scenario.program
        if isinstance(program, Plan):
            return [FlyablePlan.from_plan(program, aircraft[0])]
        assert isinstance(program, OffboardMission)
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
        time = stamp(round((DEFAULT_BOOT_TIME_UNIX_S + now_s) * 1e6))
        count = len(self._names)
        for row in range(len(self._conditions)):
            for frame in self._fleet.sim.frames(row, LINK):
                self._recordings[row // count].append(time + frame)

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
        flown = Flown(
            vehicles,
            finished=all(flight.finished for flight in own),
            end_reason=" ".join(reasons) or "the program did not finish",
            faults=tuple(faults),
            fence=fence_of(self._scenario, self._aircraft[cell.px4][0]),
            obstacles=obstacles_of(self._scenario),
        )
        recording = None if self._recordings is None else b"".join(self._recordings[index])
        return FlownCell(cell, flown, recording)
