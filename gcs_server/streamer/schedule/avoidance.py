"""Obstacle avoidance of one stream; runs after a setpoint is resolved and before it is limited."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from gcs_server.streamer.values.events import NOTICE, WARNING, StreamEvent
from gcs_server.streamer.values.snapshot import Snapshot
from missions.avoidance.avoider import Avoider
from missions.avoidance.values import (
    AdjustedMotion,
    AvoidanceState,
    AvoidanceWay,
    DetourLimits,
    MotionState,
    WantedMotion,
)
from missions.fence import FenceArea
from missions.frames import Vector3
from missions.setpoints import (
    DirectSetpoint,
    Position,
    PositionGlobal,
    Trajectory,
    Velocity,
    complete,
    zeros_for_none,
)

AHEAD_S = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0)
"""Times ahead at which a path is checked [s]."""
NOT_AVOIDED = "Avoidance does not apply to setpoints of this type; the obstacle brake still acts."
Later = Callable[[float], DirectSetpoint | None]
"""Returns the setpoint at a later time, for setpoints that change with time."""


@dataclass(frozen=True, slots=True)
class AvoidanceStatus:
    """The current state of avoidance."""

    state: AvoidanceState
    text: str
    """Message for the pilot; empty while the vehicle flies the requested setpoint."""
    way: AvoidanceWay | None = None
    """What avoidance tries first."""


class AvoidanceStage:
    """Avoidance of one stream; off until a snapshot or a mission switches it on."""

    def __init__(self) -> None:
        self._avoider: Avoider | None = None
        self._reports: list[StreamEvent] = []
        self.avoiding: AvoidanceStatus | None = None
        """None: off."""

    @property
    def way(self) -> AvoidanceWay | None:
        """What avoidance tries first; None: off."""
        return None if self._avoider is None else self._avoider.way

    @property
    def on_a_detour(self) -> bool:
        """Whether the vehicle flies a detour instead of the requested path."""
        return self.avoiding is not None and self.avoiding.state != "clear"

    def forget(self) -> None:
        """Resets, because a new stream begins or no setpoint is flown any more."""
        self._avoider = self.avoiding = None

    def take_reports(self) -> list[StreamEvent]:
        """Returns the reports since the last call."""
        taken, self._reports = self._reports, []
        return taken

    def apply(
        self,
        now_s: float,
        snapshot: Snapshot,
        requested: DirectSetpoint,
        later: Later | None,
        way: AvoidanceWay | None,
        fence: FenceArea | None = None,
    ) -> DirectSetpoint:
        """The setpoint to send instead of the requested one.

        Args:
            now_s: monotonic time.
            snapshot: the vehicle, with its sensors' scans.
            requested: the currently requested setpoint.
            later: returns the requested setpoint at later times; None: it does not change.
            way: what to try first (over or around); None: avoidance is off.
            fence: geofence of the mission being flown.
        """
        if way is None:
            self.forget()
            return requested
        if self._avoider is None or self._avoider.way != way:
            self._avoider = Avoider(way)
        target = _target(requested, snapshot)
        if target is None:
            self._report(AvoidanceStatus("clear", NOT_AVOIDED))
            return requested
        motion = _motion(now_s, snapshot)
        if motion is None:
            self._report(AvoidanceStatus("stopped", "No valid position estimate: the vehicle is stopped."))
            return Velocity((0.0, 0.0, 0.0), yaw_rate_ned_rad_s=0.0)
        feed = (
            zeros_for_none(requested.velocity_ned_m_s)
            if isinstance(requested, Trajectory)
            else (0.0, 0.0, 0.0)
        )
        yaw = getattr(requested, "yaw_ned_rad", None)
        wanted = WantedMotion(target, feed, yaw, _future_targets(now_s, later, snapshot))
        adjusted = self._avoider.adjust(
            now_s, motion, wanted, snapshot.scans, _detour_limits(snapshot, fence)
        )
        self._report(AvoidanceStatus(adjusted.state, adjusted.text))
        return _apply_adjustment(requested, adjusted)

    def _report(self, avoiding: AvoidanceStatus) -> None:
        before, self.avoiding = self.avoiding, replace(avoiding, way=self.way)
        if before is not None and before.state == avoiding.state:
            return
        if avoiding.state == "stopped":
            self._reports.append(StreamEvent("avoidance_stopped", WARNING, avoiding.text))
        elif avoiding.text:
            self._reports.append(StreamEvent("avoidance", NOTICE, avoiding.text))
        elif before is not None:
            self._reports.append(
                StreamEvent("avoidance", NOTICE, "The path is clear: following the setpoint.")
            )


def _apply_adjustment(requested: DirectSetpoint, adjusted: AdjustedMotion) -> DirectSetpoint:
    if adjusted.motion is not None:
        return adjusted.motion
    if adjusted.yaw_ned_rad is None:
        return requested
    # type: ignore[call-arg]
    return replace(requested, yaw_ned_rad=adjusted.yaw_ned_rad, yaw_rate_ned_rad_s=None)


def _target(setpoint: DirectSetpoint, snapshot: Snapshot) -> Vector3 | None:
    """Target position of a setpoint; None if it controls no position."""
    if isinstance(setpoint, Position | Trajectory):
        return complete(setpoint.position_ned_m)
    origin = snapshot.bounds.origin
    if isinstance(setpoint, PositionGlobal) and origin is not None and setpoint.alt_amsl_m is not None:
        return origin.to_ned(setpoint.lat_deg, setpoint.lon_deg, setpoint.alt_amsl_m)
    return None


def _future_targets(now_s: float, later: Later | None, snapshot: Snapshot) -> tuple[Vector3, ...]:
    if later is None:
        return ()
    later_setpoints = (later(now_s + ahead_s) for ahead_s in AHEAD_S)
    return tuple(
        target
        for each in later_setpoints
        if each is not None and (target := _target(each, snapshot)) is not None
    )


def _motion(now_s: float, snapshot: Snapshot) -> MotionState | None:
    position, velocity, yaw = snapshot.position_at(now_s), snapshot.velocity_ned_m_s, snapshot.yaw_ned_rad
    if position is None:
        return None
    return MotionState(position, velocity or (0.0, 0.0, 0.0), yaw or 0.0)


def _detour_limits(snapshot: Snapshot, fence: FenceArea | None) -> DetourLimits:
    bounds = snapshot.bounds
    return DetourLimits(
        min(bounds.speed_m_s, bounds.approach_m_s),
        min(bounds.climb_m_s, bounds.approach_climb_m_s),
        min(bounds.descent_m_s, bounds.approach_descent_m_s),
        bounds.region,
        fence,
    )
