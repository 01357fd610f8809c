"""Simulates the mission of a group: all roles in one batch, each from its vehicle's position, once or many
times in varied conditions.

The separation guard, which stops vehicles in real flights, does not act in a dry run. A finding reports where
the guard would act.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from missions.dry_run.document import (
    ClosestApproach,
    DryRunFinding,
    MonteCarloResult,
    PairDistance,
    plain,
)
from missions.dry_run.fleet import Fleet
from missions.dry_run.flight import ReportProgress, fly_fleet
from missions.dry_run.monte_carlo import OUTCOMES, MonteCarlo, outcome_probabilities, summarise
from missions.dry_run.offboard import RUNNER_EVERY_TICKS, OffboardPilot
from missions.dry_run.plans import FlyableMission, max_duration_s
from missions.dry_run.result import MAX_SAMPLES, DryRun, evaluate
from missions.dry_run.setup import LEVEL_SITE, Aircraft, Conditions, Site
from missions.dry_run.spread import MAX_FLIGHTS, MAX_VEHICLES, Chance, Quantiles, Spread
from missions.dry_run.track import SAMPLE_PERIOD_S, Recorder, Track
from missions.errors import PlanError
from missions.geodesy import LocalOrigin
from missions.offboard.document import OffboardMission
from missions.runner.group import GroupRunner
from missions.runner.requests import CannotDo
from missions.separation import braking_separation_m, planned_margin_m

Array = NDArray[np.float64]
TOO_NEAR = "nearer_than_minimum"


@dataclass(frozen=True, slots=True)
class GroupDryRun:
    """Result of one dry run of all roles. Positions are relative to the home of the first role's vehicle."""

    roles: dict[str, DryRun]
    closest: tuple[ClosestApproach, ...]
    """One entry for each pair of roles that both flew."""
    findings: tuple[DryRunFinding, ...]
    """Findings about separation; `roles` has all other findings."""

    def document(self) -> dict[str, Any]:
        """As JSON values."""
        return {
            "roles": {role: run.document(MAX_SAMPLES // len(self.roles)) for role, run in self.roles.items()},
            "closest": plain(self.closest),
            "findings": plain(self.findings),
        }


class GroupPilots:
    """Starts all roles at the same time, and lets them continue together from meeting points.

    Args:
        pilots: by role; created with `alone=False`.
    """

    def __init__(self, pilots: Mapping[str, OffboardPilot]) -> None:
        self._pilots = pilots
        self._runner = GroupRunner({role: pilot.runner for role, pilot in pilots.items()})
        self._started = False
        self._ticks = 0

    def tick(self, now_s: float) -> None:
        """Called after all pilots at each tick."""
        if not self._started:
            self._begin(now_s)
            return
        self._ticks += 1
        if self._ticks % RUNNER_EVERY_TICKS == 0:
            for role, requests in self._runner.update(now_s, self._readings()).items():
                self._pilots[role].execute(now_s, requests)

    def _begin(self, now_s: float) -> None:
        if not all(pilot.may_start(now_s) for pilot in self._pilots.values()):
            return
        self._started = True
        try:
            first_requests = self._runner.start(now_s, self._readings())
        except CannotDo as error:
            for pilot in self._pilots.values():
                pilot.refuse(error)
            return
        for role, requests in first_requests.items():
            self._pilots[role].begin(now_s, requests)

    def _readings(self) -> dict[str, Any]:
        return {role: pilot.reading() for role, pilot in self._pilots.items()}


def dry_run_group(
    mission: OffboardMission,
    aircraft: Mapping[str, Aircraft],
    conditions: Conditions | None = None,
    *,
    origins: Mapping[str, LocalOrigin] | None = None,
    seed: int = 0,
    site: Site = LEVEL_SITE,
    report: ReportProgress | None = None,
) -> GroupDryRun:
    """Flies all roles of a mission once, together.

    Args:
        mission: a mission with roles.
        aircraft: by role: the vehicle and its start position.
        conditions: for all vehicles; None: no wind, nominal vehicles.
        origins: by role: the origin of the vehicle's local frame; missing: its start position.
        seed: seed of noise and gusts.
        site: ground and obstacles around the first role's home.
        report: called with the progress; an exception from it ends the dry run.

    Raises:
        PlanError: a role has no vehicle, or the mission cannot be compiled.
    """
    same_conditions = [conditions or Conditions()] * len(mission.roles)
    (runs,), _ = fly_group(
        mission, aircraft, [same_conditions], origins=origins, seed=seed, site=site, report=report
    )
    return runs


def fly_group(
    mission: OffboardMission,
    aircraft: Mapping[str, Aircraft],
    conditions: Sequence[Sequence[Conditions]],
    *,
    origins: Mapping[str, LocalOrigin] | None = None,
    seed: int = 0,
    site: Site = LEVEL_SITE,
    report: ReportProgress | None = None,
) -> tuple[list[GroupDryRun], float]:
    """Flies all roles of a mission several times at once.

    Args:
        mission: a mission with roles.
        aircraft: by role: the vehicle and its start position.
        conditions: for each flight: the conditions of each role's vehicle.
        origins: by role: the origin of the vehicle's local frame; missing: its start position.
        seed: seed of noise and gusts.
        site: ground and obstacles around the first role's home.
        report: called with the progress; an exception from it ends the dry run.

    Returns:
        The flights and the computing time [s]. Only the first flight has velocity, attitude and gimbal.

    Raises:
        PlanError: a role has no vehicle, or the mission cannot be compiled.
    """
    if not mission.roles:
        raise PlanError("roles", "the mission has no roles", "Fly it with one vehicle.")
    missing = [role for role in mission.roles if role not in aircraft]
    if missing:
        raise PlanError("vehicles", f"role {missing[0]!r} has no vehicle", "Assign a vehicle to each role.")
    origins, roles = origins or {}, list(mission.roles)
    flyable = {
        role: FlyableMission.from_mission(mission, aircraft[role], origin=origins.get(role), role=role)
        for role in roles
    }
    began_s = time.perf_counter()
    all_conditions = [each for flight in conditions for each in flight]
    fleet = Fleet([aircraft[role] for role in roles] * len(conditions), all_conditions, seed=seed, site=site)
    vehicles = iter(fleet.vehicles)
    groups = [
        {role: flyable[role].make_pilot(next(vehicles), alone=False) for role in roles} for _ in conditions
    ]
    pilots = [pilot for group in groups for pilot in group.values()]
    coordinated = [GroupPilots(group) for group in groups]

    def coordinate(now_s: float) -> None:
        for each in coordinated:
            each.tick(now_s)

    flights = fly_fleet(
        fleet, pilots, all_conditions, Recorder(fleet, pilots, detailed=len(roles)), report=report,
        after_pilots=coordinate,
        max_duration_s=max_duration_s(sum(each.expected_s for each in flyable.values())),
    )  # fmt: skip
    computing_s = time.perf_counter() - began_s
    home = aircraft[roles[0]].home
    from_home = {role: replace(aircraft[role], home=home) for role in roles}
    ended = iter(flights)
    runs = [
        _evaluate_group(
            {
                role: evaluate(next(ended), flyable[role], from_home[role], site, computing_s)
                for role in roles
            },
            mission.separation_m,
        )
        for _ in conditions
    ]
    return runs, computing_s


def _evaluate_group(runs: dict[str, DryRun], minimum_m: float) -> GroupDryRun:
    tracks = {role: run.track for role, run in runs.items() if run.track is not None}
    separation = list(_separations(tracks, minimum_m))
    return GroupDryRun(
        runs,
        tuple(each for each, _ in separation),
        tuple(finding for _, finding in separation if finding),
    )


def _separations(
    tracks: Mapping[str, Track], minimum_m: float
) -> Iterator[tuple[ClosestApproach, DryRunFinding | None]]:
    """The smallest distance of each pair of roles while both fly, with a finding if it is too small."""
    required_m = minimum_m + planned_margin_m()
    for first_role, second_role in itertools.combinations(tracks, 2):
        count = min(len(tracks[first_role].t_s), len(tracks[second_role].t_s))
        a, b = (tracks[role].position_ned_m[:count] for role in (first_role, second_role))
        distance_m = np.linalg.norm(a - b, axis=1)
        sample = int(distance_m.argmin())
        closest = ClosestApproach(
            (first_role, second_role), float(distance_m[sample]), float(tracks[first_role].t_s[sample])
        )
        separation_m = braking_separation_m(a, _velocity(a), b, _velocity(b), required_m)
        near = np.flatnonzero(separation_m < required_m)
        yield (
            closest,
            _separation_finding(tracks, (first_role, second_role), separation_m, int(near[0]), required_m)
            if len(near)
            else None,
        )


def _velocity(position_ned_m: Array) -> Array:
    if len(position_ned_m) < 2:
        return np.zeros_like(position_ned_m)
    return np.gradient(position_ned_m, SAMPLE_PERIOD_S, axis=0)


def _separation_finding(
    tracks: Mapping[str, Track], roles: tuple[str, str], separation_m: Array, sample: int, required_m: float
) -> DryRunFinding:
    first_track, second_track = (tracks[role] for role in roles)
    t_s = float(first_track.t_s[sample])
    steps = [
        track.steps[index].place if (index := int(track.step[sample])) >= 0 else "start"
        for track in (first_track, second_track)
    ]
    north, east, down = first_track.position_ned_m[sample].tolist()
    message = (
        f"After {t_s:.0f} s the vehicles of {roles[0]} ({steps[0]}) and {roles[1]} ({steps[1]}) come within "
        f"{separation_m[sample]:.1f} m of each other, including the distance to brake. In a real flight the "
        f"separation guard stops both vehicles below {required_m:.1f} m."
    )
    step = steps[0] if int(first_track.step[sample]) >= 0 else None
    return DryRunFinding("separation", message, step, round(t_s, 2), (north, east, down))


# --- many flights -----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class GroupMonteCarlo:
    """Result of the nominal flight and of all flights with varied conditions."""

    nominal: GroupDryRun
    """The flight in the mean conditions."""
    roles: dict[str, MonteCarlo]
    closest: tuple[PairDistance, ...]
    """One entry for each pair of roles that flew."""
    chances: dict[str, Chance]
    """A flight counts if the outcome happened to any of its vehicles. `separation`: the separation guard
    would act. `nearer_than_minimum`: two vehicles come nearer than the minimum separation."""

    def document(self) -> dict[str, Any]:
        """As JSON values, without `nominal`."""
        return {
            "roles": {role: plain(each, MonteCarloResult) for role, each in self.roles.items()},
            "closest": plain(self.closest),
            "chances": plain(self.chances),
        }


def monte_carlo_group(
    mission: OffboardMission,
    aircraft: Mapping[str, Aircraft],
    conditions: Conditions | None = None,
    spread: Spread | None = None,
    *,
    flights: int = 100,
    origins: Mapping[str, LocalOrigin] | None = None,
    seed: int = 0,
    site: Site = LEVEL_SITE,
    report: ReportProgress | None = None,
) -> GroupMonteCarlo:
    """Flies all roles of a mission many times.

    Args:
        mission: a mission with roles.
        aircraft: by role: the vehicle and its start position.
        conditions: mean conditions; None: no wind, nominal vehicles.
        spread: variation of the conditions; None: defaults of `Spread`. All vehicles of a flight have the
            same wind; each has its own mass, battery and sensor noise.
        flights: number of flights in addition to the nominal one.
        origins: by role: the origin of the vehicle's local frame; missing: its start position.
        seed: seed of the conditions, of noise and of gusts.
        site: ground and obstacles around the first role's home.
        report: called with the progress; an exception from it ends the run.

    Raises:
        PlanError: a role has no vehicle, the mission cannot be compiled, or there are too many flights.
    """
    count = len(mission.roles)
    max_flights = min(MAX_FLIGHTS, MAX_VEHICLES // max(1, count))
    if not 1 <= flights <= max_flights:
        reason = f"{flights} flights of {count} vehicles, but 1 to {max_flights} are allowed"
        raise PlanError("flights", reason, "Give a number between these.")
    conditions, spread = conditions or Conditions(), spread or Spread()
    drawn = [
        [spread.draw(conditions, seed, number, vehicle) for vehicle in range(count)]
        for number in range(1, flights + 1)
    ]
    runs, computing_s = fly_group(
        mission, aircraft, [[conditions] * count, *drawn], origins=origins, seed=seed, site=site,
        report=report,
    )  # fmt: skip
    varied = runs[1:]
    return GroupMonteCarlo(
        runs[0],
        {
            role: summarise([each.roles[role] for each in runs], spread, seed, computing_s)
            for role in mission.roles
        },
        _closest(varied, mission.separation_m),
        _chances(varied, mission.separation_m),
    )


def _closest(runs: Sequence[GroupDryRun], minimum_m: float) -> tuple[PairDistance, ...]:
    distances: dict[tuple[str, str], list[float]] = {}
    for each in runs:
        for pair in each.closest:
            distances.setdefault(pair.roles, []).append(pair.distance_m)
    result: list[PairDistance] = []
    for roles, values in distances.items():
        quantiles = Quantiles.from_values(values)
        assert quantiles is not None
        near_count = sum(value < minimum_m for value in values)
        result.append(PairDistance(roles, quantiles, Chance.from_counts(near_count, len(runs))))
    return tuple(result)


def _chances(runs: Sequence[GroupDryRun], minimum_m: float) -> dict[str, Chance]:
    codes = [
        {
            *(finding.code for finding in each.findings),
            *(finding.code for run in each.roles.values() for finding in run.findings),
            *(TOO_NEAR for pair in each.closest if pair.distance_m < minimum_m),
        }
        for each in runs
    ]
    return outcome_probabilities(codes, {**OUTCOMES, "separation": ("separation",), TOO_NEAR: (TOO_NEAR,)})
