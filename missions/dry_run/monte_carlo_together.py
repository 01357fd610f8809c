"""Many dry runs of a mission for several vehicles: the corridor of each role, and the distances between the
vehicles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from missions.dry_run.document import MonteCarloResult, PairDistance, plain
from missions.dry_run.flight import ReportProgress
from missions.dry_run.monte_carlo import OUTCOMES, MonteCarlo, outcome_probabilities, summarise
from missions.dry_run.setup import LEVEL_SITE, Aircraft, Conditions, Site
from missions.dry_run.spread import MAX_FLIGHTS, MAX_VEHICLES, Chance, Quantiles, Spread
from missions.dry_run.together import DryRunTogether, fly_together
from missions.errors import PlanError
from missions.geodesy import LocalOrigin
from missions.offboard.document import OffboardMission

TOO_NEAR = "nearer_than_minimum"


@dataclass(frozen=True, slots=True)
class MonteCarloTogether:
    """Result of the nominal flight and of all flights with varied conditions."""

    nominal: DryRunTogether
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


def monte_carlo_together(
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
) -> MonteCarloTogether:
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
    runs_together, computing_s = fly_together(
        mission, aircraft, [[conditions] * count, *drawn], origins=origins, seed=seed, site=site,
        report=report,
    )  # fmt: skip
    varied = runs_together[1:]
    return MonteCarloTogether(
        runs_together[0],
        {
            role: summarise([each.roles[role] for each in runs_together], spread, seed, computing_s)
            for role in mission.roles
        },
        _closest(varied, mission.separation_m),
        _chances(varied, mission.separation_m),
    )


def _closest(runs_together: Sequence[DryRunTogether], minimum_m: float) -> tuple[PairDistance, ...]:
    distances: dict[tuple[str, str], list[float]] = {}
    for each in runs_together:
        for pair in each.closest:
            distances.setdefault(pair.roles, []).append(pair.distance_m)
    result: list[PairDistance] = []
    for roles, values in distances.items():
        quantiles = Quantiles.from_values(values)
        assert quantiles is not None
        near_count = sum(value < minimum_m for value in values)
        result.append(PairDistance(roles, quantiles, Chance.from_counts(near_count, len(runs_together))))
    return tuple(result)


def _chances(runs_together: Sequence[DryRunTogether], minimum_m: float) -> dict[str, Chance]:
    codes = [
        {
            *(finding.code for finding in each.findings),
            *(finding.code for run in each.roles.values() for finding in run.findings),
            *(TOO_NEAR for pair in each.closest if pair.distance_m < minimum_m),
        }
        for each in runs_together
    ]
    return outcome_probabilities(codes, {**OUTCOMES, "separation": ("separation",), TOO_NEAR: (TOO_NEAR,)})
