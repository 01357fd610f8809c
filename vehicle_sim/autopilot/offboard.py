"""Offboard setpoints: decodes masks and frames like PX4, and detects a lost stream."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from enum import Enum
from typing import NamedTuple

from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.control.setpoints import ControlLevel
from vehicle_sim.external_modes.slots import Controllers
from vehicle_sim.geodesy import to_local
from vehicle_sim.state import ROTOR_COUNT
from vehicle_sim.vehicle_view import VehicleView

NAN3 = (math.nan, math.nan, math.nan)
Vector = tuple[float, float, float]

POSITION_BITS, VELOCITY_BITS, ACCELERATION_BITS = 0b111, 0b111 << 3, 0b111 << 6
FORCE_BIT, YAW_BIT, YAW_RATE_BIT = 512, 1024, 2048
"""POSITION_TARGET_TYPEMASK: values to ignore; FORCE_BIT: the acceleration is a force."""
ROLL_PITCH_RATE_BITS, BODY_YAW_RATE_BIT, THRUST_BIT, ATTITUDE_BIT = 3, 4, 64, 128
"""ATTITUDE_TARGET_TYPEMASK: values to ignore."""
LOCAL_NED, BODY_NED, GLOBAL_AMSL, GLOBAL_RELATIVE, GLOBAL_TERRAIN = 1, 8, 5, 6, 11
"""MAV_FRAME."""
LIMIT = 1e6
"""Largest accepted value of a setpoint [m, m/s, rad]."""
PUBLISH_EVERY_S = 0.504
"""Measured; so the moment of an update drifts against a sequence of steps of whole seconds."""


class ControlMode:
    """The control level that PX4 publishes to the controllers of one vehicle.

    After a change from position to attitude setpoints, both controllers are therefore active for up to half a
    second: the position controller continues, and each attitude setpoint replaces its output until its next
    output, as recorded on PX4.
    """

    def __init__(self) -> None:
        self.level = ControlLevel.TRAJECTORY
        self._state: object = None
        self._due_s = -math.inf

    def update(self, now_s: float, level: ControlLevel, state: object) -> ControlLevel:
        """Publishes the level every PUBLISH_EVERY_S, and when `state` (arming, mode, failsafe) changes."""
        if state != self._state:
            self._state, self._due_s = state, now_s
        if now_s >= self._due_s - 1e-6:
            # From the time at which it was due, so that the period does not become a multiple of the tick.
            self._due_s, self.level = max(self._due_s, now_s - PUBLISH_EVERY_S) + PUBLISH_EVERY_S, level
        return self.level


class SetpointKind(Enum):
    """The highest-level quantity that a stream of setpoints controls; `level` is the setpoints' level."""

    NONE = "none"
    POSITION = "position"
    VELOCITY = "velocity"
    ACCELERATION = "acceleration"
    ATTITUDE = "attitude"
    RATES = "rates"
    THRUST_TORQUE = "thrust_torque"
    ACTUATORS = "actuators"

    def __init__(self, name: str) -> None:
        level = "motors" if name == "actuators" else name
        self.level = ControlLevel.__members__.get(level.upper(), ControlLevel.TRAJECTORY)


class Setpoint(NamedTuple):
    """A setpoint; NaN: not controlled. A tuple, because tuples are fast to create."""

    kind: SetpointKind = SetpointKind.NONE
    position_ned_m: Vector = NAN3
    velocity_ned_m_s: Vector = NAN3
    acceleration_ned_m_s2: Vector = NAN3
    yaw_ned_rad: float = math.nan
    yaw_rate_ned_rad_s: float = math.nan
    q_ned_frd: tuple[float, float, float, float] | None = None
    thrust: float = 0.0
    rates_frd_rad_s: Vector = (0.0, 0.0, 0.0)
    torque_frd: Vector = (0.0, 0.0, 0.0)
    """Normalised, -1..1."""
    motors: tuple[float, ...] = ()
    """0..1 each; NaN: the motor is stopped."""

    @property
    def is_complete(self) -> bool:
        """Whether each axis has a value, and the same quantities are set for north and east.

        The position controller uses only complete setpoints; others stop the vehicle (velocity zero).
        """
        finite = math.isfinite
        (n, e, d), (vn, ve, vd), (an, ae, ad) = (
            self.position_ned_m, self.velocity_ned_m_s, self.acceleration_ned_m_s2,
        )  # fmt: skip
        if finite(n + e + d + vn + ve + vd + an + ae + ad):  # the usual case: all are finite
            return True
        position, velocity, acceleration = finite(n), finite(vn), finite(an)
        pairs_equal = position is finite(e) and velocity is finite(ve) and acceleration is finite(ae)
        has_vertical = finite(d) or finite(vd) or finite(ad)
        return pairs_equal and (position or velocity or acceleration) and has_vertical


def _any_finite(values: Vector) -> bool:
    x, y, z = values
    return math.isfinite(x) or math.isfinite(y) or math.isfinite(z)


def _rotate(q: tuple[float, float, float, float], v: Vector) -> Vector:
    """Rotates a vector by a unit quaternion (w, x, y, z)."""
    w, x, y, z = q
    tx, ty, tz = 2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0])
    return (
        v[0] + w * tx + y * tz - z * ty,
        v[1] + w * ty + z * tx - x * tz,
        v[2] + w * tz + x * ty - y * tx,
    )


class Offboard:
    """The offboard receiver of one vehicle."""

    def __init__(self, view: VehicleView, announcer: Announcer) -> None:
        self._view = view
        self._announcer = announcer
        self._received_at_s = -math.inf
        self._selected_kind: SetpointKind | None = None
        """Kind that OffboardControlMode or an external mode selects; None: the kind of MAVLink setpoints."""
        self._offboard_kind: SetpointKind | None = None
        """Kind of the Offboard stream, saved while an external mode is active; None: no external mode is
        active."""
        self._topic_setpoints: dict[ControlLevel, Setpoint] = {}
        """Newest setpoints of the uORB topics, by control level."""
        self.setpoint = Setpoint()
        self.invalid_attitude: tuple[float, float, float, float] | None = None
        """The newest attitude if invalid (zeros or NaN); PX4 reports this attitude, but does not use it."""
        self.reported_thrust = math.nan
        """Thrust of the newest attitude or rates message; PX4 reports it without its sign."""
        self.invalid = False
        """Whether the newest setpoint is invalid; the vehicle then descends with level attitude."""
        self.on_setpoint: Callable[[], None] = _no_listener
        """Called at each attitude, rate, torque or motor setpoint, because these are applied immediately."""

    @property
    def received_at_s(self) -> float:
        """Time since boot of the newest setpoint; -inf: none."""
        return self._received_at_s

    def has_signal(self) -> bool:
        """Whether a valid setpoint was received within COM_OF_LOSS_T."""
        loss_s = max(0.0, self._view.parameter("COM_OF_LOSS_T"))
        return self._view.time_s - self._received_at_s < loss_s

    def receive_control_mode(self, kind: SetpointKind) -> None:
        """Handles OffboardControlMode: keeps Offboard active, and selects the setpoints to use.

        Args:
            kind: the first flag that is set; NONE: no flag is set, which counts as no signal.
        """
        self._received_at_s = -math.inf if kind is SetpointKind.NONE else self._view.time_s
        self._selected_kind = kind
        self._apply_selection()

    def select_kind(self, kind: SetpointKind) -> None:
        """Selects the kind of setpoints that an external mode sends, without OffboardControlMode."""
        if self._offboard_kind is None or self._selected_kind is not kind:
            self._offboard_kind, self._selected_kind = self.kind, kind
            self._apply_selection()

    def restore_kind(self) -> None:
        """Called when no external mode is active: restores the kind of the Offboard stream."""
        kind = self._offboard_kind
        if kind is None:
            return
        self._offboard_kind, self._selected_kind, self.setpoint = None, None, Setpoint()
        if kind is not SetpointKind.NONE:
            self._selected_kind = kind
            self._apply_selection()

    def store_topic_setpoint(self, setpoint: Setpoint) -> None:
        """Stores a setpoint of a uORB topic; Offboard uses it if OffboardControlMode selects its level."""
        self._topic_setpoints[setpoint.kind.level] = setpoint
        if self._selected_kind is not None:
            self._apply_selection()

    @property
    def has_topic_setpoints(self) -> bool:
        """Whether setpoints of uORB topics were received since Offboard or an external mode became active."""
        return bool(self._topic_setpoints)

    def clear_topic_setpoints(self) -> None:
        """Called when another mode is active: deletes the setpoints of the uORB topics."""
        if self._topic_setpoints:
            self._topic_setpoints.clear()
            if self._selected_kind is not None:
                self._apply_selection()

    def _apply_selection(self) -> None:
        self.setpoint = self._topic_setpoints.get(self.level, Setpoint())
        self.invalid, self.invalid_attitude = False, None

    @property
    def kind(self) -> SetpointKind:
        """Kind of the setpoints that are used in Offboard."""
        return self.setpoint.kind if self._selected_kind is None else self._selected_kind

    @property
    def awaits_setpoint(self) -> bool:
        """Whether no setpoint of the selected level was received yet; the last outputs then stay active."""
        return self._selected_kind is not None and self.setpoint.kind is SetpointKind.NONE

    def receive_local_target(
        self, frame: int, mask: int, p: Vector, v: Vector, a: Vector, yaw_rad: float, yaw_rate_rad_s: float
    ) -> None:
        """Handles SET_POSITION_TARGET_LOCAL_NED; `p`, `v` and `a` are position, velocity and acceleration."""
        if frame not in (LOCAL_NED, BODY_NED):
            self.invalid = True
            self._announcer.announce(
                2,
                f"SET_POSITION_TARGET_LOCAL_NED coordinate frame {frame} unsupported",
                "mavlink_rcv_sp_target_unsup_coord",
                "B",
                frame,
            )
            return
        position, velocity, acceleration = _masked(mask, p), _masked(mask >> 3, v), _masked(mask >> 6, a)
        if frame == BODY_NED:
            position = NAN3
            q_ned_frd = self._view.estimate.q_ned_frd
            velocity = NAN3 if mask & VELOCITY_BITS else self._rotate_by_yaw(velocity)
            acceleration = NAN3 if mask & ACCELERATION_BITS else _rotate(q_ned_frd, acceleration)
        valid = not (mask & FORCE_BIT and _any_finite(acceleration))
        yaw = _yaw(mask, yaw_rad, yaw_rate_rad_s)
        self.trajectory(trajectory_setpoint(position, velocity, acceleration, *yaw), valid=valid, report=True)

    def receive_global_target(
        self,
        frame: int,
        mask: int,
        lat_lon_alt: Vector,
        home_alt_amsl_m: float,
        v: Vector,
        a: Vector,
        yaw_rad: float,
        yaw_rate_rad_s: float,
    ) -> None:
        """Handles SET_POSITION_TARGET_GLOBAL_INT; altitudes are above mean sea level, above the local origin
        (relative frame) or above home (terrain frame)."""
        if frame not in (GLOBAL_AMSL, GLOBAL_RELATIVE, GLOBAL_TERRAIN):
            self.invalid = True
            self._announcer.announce(
                2,
                f"SET_POSITION_TARGET_GLOBAL_INT invalid coordinate frame {frame}",
                "mavlink_rcv_sp_target_gl_invalid_coord",
                "B",
                frame,
            )
            return
        lat_deg, lon_deg, alt_m = lat_lon_alt
        origin_lat, origin_lon, origin_alt = self._view.origin
        position = NAN3
        if not mask & POSITION_BITS and math.isfinite(origin_lat):
            north, east = to_local(lat_deg, lon_deg, origin_lat, origin_lon)  # type: ignore[arg-type]
            down = -(alt_m - origin_alt) if frame == GLOBAL_AMSL else -alt_m
            if frame == GLOBAL_TERRAIN:
                down = -(alt_m + home_alt_amsl_m - origin_alt)
            position = (float(north), float(east), down)
        velocity, acceleration = _masked(mask >> 3, v), _masked(mask >> 6, a)
        yaw = _yaw(mask, yaw_rad, yaw_rate_rad_s)
        self.trajectory(trajectory_setpoint(position, velocity, acceleration, *yaw))

    def attitude(self, mask: int, q: tuple[float, float, float, float], rates: Vector, thrust: float) -> None:
        """Handles SET_ATTITUDE_TARGET: attitude and thrust, or body rates and thrust."""
        self._selected_kind = None
        limited_thrust = min(1.0, max(0.0, thrust)) if math.isfinite(thrust) else 0.0
        self.reported_thrust = 0.0 if mask & THRUST_BIT else abs(thrust)
        thrust = self.setpoint.thrust if mask & THRUST_BIT else limited_thrust
        norm = math.sqrt(sum(each * each for each in q))
        self._received_at_s = self._view.time_s
        self.invalid_attitude = None
        if not mask & ATTITUDE_BIT:
            if not math.isfinite(norm) or norm < 1e-6:
                self.invalid_attitude = q
                return
            unit_q = (q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm)
            yaw_rate = math.nan if mask & BODY_YAW_RATE_BIT else _limit(rates[2])
            self.setpoint = Setpoint(
                SetpointKind.ATTITUDE, q_ned_frd=unit_q, thrust=thrust, yaw_rate_ned_rad_s=yaw_rate
            )
        elif not mask & ROLL_PITCH_RATE_BITS:
            x, y, z = (max(-50.0, min(50.0, each)) if math.isfinite(each) else 0.0 for each in rates)
            self.setpoint = Setpoint(SetpointKind.RATES, rates_frd_rad_s=(x, y, z), thrust=thrust)
        self.invalid = False
        self.on_setpoint()

    def thrust_torque(self, thrust_frd: Vector, torque_frd: Vector) -> None:
        """Applies thrust and torque setpoints, each -1..1 in FRD.

        Rotors only lift, so only the upward part (-z) of the thrust has an effect; NaN counts as zero.
        """
        self._apply_direct_setpoint(thrust_torque_setpoint(thrust_frd, torque_frd))

    def actuators(self, motors: Sequence[float]) -> None:
        """Applies up to `ROTOR_COUNT` motor signals, each -1..1.

        NaN, a missing value and a negative value (these motors do not reverse) disarm a motor.

        Raises:
            ValueError: more motors than the airframe has.
        """
        if len(motors) > ROTOR_COUNT:
            raise ValueError(f"{len(motors)} motor signals for {ROTOR_COUNT} motors; send one for each motor")
        self._apply_direct_setpoint(motor_setpoint(motors))

    def _apply_direct_setpoint(self, setpoint: Setpoint) -> None:
        self._received_at_s, self._selected_kind = self._view.time_s, None
        self.setpoint, self.invalid, self.invalid_attitude = setpoint, False, None
        self.on_setpoint()

    def _rotate_by_yaw(self, v: Vector) -> Vector:
        yaw = self._view.estimate.yaw_ned_rad
        c, s = math.cos(yaw), math.sin(yaw)
        return (c * v[0] - s * v[1], s * v[0] + c * v[1], v[2])

    def trajectory(self, setpoint: Setpoint, *, valid: bool = True, report: bool = False) -> None:
        """Applies a setpoint of `trajectory_setpoint`.

        Args:
            setpoint: the setpoint; invalid if it controls no quantity.
            valid: False if the setpoint is invalid for another reason.
            report: whether to report an invalid setpoint.
        """
        self._selected_kind, self.setpoint, self.invalid_attitude = None, setpoint, None
        self.invalid = setpoint.kind is SetpointKind.NONE or not valid
        if not self.invalid:
            self._received_at_s = self._view.time_s
        elif report:
            self._announcer.announce(
                2, "SET_POSITION_TARGET_LOCAL_NED invalid", "mavlink_rcv_sp_target_invalid"
            )

    @property
    def level(self) -> ControlLevel:
        """Control level of the setpoints that are used in Offboard."""
        return self.kind.level

    def wants_to_climb(self, z_ned_m: float) -> bool:
        """Whether the setpoint requires a take-off."""
        setpoint = self.setpoint
        return (
            setpoint.position_ned_m[2] < z_ned_m
            or setpoint.velocity_ned_m_s[2] < 0.0
            or setpoint.acceleration_ned_m_s2[2] < 0.0
        )


def kind_for_controllers(controllers: Controllers) -> SetpointKind:
    """The kind of setpoints that an external mode sends, by the controllers that the mode has selected."""
    if controllers.trajectory:
        return SetpointKind.POSITION
    if controllers.attitude:
        return SetpointKind.ATTITUDE
    if controllers.rates:
        return SetpointKind.RATES
    return SetpointKind.THRUST_TORQUE if controllers.allocation else SetpointKind.ACTUATORS


def trajectory_kind(position: Vector, velocity: Vector, acceleration: Vector) -> SetpointKind:
    """The highest-level quantity with a finite value."""
    if _any_finite(position):
        return SetpointKind.POSITION
    if _any_finite(velocity):
        return SetpointKind.VELOCITY
    return SetpointKind.ACCELERATION if _any_finite(acceleration) else SetpointKind.NONE


def trajectory_setpoint(
    position: Vector, velocity: Vector, acceleration: Vector, yaw_rad: float, yaw_rate_rad_s: float
) -> Setpoint:
    """Setpoint of the position controller in the local frame (NED, SI units); NaN: not controlled."""
    kind = trajectory_kind(position, velocity, acceleration)
    return Setpoint(kind, position, velocity, acceleration, yaw_rad, yaw_rate_rad_s)


def collective_thrust(thrust_frd: Vector) -> float:
    """Collective thrust 0..1 from a thrust vector: rotors only lift, and NaN counts as zero."""
    return max(0.0, min(1.0, -thrust_frd[2])) if math.isfinite(thrust_frd[2]) else 0.0


def thrust_torque_setpoint(thrust_frd: Vector, torque_frd: Vector) -> Setpoint:
    """Setpoint of normalised thrust and torques, -1..1; NaN counts as zero."""
    x, y, z = (max(-1.0, min(1.0, each)) if math.isfinite(each) else 0.0 for each in torque_frd)
    return Setpoint(SetpointKind.THRUST_TORQUE, thrust=collective_thrust(thrust_frd), torque_frd=(x, y, z))


def motor_setpoint(motors: Sequence[float]) -> Setpoint:
    """Setpoint of motor signals; NaN and negative values disarm a motor."""
    signals = tuple(min(1.0, each) if math.isfinite(each) and each >= 0.0 else math.nan for each in motors)
    return Setpoint(SetpointKind.ACTUATORS, motors=signals)


def _no_listener() -> None:
    """Default listener without effect."""


def _limit(value: float) -> float:
    """The value within ±LIMIT; NaN if the value is not finite."""
    return max(-LIMIT, min(LIMIT, value)) if math.isfinite(value) else math.nan


def _masked(ignored: int, values: Vector) -> Vector:
    """The limited values; NaN for each value whose bit in `ignored` is set (lowest bit: the first value)."""
    x, y, z = (math.nan if ignored >> n & 1 else _limit(value) for n, value in enumerate(values))
    return (x, y, z)


def _yaw(mask: int, yaw_rad: float, yaw_rate_rad_s: float) -> tuple[float, float]:
    """Yaw and yaw rate; NaN if the type mask ignores them."""
    return (
        math.nan if mask & YAW_BIT else _limit(yaw_rad),
        math.nan if mask & YAW_RATE_BIT else _limit(yaw_rate_rad_s),
    )
