"""Every reference flight: the simulated PX4 compared with the real one, and the influence of noise."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

from vehicle_sim.airframe import Airframe
from vehicle_sim.parameters import Parameters
from vehicle_sim.px4_version import V1_16

from . import flight_recordings, flight_replay, flight_spread, recorded_motion
from .flight_comparison import VELOCITY, Comparison, compare
from .flight_spread import sim_and_real

NOISY_FLIGHTS = 8


def measure(selected: list[str] | None = None) -> list[Comparison]:
    """Flies and compares these flights (default: all)."""
    recordings = [flight_recordings.load(name) for name in selected or flight_recordings.names()]
    flown = flight_replay.fly(recordings)
    return [compare(recording, flown[recording.name]) for recording in recordings]


def _size(c: Comparison) -> str:
    return "–" if math.isnan(c.size) else f"{c.size:.1f} {c.quantity.unit}"


def rows(comparisons: list[Comparison]) -> Iterator[str]:
    """The table in Markdown; values are simulated / PX4's."""
    headings = ("flight", "size", "error RMS", "limit", "outside", "first motion s", "rise s", "overshoot",
                "settling s", "path RMS m")  # fmt: skip
    yield f"| {' | '.join(headings)} |"
    yield "|---" * len(headings) + "|"
    for c in comparisons:
        outside = ", ".join(
            name for name, ok in (("error", c.within_limit), ("rise", c.rise_agrees)) if not ok
        )
        sim, real = c.sim, c.real
        cells = (
            c.name, _size(c), f"{c.error:.2f}", f"{c.limit:.2f}", outside,
            sim_and_real(sim.first_motion_s, real.first_motion_s), sim_and_real(sim.rise_s, real.rise_s),
            sim_and_real(sim.overshoot, real.overshoot), sim_and_real(sim.settling_s, real.settling_s, 1),
            f"{c.path_error_m:.2f}",
        )  # fmt: skip
        yield f"| {' | '.join(cells)} |"
    flights_outside = [c for c in comparisons if not (c.within_limit and c.rise_agrees)]
    within = len(comparisons) - len(flights_outside)
    yield ""
    yield f"{within} of {len(comparisons)} within their limits (error and rise time); sensors without noise."


def noise_rows(flights_outside: list[Comparison]) -> Iterator[str]:
    """For flights outside their limits: results with sensor noise, and velocities from the motor signals."""
    repeats = flight_spread.measure([c.name for c in flights_outside], NOISY_FLIGHTS)
    for c in flights_outside:
        spread, unit = repeats[c.name], c.quantity.unit
        if not c.comparable:
            low, high = min(spread.errors), max(spread.errors)
            yield (
                f"{c.name}: its repeat on PX4 is not comparable (spread.json); {NOISY_FLIGHTS} simulated "
                f"flights with sensor noise lie {low:.2f} to {high:.2f} {unit} from each other."
            )
        if not c.rise_agrees:
            low, high = min(spread.rises_s), max(spread.rises_s)
            yield (
                f"{c.name}: with sensor noise it rises in {low:.2f} to {high:.2f} s, "
                f"PX4 in {c.real.rise_s:.2f} s."
            )
            if c.quantity is VELOCITY:
                sim_s, real_s = motion_rises(c.name)
                yield (
                    f"{c.name}: by its motors and attitude, without GPS, the simulated vehicle rises in "
                    f"{sim_s:.2f} s, "
                    f"the real PX4's in {real_s:.2f} s (limit ±{c.rise_limit_s:.2f})."
                )


def motion_rises(name: str) -> tuple[float, float]:
    """Rise times [s] of the motion itself (`recorded_motion`): simulated, real."""
    recording = flight_recordings.load(name)
    replay = flight_replay.fly([recording])[name]
    airframe = Airframe.from_parameters(Parameters(px4=V1_16))
    comparison = compare(
        dataclasses.replace(recording, columns=recorded_motion.with_motor_velocity(airframe, recording)),
        dataclasses.replace(replay, columns=recorded_motion.with_motor_velocity(airframe, replay)),
    )
    return comparison.sim.rise_s, comparison.real.rise_s


def table() -> Iterator[str]:
    """Rows of Markdown."""
    if not flight_recordings.FLIGHTS.is_dir():
        yield "The recordings (../shared/px4/flights) are not beside this checkout."
        return
    comparisons = measure()
    yield from rows(comparisons)
    flights_outside = [c for c in comparisons if not (c.within_limit and c.rise_agrees)]
    if flights_outside:
        yield ""
        yield from noise_rows(flights_outside)
