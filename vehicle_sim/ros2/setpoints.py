"""Converts ROS 2 messages with setpoints and stick positions to inputs of the autopilot."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.autopilot.goto import Goto
from vehicle_sim.autopilot.offboard import (
    LIMIT,
    Setpoint,
    SetpointKind,
    Vector,
    collective_thrust,
    motor_setpoint,
    thrust_torque_setpoint,
    trajectory_kind,
)
from vehicle_sim.state import ROTOR_COUNT

MessageValues = Mapping[str, Any]
STICK_RANGE = 1000.0
"""Full deflection of a stick in MANUAL_CONTROL."""
MAX_RATE_RAD_S = 50.0
KIND_BY_FLAG = {
    "position": SetpointKind.POSITION,
    "velocity": SetpointKind.VELOCITY,
    "acceleration": SetpointKind.ACCELERATION,
    "attitude": SetpointKind.ATTITUDE,
    "body_rate": SetpointKind.RATES,
    "thrust_and_torque": SetpointKind.THRUST_TORQUE,
    "direct_actuator": SetpointKind.ACTUATORS,
}
"""Kind of setpoint for each flag of OffboardControlMode; the first flag that is set applies."""


class SetpointInputs:
    """Passes the setpoints and stick positions that one vehicle receives to its autopilot."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._thrust_frd: Vector = (0.0, 0.0, 0.0)
        self.receivers: dict[str, Callable[[MessageValues], None]] = {
            "/fmu/in/manual_control_input": self._sticks,
            "/fmu/in/offboard_control_mode": self._control_mode,
            "/fmu/in/trajectory_setpoint": self._trajectory,
            "/fmu/in/vehicle_attitude_setpoint": self._attitude,
            "/fmu/in/vehicle_rates_setpoint": self._rates,
            "/fmu/in/vehicle_thrust_setpoint": self._thrust,
            "/fmu/in/vehicle_torque_setpoint": self._torque,
            "/fmu/in/actuator_motors": self._motors,
            "/fmu/in/goto_setpoint": self._goto,
        }

    def _control_mode(self, v: MessageValues) -> None:
        kind = next((kind for flag, kind in KIND_BY_FLAG.items() if v[flag]), SetpointKind.NONE)
        self._autopilot.offboard.receive_control_mode(kind)

    def _trajectory(self, v: MessageValues) -> None:
        position, velocity, acceleration = (
            _limited_vector(v[name]) for name in ("position", "velocity", "acceleration")
        )
        kind = trajectory_kind(position, velocity, acceleration)
        # A setpoint with only NaN is valid; the position controller then keeps the velocity at zero.
        kind = SetpointKind.ACCELERATION if kind is SetpointKind.NONE else kind
        yaw_rad, yaw_rate_rad_s = _limited(v["yaw"]), _limited(v["yawspeed"])
        self._autopilot.apply_topic_setpoint(
            Setpoint(kind, position, velocity, acceleration, yaw_rad, yaw_rate_rad_s)
        )

    def _attitude(self, v: MessageValues) -> None:
        w, x, y, z = v["q_d"]
        norm = math.sqrt(w * w + x * x + y * y + z * z)
        if not (math.isfinite(norm) and norm > 1e-6):
            return
        yaw_rate_rad_s = v["yaw_sp_move_rate"]
        self._autopilot.apply_topic_setpoint(
            Setpoint(
                SetpointKind.ATTITUDE, q_ned_frd=(w / norm, x / norm, y / norm, z / norm),
                thrust=collective_thrust(v["thrust_body"]),
                yaw_rate_ned_rad_s=yaw_rate_rad_s if abs(yaw_rate_rad_s) <= MAX_RATE_RAD_S else math.nan,
            )
        )  # fmt: skip

    def _rates(self, v: MessageValues) -> None:
        roll, pitch, yaw = (
            max(-MAX_RATE_RAD_S, min(MAX_RATE_RAD_S, v[axis])) if math.isfinite(v[axis]) else 0.0
            for axis in ("roll", "pitch", "yaw")
        )
        self._autopilot.apply_topic_setpoint(
            Setpoint(
                SetpointKind.RATES,
                rates_frd_rad_s=(roll, pitch, yaw),
                thrust=collective_thrust(v["thrust_body"]),
            )
        )

    def _thrust(self, v: MessageValues) -> None:
        """Stores the thrust, which is applied with the next torque setpoint."""
        self._thrust_frd = v["xyz"]

    def _torque(self, v: MessageValues) -> None:
        self._autopilot.apply_topic_setpoint(thrust_torque_setpoint(self._thrust_frd, v["xyz"]))

    def _motors(self, v: MessageValues) -> None:
        self._autopilot.apply_topic_setpoint(motor_setpoint(v["control"][:ROTOR_COUNT]))

    def _goto(self, v: MessageValues) -> None:
        self._autopilot.receive_goto(
            Goto(
                _limited_vector(v["position"]),
                v["heading"] if v["flag_control_heading"] else math.nan,
                _speed_limit(v["max_horizontal_speed"]) if v["flag_set_max_horizontal_speed"] else math.nan,
                _speed_limit(v["max_vertical_speed"]) if v["flag_set_max_vertical_speed"] else math.nan,
            )
        )

    def _sticks(self, v: MessageValues) -> None:
        if not v["valid"]:
            return
        autopilot = self._autopilot
        axes = (v["pitch"], v["roll"], 0.5 * (v["throttle"] + 1.0), v["yaw"])
        if not all(abs(axis) <= 1.0 for axis in axes):
            return
        pitch, roll, throttle, yaw = (round(axis * STICK_RANGE) for axis in axes)
        if autopilot.sticks.receive(pitch, roll, throttle, yaw):
            autopilot.commander.checks.manual_control_at_s = autopilot.view.time_s
            autopilot.commander.on_stick_input()


def _limited(value: float) -> float:
    """Replaces an infinite value by NaN, and clips a finite value to ±LIMIT."""
    return max(-LIMIT, min(LIMIT, value)) if math.isfinite(value) else math.nan


def _limited_vector(values: tuple[float, float, float]) -> Vector:
    x, y, z = values
    return _limited(x), _limited(y), _limited(z)


def _speed_limit(speed_m_s: float) -> float:
    """The speed limit; NaN (no limit) if the value is invalid."""
    return speed_m_s if 0.0 < speed_m_s < LIMIT else math.nan
