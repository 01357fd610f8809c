"""PX4's multicopter land detector, from estimate, thrust and setpoints.

The detector has three stages, each after a third of LNDMC_TRIG_TIME: ground contact (descent setpoint, no
motion, low thrust), maybe landed (minimum thrust, no rotation), landed. If the range finder has measured the
ground, but does not measure it now, each stage takes three times as long.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.kernels import Column, formula, kernel
from vehicle_sim.vehicle_view import VehicleView


class LandedState(IntEnum):
    """MAV_LANDED_STATE."""

    UNDEFINED = 0
    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


LOW_THRUST_FRACTION = 0.3
"""Limit of low thrust: 0 is the minimum thrust MPC_THR_MIN, 1 the hover thrust MPC_THR_HOVER."""
LOW_THRUST_FRACTION_WITH_ESTIMATE = 0.6
"""Limit of low thrust if the hover thrust is estimated."""
MIN_THRUST_FRACTION = 0.1
"""Limit of minimum thrust, on the same scale."""
LANDED_FACTOR = 2.5
"""Factor on the limits of vertical speed and rotation after a landing."""
DESCENT_FACTOR = 1.1
"""A setpoint that descends at this factor times LNDMC_Z_VEL_MAX or faster counts as a descent."""
NEAR_GROUND_M = 1.0
"""A larger height above ground prevents ground contact."""
NO_RANGE_FACTOR = 3.0
"""Factor on the duration of each stage while the range finder does not measure the ground."""
NO_ALTITUDE_S = 8.0
"""Without an altitude estimate, minimum thrust for this long counts as a landing."""


class DetectorInputs(NamedTuple):
    """Inputs of the land detector."""

    armed: bool
    thrust: float
    hover_thrust: float
    """The estimated hover thrust, or MPC_THR_HOVER."""
    hover_thrust_known: bool
    """Whether the hover thrust is estimated."""
    velocity_ned_m_s: tuple[float, float, float]
    down_by_position_m_s: float
    """Derivative of the estimated position (PX4's z_deriv): noisier, but without the bias of the velocity
    estimate."""
    vertical_known: bool
    """Whether the altitude estimate is valid."""
    rates_frd_rad_s: tuple[float, float, float]
    height_above_ground_m: float
    """Height that the range finder measures; NaN: no measurement."""
    climb_rate_controlled: bool
    """Whether the position controller is active."""
    setpoint_down_m_s: float
    """Vertical velocity of the newest trajectory setpoint; NaN: none."""


@dataclass(frozen=True, slots=True)
class LandingThresholds:
    """LNDMC_* and thrust parameters."""

    climb_max_m_s: float
    horizontal_max_m_s: float
    rotation_max_rad_s: float
    trigger_s: float
    thrust_min: float
    manual_thrust_min: float

    @classmethod
    def for_vehicle(cls, view: VehicleView) -> LandingThresholds:
        """The thresholds of the vehicle's current parameters."""
        parameter = view.parameter
        return cls(
            climb_max_m_s=parameter("LNDMC_Z_VEL_MAX"),
            horizontal_max_m_s=parameter("LNDMC_XY_VEL_MAX"),
            rotation_max_rad_s=math.radians(parameter("LNDMC_ROT_MAX")),
            trigger_s=parameter("LNDMC_TRIG_TIME"),
            thrust_min=parameter("MPC_THR_MIN"),
            manual_thrust_min=parameter("MPC_MANTHR_MIN"),
        )


CONTACT, MAYBE_LANDED, LANDED, _AT_MIN_THRUST, _HAD_RANGE = 0, 2, 4, 6, 8
"""Indices of the state array. Each condition has two numbers: 1 if the condition has been true for long
enough, and the time since which the condition is true [s]. _HAD_RANGE: 1 after the first measured range."""
_CLIMB_MAX, _HORIZONTAL_MAX, _ROTATION_MAX, _TRIGGER, _THRUST_MIN, _MANUAL_THRUST_MIN = range(6)
LIMIT_COUNT = 6


def new_state() -> NDArray[np.float64]:
    """(9,) conditions of a vehicle on the ground."""
    return np.array([1.0, -math.inf] * 4 + [0.0])


class LandDetector:
    """The land detector of one vehicle.

    Args:
        state: (9,) conditions; default: the conditions of a vehicle on the ground.
        limits: (`LIMIT_COUNT`,) row that stores the thresholds.
    """

    def __init__(self, state: Column | None = None, limits: Column | None = None) -> None:
        self._state = new_state() if state is None else state
        self._state_view = self._state.data.cast("B").cast("d")
        self._thresholds: LandingThresholds | None = None
        self._limit_row = np.zeros(LIMIT_COUNT) if limits is None else limits

    @property
    def ground_contact(self) -> bool:
        """Whether the vehicle is supported by a surface."""
        return self._state_view[CONTACT] != 0.0

    @property
    def maybe_landed(self) -> bool:
        """Whether the vehicle has ground contact, minimum thrust and no rotation."""
        return self._state_view[MAYBE_LANDED] != 0.0

    @property
    def landed(self) -> bool:
        """Whether `maybe_landed` has been true for the whole stage."""
        return self._state_view[LANDED] != 0.0

    @property
    def stages(self) -> float:
        """The three stages as one number, 0 in flight: 1 ground contact + 2 maybe landed + 4 landed."""
        state = self._state_view
        return state[CONTACT] + 2.0 * state[MAYBE_LANDED] + 4.0 * state[LANDED]

    def update(self, now_s: float, inputs: DetectorInputs, thresholds: LandingThresholds) -> None:
        """Updates the state; call at 50 Hz."""
        if thresholds is not self._thresholds:
            self._thresholds = thresholds
            self._limit_row[:] = (
                thresholds.climb_max_m_s, thresholds.horizontal_max_m_s, thresholds.rotation_max_rad_s,
                thresholds.trigger_s, thresholds.thrust_min, thresholds.manual_thrust_min,
            )  # fmt: skip
        vn, ve, vd = inputs.velocity_ned_m_s
        roll_rate, pitch_rate, _ = inputs.rates_frd_rad_s
        detect(
            self._state, self._limit_row, now_s, inputs.armed, inputs.thrust, inputs.hover_thrust,
            inputs.hover_thrust_known, vn, ve, vd, inputs.down_by_position_m_s, inputs.vertical_known,
            roll_rate, pitch_rate, inputs.height_above_ground_m, inputs.climb_rate_controlled,
            inputs.setpoint_down_m_s,
        )  # fmt: skip


@formula
def landing_stages(state: Column) -> float:
    """`LandDetector.stages`."""
    return state[CONTACT] + 2.0 * state[MAYBE_LANDED] + 4.0 * state[LANDED]


@formula
def _debounce(state: Column, index: int, now_s: float, condition: bool, delay_s: float) -> None:
    """Sets a condition that has been true for `delay_s`, and clears it as soon as it is false."""
    if not condition:
        state[index], state[index + 1] = 0.0, math.inf
        return
    state[index + 1] = min(state[index + 1], now_s)
    if now_s - state[index + 1] >= delay_s:
        state[index] = 1.0


@formula
def _thrust_level(min_thrust: float, hover: float, fraction: float) -> float:
    return min_thrust + (hover - min_thrust) * fraction


@kernel
def detect(
    state: Column, limits: Column, now_s: float, armed: bool, thrust: float, hover_thrust: float,
    hover_known: bool, vn: float, ve: float, vd: float, down_by_position: float, vertical_known: bool,
    roll_rate: float, pitch_rate: float, height_m: float, climb_rate_controlled: bool, setpoint_down: float,
) -> None:  # fmt: skip
    """Updates one vehicle's state by one tick; the arguments are those of `DetectorInputs`."""
    range_missing = math.isnan(height_m)
    if not range_missing:
        state[_HAD_RANGE] = 1.0
    factor = NO_RANGE_FACTOR if range_missing and state[_HAD_RANGE] != 0.0 else 1.0
    stage_s = limits[_TRIGGER] / 3.0 * factor
    landed_factor = LANDED_FACTOR if state[LANDED] != 0.0 else 1.0

    vertical_m_s = min(abs(vd), abs(down_by_position))
    is_moving = (
        not vertical_known
        or vertical_m_s >= limits[_CLIMB_MAX] * landed_factor
        or math.hypot(vn, ve) > limits[_HORIZONTAL_MAX]
    )
    fraction = LOW_THRUST_FRACTION_WITH_ESTIMATE if hover_known else LOW_THRUST_FRACTION
    low_thrust = thrust <= _thrust_level(limits[_THRUST_MIN], hover_thrust, fraction)
    wants_descent = not climb_rate_controlled or setpoint_down >= DESCENT_FACTOR * limits[_CLIMB_MAX]
    may_descend = wants_descent or state[MAYBE_LANDED] != 0.0 or state[LANDED] != 0.0
    near_ground = not height_m >= NEAR_GROUND_M
    in_contact = near_ground and low_thrust and may_descend and not is_moving
    _debounce(state, CONTACT, now_s, not armed or in_contact, stage_s)

    min_thrust = limits[_MANUAL_THRUST_MIN] + 0.01
    if climb_rate_controlled:
        min_thrust = _thrust_level(limits[_THRUST_MIN], hover_thrust, MIN_THRUST_FRACTION)
    at_min_thrust = thrust <= min_thrust
    if armed:
        _debounce(state, _AT_MIN_THRUST, now_s, at_min_thrust, NO_ALTITUDE_S)
    is_rotating = math.hypot(roll_rate, pitch_rate) > limits[_ROTATION_MAX] * landed_factor
    supported = state[CONTACT] != 0.0 if vertical_known else state[_AT_MIN_THRUST] != 0.0
    at_rest = at_min_thrust and not is_rotating and supported
    _debounce(state, MAYBE_LANDED, now_s, not armed or at_rest, stage_s)
    _debounce(state, LANDED, now_s, not armed or state[MAYBE_LANDED] != 0.0, stage_s)
