"""How near simulated flights come to those of a real PX4: error, rise, overshoot and settling side by side.

Error is the RMS over the controlled axes, both flights aligned at their first motion. Position flights are
compared where they are; where no position is controlled (velocity, acceleration, attitude, rates, the ground)
both start from zero. The limit is the larger of 5 % of the manoeuvre, a floor, and PX4's own spread.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import flight_recordings, flight_replay
from .flight_recordings import Recording
from .flight_replay import Replay

FloatArray = NDArray[np.float64]

PART_OF_SIZE = 0.05
GRID_S = 0.02
MOVED = 0.1
"""Part of the manoeuvre that counts as first motion."""
MOVED_ROWS = 3
"""For so many rows on end: a single one may be gyro noise."""
RISEN = 0.8
"""Of the way; the last fifth of a slow approach is the wander of GPS."""
SETTLED = 0.1
HOLDS = 0.6
"""A response that ends at more than this part of its farthest point is a step, else a pulse."""
END_ROWS = 25
STEP_RISE = 0.1
NOISY_FLIGHTS = 8


@dataclass(frozen=True, slots=True)
class Quantity:
    """A kind of controlled axes: unit, factor to it, smallest limit, and whether flights start from zero."""

    unit: str
    scale: float
    floor: float
    from_zero: bool


POSITION = Quantity("m", 1.0, 0.3, False)
PATH = Quantity("m", 1.0, 0.3, True)
VELOCITY = Quantity("m/s", 1.0, 0.1, False)
ATTITUDE = Quantity("°", math.degrees(1.0), 0.5, False)
RATE = Quantity("rad/s", 1.0, 0.15, False)
"""The floor is the gyro noise in a recording."""


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """What a flight is judged by: its axes, and the one that rises, between two times."""

    quantity: Quantity
    axes: tuple[str, ...]
    primary: str
    from_s: float = 0.0
    until_s: float = math.inf


_XYZ = ("x", "y", "z")
MANOEUVRES: dict[str, Manoeuvre] = {
    "acc_x_1": Manoeuvre(VELOCITY, ("vx",), "vx", 0.0, 2.5),
    "acc_y_1_z_m1": Manoeuvre(VELOCITY, ("vy", "vz"), "vy", 0.0, 2.0),
    "arm_idle_autodisarm": Manoeuvre(PATH, _XYZ, "armed"),
    "att_pitch_m10_yaw_30": Manoeuvre(ATTITUDE, ("roll", "pitch", "yaw"), "yaw", 0.0, 2.0),
    "att_pitch_m15_clean": Manoeuvre(ATTITUDE, ("roll", "pitch", "yaw"), "pitch", 1.2, 2.7),
    "att_roll_10": Manoeuvre(ATTITUDE, ("roll", "pitch", "yaw"), "roll", 0.0, 2.0),
    "att_roll_10_clean": Manoeuvre(ATTITUDE, ("roll", "pitch", "yaw"), "roll", 1.2, 2.7),
    "att_thrust_step": Manoeuvre(PATH, ("z",), "z", 0.0, 2.0),
    "att_thrust_step_clean": Manoeuvre(PATH, ("z",), "z", 1.2, 3.2),
    "att_yaw_45_clean": Manoeuvre(ATTITUDE, ("roll", "pitch", "yaw"), "yaw", 1.2, 3.7),
    "change_speed_mid_reposition": Manoeuvre(POSITION, _XYZ, "y"),
    "circle_r5_v3_posvel": Manoeuvre(POSITION, _XYZ, "y"),
    "figure8_fast_posvelacc": Manoeuvre(POSITION, _XYZ, "x"),
    "global_frame6_n5": Manoeuvre(POSITION, _XYZ, "x"),
    "hold_drift_30s": Manoeuvre(POSITION, _XYZ, "armed"),
    "land_from_10m": Manoeuvre(PATH, ("z",), "z"),
    "land_from_5m": Manoeuvre(PATH, ("z",), "z"),
    "mission_box_40m": Manoeuvre(POSITION, _XYZ, "x"),
    "offboard_stop_streaming": Manoeuvre(PATH, ("z",), "z"),
    "orbit_r10_v3": Manoeuvre(POSITION, _XYZ, "x"),
    "orbit_to_hold": Manoeuvre(PATH, _XYZ, "x"),
    "pos_step_x_p5": Manoeuvre(POSITION, _XYZ, "x"),
    "pos_step_y_10": Manoeuvre(POSITION, _XYZ, "y"),
    "pos_step_z_up3": Manoeuvre(POSITION, _XYZ, "z"),
    "pos_yawrate_0p5": Manoeuvre(ATTITUDE, ("yaw",), "yaw"),
    "rate_roll_pulse": Manoeuvre(RATE, ("p",), "p", 0.0, 1.1),
    "rate_roll_pulse_clean": Manoeuvre(RATE, ("p",), "p", 1.2, 2.3),
    "rate_yaw_pulse": Manoeuvre(RATE, ("r",), "r", 0.0, 1.5),
    "rate_yaw_pulse_clean": Manoeuvre(RATE, ("r",), "r", 1.2, 2.7),
    "reposition_50m_then_stop": Manoeuvre(POSITION, _XYZ, "y"),
    "reposition_60m_default_speed": Manoeuvre(POSITION, _XYZ, "x"),
    "rtl_60m_15m": Manoeuvre(POSITION, _XYZ, "x"),
    "takeoff_10m": Manoeuvre(PATH, ("z",), "z"),
    "takeoff_2p5m": Manoeuvre(PATH, ("z",), "z"),
    "takeoff_30m": Manoeuvre(PATH, ("z",), "z"),
    "vel_body_2_yaw90": Manoeuvre(VELOCITY, ("vx", "vy"), "vy"),
    "vel_diag": Manoeuvre(VELOCITY, ("vx", "vy", "vz"), "vx", 0.0, 5.0),
    "vel_x_1": Manoeuvre(VELOCITY, ("vx",), "vx", 0.0, 6.0),
    "vel_x_8": Manoeuvre(VELOCITY, ("vx",), "vx", 0.0, 7.0),
    "vel_z_up1p5": Manoeuvre(VELOCITY, ("vz",), "vz", 0.0, 4.0),
    "yaw_step_90": Manoeuvre(ATTITUDE, ("yaw",), "yaw"),
}


@dataclass(frozen=True, slots=True)
class Shape:
    """What is read off one response."""

    first_motion_s: float
    rise_s: float
    """From the first motion to 80 % of the way."""
    overshoot: float
    """Part of the way."""
    settling_s: float
    """After which it stays within 10 % of where it ends; NaN: it does not settle."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """One flight beside the real one."""

    name: str
    quantity: Quantity
    size: float
    error: float
    limit: float
    path_error_m: float
    """RMS of the position since the first motion, whatever was controlled."""
    path_limit_m: float
    sim: Shape
    real: Shape
    rise_limit_s: float
    comparable: bool
    """Whether PX4's own repeat of it says anything."""

    @property
    def near(self) -> bool:
        """Whether the error is within its limit."""
        return self.error <= self.limit

    @property
    def rises_alike(self) -> bool:
        """Whether the rise times agree (flights without a rise do)."""
        gap = abs(self.sim.rise_s - self.real.rise_s)
        return not gap > self.rise_limit_s + 1e-9  # both are multiples of the grid


def compare(recording: Recording, replay: Replay) -> Comparison:
    """Measure one flight against its recording."""
    manoeuvre = MANOEUVRES[recording.name]
    quantity = manoeuvre.quantity
    real, sim = flight_replay.with_angles(recording.columns), flight_replay.with_angles(replay.columns)
    end_s = min(manoeuvre.until_s, float(recording.t_s[-1]), float(replay.t_s[-1]))
    grid = np.arange(manoeuvre.from_s, end_s, GRID_S)

    def take(columns: dict[str, FloatArray], t_s: FloatArray, axis: str, at_s: FloatArray) -> FloatArray:
        return np.interp(at_s, t_s, columns[axis])

    # Size and shape by the axis that rises.
    was = take(real, recording.t_s, manoeuvre.primary, grid)
    now = take(sim, replay.t_s, manoeuvre.primary, grid)
    size = _size(was)
    real_shape, sim_shape = _shape(grid, was, size), _shape(grid, now, size)
    lag_s = sim_shape.first_motion_s - real_shape.first_motion_s
    # Gyro noise hides the first motion of a rate; nothing moves where nothing was asked.
    unclear = math.isnan(lag_s) or quantity is RATE or manoeuvre.primary == "armed"
    lag_s = 0.0 if unclear else lag_s
    common = grid[(grid + lag_s >= replay.t_s[0]) & (grid + lag_s <= min(end_s, float(replay.t_s[-1])))]

    def rms(axes: tuple[str, ...], *, from_zero: bool) -> float:
        total = np.zeros(len(common))
        for axis in axes:
            a = take(real, recording.t_s, axis, common)
            b = take(sim, replay.t_s, axis, common + lag_s)
            if from_zero:
                a, b = a - a[0], b - b[0]
            total += (a - b) ** 2
        return float(np.sqrt(total.mean()))

    spread = {"m": recording.spread.position_m, "m/s": recording.spread.velocity_m_s,
              "°": recording.spread.attitude_deg}.get(quantity.unit, math.nan)  # fmt: skip
    limit = max(PART_OF_SIZE * abs(size) * quantity.scale, quantity.floor, np.nan_to_num(spread))
    return Comparison(
        recording.name, quantity, size * quantity.scale,
        rms(manoeuvre.axes, from_zero=quantity.from_zero) * quantity.scale, limit,
        rms(_XYZ, from_zero=True), max(0.3, float(np.nan_to_num(recording.spread.position_m))),
        sim_shape, real_shape,
        max(STEP_RISE * abs(real_shape.rise_s), float(np.nan_to_num(recording.spread.rise_s)), 3 * GRID_S),
        recording.spread.comparable,
    )  # fmt: skip


def _size(values: FloatArray) -> float:
    """The way from the start to the farthest point, with its sign."""
    way = values - values[0]
    return float(way[np.argmax(np.abs(way))])


def _shape(grid: FloatArray, values: FloatArray, sign: float) -> Shape:
    """Read a response against its own way: to where it ends, or to its peak where it comes back."""
    farthest = float((values - values[0]).max()) if sign > 0.0 else float((values - values[0]).min())
    ends = float(np.mean(values[-END_ROWS:])) - values[0]
    size = ends if abs(ends) > HOLDS * abs(farthest) else farthest
    way = (values - values[0]) / size if size else np.zeros_like(values)
    beyond = np.lib.stride_tricks.sliding_window_view(way >= MOVED, MOVED_ROWS).all(axis=1)
    moved, risen = np.flatnonzero(beyond), np.flatnonzero(way >= RISEN)
    first_s = float(grid[moved[0]]) if len(moved) else math.nan
    rise_s = float(grid[risen[0]]) - first_s if len(risen) else math.nan
    end = float(np.mean(way[-END_ROWS:]))
    outside = np.flatnonzero(np.abs(way - end) > SETTLED)
    settling_s = (
        float(grid[outside[-1]]) - grid[0] if len(outside) and outside[-1] < len(way) - 26 else math.nan
    )
    return Shape(first_s, rise_s, float(way.max()) - end, float(settling_s))


def measure(wanted: list[str] | None = None, *, noise: bool = False, seed: int = 0) -> list[Comparison]:
    """Fly and compare."""
    recordings = [flight_recordings.load(name) for name in wanted or flight_recordings.names()]
    flown = flight_replay.fly(recordings, noise=noise, seed=seed)
    return [compare(recording, flown[recording.name]) for recording in recordings]


def _pair(sim: float, real: float, digits: int) -> str:
    return " / ".join("–" if math.isnan(value) else f"{value:.{digits}f}" for value in (sim, real))


def rows(comparisons: list[Comparison]) -> Iterator[str]:
    """The table in Markdown; ours / PX4's."""
    heads = ("flight", "size", "error RMS", "limit", "", "first motion s", "rise s", "overshoot",
             "settling s", "path RMS m")  # fmt: skip
    yield f"| {' | '.join(heads)} |"
    yield "|---" * len(heads) + "|"
    for c in comparisons:
        verdict = ("" if c.near else "far ") + ("" if c.rises_alike else "rise")
        sim, real = c.sim, c.real
        cells = (
            c.name, f"{c.size:.1f} {c.quantity.unit}", f"{c.error:.2f}", f"{c.limit:.2f}", verdict,
            _pair(sim.first_motion_s, real.first_motion_s, 2), _pair(sim.rise_s, real.rise_s, 2),
            _pair(sim.overshoot, real.overshoot, 2), _pair(sim.settling_s, real.settling_s, 1),
            f"{c.path_error_m:.2f}",
        )  # fmt: skip
        yield f"| {' | '.join(cells)} |"
    missed = [c for c in comparisons if not (c.near and c.rises_alike)]
    near = len(comparisons) - len(missed)
    yield ""
    yield f"{near} of {len(comparisons)} within their limits (error and rise time); sensors without noise."
    vague = [c.name for c in missed if not c.comparable]
    if vague:
        yield f"PX4's own repeats of {', '.join(vague)} are not comparable (spread.json)."


def open_rises(missed: list[Comparison]) -> Iterator[str]:
    """What noise leaves open of rise times that missed: the same flights again, with noisy sensors."""
    wanted = [c.name for c in missed]
    rises: dict[str, list[float]] = {name: [] for name in wanted}
    for seed in range(NOISY_FLIGHTS):
        for c in measure(wanted, noise=True, seed=seed):
            rises[c.name].append(c.sim.rise_s)
    for c in missed:
        low, high = min(rises[c.name]), max(rises[c.name])
        yield (
            f"{c.name}: with sensor noise it rises in {low:.2f} to {high:.2f} s ({NOISY_FLIGHTS} seeds), "
            f"PX4 in {c.real.rise_s:.2f} s."
        )


def table() -> Iterator[str]:
    """For `make bench`."""
    if not flight_recordings.FLIGHTS.is_dir():
        yield "The recordings (../shared/px4/flights) are not beside this checkout."
        return
    comparisons = measure()
    yield from rows(comparisons)
    missed = [c for c in comparisons if not c.rises_alike]
    if missed:
        yield ""
        yield from open_rises(missed)
