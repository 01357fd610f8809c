"""Recorded faults on the simulated PX4 beside the real one's two runs: what is signalled, and how far off.

Each fault is flown twice, with other noise. A number may lie outside what PX4's own two runs span by 1.5
times their difference, or by its limit here, whichever is more. A moment is a change of a flag or mode, a
reset, an event or a text: what both of PX4's runs have must come, in time; what neither has must not come.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from . import fault_recordings, fault_replay
from .fault_recordings import Course, Scenario

OWN_DIFFERENCE = 1.5
SOON_S = 0.35
"""Flags, failsafes and texts: PX4's own agree within 0.15 s (0.3 s of a stopped driver), and a GPS fix, which
decides most of them, comes every 0.125 s."""
ON_THE_GROUND_S = 15.0
"""Touch-down without GPS and all that follows it. The recorded losses came at the same second after PX4's
boot, with the same sequence of noise, and agree within 9 s; but the recorded vertical speeds were wrong by
-0.2 to 0.7 m/s, and a descent at 0.7 m/s less that takes anything from 11 s on."""
SINKS_OTHERWISE_M_S = 0.4
"""So much may a descent without GPS differ, for that reason."""
TOUCH = ("ground_contact=1", "cs_in_air=0")
BY_CHANCE = ("ground_contact", "battery_warning=1 (2)", "battery_warning=2 (2)")
"""Ground contact comes and goes in six of 26 recorded landings; a battery that is full again after disarming
passes its levels within 0.2 s, which PX4 looks at every 0.1 s: there or not, it is no difference."""
FACTOR = {
    "horizontal_error": 3.0, "true_displacement": 3.0, "true_speed": 1.5, "tilt_deg": 1.5, "eph": 1.25,
    "epv": 1.35,
}  # fmt: skip
"""A size may be this many times greater or smaller; without GPS, PX4's own errors differ threefold."""
SLACK = {
    "horizontal_error": 0.7, "height_error_down": 1.6, "true_displacement": 1.5,
    "true_height_above_ground": 2.0, "true_speed": 0.6, "yaw_error_deg": 18.0, "tilt_deg": 6.0, "eph": 0.05,
    "epv": 0.05,
}  # fmt: skip
"""What flights without any fault differ by: position and height wander with the GPS noise (the height by
1 m to either side, always the same way at the same time after PX4's boot), the heading by 18 degrees in one
of ten recorded flights."""
ALIKE_FOR_S = {
    "gps_stuck_hold": 8.0, "gps_stuck_offboard_vel": 8.0, "baro_step_p1200pa_gps_lost": 5.0,
    "gyro_bias_x_005": 8.0, "gps_lost_20s_hold": 15.0,
}  # fmt: skip
"""So long PX4's own runs are alike; then it is chance whether a loop runs away north or south, whether the
barometer is believed, or whether the fix comes back before the ground does."""
DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "simulator.md"
HEADER = "| fault | moments | outside | errors and accuracies | outside | the first outside | why |"
"""Of the table there that gives each fault outside its limits a reason."""
SIDE_BY_SIDE = 24
"""So many faults fly together."""


@dataclass(frozen=True, slots=True)
class Outside:
    """One number that is not where PX4's runs allow it."""

    what: str
    simulated: float
    """NaN: it never came."""
    recorded: tuple[float, float]
    """NaN: in none of PX4's runs."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """A flight after a fault, beside its recordings."""

    name: str
    moments: int
    """How many moments were compared,"""
    numbers: int
    """and how many errors and accuracies."""
    late: tuple[Outside, ...]
    off: tuple[Outside, ...]


def compare(scenario: Scenario, flown: Course) -> Comparison:
    """The flown fault beside PX4's runs."""
    until_s = ALIKE_FOR_S.get(scenario.name, scenario.ends_s)
    late, moments = _moments(scenario, flown, until_s)
    first, second = scenario.runs
    until_s = min(until_s, *(_touched_s(course) for course in (first, second, flown)))
    blind_s = max(course.moments_s.get("xy_valid=0", math.inf) for course in scenario.runs)
    off: list[Outside] = []
    numbers = 0
    for t_s in sorted(at for at in set(first.at) & set(second.at) & set(flown.at) if at < until_s):
        for key, limit in SLACK.items():
            numbers += 1
            sinks = SINKS_OTHERWISE_M_S if key == "true_height_above_ground" else 0.0
            slack = limit + sinks * max(0.0, t_s - blind_s)
            pair = first.at[t_s][key], second.at[t_s][key]
            if not _near(flown.at[t_s][key], pair, slack, FACTOR.get(key, 1.0)):
                off.append(Outside(f"{key} at {t_s:g} s", flown.at[t_s][key], pair))
    return Comparison(scenario.name, moments, numbers, tuple(late), tuple(off))


def _moments(scenario: Scenario, flown: Course, until_s: float) -> tuple[list[Outside], int]:
    """What came at another time than in both of PX4's runs, or in none of them; how much was compared."""
    first, second = (run.moments_s for run in scenario.runs)
    touched_s = min(map(_touched_s, scenario.runs))
    late: list[Outside] = []
    common = [key for key in sorted(set(first) & set(second)) if max(first[key], second[key]) < until_s]
    for key in common:
        pair = first[key], second[key]
        limit_s = SOON_S if max(pair) < touched_s - SOON_S else ON_THE_GROUND_S
        found_s = flown.moments_s.get(key, math.nan)
        if not _near(found_s, pair, limit_s, 1.0):
            late.append(Outside(key, found_s, pair))
    for key in sorted(set(flown.moments_s) - set(first) - set(second)):
        if flown.moments_s[key] < until_s and not key.startswith(BY_CHANCE):
            late.append(Outside(key, flown.moments_s[key], (math.nan, math.nan)))
    return late, len(common)


def _touched_s(course: Course) -> float:
    """When it came down; infinite: it did not."""
    return min((course.moments_s[key] for key in TOUCH if key in course.moments_s), default=math.inf)


def _near(value: float, pair: tuple[float, float], limit: float, factor: float) -> bool:
    low, high = min(pair), max(pair)
    slack = max(limit, OWN_DIFFERENCE * (high - low))
    if factor > 1.0:
        low, high = low / factor, high * factor
    return low - slack <= value <= high + slack


def measure(names: list[str] | None = None, *, seed: int = 0, times: int = 2) -> list[Comparison]:
    """Fly faults (default: all recorded) so many times each and compare every flight."""
    return compare_all(
        [fault_recordings.load(name) for name in names or fault_recordings.names()], seed, times
    )


def compare_all(scenarios: list[Scenario], seed: int = 0, times: int = 1) -> list[Comparison]:
    """Fly these so many times each and compare every flight."""
    scenarios.sort(key=lambda scenario: scenario.ends_s)
    found: list[Comparison] = []
    for at in range(0, len(scenarios), SIDE_BY_SIDE):
        side_by_side = [each for each in scenarios[at : at + SIDE_BY_SIDE] for _ in range(times)]
        flown = fault_replay.fly(side_by_side, seed=seed)
        found += map(compare, side_by_side, flown)
    return sorted(found, key=lambda each: each.name)


def reasons(document: str) -> dict[str, str]:
    """Why a fault is outside its limits, by its name, as the documentation's table says.

    Raises:
        ValueError: a row without a reason, or two for one fault.
    """
    found: dict[str, str] = {}
    lines = itertools.takewhile(
        lambda line: line.startswith("|"), document.split(HEADER, 1)[1].splitlines()[2:]
    )
    for line in lines:
        name, *_, why = (cell.strip() for cell in line.strip()[1:-1].split("|"))
        if name in found or not why:
            raise ValueError(f"docs/simulator.md: give {name} one row, with a reason in its last column")
        found[name] = why
    return found


def rows(comparisons: list[Comparison], why: dict[str, str]) -> Iterator[str]:
    """The table: a line for each fault that is outside its limits, and what is wrong with its reasons.

    Args:
        comparisons: of all flights, sorted by name.
        why: `reasons` of the documentation.
    """
    yield HEADER
    yield "|---" * 7 + "|"
    flights = {
        name: list(group) for name, group in itertools.groupby(comparisons, key=lambda each: each.name)
    }
    outside: set[str] = set()
    for name, group in flights.items():
        first = next((each for flight in group for each in (*flight.late, *flight.off)), None)
        if first is None:
            continue
        outside.add(name)
        late, off = (
            " and ".join(str(len(each)) for each in kind)
            for kind in ([flight.late for flight in group], [flight.off for flight in group])
        )
        reason = why.get(name, "NO REASON: give it a row in docs/simulator.md")
        compared = group[0].moments, late, group[0].numbers, off
        yield f"| {name} | {' | '.join(map(str, compared))} | {_words(first)} | {reason} |"
    moments, late = sum(each.moments for each in comparisons), sum(len(each.late) for each in comparisons)
    numbers, off = sum(each.numbers for each in comparisons), sum(len(each.off) for each in comparisons)
    yield ""
    yield f"{len(flights)} faults, {len(comparisons)} flights: of {moments} moments {late} are outside,"
    yield f"of {numbers} errors and accuracies {off}."
    for name in sorted(set(why) & set(flights) - outside):
        yield f"STALE: {name} is within its limits; take its row out of docs/simulator.md."


def _words(outside: Outside) -> str:
    first, second = outside.recorded
    if math.isnan(first):
        return f"{outside.what}: {outside.simulated:.2f}, PX4 never"
    simulated = "never" if math.isnan(outside.simulated) else f"{outside.simulated:.2f}"
    return f"{outside.what}: {simulated}, PX4 {first:.2f} and {second:.2f}"


def table() -> Iterator[str]:
    """The table of all recorded faults; nothing without the recordings."""
    if not fault_recordings.FAULTS.is_dir():
        yield "not measured: the recordings are not beside this repository"
        return
    yield from rows(measure(), reasons(DOCUMENT.read_text(encoding="utf-8")))
