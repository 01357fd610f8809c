"""Recorded faults on the simulated PX4, compared with two runs of a real PX4: reports and errors.

Each fault is flown twice, with different noise. A number may lie outside the range of PX4's two runs by 1.5
times their difference, or by its limit in this file, whichever is larger. A moment is a change of a flag or
mode, a reset, an event or a text: a moment that is in both PX4 runs must occur in time, and a moment that
is in neither must not occur.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from . import fault_recordings, fault_replay
from .fault_recordings import FaultFlight, Scenario

RUN_DIFFERENCES = 1.5
"""A number may lie this many differences of PX4's two runs outside their range."""
MOMENT_LIMIT_S = 0.35
"""Limit for flags, failsafes and texts. PX4's two runs agree within 0.15 s (0.3 s after a driver stopped).
Most of these moments depend on a GPS fix, which comes every 0.125 s."""
TOUCHDOWN_LIMIT_S = 15.0
"""Limit for the touch-down without GPS and everything after it. In the recordings GPS was lost at the same
time after boot, with the same sequence of noise, so they agree within 9 s. But their vertical speeds were
wrong by -0.2 to 0.7 m/s, so a descent at 0.7 m/s minus that error takes 11 s or more."""
DESCENT_DIFFERENCE_M_S = 0.4
"""Allowed difference of a descent without GPS, for the same reason."""
TOUCHDOWN_FLAGS = ("ground_contact=1", "cs_in_air=0")
RANDOM_MOMENTS = ("ground_contact", "battery_warning=1 (2)", "battery_warning=2 (2)")
"""Moments that may occur or not. Ground contact changes repeatedly in six of 26 recorded landings. A battery
that is full again after disarming passes its warning levels within 0.2 s, and PX4 checks them every 0.1 s."""
ALLOWED_FACTORS = {
    "horizontal_error": 3.0, "true_displacement": 3.0, "true_speed": 1.5, "tilt_deg": 1.5, "eph": 1.25,
    "epv": 1.35,
}  # fmt: skip
"""A value may be larger or smaller by this factor; without GPS, PX4's two runs differ by up to 3."""
ALLOWED_DIFFERENCES = {
    "horizontal_error": 0.7, "height_error_down": 1.6, "true_displacement": 1.5,
    "true_height_above_ground": 2.0, "true_speed": 0.6, "yaw_error_deg": 18.0, "tilt_deg": 6.0, "eph": 0.05,
    "epv": 0.05,
}  # fmt: skip
"""Allowed differences, as between flights without a fault: position and height drift with the GPS noise (the
height by ±1 m, always by the same value at the same time after PX4's boot), the heading by 18 degrees in one
of ten flights."""
SIMILAR_FOR_S = {
    "gps_stuck_hold": 8.0, "gps_stuck_offboard_vel": 8.0, "baro_step_p1200pa_gps_lost": 5.0,
    "gyro_bias_x_005": 8.0, "gps_lost_20s_hold": 15.0,
}  # fmt: skip
"""Time during which PX4's two runs are similar. Afterwards it is random whether a control loop diverges to
the north or south, whether the barometer is used, or whether the fix returns before the touch-down."""
DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "simulator.md"
HEADER = "| fault | moments | outside | errors and accuracies | outside | the first outside | why |"
"""Header of the table in that document with a reason for each fault outside its limits."""
FLIGHTS_PER_SIMULATION = 24
"""Number of flights in one simulation."""


@dataclass(frozen=True, slots=True)
class OutOfLimits:
    """A number outside its limits."""

    what: str
    simulated: float
    """NaN: it did not occur."""
    recorded: tuple[float, float]
    """NaN: it occurred in neither PX4 run."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """A simulated flight with a fault, compared with its recordings."""

    name: str
    moment_count: int
    """Number of compared moments."""
    number_count: int
    """Number of compared errors and accuracies."""
    moments_outside: tuple[OutOfLimits, ...]
    """Moments outside their limits."""
    errors_outside: tuple[OutOfLimits, ...]
    """Errors and accuracies outside their limits."""


def compare(scenario: Scenario, flown: FaultFlight) -> Comparison:
    """Compares the simulated flight with PX4's runs."""
    until_s = SIMILAR_FOR_S.get(scenario.name, scenario.ends_s)
    moments_outside, moments = _compare_moments(scenario, flown, until_s)
    first, second = scenario.runs
    until_s = min(until_s, *(_touchdown_s(run) for run in (first, second, flown)))
    position_lost_s = max(run.moments_s.get("xy_valid=0", math.inf) for run in scenario.runs)
    errors_outside: list[OutOfLimits] = []
    numbers = 0
    for t_s in sorted(
        t_s for t_s in set(first.errors_at) & set(second.errors_at) & set(flown.errors_at) if t_s < until_s
    ):
        for key, limit in ALLOWED_DIFFERENCES.items():
            numbers += 1
            descent = DESCENT_DIFFERENCE_M_S if key == "true_height_above_ground" else 0.0
            slack = limit + descent * max(0.0, t_s - position_lost_s)
            recorded = first.errors_at[t_s][key], second.errors_at[t_s][key]
            if not _is_within(flown.errors_at[t_s][key], recorded, slack, ALLOWED_FACTORS.get(key, 1.0)):
                errors_outside.append(OutOfLimits(f"{key} at {t_s:g} s", flown.errors_at[t_s][key], recorded))
    return Comparison(scenario.name, moments, numbers, tuple(moments_outside), tuple(errors_outside))


def _compare_moments(scenario: Scenario, flown: FaultFlight, until_s: float) -> tuple[list[OutOfLimits], int]:
    """Moments that are outside the times of PX4's runs or in neither run; and the number of compared
    moments."""
    first, second = (run.moments_s for run in scenario.runs)
    touchdown_s = min(map(_touchdown_s, scenario.runs))
    outside: list[OutOfLimits] = []
    common = [key for key in sorted(set(first) & set(second)) if max(first[key], second[key]) < until_s]
    for key in common:
        recorded_s = first[key], second[key]
        limit_s = MOMENT_LIMIT_S if max(recorded_s) < touchdown_s - MOMENT_LIMIT_S else TOUCHDOWN_LIMIT_S
        simulated_s = flown.moments_s.get(key, math.nan)
        if not _is_within(simulated_s, recorded_s, limit_s, 1.0):
            outside.append(OutOfLimits(key, simulated_s, recorded_s))
    for key in sorted(set(flown.moments_s) - set(first) - set(second)):
        if flown.moments_s[key] < until_s and not key.startswith(RANDOM_MOMENTS):
            outside.append(OutOfLimits(key, flown.moments_s[key], (math.nan, math.nan)))
    return outside, len(common)


def _touchdown_s(run: FaultFlight) -> float:
    """Time of the touch-down; infinite without a touch-down."""
    return min((run.moments_s[key] for key in TOUCHDOWN_FLAGS if key in run.moments_s), default=math.inf)


def _is_within(value: float, recorded: tuple[float, float], limit: float, factor: float) -> bool:
    low, high = min(recorded), max(recorded)
    slack = max(limit, RUN_DIFFERENCES * (high - low))
    if factor > 1.0:
        low, high = low / factor, high * factor
    return low - slack <= value <= high + slack


def measure(names: list[str] | None = None, *, seed: int = 0, flights: int = 2) -> list[Comparison]:
    """Flies each fault (default: all recorded ones) `flights` times and compares every flight."""
    return compare_all(
        [fault_recordings.load(name) for name in names or fault_recordings.names()], seed, flights
    )


def compare_all(scenarios: list[Scenario], seed: int = 0, flights: int = 1) -> list[Comparison]:
    """Flies each scenario `flights` times and compares every flight."""
    scenarios.sort(key=lambda scenario: scenario.ends_s)
    comparisons: list[Comparison] = []
    for start in range(0, len(scenarios), FLIGHTS_PER_SIMULATION):
        scenarios_together = [
            each for each in scenarios[start : start + FLIGHTS_PER_SIMULATION] for _ in range(flights)
        ]
        flown = fault_replay.fly(scenarios_together, seed=seed)
        comparisons += map(compare, scenarios_together, flown)
    return sorted(comparisons, key=lambda each: each.name)


def reasons(document: str) -> dict[str, str]:
    """The reasons in the documentation's table why faults are outside their limits, by the fault's name.

    Raises:
        ValueError: a row without a reason, or two for one fault.
    """
    reason_by_fault: dict[str, str] = {}
    lines = itertools.takewhile(
        lambda line: line.startswith("|"), document.split(HEADER, 1)[1].splitlines()[2:]
    )
    for line in lines:
        name, *_, why = (cell.strip() for cell in line.strip()[1:-1].split("|"))
        if name in reason_by_fault or not why:
            raise ValueError(f"docs/simulator.md: give {name} one row, with a reason in its last column")
        reason_by_fault[name] = why
    return reason_by_fault


def rows(flights: list[Comparison], reason_by_fault: dict[str, str]) -> Iterator[str]:
    """The table: a row for each fault outside its limits, then missing and outdated reasons.

    Args:
        flights: comparisons of all flights, sorted by name.
        reason_by_fault: `reasons` of the documentation.
    """
    yield HEADER
    yield "|---" * 7 + "|"
    flights_by_fault = {
        name: list(group) for name, group in itertools.groupby(flights, key=lambda each: each.name)
    }
    outside: set[str] = set()
    for name, group in flights_by_fault.items():
        first_outside = next(
            (each for flight in group for each in (*flight.moments_outside, *flight.errors_outside)), None
        )
        if first_outside is None:
            continue
        outside.add(name)
        moments_outside, errors_outside = (
            " and ".join(str(len(each)) for each in outside_by_flight)
            for outside_by_flight in (
                [flight.moments_outside for flight in group],
                [flight.errors_outside for flight in group],
            )
        )
        reason = reason_by_fault.get(name, "NO REASON: give it a row in docs/simulator.md")
        compared = group[0].moment_count, moments_outside, group[0].number_count, errors_outside
        yield f"| {name} | {' | '.join(map(str, compared))} | {_outside_text(first_outside)} | {reason} |"
    moments, moments_outside = (
        sum(each.moment_count for each in flights),
        sum(len(each.moments_outside) for each in flights),
    )
    numbers, errors_outside = (
        sum(each.number_count for each in flights),
        sum(len(each.errors_outside) for each in flights),
    )
    yield ""
    faults = len(flights_by_fault)
    yield f"{faults} faults, {len(flights)} flights: of {moments} moments {moments_outside} are outside,"
    yield f"of {numbers} errors and accuracies {errors_outside}."
    for name in sorted(set(reason_by_fault) & set(flights_by_fault) - outside):
        yield f"STALE: {name} is within its limits; remove its row from docs/simulator.md."


def _outside_text(outside: OutOfLimits) -> str:
    first, second = outside.recorded
    if math.isnan(first):
        return f"{outside.what}: {outside.simulated:.2f}, PX4 never"
    simulated = "never" if math.isnan(outside.simulated) else f"{outside.simulated:.2f}"
    return f"{outside.what}: {simulated}, PX4 {first:.2f} and {second:.2f}"


def table() -> Iterator[str]:
    """The table of all recorded faults, or one line if there are no recordings."""
    if not fault_recordings.FAULTS.is_dir():
        yield "not measured: the recordings are not beside this repository"
        return
    yield from rows(measure(), reasons(DOCUMENT.read_text(encoding="utf-8")))
