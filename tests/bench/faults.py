"""Recorded faults on the simulated PX4 beside the real one's two runs: what is signalled, and how far off.

Each number may lie outside what PX4's own two runs span by 1.5 times their difference, or by its limit here,
whichever is more. A time is that of the first change of a flag, of an event or of a text.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from . import fault_recordings, fault_replay
from .fault_recordings import Course, Scenario

OWN_DIFFERENCE = 1.5
SOON_S = 0.35
"""Flags, failsafes and texts: PX4's own agree within 0.15 s (0.3 s of a stopped driver), and a GPS fix, which
decides most of them, comes every 0.125 s."""
ON_THE_GROUND_S = 6.0
"""Touch-down and what follows: PX4's own agree within 5 s, and a height that is a metre off costs another."""
_GROUND = (
    "ground_contact", "landed", "cs_in_air=0", "arming_state=1", "cs_vehicle_at_rest", "cs_valid_fake_pos",
    "landing", "Landing", "disarmed", "Disarmed", "Preflight: ", "xy_reset_counter", "failsafe=0",
    "nav_state=4", "nav_state=14", "battery_warning=0",
)  # fmt: skip
FACTOR = {
    "horizontal_error": 3.0, "true_displacement": 3.0, "true_speed": 1.5, "tilt_deg": 1.5, "eph": 1.25,
    "epv": 1.35,
}  # fmt: skip
"""A size may be this many times greater or smaller; without GPS, PX4's own errors differ threefold."""
SLACK = {
    "horizontal_error": 0.7, "height_error_down": 1.3, "true_displacement": 1.5,
    "true_height_above_ground": 1.6, "true_speed": 0.6, "yaw_error_deg": 18.0, "tilt_deg": 6.0, "eph": 0.05,
    "epv": 0.05,
}  # fmt: skip
"""What flights without any fault differ by: position and height wander with the GPS noise, the heading by 18
degrees in one of ten recorded flights."""
CHANCE = frozenset(
    {"gps_stuck_hold", "gps_stuck_offboard_vel", "baro_step_p1200pa_gps_lost", "gyro_bias_x_005"}
)
"""PX4's own runs end differently: only when the estimate says what, and how sure it is, can be compared."""
_OF_CHANCE = ("eph", "epv")


@dataclass(frozen=True, slots=True)
class Outside:
    """One number that is not where PX4's runs allow it."""

    what: str
    simulated: float
    """NaN: it never came."""
    recorded: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Comparison:
    """A fault flown, beside its recordings."""

    name: str
    times: int
    """How many moments were compared,"""
    numbers: int
    """and how many errors and accuracies."""
    late: tuple[Outside, ...]
    off: tuple[Outside, ...]


def compare(scenario: Scenario, flown: Course) -> Comparison:
    """The flown fault beside PX4's runs."""
    first, second = scenario.runs
    by_chance = scenario.name in CHANCE
    moments = sorted(set(first.first_s) & set(second.first_s))
    if by_chance:
        moments = [key for key in moments if max(first.first_s[key], second.first_s[key]) < 8.0]
    late: list[Outside] = []
    for key in moments:
        pair = first.first_s[key], second.first_s[key]
        limit_s = ON_THE_GROUND_S if any(word in key for word in _GROUND) else SOON_S
        found_s = flown.first_s.get(key, math.nan)
        if not _near(found_s, pair, limit_s, 1.0):
            late.append(Outside(key, found_s, pair))
    off: list[Outside] = []
    numbers = 0
    for t_s in sorted(set(first.at) & set(second.at) & set(flown.at)):
        for key, slack in SLACK.items():
            if by_chance and key not in _OF_CHANCE:
                continue
            numbers += 1
            pair = first.at[t_s][key], second.at[t_s][key]
            if not _near(flown.at[t_s][key], pair, slack, FACTOR.get(key, 1.0)):
                off.append(Outside(f"{key} at {t_s:g} s", flown.at[t_s][key], pair))
    return Comparison(scenario.name, len(moments), numbers, tuple(late), tuple(off))


def _near(value: float, pair: tuple[float, float], limit: float, factor: float) -> bool:
    low, high = min(pair), max(pair)
    slack = max(limit, OWN_DIFFERENCE * (high - low))
    if factor > 1.0:
        low, high = low / factor, high * factor
    return low - slack <= value <= high + slack


def measure(names: list[str] | None = None, *, seed: int = 0) -> list[Comparison]:
    """Fly faults (default: all recorded) and compare each."""
    scenarios = [fault_recordings.load(name) for name in names or fault_recordings.names()]
    flown = fault_replay.fly(scenarios, seed=seed)
    return [compare(scenario, flown[scenario.name]) for scenario in scenarios]


def rows(comparisons: list[Comparison]) -> Iterator[str]:
    """The table: a line a fault, what is outside named."""
    yield "| fault | moments | outside | errors and accuracies | outside | the first outside |"
    yield "|---|---|---|---|---|---|"
    for each in comparisons:
        worst = next(iter((*each.late, *each.off)), None)
        told = ""
        if worst is not None:
            first, second = worst.recorded
            told = f"{worst.what}: {worst.simulated:.2f}, PX4 {first:.2f} and {second:.2f}"
        yield f"| {each.name} | {each.times} | {len(each.late)} | {each.numbers} | {len(each.off)} | {told} |"
    times, late = sum(each.times for each in comparisons), sum(len(each.late) for each in comparisons)
    numbers, off = sum(each.numbers for each in comparisons), sum(len(each.off) for each in comparisons)
    yield f"| all {len(comparisons)} | {times} | {late} | {numbers} | {off} | |"


def table() -> Iterator[str]:
    """The table of all recorded faults; nothing without the recordings."""
    if not fault_recordings.FAULTS.is_dir():
        yield "not measured: the recordings are not beside this repository"
        return
    yield from rows(measure())
