"""The pilot's sticks from MANUAL_CONTROL: dead zone, expo, validity, and takeover of automatic modes."""

from __future__ import annotations

import math
from dataclasses import dataclass

from vehicle_sim.vehicle_view import VehicleView

AXIS_MAX = 1000.0
AXIS_MISSING = 32767
"""Values of a MANUAL_CONTROL axis: full deflection, and axis not available."""
JOYSTICK_MODES = frozenset({1, 2, 3, 5, 6, 7, 8})
"""Values of COM_RC_IN_MODE with which PX4 accepts MANUAL_CONTROL."""
EXPO = 0.6
"""Expo of all sticks in PX4 v1.17, which has no parameters for it."""
OVERRIDE_AUTO, OVERRIDE_OFFBOARD = 1, 2
"""Bits of COM_RC_OVERRIDE."""


@dataclass(frozen=True, slots=True)
class Deflection:
    """Stick positions, -1..1; positive is pitch forward, roll right, yaw clockwise, throttle up."""

    forward: float = 0.0
    right: float = 0.0
    yaw: float = 0.0
    throttle: float = 0.0


class Sticks:
    """The sticks of one vehicle."""

    def __init__(self, view: VehicleView) -> None:
        self._view = view
        self.raw = Deflection()
        self.received_at_s = -math.inf
        self.moved = False
        """Whether a stick has moved faster than COM_RC_STICK_OV since the autopilot cleared this flag."""

    def receive(self, x: int, y: int, z: int, r: int) -> bool:
        """Handles the axes of one MANUAL_CONTROL.

        Returns:
            False if sticks are disabled or an axis is not available.
        """
        if self._view.choice("COM_RC_IN_MODE") not in JOYSTICK_MODES or AXIS_MISSING in (x, y, z, r):
            return False
        throttle = 2.0 * z / AXIS_MAX - 1.0
        new = Deflection(*(_clamped(value) for value in (x / AXIS_MAX, y / AXIS_MAX, r / AXIS_MAX, throttle)))
        now_s = self._view.time_s
        since_s = now_s - self.received_at_s
        if self.valid and since_s > 0.0:
            threshold_per_s = 0.01 * self._view.parameter("COM_RC_STICK_OV")
            changes = (new.forward - self.raw.forward, new.right - self.raw.right, new.yaw - self.raw.yaw)
            self.moved = self.moved or any(abs(change) / since_s > threshold_per_s for change in changes)
        self.raw, self.received_at_s = new, now_s
        return True

    @property
    def valid(self) -> bool:
        """Whether stick input was received within COM_RC_LOSS_T."""
        return self._view.time_s - self.received_at_s < max(0.0, self._view.parameter("COM_RC_LOSS_T"))

    def takes_over(self, *, offboard: bool) -> bool:
        """Whether the pilot has moved a stick, and COM_RC_OVERRIDE allows a takeover; clears `moved`."""
        moved, self.moved = self.moved, False
        bit = OVERRIDE_OFFBOARD if offboard else OVERRIDE_AUTO
        return moved and self.valid and bool(self._view.choice("COM_RC_OVERRIDE") & bit)

    def shaped(self) -> Deflection:
        """Stick positions after dead zone and expo, for Position and Altitude modes."""
        parameter, raw = self._view.parameter, self.raw
        if "MAN_DEADZONE" in self._view.parameters:  # from PX4 v1.17 on
            dead_zone, expo_xy, expo_z, expo_yaw = parameter("MAN_DEADZONE"), EXPO, EXPO, EXPO
        else:
            dead_zone, expo_xy, expo_z, expo_yaw = (
                parameter(name)
                for name in ("MPC_HOLD_DZ", "MPC_XY_MAN_EXPO", "MPC_Z_MAN_EXPO", "MPC_YAW_EXPO")
            )
        return Deflection(
            _expo(_dead_zone(raw.forward, dead_zone), expo_xy),
            _expo(_dead_zone(raw.right, dead_zone), expo_xy),
            _expo(_dead_zone(raw.yaw, dead_zone), expo_yaw),
            _expo(_dead_zone(raw.throttle, dead_zone), expo_z),
        )

    def acro_rates_rad_s(self) -> tuple[float, float, float]:
        """Body rate setpoints of Acro (MC_ACRO_*)."""
        parameter, raw = self._view.parameter, self.raw
        expo, super_expo = parameter("MC_ACRO_EXPO"), parameter("MC_ACRO_SUPEXPO")
        expo_y, super_y = parameter("MC_ACRO_EXPO_Y"), parameter("MC_ACRO_SUPEXPOY")
        max_rates = [math.radians(parameter(f"MC_ACRO_{axis}_MAX")) for axis in "RPY"]
        return (
            _super_expo(raw.right, expo, super_expo) * max_rates[0],
            _super_expo(-raw.forward, expo, super_expo) * max_rates[1],
            _super_expo(raw.yaw, expo_y, super_y) * max_rates[2],
        )

    def thrust(self, hover_thrust: float) -> float:
        """Collective thrust in Stabilized mode; MPC_THR_CURVE: the stick centre is hover thrust (0) or half
        thrust (1)."""
        parameter = self._view.parameter
        throttle = 0.5 * (self.raw.throttle + 1.0)
        lowest, highest = parameter("MPC_MANTHR_MIN"), parameter("MPC_THR_MAX")
        if self._view.choice("MPC_THR_CURVE") != 0:
            return lowest + throttle * (highest - lowest)
        if throttle < 0.5:
            return lowest + 2.0 * throttle * (hover_thrust - lowest)
        return hover_thrust + (2.0 * throttle - 1.0) * (highest - hover_thrust)


def _clamped(value: float) -> float:
    return max(-1.0, min(1.0, value))


def _dead_zone(value: float, zone: float) -> float:
    if abs(value) <= zone or zone >= 1.0:
        return 0.0
    return (value - math.copysign(zone, value)) / (1.0 - zone)


def _expo(value: float, expo: float) -> float:
    return (1.0 - expo) * value + expo * value**3


def _super_expo(value: float, expo: float, super_expo: float) -> float:
    return _expo(value, expo) * (1.0 - super_expo) / (1.0 - abs(value) * super_expo)
