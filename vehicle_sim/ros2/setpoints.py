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

Values = Mapping[str, Any]
STICK_RANGE = 1000.0
MAX_RATE_RAD_S = 50.0
KINDS = {
    "position": SetpointKind.POSITION,
    "velocity": SetpointKind.VELOCITY,
    "acceleration": SetpointKind.ACCELERATION,
    "attitude": SetpointKind.ATTITUDE,
    "body_rate": SetpointKind.RATES,
    "thrust_and_torque": SetpointKind.THRUST_TORQUE,
    "direct_actuator": SetpointKind.ACTUATORS,
}
"""Kind of setpoint by flag of OffboardControlMode; the first flag that is set counts."""


class SetpointInputs:
    """Passes each message to the autopilot of one vehicle."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._thrust_frd: Vector = (0.0, 0.0, 0.0)
        self.receivers: dict[str, Callable[[Values], None]] = {
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

    def _control_mode(self, v: Values) -> None:
        kind = next((kind for flag, kind in KINDS.items() if v[flag]), SetpointKind.NONE)
        self._autopilot.offboard.receive_control_mode(kind)

    def _trajectory(self, v: Values) -> None:
        position, velocity, acceleration = (_limited(v[n]) for n in ("position", "velocity", "acceleration"))
        kind = trajectory_kind(position, velocity, acceleration)
        # A setpoint with only NaN is valid too: the position controller then keeps the velocity at zero.
        kind = SetpointKind.ACCELERATION if kind is SetpointKind.NONE else kind
        (yaw_rad, yaw_rate_rad_s, _) = _limited((v["yaw"], v["yawspeed"], 0.0))
        self._autopilot.apply_topic_setpoint(
            Setpoint(kind, position, velocity, acceleration, yaw_rad, yaw_rate_rad_s)
        )

    def _attitude(self, v: Values) -> None:
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

    def _rates(self, v: Values) -> None:
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

    def _thrust(self, v: Values) -> None:
        """Stores the thrust, which is applied with the next torque setpoint."""
        self._thrust_frd = v["xyz"]

    def _torque(self, v: Values) -> None:
        self._autopilot.apply_topic_setpoint(thrust_torque_setpoint(self._thrust_frd, v["xyz"]))

    def _motors(self, v: Values) -> None:
        self._autopilot.apply_topic_setpoint(motor_setpoint(v["control"][:ROTOR_COUNT]))

    def _goto(self, v: Values) -> None:
        self._autopilot.receive_goto(
            Goto(
                _limited(v["position"]),
                v["heading"] if v["flag_control_heading"] else math.nan,
                _speed(v["max_horizontal_speed"]) if v["flag_set_max_horizontal_speed"] else math.nan,
                _speed(v["max_vertical_speed"]) if v["flag_set_max_vertical_speed"] else math.nan,
            )
        )

    def _sticks(self, v: Values) -> None:
        if not v["valid"]:
            return
        autopilot = self._autopilot
        throttle = 0.5 * (v["throttle"] + 1.0)
        axes = (v["pitch"], v["roll"], throttle, v["yaw"])
        if not all(abs(each) <= 1.0 for each in axes):
            return
        pitch, roll, stick_throttle, yaw = (round(each * STICK_RANGE) for each in axes)
        if autopilot.sticks.receive(pitch, roll, stick_throttle, yaw):
            autopilot.commander.checks.manual_control_at_s = autopilot.view.time_s
            autopilot.commander.on_stick_input()


def _limited(values: tuple[float, ...]) -> Vector:
    """Replaces infinite values by NaN, and limits finite values to a plausible range."""
    x, y, z = (max(-LIMIT, min(LIMIT, each)) if math.isfinite(each) else math.nan for each in values)
    return x, y, z


def _speed(speed_m_s: float) -> float:
    return speed_m_s if 0.0 < speed_m_s < LIMIT else math.nan
