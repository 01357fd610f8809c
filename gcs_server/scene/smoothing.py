"""Smooths telemetry, which is received at 10 to 50 Hz and drawn at 30 Hz, by a short first-order lag."""

from __future__ import annotations

import math
from dataclasses import replace

from gcs_server.scene.model import ROTOR_SPINS
from gcs_server.scene.pose import VehiclePose
from missions.frames import Quaternion, Vector3, normalized, yaw_from_q

LAG_S = 0.07
HEADING_LAG_S = 0.3
"""Lag of the chase camera's heading [s], because yaw estimates are noisy and the picture would shake."""
MIN_JUMP_M = 15.0
"""A larger change of the position in one step is a jump, which is shown without smoothing [m]."""
SPIN_HZ = 2.6
"""Drawn rotation rate of a rotor at full effort [Hz]; at the real rate of about 100 Hz it would seem to stand
still."""
MIN_DIFFERENCE = 1e-4
"""Difference (metres, radians, or of quaternions) below which the measured value is shown directly."""


class Smoother:
    """The drawn pose of one vehicle, and the angles of its rotors."""

    def __init__(self) -> None:
        self.pose: VehiclePose | None = None
        self.heading_enu_rad = 0.0
        """Smoothed heading of the chase camera."""
        self.rotor_angles_rad: tuple[float, ...] = (0.3, 1.1, 2.0, 2.7)

    def step(self, measured: VehiclePose, dt_s: float) -> VehiclePose:
        """The pose to draw, `dt_s` after the last call."""
        last = self.pose
        if measured.motors is not None and not measured.lost:
            self.rotor_angles_rad = tuple(
                (angle + spin * 2 * math.pi * SPIN_HZ * _visible_effort(effort) * dt_s) % (2 * math.pi)
                for angle, spin, effort in zip(
                    self.rotor_angles_rad, ROTOR_SPINS, measured.motors, strict=True
                )
            )
        if last is None or math.dist(last.position_enu_m, measured.position_enu_m) > MIN_JUMP_M:
            self.pose = measured
            self.heading_enu_rad = yaw_from_q(measured.q_enu_flu)
            return measured
        fraction = 1.0 - math.exp(-max(0.0, dt_s) / LAG_S)
        camera = measured.q_body_camera
        if camera is not None and last.q_body_camera is not None:
            camera = _interpolate_rotation(last.q_body_camera, camera, fraction)
        self.pose = replace(
            measured,
            position_enu_m=_interpolate(last.position_enu_m, measured.position_enu_m, fraction),
            q_enu_flu=_interpolate_rotation(last.q_enu_flu, measured.q_enu_flu, fraction),
            q_body_camera=camera,
        )
        self._update_heading(yaw_from_q(self.pose.q_enu_flu), dt_s)
        return self.pose

    def _update_heading(self, yaw_enu_rad: float, dt_s: float) -> None:
        difference = math.remainder(yaw_enu_rad - self.heading_enu_rad, 2 * math.pi)
        fraction = (
            1.0 - math.exp(-max(0.0, dt_s) / HEADING_LAG_S) if abs(difference) > MIN_DIFFERENCE else 1.0
        )
        self.heading_enu_rad = math.remainder(self.heading_enu_rad + difference * fraction, 2 * math.pi)


def _visible_effort(effort: float) -> float:
    # The square root makes the rotation visible while idling, and enlarges the differences while hovering.
    return math.sqrt(effort) if effort > 0.0 else 0.0


def _interpolate(a: Vector3, b: Vector3, fraction: float) -> Vector3:
    if math.dist(a, b) < MIN_DIFFERENCE:
        return b
    return (a[0] + (b[0] - a[0]) * fraction, a[1] + (b[1] - a[1]) * fraction, a[2] + (b[2] - a[2]) * fraction)


def _interpolate_rotation(a: Quaternion, b: Quaternion, fraction: float) -> Quaternion:
    dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    if abs(dot) > 1.0 - MIN_DIFFERENCE * MIN_DIFFERENCE:
        return b
    s = math.copysign(fraction, dot)
    mixed = tuple(x * (1.0 - fraction) + y * s for x, y in zip(a, b, strict=True))
    return normalized((mixed[0], mixed[1], mixed[2], mixed[3])) or b
