"""The speed profile of a path: its speed at each path parameter, within all limits, from stop to stop.

The path is divided into zones. Each zone has one maximum speed, one acceleration and one jerk. With these
values the vehicle stays within its limits anywhere in the zone; the acceleration is zero at both ends of a
zone. The speed between two zones is limited by braking (computed in one backward pass) and by acceleration
(one forward pass). On a straight leg between two stops this is the jerk-limited optimum. Several variants
(`VARIANTS`) are computed with different zones, accelerations and jerks. The fastest variant between two stops
is used.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from missions.trajectory import ramps
from missions.trajectory.limits import MotionLimits
from missions.trajectory.pieces import Bounds, Pieces

Array = NDArray[np.float64]
VARIANTS = (
    (1.0, 1.0, 2.0), (0.9, 0.4, 2.0), (0.9, 0.8, 0.9), (0.8, 0.3, 0.95), (0.7, 0.3, 0.9), (0.8, 0.6, 0.75),
    (0.6, 0.4, 0.5), (0.4, 0.3, 0.0),
)  # fmt: skip
"""Fractions of acceleration and jerk reserved for bends, and smallest ratio of the maximum speeds in one zone
(2: one zone for each piece, 0: one zone from stop to stop)."""
SLOW_BEND_FACTOR = 1.05
"""A stop replaces a bend that takes longer than the stop by this factor."""
COUPLING = 0.5
"""Fraction of the remaining jerk that may change the speed within a bend."""
COARSE_BISECTIONS, FINE_BISECTIONS = 10, 48
"""Number of bisections for the peak speed of a zone: to compare variants, and for the chosen variant."""


@dataclass(frozen=True, slots=True, eq=False)
class TimeLaw:
    """The path parameter as a function of time, in phases of constant jerk; all (K,)."""

    start_s: Array
    parameter: Array
    speed: Array
    acceleration: Array
    jerk: Array
    duration_s: float


@dataclass(frozen=True, slots=True, eq=False)
class _Zones:
    """Zones of successive pieces; all (Z,)."""

    first: NDArray[np.int64]
    """Index of the first piece."""
    start: Array
    """Path parameter at the start of the zone."""
    length: Array
    """Length of the zone in the path parameter."""
    max_speed: Array
    """Maximum speed."""
    acceleration: Array
    """Maximum acceleration along the path."""
    jerk: Array
    v0: Array
    """Speed at the start of the zone."""
    v1: Array
    """Speed at the end of the zone."""
    peak: Array
    """Highest speed in the zone."""
    time_s: Array

    def select(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> list[Any]:
        """The values of all fields, for the chosen zones."""
        return [getattr(self, name)[chosen] for name in self.__slots__]


def time_law(pieces: Pieces, limits: MotionLimits) -> TimeLaw:
    """The fastest variant to fly a path, from rest at every stop to rest at the next."""
    bounds = Bounds.from_pieces(pieces)
    stops = np.flatnonzero(pieces.stops)
    variants = _variants(pieces, bounds, limits)
    times = np.stack([_times_between_stops(zones, stops) for zones in variants])
    best = times.argmin(axis=0)
    columns: list[list[Any]] = []
    for variant, zones in enumerate(variants):
        section = np.searchsorted(stops, zones.first, side="right") - 1
        columns.append(zones.select(best[section] == variant))
    merged = [np.concatenate(parts) for parts in zip(*columns, strict=True)]
    order = np.argsort(merged[0], kind="stable")
    zones = _Zones(*(values[order] for values in merged))
    return _phases(replace(zones, peak=_peaks(zones, FINE_BISECTIONS)))


def _times_between_stops(zones: _Zones, stops: NDArray[np.int64]) -> Array:
    first_zones = np.searchsorted(zones.first, stops[:-1])
    return np.add.reduceat(zones.time_s, first_zones)


def _variants(pieces: Pieces, bounds: Bounds, limits: MotionLimits) -> list[_Zones]:
    """The zones of each variant; equal variants, as on a straight path, are computed once."""
    zones_by_key: dict[tuple[bytes, bytes], _Zones] = {}
    variants: list[_Zones] = []
    for bend_fraction, jerk_fraction, min_ratio in VARIANTS:
        max_speeds = _max_speeds(bounds, limits, bend_fraction, jerk_fraction)
        first = _first_pieces(max_speeds, pieces.stops, min_ratio)
        key = max_speeds.tobytes(), first.tobytes()
        if key not in zones_by_key:
            zones_by_key[key] = _zones(pieces, bounds, limits, max_speeds, first)
        variants.append(zones_by_key[key])
    return variants


def _zones(
    pieces: Pieces, bounds: Bounds, limits: MotionLimits, max_speeds: Array, first: NDArray[np.int64]
) -> _Zones:
    counts = np.diff(np.append(first, len(max_speeds)))
    max_speed = np.minimum.reduceat(max_speeds, first)
    accelerations, jerks = _remaining_limits(bounds, limits, np.repeat(max_speed, counts))
    acceleration = np.minimum.reduceat(accelerations, first)
    jerk = np.minimum.reduceat(jerks, first)
    start = np.concatenate(([0.0], np.cumsum(pieces.spans)))
    length = start[np.append(first[1:], len(max_speeds))] - start[first]
    v0, v1 = _junction_speeds(length, max_speed, acceleration, jerk, pieces.stops[first])
    # The last two values are placeholders: the peak and the time are computed from the other values.
    zones = _Zones(first, start[first], length, max_speed, acceleration, jerk, v0, v1, max_speed, max_speed)
    zones = replace(zones, peak=_peaks(zones, COARSE_BISECTIONS))
    time_s = _phase_table(zones)[0].sum(axis=0)
    return replace(zones, time_s=np.where(zones.peak > 0.0, time_s, np.inf))


def _max_speeds(bounds: Bounds, limits: MotionLimits, bend_fraction: float, jerk_fraction: float) -> Array:
    """The maximum speed of each piece."""
    with np.errstate(divide="ignore"):
        speed_limited = (
            limits.speed_m_s / bounds.horizontal[0],
            limits.climb_m_s / bounds.up,
            limits.descent_m_s / bounds.down,
            limits.yaw_rate_rad_s / bounds.yaw[0],
        )
        acceleration_limited = (
            np.sqrt(bend_fraction * limits.horizontal_acceleration_m_s2 / bounds.horizontal[1]),
            np.sqrt(bend_fraction * limits.vertical_acceleration_m_s2 / bounds.vertical[1]),
            np.sqrt(bend_fraction * limits.yaw_acceleration_rad_s2 / bounds.yaw[1]),
        )
        jerk_limited = (np.cbrt(jerk_fraction * limits.jerk_m_s3 / bounds.magnitude[2]),)
    return np.minimum.reduce((*speed_limited, *acceleration_limited, *jerk_limited))


def _remaining_limits(bounds: Bounds, limits: MotionLimits, speed: Array) -> tuple[Array, Array]:
    """Acceleration and jerk along the path parameter that remain for each piece at a speed."""
    speed_squared = speed * speed
    with np.errstate(divide="ignore", invalid="ignore"):
        jerk_left = np.maximum(limits.jerk_m_s3 - bounds.magnitude[2] * speed_squared * speed, 0.0)
        coupled = 3.0 * bounds.magnitude[1] * speed
        acceleration = np.fmin.reduce(
            (
                (limits.horizontal_acceleration_m_s2 - bounds.horizontal[1] * speed_squared)
                / bounds.horizontal[0],
                (limits.vertical_acceleration_m_s2 - bounds.vertical[1] * speed_squared) / bounds.vertical[0],
                (limits.yaw_acceleration_rad_s2 - bounds.yaw[1] * speed_squared) / bounds.yaw[0],
                COUPLING * jerk_left / coupled,
            )
        )
        acceleration = np.maximum(acceleration, 0.0)
        jerk = np.fmin(
            (jerk_left - coupled * acceleration) / bounds.magnitude[0],
            limits.yaw_jerk_rad_s3 / bounds.yaw[0],
        )
    return acceleration, np.maximum(jerk, ramps.MIN_ACCELERATION)


def _first_pieces(max_speeds: Array, stops: NDArray[np.bool_], min_ratio: float) -> NDArray[np.int64]:
    """The first piece of each zone; a zone ends at a stop, or where the maximum speeds differ too much."""
    if min_ratio > 1.0:
        return np.arange(len(max_speeds))
    if min_ratio == 0.0:
        return np.flatnonzero(stops[:-1])
    first: list[int] = []
    lower = upper = 0.0
    for index, (max_speed, stop) in enumerate(zip(max_speeds.tolist(), stops[:-1].tolist(), strict=True)):
        lower, upper = min(lower, max_speed), max(upper, max_speed)
        if stop or lower < min_ratio * upper:
            first.append(index)
            lower = upper = max_speed
    return np.array(first)


def _junction_speeds(
    length: Array, max_speed: Array, acceleration: Array, jerk: Array, stops: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """The speed at the start and end of each zone."""
    max_speeds = max_speed.tolist()
    zones = list(zip(length.tolist(), acceleration.tolist(), jerk.tolist(), strict=True))
    is_stop = [*stops.tolist(), True]
    speeds = [0.0] * len(is_stop)
    for k in range(1, len(zones)):
        speeds[k] = 0.0 if is_stop[k] else min(max_speeds[k - 1], max_speeds[k])
    for k in range(len(zones) - 1, 0, -1):
        if speeds[k] > speeds[k + 1]:
            speeds[k] = min(speeds[k], ramps.reachable_speed(speeds[k + 1], *zones[k]))
    for k in range(len(zones)):
        if speeds[k + 1] > speeds[k]:
            speeds[k + 1] = min(speeds[k + 1], ramps.reachable_speed(speeds[k], *zones[k]))
    junction_speeds = np.array(speeds)
    return junction_speeds[:-1], junction_speeds[1:]


def _peaks(zones: _Zones, bisections: int) -> Array:
    """The highest speed in each zone from which the zone's end speed can still be reached."""
    lower = np.maximum(zones.v0, zones.v1)
    upper = np.maximum(zones.max_speed, lower)
    fits = _ramp_length(zones, upper) <= zones.length
    peak = np.where(fits, upper, lower)
    unsolved = np.flatnonzero(~fits)
    if not len(unsolved):
        return peak
    unsolved_zones = _Zones(*zones.select(unsolved))
    lower, upper = lower[unsolved], upper[unsolved]
    ends = np.stack((unsolved_zones.v0, unsolved_zones.v1))  # both ramps in one call, for short paths
    for _ in range(bisections):
        middle = 0.5 * (lower + upper)
        up, down = ramps.lengths(ends, middle, unsolved_zones.acceleration, unsolved_zones.jerk)
        fits = up + down <= unsolved_zones.length
        lower, upper = np.where(fits, middle, lower), np.where(fits, upper, middle)
    peak[unsolved] = lower
    return peak


def _ramp_length(zones: _Zones, peak: Array) -> Array:
    """Distance needed to increase the speed to a peak and reduce it again."""
    up = ramps.lengths(zones.v0, peak, zones.acceleration, zones.jerk)
    return up + ramps.lengths(zones.v1, peak, zones.acceleration, zones.jerk)


def _phase_table(zones: _Zones) -> tuple[Array, Array]:
    """Durations and jerks of the seven phases of each zone, (7, Z)."""
    up_s, up_full_s = ramps.phase_durations(zones.peak - zones.v0, zones.acceleration, zones.jerk)
    down_s, down_full_s = ramps.phase_durations(zones.peak - zones.v1, zones.acceleration, zones.jerk)
    cruise_m = zones.length - _ramp_length(zones, zones.peak)
    with np.errstate(divide="ignore", invalid="ignore"):
        cruise_s = np.where(zones.peak > 0.0, np.maximum(cruise_m, 0.0) / zones.peak, 0.0)
    zero = np.zeros_like(up_s)
    times = np.stack((up_s, up_full_s, up_s, cruise_s, down_s, down_full_s, down_s))
    j = zones.jerk
    return times, np.stack((j, zero, -j, zero, -j, zero, j))


def _phases(zones: _Zones) -> TimeLaw:
    """All phases of all zones in order; each zone starts at its exact path parameter."""
    times, jerks = _phase_table(zones)
    count = len(zones.length)
    u, v, a = np.empty((7, count)), np.empty((7, count)), np.empty((7, count))
    at_u, at_v, at_a = zones.start, zones.v0, np.zeros(count)
    for k in range(7):
        u[k], v[k], a[k] = at_u, at_v, at_a
        t, j = times[k], jerks[k]
        at_u = at_u + t * (at_v + t * (at_a / 2.0 + t * j / 6.0))
        at_v = at_v + t * (at_a + t * j / 2.0)
        at_a = at_a + t * j
        if k in (2, 3):  # exact values at the peak and at the end of the cruise
            at_v, at_a = zones.peak, np.zeros(count)
    has_duration = (times > 0.0).T.ravel()
    phase_values = [values.T.ravel()[has_duration] for values in (times, u, v, a, jerks)]
    start_s = np.concatenate(([0.0], np.cumsum(phase_values[0])))
    return TimeLaw(start_s[:-1], *phase_values[1:], duration_s=float(start_s[-1]))


def slow_bends(pieces: Pieces, limits: MotionLimits) -> set[int]:
    """The points (index in `marks`) whose bends take longer than a stop would; a bend has two pieces.

    Both times are relative to passing the point at the speed of the legs.
    """
    bounds = Bounds.from_pieces(pieces)
    max_speeds = _max_speeds(bounds, limits, 1.0, 1.0)
    accelerations, jerks = _remaining_limits(bounds, limits, max_speeds)
    curved = bounds.magnitude[1] > 1e-9
    slow_points: set[int] = set()
    for index, mark in enumerate(pieces.marks.tolist()):
        if not 0 < mark < len(max_speeds) or pieces.stops[mark] or not (curved[mark] and curved[mark - 1]):
            continue
        straight_legs = [
            leg for leg in (mark - 2, mark + 1) if 0 <= leg < len(max_speeds) and not curved[leg]
        ]
        if not straight_legs:
            continue
        leg = min(straight_legs, key=lambda leg: float(max_speeds[leg]))
        acceleration, jerk = float(accelerations[leg]), float(jerks[leg])
        bend_m = 2.0 * float(pieces.spans[mark])
        half_m = 0.5 * (float(pieces.spans[leg]) + bend_m)
        speed = min(float(max_speeds[leg]), ramps.reachable_speed(0.0, half_m, acceleration, jerk))
        bend_speed = min(float(max_speeds[mark - 1]), float(max_speeds[mark]), speed)
        changes = np.array([speed, speed - bend_speed])
        stop_s, slow_s = ramps.durations(changes, np.full(2, acceleration), np.full(2, jerk)).tolist()
        corner_m = float(np.sqrt(((pieces.points[mark, -1, :3] - pieces.points[mark, 0, :3]) ** 2).sum()))
        lost_s = bend_m / bend_speed - 2.0 * corner_m / speed + slow_s * (1.0 - bend_speed / speed)
        if lost_s > SLOW_BEND_FACTOR * stop_s:
            slow_points.add(index)
    return slow_points
