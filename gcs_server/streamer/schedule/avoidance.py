"""Obstacle avoidance of one stream: changes a setpoint after it is resolved and before it is limited."""

from __future__ import annotations

from gcs_server.streamer.values.events import NOTICE, WARNING, StreamEvent
from gcs_server.streamer.values.snapshot import Snapshot
from missions.avoidance.setpoints import AvoidanceStatus, SetpointAt, SetpointAvoidance, Surroundings
from missions.avoidance.values import AvoidanceWay, DetourLimits, MotionState
from missions.fence import FenceArea
from missions.setpoints import DirectSetpoint


class AvoidanceStage:
    """Avoidance of one stream; off until a snapshot or a mission switches it on."""

    def __init__(self) -> None:
        self._avoidance = SetpointAvoidance()
        self._reports: list[StreamEvent] = []

    @property
    def status(self) -> AvoidanceStatus | None:
        """The current state; None: avoidance is off."""
        return self._avoidance.status

    @property
    def way(self) -> AvoidanceWay | None:
        """What avoidance tries first; None: avoidance is off."""
        return self._avoidance.way

    @property
    def is_on_detour(self) -> bool:
        """Whether the vehicle flies a detour instead of the requested path."""
        return self._avoidance.is_on_detour

    def reset(self) -> None:
        """Resets avoidance: it is off, a new stream begins, or the accepted setpoint is no longer flown."""
        self._avoidance.reset()

    def take_reports(self) -> list[StreamEvent]:
        """Returns the reports since the last call."""
        reports, self._reports = self._reports, []
        return reports

    def apply(
        self,
        now_s: float,
        snapshot: Snapshot,
        requested: DirectSetpoint,
        later: SetpointAt | None,
        way: AvoidanceWay,
        fence: FenceArea | None = None,
    ) -> DirectSetpoint:
        """The setpoint to send instead of the requested one.

        Args:
            now_s: current time [s, monotonic].
            snapshot: the vehicle, with its sensors' scans.
            requested: the currently requested setpoint.
            later: returns the requested setpoint at later times; None: the setpoint does not change.
            way: what avoidance tries first (over or around).
            fence: geofence of the mission being flown.
        """

        def surroundings() -> Surroundings:
            limits = _detour_limits(snapshot, fence)
            return Surroundings(_motion(now_s, snapshot), snapshot.scans, limits, snapshot.bounds.origin)

        previous = self._avoidance.status
        setpoint = self._avoidance.apply(now_s, requested, later, way, surroundings)
        self._report(previous, self._avoidance.status)
        return setpoint

    def _report(self, previous: AvoidanceStatus | None, current: AvoidanceStatus | None) -> None:
        if current is None or (previous is not None and previous.state == current.state):
            return
        if current.state == "stopped":
            self._reports.append(StreamEvent("avoidance_stopped", WARNING, current.text))
        elif current.text:
            self._reports.append(StreamEvent("avoidance", NOTICE, current.text))
        elif previous is not None:
            self._reports.append(
                StreamEvent("avoidance", NOTICE, "The path is clear: following the setpoint.")
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
