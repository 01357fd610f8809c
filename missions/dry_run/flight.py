"""Flies a batch of simulated flights to their end, faster than real time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from missions.dry_run.document import DryRunFinding
from missions.dry_run.fleet import Fleet, Vehicle
from missions.dry_run.pilot import READY_WITHIN_S, Pilot, finding_now
from missions.dry_run.setup import LEVEL_SITE, Aircraft, Conditions, Site
from missions.dry_run.track import SAMPLE_EVERY_TICKS, Recorder, Track

ReportProgress = Callable[[float, int], None]
"""Called once per simulated second with (simulated seconds since boot, number of ended flights). An exception
from this function stops the batch."""
MakePilot = Callable[[Vehicle], Pilot]
REPORT_EVERY_TICKS = 50


@dataclass(frozen=True, slots=True)
class Flight:
    """The outcome of one flight."""

    conditions: Conditions
    track: Track | None
    """None: the flight did not start."""
    finished: bool
    """Whether the flight completed the plan."""
    collided: bool
    """Whether the vehicle hit an obstacle."""
    landed: bool
    """Whether the flight ended on the ground, disarmed."""
    findings: tuple[DryRunFinding, ...]


def fly(
    aircraft: Aircraft,
    conditions: Sequence[Conditions],
    make_pilot: MakePilot,
    *,
    max_duration_s: float,
    seed: int = 0,
    first: int = 0,
    site: Site = LEVEL_SITE,
    report: ReportProgress | None = None,
) -> list[Flight]:
    """Flies all flights of a batch at once, in simulated time.

    Args:
        aircraft: the vehicle.
        conditions: one for each flight.
        make_pilot: creates the pilot of a vehicle.
        max_duration_s: time limit of a flight.
        seed: seed of noise and gusts.
        first: number of the first flight. The noise of a flight depends on this number.
        site: ground and obstacles around the start.
        report: called with the progress.
    """
    fleet = Fleet([aircraft] * len(conditions), conditions, seed=seed, first=first, site=site)
    pilots = [make_pilot(vehicle) for vehicle in fleet.vehicles]
    return fly_fleet(
        fleet, pilots, conditions, Recorder(fleet, pilots), max_duration_s=max_duration_s, report=report
    )


def fly_fleet(
    fleet: Fleet,
    pilots: Sequence[Pilot],
    conditions: Sequence[Conditions],
    recorder: Recorder,
    *,
    max_duration_s: float,
    report: ReportProgress | None = None,
    after_pilots: Callable[[float], None] | None = None,
) -> list[Flight]:
    """Flies all vehicles until the last flight has ended.

    Args:
        fleet: the vehicles.
        pilots: one for each vehicle.
        conditions: one for each vehicle.
        recorder: records these vehicles.
        max_duration_s: time limit of a flight.
        report: called with the progress.
        after_pilots: called after the pilots at each tick, to coordinate them.
    """
    flights: dict[int, Flight] = {}
    ticks, running = 0, list(enumerate(pilots))
    while running:
        fleet.tick()
        now_s = fleet.time_s
        for _, pilot in running:
            pilot.tick(now_s)
        if after_pilots is not None:
            after_pilots(now_s)
        ticks += 1
        if ticks % SAMPLE_EVERY_TICKS == 0:
            recorder.sample()
            for row, pilot in running:
                if pilot.ended or _has_timed_out(pilot, now_s, max_duration_s):
                    flights[row] = _flight(fleet, row, pilot, recorder, conditions[row], max_duration_s)
                    fleet.retire(row)
            running = [(row, pilot) for row, pilot in running if row not in flights]
        if report is not None and ticks % REPORT_EVERY_TICKS == 0:
            report(now_s, len(flights))
    return [flights[row] for row in range(len(pilots))]


def _has_timed_out(pilot: Pilot, now_s: float, max_duration_s: float) -> bool:
    return now_s - (READY_WITHIN_S if pilot.started_s is None else pilot.started_s) >= max_duration_s


def _flight(
    fleet: Fleet, row: int, pilot: Pilot, recorder: Recorder, conditions: Conditions, max_duration_s: float
) -> Flight:
    vehicle = fleet.vehicles[row]
    findings = list(pilot.findings)
    collided = fleet.collided(row)
    if not pilot.ended:
        message = f"The flight did not end within {max_duration_s:.0f} s."
        findings.append(finding_now("not_finished", message, pilot.step, max_duration_s, vehicle))
    track = recorder.track(row)
    if collided:
        end_s = 0.0 if track is None else float(track.t_s[-1])
        message = f"{vehicle.last_warning}."
        findings.append(finding_now("obstacle_hit", message, pilot.step, end_s, vehicle))
    elif pilot.ended and track is not None and not pilot.finished:
        where = "the first item" if pilot.step is None else pilot.step.place
        message = f"The flight ends at {where}, before the end of the plan: {vehicle.last_warning}."
        findings.append(finding_now("mission_left", message, pilot.step, float(track.t_s[-1]), vehicle))
    return Flight(conditions, track, pilot.finished, collided, not vehicle.armed, tuple(findings))
