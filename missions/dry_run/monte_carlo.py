"""Many dry runs of one plan at once, with varied wind, mass, battery and noise."""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from missions.dry_run.corridor import corridor
from missions.dry_run.document import FlightSummary, MonteCarloResult
from missions.dry_run.flight import ReportProgress, fly
from missions.dry_run.plans import Flyable
from missions.dry_run.result import DryRun, evaluate
from missions.dry_run.setup import LEVEL_SITE, Aircraft, Conditions, Site
from missions.dry_run.spread import MAX_FLIGHTS, Chance, Quantiles, Spread
from missions.errors import PlanError

OUTCOMES = {
    "not_finished": ("start_refused", "failsafe", "mission_left", "not_finished", "obstacle_hit"),
    "fence_touched": ("fence_touched",),
    "obstacle_hit": ("obstacle_hit", "ground_touched"),
    "obstacle_near": ("obstacle_near", "obstacle_hit", "ground_touched"),
    "failsafe": ("failsafe",),
    "battery_reserve": ("battery_reserve", "battery_empty"),
}
"""Outcomes to count, each with the codes of the findings that count as this outcome."""


@dataclass(frozen=True, slots=True)
class MonteCarlo(MonteCarloResult):
    """Result of the nominal flight and of all flights with varied conditions."""

    nominal: DryRun
    """The flight in the mean conditions."""


def monte_carlo(
    flyable: Flyable,
    aircraft: Aircraft,
    conditions: Conditions | None = None,
    spread: Spread | None = None,
    *,
    flights: int = 100,
    seed: int = 0,
    site: Site = LEVEL_SITE,
    report: ReportProgress | None = None,
) -> MonteCarlo:
    """Flies a plan many times.

    Args:
        flyable: the plan.
        aircraft: the vehicle and its start position.
        conditions: mean conditions; None: no wind, nominal vehicle.
        spread: variation of the conditions; None: defaults of `Spread`.
        flights: number of flights in addition to the nominal one.
        seed: seed of the conditions, of noise and of gusts.
        site: ground and obstacles around the start.
        report: called with the progress; an exception from it ends the run.

    Raises:
        PlanError: PX4 refuses the plan, or there are too many flights.
    """
    if not 1 <= flights <= MAX_FLIGHTS:
        reason = f"{flights} flights, but 1 to {MAX_FLIGHTS} are allowed"
        raise PlanError("flights", reason, "Give a number between these.")
    conditions, spread = conditions or Conditions(), spread or Spread()
    drawn = [spread.draw(conditions, seed, number) for number in range(1, flights + 1)]
    began_s = time.perf_counter()
    flown = fly(
        aircraft, [conditions, *drawn], flyable.make_pilot, max_duration_s=flyable.max_duration_s, seed=seed,
        site=site, report=report,
    )  # fmt: skip
    computing_s = time.perf_counter() - began_s
    return summarise(
        [evaluate(each, flyable, aircraft, site, computing_s) for each in flown],
        spread,
        seed,
        computing_s,
    )


def summarise(evaluated: Sequence[DryRun], spread: Spread, seed: int, computing_s: float) -> MonteCarlo:
    """Summarises the flights of one plan; the first one is the nominal flight."""
    nominal, varied = evaluated[0], evaluated[1:]
    summaries = tuple(_summary_of(each) for each in varied)
    tracks = [each.track for each in varied if each.track is not None]
    longest_flight_s = max(each.duration_s for each in evaluated)
    return MonteCarlo(
        spread, seed, summaries,
        None if nominal.track is None else corridor(nominal.track, tracks),
        Quantiles.from_values([each.duration_s for each in summaries if each.finished]),
        Quantiles.from_values(_without_none(each.battery_end_share for each in summaries)),
        Quantiles.from_values(_without_none(each.fence_distance_m for each in summaries)),
        Quantiles.from_values(_without_none(each.obstacle_distance_m for each in summaries)),
        outcome_probabilities([each.findings for each in summaries], OUTCOMES),
        longest_flight_s / max(computing_s, 1e-9), nominal,
    )  # fmt: skip


def outcome_probabilities(
    flights: Sequence[Collection[str]], outcomes: Mapping[str, tuple[str, ...]]
) -> dict[str, Chance]:
    """How often each outcome happened.

    Args:
        flights: the codes of the findings of each flight.
        outcomes: the codes that count as each outcome.
    """
    return {
        name: Chance.from_counts(
            sum(any(code in codes for code in flight) for flight in flights), len(flights)
        )
        for name, codes in outcomes.items()
    }


def _without_none(values: Any) -> list[float]:
    return [each for each in values if each is not None]


def _summary_of(run: DryRun) -> FlightSummary:
    codes = tuple(dict.fromkeys(finding.code for finding in run.findings))
    return FlightSummary(
        **asdict(run.conditions), finished=run.finished, duration_s=run.duration_s,
        battery_end_share=run.battery_end_share, fence_distance_m=run.fence_distance_m,
        obstacle_distance_m=run.obstacle_distance_m, findings=codes,
    )  # fmt: skip
