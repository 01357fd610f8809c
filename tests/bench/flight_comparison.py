"""Compares a simulated flight with a real PX4's: error, rise, overshoot and settling.

The error is the RMS over the controlled axes; both flights are aligned at their first motion. Positions are
absolute if the position is controlled, and relative to the start otherwise (velocity, acceleration, attitude,
rates, the ground). The limit is the largest of 5 % of the manoeuvre, a floor, and PX4's own spread. The
response is measured on one axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import flight_replay
from .flight_recordings import Recording
from .flight_replay import Replay

FloatArray = NDArray[np.float64]

ERROR_FRACTION = 0.05
"""Allowed error, as a fraction of the manoeuvre's size."""
GRID_S = 0.02
"""Period of the times at which flights are compared."""
FIRST_MOTION_FRACTION = 0.1
"""Fraction of the manoeuvre's size at which the motion begins."""
FIRST_MOTION_ROWS = 3
"""Number of consecutive rows: a single row may be gyro noise."""
RISE_FRACTION = 0.8
"""The rise ends at this fraction of the distance: the last fifth of a slow approach is GPS drift."""
SETTLING_FRACTION = 0.1
"""A response has settled within this fraction of the distance around its final value."""
STEP_FRACTION = 0.6
"""A response that ends above this fraction of its maximum is a step, otherwise a pulse."""
END_ROWS = 25
"""Number of last rows whose mean is the final value."""
RISE_TIME_FRACTION = 0.1
"""Allowed difference of the rise times, as a fraction of the real rise time."""


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
    """The evaluation of a flight between two times."""

    quantity: Quantity
    axes: tuple[str, ...]
    """Controlled axes, over which the error is computed."""
    rising: str | None
    """The axis on which the response is measured; None: no motion is commanded."""
    from_s: float = 0.0
    until_s: float = math.inf


XYZ = ("x", "y", "z")
MANOEUVRES: dict[str, Manoeuvre] = {
    "acc_x_1": Manoeuvre(VELOCITY, ("vx",), "vx", 0.0, 2.5),
    "acc_y_1_z_m1": Manoeuvre(VELOCITY, ("vy", "vz"), "vy", 0.0, 2.0),
    "arm_idle_autodisarm": Manoeuvre(PATH, XYZ, None),
    "att_pitch_m10_yaw_30": Manoeuvre(ATTITUDE, ("roll", "pitch", "yaw"), "yaw", 0.0, 2.0),
    "att_pitch_m15_clean": Manoeuvre(ATTITUDE, ("roll", "pitch", "yaw"), "pitch", 1.2, 2.7),
    "att_roll_10": Manoeuvre(ATTITUDE, ("roll", "pitch", "yaw"), "roll", 0.0, 2.0),
    "att_roll_10_clean": Manoeuvre(ATTITUDE, ("roll", "pitch", "yaw"), "roll", 1.2, 2.7),
    "att_thrust_step": Manoeuvre(PATH, ("z",), "z", 0.0, 2.0),
    "att_thrust_step_clean": Manoeuvre(PATH, ("z",), "z", 1.2, 3.2),
    "att_yaw_45_clean": Manoeuvre(ATTITUDE, ("roll", "pitch", "yaw"), "yaw", 1.2, 3.7),
    "change_speed_mid_reposition": Manoeuvre(POSITION, XYZ, "y"),
    "circle_r5_v3_posvel": Manoeuvre(POSITION, XYZ, "y"),
    "figure8_fast_posvelacc": Manoeuvre(POSITION, XYZ, "x"),
    "global_frame6_n5": Manoeuvre(POSITION, XYZ, "x"),
    "hold_drift_30s": Manoeuvre(POSITION, XYZ, None),
    "land_from_10m": Manoeuvre(PATH, ("z",), "z"),
    "land_from_5m": Manoeuvre(PATH, ("z",), "z"),
    "mission_box_40m": Manoeuvre(POSITION, XYZ, "x"),
    "offboard_stop_streaming": Manoeuvre(PATH, ("z",), "z"),
    "orbit_r10_v3": Manoeuvre(POSITION, XYZ, "x"),
    "orbit_to_hold": Manoeuvre(PATH, XYZ, "y"),
    "pos_step_x_p5": Manoeuvre(POSITION, XYZ, "x"),
    "pos_step_y_10": Manoeuvre(POSITION, XYZ, "y"),
    "pos_step_z_up3": Manoeuvre(POSITION, XYZ, "z"),
    "pos_yawrate_0p5": Manoeuvre(ATTITUDE, ("yaw",), "yaw"),
    "rate_roll_pulse": Manoeuvre(RATE, ("p",), "p", 0.0, 1.1),
    "rate_roll_pulse_clean": Manoeuvre(RATE, ("p",), "p", 1.2, 2.3),
    "rate_yaw_pulse": Manoeuvre(RATE, ("r",), "r", 0.0, 1.5),
    "rate_yaw_pulse_clean": Manoeuvre(RATE, ("r",), "r", 1.2, 2.7),
    "reposition_50m_then_stop": Manoeuvre(POSITION, XYZ, "y"),
    "reposition_60m_default_speed": Manoeuvre(POSITION, XYZ, "x"),
    "rtl_60m_15m": Manoeuvre(POSITION, XYZ, "x"),
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
class StepResponse:
    """Rise, overshoot and settling of one response."""

    first_motion_s: float
    rise_s: float
    """Time from the first motion to 80 % of the distance."""
    overshoot: float
    """As a fraction of the distance."""
    settling_s: float
    """Time after which the response stays within 10 % of its final value; NaN: it does not settle."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """One flight compared with the real one; size, error and limit are in the unit of the quantity."""

    name: str
    quantity: Quantity
    size: float
    error: float
    limit: float
    path_error_m: float
    """RMS of the position since the first motion, for any controlled quantity."""
    path_limit_m: float
    sim: StepResponse
    real: StepResponse
    rise_limit_s: float
    comparable: bool
    """Whether PX4's second flight is comparable with its first."""

    @property
    def within_limit(self) -> bool:
        """Whether the error is within its limit."""
        return self.error <= self.limit

    @property
    def rise_agrees(self) -> bool:
        """Whether the rise times agree; also True if a flight has no rise."""
        difference_s = abs(self.sim.rise_s - self.real.rise_s)
        return not difference_s > self.rise_limit_s + 1e-9  # both are multiples of the grid


class Track:
    """A flight's columns, with roll, pitch and yaw, as functions of time."""

    def __init__(self, flight: Recording | Replay) -> None:
        self.t_s = flight.t_s
        self._columns = flight_replay.with_angles(flight.columns)

    def at(self, axis: str, at_s: FloatArray) -> FloatArray:
        """One axis at these times (linear between rows)."""
        return np.interp(at_s, self.t_s, self._columns[axis])


def compare(recording: Recording, replay: Replay, manoeuvre: Manoeuvre | None = None) -> Comparison:
    """Compares a flight with its recording; without `manoeuvre` with that of the reference flight's name."""
    manoeuvre = manoeuvre or MANOEUVRES[recording.name]
    quantity = manoeuvre.quantity
    real, sim = Track(recording), Track(replay)
    grid = grid_of(manoeuvre, real, sim)
    size = math.nan
    real_response = sim_response = StepResponse(math.nan, math.nan, math.nan, math.nan)
    if manoeuvre.rising is not None:
        size = size_of(real.at(manoeuvre.rising, grid))
        real_response = response_of(grid, real.at(manoeuvre.rising, grid), size)
        sim_response = response_of(grid, sim.at(manoeuvre.rising, grid), size)
    lag_s = sim_response.first_motion_s - real_response.first_motion_s
    # No alignment: gyro noise hides the first motion of a rate, and without a command there is no motion.
    lag_s = 0.0 if math.isnan(lag_s) or quantity is RATE else lag_s
    last_s = min(float(grid[-1]) + GRID_S, float(sim.t_s[-1]))
    compared_s = grid[(grid + lag_s >= sim.t_s[0]) & (grid + lag_s <= last_s)]
    error = rms(real, compared_s, sim, compared_s + lag_s, manoeuvre.axes, from_zero=quantity.from_zero)
    path_error_m = rms(real, compared_s, sim, compared_s + lag_s, XYZ, from_zero=True)
    real_spread = {"m": recording.spread.position_m, "m/s": recording.spread.velocity_m_s,
                   "°": recording.spread.attitude_deg}.get(quantity.unit, math.nan)  # fmt: skip
    return Comparison(
        recording.name, quantity, size * quantity.scale, error * quantity.scale,
        float(np.nanmax([ERROR_FRACTION * abs(size) * quantity.scale, quantity.floor, real_spread])),
        path_error_m, max(PATH.floor, float(np.nan_to_num(recording.spread.position_m))),
        sim_response, real_response,
        max(RISE_TIME_FRACTION * abs(real_response.rise_s), float(np.nan_to_num(recording.spread.rise_s)),
            3 * GRID_S),
        recording.spread.comparable,
    )  # fmt: skip


def grid_of(manoeuvre: Manoeuvre, *tracks: Track) -> FloatArray:
    """Times of the manoeuvre [s] that all these flights have."""
    end_s = min(manoeuvre.until_s, *(float(track.t_s[-1]) for track in tracks))
    return np.arange(manoeuvre.from_s, end_s, GRID_S)


def rms(
    a: Track, a_s: FloatArray, b: Track, b_s: FloatArray, axes: tuple[str, ...], *, from_zero: bool
) -> float:
    """RMS distance of two flights over these axes, each at its own times; `from_zero`: from the start."""
    total = np.zeros(len(a_s))
    for axis in axes:
        difference = a.at(axis, a_s) - b.at(axis, b_s)
        total += (difference - difference[0] if from_zero else difference) ** 2
    return float(np.sqrt(total.mean()))


def size_of(values: FloatArray) -> float:
    """The distance from the start to the farthest point, with its sign."""
    offsets = values - values[0]
    return float(offsets[np.argmax(np.abs(offsets))])


def response_of(grid: FloatArray, values: FloatArray, sign: float) -> StepResponse:
    """Measures a response relative to its distance: a step's final value, or a pulse's peak."""
    farthest = float((values - values[0]).max()) if sign > 0.0 else float((values - values[0]).min())
    final = float(np.mean(values[-END_ROWS:])) - values[0]
    size = final if abs(final) > STEP_FRACTION * abs(farthest) else farthest
    offsets = (values - values[0]) / size if size else np.zeros_like(values)
    is_beyond = np.lib.stride_tricks.sliding_window_view(
        offsets >= FIRST_MOTION_FRACTION, FIRST_MOTION_ROWS
    ).all(axis=1)
    moved_rows, risen_rows = np.flatnonzero(is_beyond), np.flatnonzero(offsets >= RISE_FRACTION)
    first_s = float(grid[moved_rows[0]]) if len(moved_rows) else math.nan
    rise_s = float(grid[risen_rows[0]]) - first_s if len(risen_rows) else math.nan
    end = float(np.mean(offsets[-END_ROWS:]))
    outside = np.flatnonzero(np.abs(offsets - end) > SETTLING_FRACTION)
    settling_s = (
        float(grid[outside[-1]]) - grid[0]
        if len(outside) and outside[-1] < len(offsets) - END_ROWS - 1
        else math.nan
    )
    return StepResponse(first_s, rise_s, float(offsets.max()) - end, float(settling_s))
