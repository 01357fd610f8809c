"""Obstacle avoidance of a stream of setpoints: replaces setpoints that control a position."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from missions.avoidance.avoider import Avoider
from missions.avoidance.scans import Scan
from missions.avoidance.values import (
    AdjustedMotion,
    AvoidanceState,
    AvoidanceWay,
    DetourLimits,
    MotionState,
    WantedMotion,
)
from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.setpoints import (
    DirectSetpoint,
    Position,
    PositionGlobal,
    Trajectory,
    Velocity,
    complete_vector,
    zeros_for_none,
)

AHEAD_S = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0)
"""Times ahead at which a path is checked [s]."""
NOT_APPLICABLE = "Avoidance does not apply to setpoints of this type; the obstacle brake still acts."
SetpointAt = Callable[[float], DirectSetpoint | None]
"""Returns the setpoint at a later time, for setpoints that change with time."""


@dataclass(frozen=True, slots=True)
class AvoidanceStatus:
    """The current state of avoidance."""

    state: AvoidanceState
    text: str
    """Message for the pilot; empty while the vehicle flies the requested setpoint."""
    way: AvoidanceWay | None = None
    """What avoidance tries first."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Motion of the vehicle, measurements of its sensors, and limits of a detour."""

    motion: MotionState | None
    """None: no valid position estimate."""
    scans: tuple[Scan, ...]
    """The newest scan of each sensor."""
    limits: DetourLimits
    origin: LocalOrigin | None = None
    """Origin of the local frame; None: unknown, and setpoints with a global position are not changed."""


class SetpointAvoidance:
    """Avoidance of one vehicle's setpoints; off until `apply` is called with a way."""

    def __init__(self) -> None:
        self._avoider: Avoider | None = None
        self.status: AvoidanceStatus | None = None
        """None: off."""

    @property
    def way(self) -> AvoidanceWay | None:
        """What avoidance tries first; None: off."""
        return None if self._avoider is None else self._avoider.way

    @property
    def is_on_detour(self) -> bool:
        """Whether the vehicle flies a detour instead of the requested path."""
        return self.status is not None and self.status.state != "clear"

    def reset(self) -> None:
        """Switches avoidance off and forgets all obstacles: a new stream begins, or no setpoint is flown."""
        self._avoider = self.status = None

    def apply(
        self,
        now_s: float,
        requested: DirectSetpoint,
        later: SetpointAt | None,
        way: AvoidanceWay | None,
        surroundings: Callable[[], Surroundings],
    ) -> DirectSetpoint:
        """The setpoint to send instead of the requested one.

        Args:
            now_s: monotonic time, on the same clock as the scans.
            requested: the currently requested setpoint.
            later: returns the requested setpoint at later times; None: the setpoint does not change.
            way: what avoidance tries first, over or around; None: avoidance is off.
            surroundings: returns the vehicle and its surroundings; called only while avoidance is on.
        """
        if way is None:
            self.reset()
            return requested
        if self._avoider is None or self._avoider.way != way:
            self._avoider = Avoider(way)
        current = surroundings()
        target = _target(requested, current.origin)
        if target is None:
            self._set("clear", NOT_APPLICABLE)
            return requested
        if current.motion is None:
            self._set("stopped", "No valid position estimate: the vehicle is stopped.")
            return Velocity((0.0, 0.0, 0.0), yaw_rate_ned_rad_s=0.0)
        feed_forward = (
            zeros_for_none(requested.velocity_ned_m_s)
            if isinstance(requested, Trajectory)
            else (0.0, 0.0, 0.0)
        )
        yaw = getattr(requested, "yaw_ned_rad", None)
        wanted = WantedMotion(target, feed_forward, yaw, _future_targets(now_s, later, current.origin))
        adjusted = self._avoider.adjust(now_s, current.motion, wanted, current.scans, current.limits)
        self._set(adjusted.state, adjusted.text)
        return _apply_adjustment(requested, adjusted)

    def _set(self, state: AvoidanceState, text: str) -> None:
        self.status = AvoidanceStatus(state, text, self.way)


def _apply_adjustment(requested: DirectSetpoint, adjusted: AdjustedMotion) -> DirectSetpoint:
    if adjusted.motion is not None:
        return adjusted.motion
    if adjusted.yaw_ned_rad is None:
        return requested
    # type: ignore[call-arg]
    return replace(requested, yaw_ned_rad=adjusted.yaw_ned_rad, yaw_rate_ned_rad_s=None)


def _target(setpoint: DirectSetpoint, origin: LocalOrigin | None) -> Vector3 | None:
    """Target position of a setpoint; None: the setpoint controls no position."""
    if isinstance(setpoint, Position | Trajectory):
        return complete_vector(setpoint.position_ned_m)
    if isinstance(setpoint, PositionGlobal) and origin is not None and setpoint.alt_amsl_m is not None:
        return origin.to_ned(setpoint.lat_deg, setpoint.lon_deg, setpoint.alt_amsl_m)
    return None


def _future_targets(
    now_s: float, later: SetpointAt | None, origin: LocalOrigin | None
) -> tuple[Vector3, ...]:
    if later is None:
        return ()
    later_setpoints = (later(now_s + ahead_s) for ahead_s in AHEAD_S)
    return tuple(
        target
        for each in later_setpoints
        if each is not None and (target := _target(each, origin)) is not None
    )
