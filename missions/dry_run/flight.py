"""Flies a batch to its end, far faster than real time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from missions.dry_run.findings import DryRunFinding
from missions.dry_run.fleet import Fleet, Vehicle
from missions.dry_run.pilot import READY_WITHIN_S, Pilot, found
from missions.dry_run.setup import Aircraft, Conditions, Obstacle
from missions.dry_run.track import EVERY_TICKS, Recorder, Track

Report = Callable[[float, int], None]
"""(simulated seconds since boot, how many flights have ended), each simulated second; may raise to stop."""
PilotOf = Callable[[Vehicle], Pilot]
REPORT_EVERY_TICKS = 50


@dataclass(frozen=True, slots=True)
class Flight:
    """One flight as it went."""

    conditions: Conditions
    track: Track | None
    """None: it never began."""
    finished: bool
    """The whole plan was flown."""
    collided: bool
    """It flew into an obstacle."""
    landed: bool
    """It ended on the ground, disarmed."""
    findings: tuple[DryRunFinding, ...]


def fly(
    aircraft: Aircraft,
    conditions: Sequence[Conditions],
    pilot_of: PilotOf,
    *,
    longest_s: float,
    seed: int = 0,
    first: int = 0,
    obstacles: Sequence[Obstacle] = (),
    report: Report | None = None,
) -> list[Flight]:
    """All flights of a batch at once.

    Args:
        aircraft: what flies.
        conditions: of each flight.
        pilot_of: makes who flies a vehicle.
        longest_s: a flight that takes longer is ended.
        seed: of noise and gusts.
        first: number of the first flight, which its noise follows from.
        obstacles: what stands around.
        report: is told how far it is; what it raises ends the batch.
    """
    of_each = [aircraft] * len(conditions)
    fleet = Fleet(of_each, conditions, seed=seed, first=first, obstacles=obstacles)
    pilots = [pilot_of(vehicle) for vehicle in fleet.vehicles]
    return fly_fleet(fleet, pilots, conditions, Recorder(fleet, pilots), longest_s=longest_s, report=report)


def fly_fleet(
    fleet: Fleet,
    pilots: Sequence[Pilot],
    conditions: Sequence[Conditions],
    recorder: Recorder,
    *,
    longest_s: float,
    report: Report | None = None,
    look: Callable[[float], None] | None = None,
) -> list[Flight]:
    """Flies all vehicles until the last flight has ended.

    Args:
        fleet: the vehicles.
        pilots: one each.
        conditions: of each.
        recorder: of these vehicles.
        longest_s: a flight that takes longer is ended.
        report: is told how far it is; what it raises ends the batch.
        look: called after the pilots at each tick, for what they do together.
    """
    flights: dict[int, Flight] = {}
    ticks, running = 0, list(enumerate(pilots))
    while running:
        fleet.tick()
        now_s = fleet.time_s
        for _, pilot in running:
            pilot.tick(now_s)
        if look is not None:
            look(now_s)
        ticks += 1
        if ticks % EVERY_TICKS == 0:
            recorder.sample()
            for row, pilot in running:
                if pilot.done or _is_late(pilot, now_s, longest_s):
                    flights[row] = _flight(fleet, row, pilot, recorder, conditions[row], longest_s)
                    fleet.retire(row)
            running = [(row, pilot) for row, pilot in running if row not in flights]
        if report is not None and ticks % REPORT_EVERY_TICKS == 0:
            report(now_s, len(flights))
    return [flights[row] for row in range(len(pilots))]


def _is_late(pilot: Pilot, now_s: float, longest_s: float) -> bool:
    return now_s - (READY_WITHIN_S if pilot.started_s is None else pilot.started_s) >= longest_s


def _flight(
    fleet: Fleet, row: int, pilot: Pilot, recorder: Recorder, conditions: Conditions, longest_s: float
) -> Flight:
    vehicle = fleet.vehicles[row]
    findings = list(pilot.findings)
    collided = fleet.collided(row)
    if not pilot.done:
        message = f"The flight did not end within {longest_s:.0f} s."
        findings.append(found("not_finished", message, pilot.step, longest_s, vehicle))
    track = recorder.track(row)
    if collided:
        end_s = 0.0 if track is None else float(track.t_s[-1])
        message = f"{vehicle.last_warning}."
        findings.append(found("obstacle_hit", message, pilot.step, end_s, vehicle))
    elif pilot.done and track is not None and not pilot.finished:
        where = "the first item" if pilot.step is None else pilot.step.place
        message = f"The flight ends at {where}, before the end of the plan: {vehicle.last_warning}."
        findings.append(found("mission_left", message, pilot.step, float(track.t_s[-1]), vehicle))
    return Flight(conditions, track, pilot.finished, collided, not vehicle.armed, tuple(findings))
