"""The trail of a vehicle; and telemetry, which is received at 10 to 50 Hz and drawn at 30 Hz, smoothed by a
short first-order lag."""

from __future__ import annotations

import math
from collections import deque
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


SPACING_M = 0.5
NEIGHBOURS = 24
"""A new point must be at least `SPACING_M` from each of this number of newest points, so that a drifting
hover produces few lines."""
MAX_POINTS = 512
JUMP_M = 50.0
"""A larger step between two updates is not a flight: the estimator was reset, or the log was rewound [m]."""


class Trail:
    """Points at least `SPACING_M` from the newest points; when the trail is full, its older half is thinned.

    `recent` contains the newest points, at most `RECENT_POINTS`; `sealed` contains all older points. Each
    change of `sealed` increments `version`, so that a view sends `sealed` only once per version.
    """

    RECENT_POINTS = 32

    def __init__(self) -> None:
        self.sealed: list[Vector3] = []
        self.recent: list[Vector3] = []
        self._spacing_points: deque[Vector3] = deque(maxlen=NEIGHBOURS)
        self.version = 0
        """Counts the changes of `sealed`."""

    def add(self, position_enu_m: Vector3) -> bool:
        """Adds the vehicle's position; True if it was stored."""
        if not all(math.isfinite(c) for c in position_enu_m):
            return False
        if self._spacing_points and math.dist(self._spacing_points[-1], position_enu_m) > JUMP_M:
            self.clear()
        if any(math.dist(other, position_enu_m) < SPACING_M for other in reversed(self._spacing_points)):
            return False
        self._spacing_points.append(position_enu_m)
        self.recent.append(position_enu_m)
        if len(self.recent) >= self.RECENT_POINTS:
            self._seal()
        return True

    def clear(self) -> None:
        """Removes all points."""
        self.sealed, self.recent = [], []
        self._spacing_points.clear()
        self.version += 1

    def _seal(self) -> None:
        # The last point stays in `recent`, so that the line to the next point is drawn.
        self.sealed += self.recent if not self.sealed else self.recent[1:]
        self.recent = self.recent[-1:]
        if len(self.sealed) > MAX_POINTS:
            older, newer = self.sealed[: MAX_POINTS // 2], self.sealed[MAX_POINTS // 2 :]
            self.sealed = older[::2] + newer
        self.version += 1
