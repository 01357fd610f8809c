"""Compares a stream with its requested rate, and the vehicle's state with the sent setpoints."""

from __future__ import annotations

import math

from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.streamer.offboard.failsafe import DEFAULT_COM_OF_LOSS_T_S, Failsafe
from gcs_server.streamer.offboard.status import Echo, StreamHealth
from gcs_server.streamer.schedule.scheduler import StreamState
from missions.frames import Quaternion, Vector3, ned_from_heading
from missions.setpoints import (
    Actuators,
    Attitude,
    DirectSetpoint,
    Partial3,
    Position,
    PositionGlobal,
    Rates,
    ThrustTorque,
    Trajectory,
    Velocity,
    VelocityBody,
    complete_vector,
)


def health_of(state: StreamState, estimates: VehicleEstimates, failsafe: Failsafe | None) -> StreamHealth:
    """Health of a stream, from its state and the vehicle's newest samples."""
    sent = state.sent
    loss_timeout_s = failsafe.loss_timeout_s if failsafe is not None else None
    left_s = None
    if state.sent_age_s is not None:
        left_s = (DEFAULT_COM_OF_LOSS_T_S if loss_timeout_s is None else loss_timeout_s) - state.sent_age_s
    attitude = estimates.attitude()
    return StreamHealth(
        rate_achieved_hz=state.rate_achieved_hz,
        setpoint_age_s=state.age_s,
        sent_age_s=state.sent_age_s,
        valid_left_s=state.valid_left_s,
        failsafe_in_s=None if left_s is None else max(0.0, left_s),
        echo=None if sent is None else _echo(sent, estimates),
        position_error_m=None if sent is None else _position_error(sent, estimates),
        velocity_error_m_s=None if sent is None else _velocity_error(sent, estimates),
        attitude_error_rad=(
            angle_between(sent.q_ned_frd, attitude.q_ned_frd)
            if isinstance(sent, Attitude) and attitude is not None
            else None
        ),
        yaw_error_rad=(
            None
            if attitude is None or (target := getattr(sent, "yaw_ned_rad", None)) is None
            else math.remainder(target - attitude.yaw_ned_rad, math.tau)
        ),
    )


def angle_between(a: Quaternion, b: Quaternion) -> float:
    """Angle of the single rotation between two attitudes [rad]."""
    dot = abs(sum(x * y for x, y in zip(a, b, strict=True)))
    return 2.0 * math.acos(min(1.0, dot))


def _echo(sent: DirectSetpoint, estimates: VehicleEstimates) -> Echo | None:
    if isinstance(sent, ThrustTorque | Actuators):
        return None  # PX4 reports no target of these types
    if isinstance(sent, Attitude | Rates):
        reported_attitude = estimates.target_attitude()
        if reported_attitude is None:
            return None
        attitude, age_s = reported_attitude
        return Echo(
            age_s,
            q_ned_frd=attitude.q_ned_frd,
            rates_frd_rad_s=attitude.rates_frd_rad_s,
            thrust=attitude.thrust,
        )
    reported = estimates.target_local()
    if reported is None:
        return None
    target, age_s = reported
    return Echo(
        age_s,
        target.position_ned_m,
        target.velocity_ned_m_s,
        target.acceleration_ned_m_s2,
        target.yaw_ned_rad,
    )


def _position_error(sent: DirectSetpoint, estimates: VehicleEstimates) -> float | None:
    local = estimates.local()
    if local is None:
        return None
    if isinstance(sent, PositionGlobal):
        origin = estimates.origin()
        if origin is None or sent.alt_amsl_m is None:
            return None
        return math.dist(origin.to_ned(sent.lat_deg, sent.lon_deg, sent.alt_amsl_m), local.position_ned_m)
    if not isinstance(sent, Position | Trajectory):
        return None
    return _distance(sent.position_ned_m, local.position_ned_m)


def _velocity_error(sent: DirectSetpoint, estimates: VehicleEstimates) -> float | None:
    local, attitude = estimates.local(), estimates.attitude()
    if local is None:
        return None
    if isinstance(sent, VelocityBody):
        if attitude is None:
            return None
        return math.dist(
            ned_from_heading(sent.velocity_frd_m_s, attitude.yaw_ned_rad), local.velocity_ned_m_s
        )
    if isinstance(sent, Velocity):
        return _distance(sent.velocity_ned_m_s, local.velocity_ned_m_s)
    if isinstance(sent, Trajectory) and complete_vector(sent.position_ned_m) is None:
        return _distance(sent.velocity_ned_m_s, local.velocity_ned_m_s)
    return None


def _distance(target: Partial3, measured: Vector3) -> float | None:
    """Distance over the controlled axes; None if no axis is controlled."""
    squares = [(t - m) ** 2 for t, m in zip(target, measured, strict=True) if t is not None]
    return math.sqrt(sum(squares)) if squares else None
