"""Computes the setpoint that is sent to one vehicle: resolves, limits and packs the newest accepted
setpoint."""

from __future__ import annotations

import math

from gcs_server.streamer.frames import ResolvedSetpoint, keeps_heading
from gcs_server.streamer.limits.brake import SCAN_VALID_S, BrakeMemory, Surroundings
from gcs_server.streamer.limits.limiter import LimitResult, apply_limits
from gcs_server.streamer.limits.region import VehicleMotion
from gcs_server.streamer.values.limit_values import UNBOUNDED, Bounds
from gcs_server.streamer.values.snapshot import Snapshot
from gcs_server.streamer.values.stream_request import NOTICE, WARNING, SetpointLoader, StreamEvent
from missions.avoidance.scans import measures_outwards, recent_scans
from missions.avoidance.setpoints import AvoidanceStatus, SetpointAt, SetpointAvoidance
from missions.avoidance.setpoints import Surroundings as AvoidanceSurroundings
from missions.avoidance.values import AvoidanceWay, DetourLimits, MotionState
from missions.fence import FenceArea
from missions.runner.script import Script, ScriptChange, ScriptProgress
from missions.setpoints import (
    Actuators,
    Attitude,
    DirectSetpoint,
    Position,
    Rates,
    Setpoint,
    ThrustTorque,
    Trajectory,
    Velocity,
)


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

        def surroundings() -> AvoidanceSurroundings:
            motion, limits = _detour_motion(now_s, snapshot), _detour_limits(snapshot, fence)
            return AvoidanceSurroundings(motion, snapshot.scans, limits, snapshot.bounds.origin)

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


def _detour_motion(now_s: float, snapshot: Snapshot) -> MotionState | None:
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


ATTITUDE_KINDS = (Attitude, Rates, ThrustTorque, Actuators)
"""Kinds that enter PX4's control cascade at the attitude controller or below."""
REPORT_PERIOD_S = 10.0
"""A reduction is reported again if it did not occur for this time [s]."""


class SetpointPipeline:
    """Resolves, limits and packs the accepted setpoint, or a setpoint that keeps the position.

    Args:
        loader: the transport; packs each setpoint before it is sent.
    """

    def __init__(self, loader: SetpointLoader) -> None:
        self._loader = loader
        self.sent: DirectSetpoint | None = None
        self.limited: tuple[str, ...] = ()
        self._resolved: ResolvedSetpoint | None = None
        self._held_setpoint: DirectSetpoint | None = None
        """Setpoint that is sent when the accepted setpoint is no longer flown."""
        self._keeps_yaw = False
        self._unlimited: DirectSetpoint | None = None
        self._bounds: Bounds = UNBOUNDED
        self._bounds_of_snapshot: Bounds = UNBOUNDED
        """Bounds of the newest snapshot: equal to `_bounds`, but received again."""
        self._limited_s = 0.0
        """Time when `_unlimited` was last limited by `_bounds` [s, monotonic]."""
        self._reported_s: dict[str, float] = {}
        self._reports: list[StreamEvent] = []
        self._avoidance = AvoidanceStage()
        self._brake_has_scans = self._braked = False
        self._held_without_sensor: DirectSetpoint | None = None
        """Setpoint that keeps the position, because the obstacle sensor stopped sending while the brake was
        active."""
        self._brake_memory = BrakeMemory()

    def reset(self) -> None:
        """Resets for a new stream."""
        self.sent, self.limited, self._unlimited = None, (), None
        self._brake_has_scans = self._braked = False
        self._brake_memory.track_point_ne_m = None
        self._avoidance.reset()

    def accept(self, now_s: float, setpoint: Setpoint | Script, snapshot: Snapshot) -> None:
        """Starts flying a newly accepted setpoint."""
        keeps_yaw = keeps_heading(setpoint)
        previous_yaw = getattr(self.sent, "yaw_ned_rad", None) if keeps_yaw and self._keeps_yaw else None
        resolved = ResolvedSetpoint(
            setpoint, now_s, snapshot, snapshot.yaw_ned_rad if previous_yaw is None else previous_yaw
        )
        first = resolved.at(now_s, snapshot, waiting=True)
        if first is None:
            raise ValueError(f"vehicle {resolved.followed_vehicle} sends no position")
        self._resolved, self._keeps_yaw = resolved, keeps_yaw
        self._held_setpoint = self._held_without_sensor = None
        self._limit_and_load(now_s, snapshot, self._avoid(now_s, snapshot, first, waiting=True))

    def restart_path(self, now_s: float) -> None:
        """Starts the path now. Before this call, only its first point was sent."""
        if self._resolved is not None:
            self._resolved.restart_path(now_s)

    def set_received(self, received: bool) -> None:
        """Stops the time of a mission while the link does not accept its setpoints."""
        if self._resolved is not None and self._resolved.sampler is not None:
            self._resolved.sampler.received = received

    def change_script(self, change: ScriptChange) -> bool:
        """Updates the mission that is being flown; returns False if no mission is being flown."""
        sampler = None if self._resolved is None else self._resolved.sampler
        if sampler is None:
            return False
        sampler.change_script(change)
        return True

    @property
    def progress(self) -> ScriptProgress | None:
        """Progress of the mission being flown; None: no mission."""
        sampler = None if self._resolved is None else self._resolved.sampler
        return None if sampler is None else sampler.progress

    def hold_position(self, now_s: float, snapshot: Snapshot) -> None:
        """Stops flying the accepted setpoint and keeps the position. Sends the current position, or zero
        velocity without a position estimate. In a flight by attitude or rates without a velocity estimate,
        sends level attitude with hover thrust.
        """
        position, yaw, sent = snapshot.position_at(now_s), snapshot.yaw_ned_rad, self.sent
        if position is not None:
            held_setpoint: DirectSetpoint = Position(position, yaw)
        elif isinstance(sent, ATTITUDE_KINDS) and snapshot.velocity_ned_m_s is None:
            held_setpoint = level_attitude(
                yaw, thrust_of(sent) if snapshot.hover_thrust is None else snapshot.hover_thrust
            )
        else:
            held_setpoint = Velocity((0.0, 0.0, 0.0), yaw_rate_ned_rad_s=0.0)
        self._resolved, self._keeps_yaw = None, False
        self._held_setpoint, self._held_without_sensor = held_setpoint, None
        self._avoidance.reset()
        self._limit_and_load(now_s, snapshot, held_setpoint)

    def refresh(self, now_s: float, snapshot: Snapshot, *, waiting: bool) -> str | None:
        """Updates the setpoint to send. Returns why the stream must stop flying the accepted setpoint; None:
        no reason.

        Args:
            now_s: current time [s, monotonic].
            snapshot: the newest snapshot of the vehicle.
            waiting: whether the vehicle has not confirmed Offboard yet.
        """
        requested = (
            self._held_setpoint
            if self._resolved is None
            else self._resolved.at(now_s, snapshot, waiting=waiting)
        )
        if requested is None:
            return None
        if self._resolved is not None:
            requested = self._avoid(now_s, snapshot, requested, waiting=waiting)
        return self._limit_and_load(now_s, snapshot, requested).stop_reason

    def take_reports(self) -> list[StreamEvent]:
        """Returns the reports of limits and avoidance since the last call."""
        reports, self._reports = [*self._reports, *self._avoidance.take_reports()], []
        return reports

    @property
    def avoiding(self) -> AvoidanceStatus | None:
        """State of obstacle avoidance; None: avoidance is off."""
        return self._avoidance.status

    @property
    def followed_vehicle(self) -> str | None:
        """Id of the followed vehicle."""
        return None if self._resolved is None else self._resolved.followed_vehicle

    def leader_is_lost(self, now_s: float, snapshot: Snapshot) -> bool:
        """Whether the followed vehicle sends no position."""
        return (
            self._resolved is not None
            and self.followed_vehicle is not None
            and self._resolved.at(now_s, snapshot) is None
        )

    def depends_on_local_origin(self) -> bool:
        """Whether the sent setpoint is a fixed position relative to the vehicle's local origin. False
        for a position relative to a leader, which is computed again for each setpoint."""
        sent = self.sent
        if self.followed_vehicle is not None or not isinstance(sent, Position | Trajectory):
            return False
        return any(axis is not None for axis in sent.position_ned_m)

    def _avoid(
        self, now_s: float, snapshot: Snapshot, requested: DirectSetpoint, *, waiting: bool
    ) -> DirectSetpoint:
        resolved, way = self._resolved, self._way(snapshot)
        if way is None:
            self._avoidance.reset()
            return requested

        def later(at_s: float) -> DirectSetpoint | None:
            return None if resolved is None else resolved.later(now_s, at_s, snapshot)

        sampler = None if resolved is None else resolved.sampler
        return self._avoidance.apply(
            now_s, snapshot, requested, None if waiting else later, way,
            None if sampler is None else sampler.fence,
        )  # fmt: skip

    def _way(self, snapshot: Snapshot) -> AvoidanceWay | None:
        """What avoidance tries first; None: avoidance is off. Avoidance that a mission step requests ends
        with the step, but never during a detour.
        """
        sampler = None if self._resolved is None else self._resolved.sampler
        if snapshot.avoidance is not None or sampler is None:
            return snapshot.avoidance
        if snapshot.mission_avoidance is None:
            return None
        return self._avoidance.way if self._avoidance.is_on_detour else sampler.avoidance

    def _limit_and_load(self, now_s: float, snapshot: Snapshot, requested: DirectSetpoint) -> LimitResult:
        bounds = self._bounds
        if snapshot.bounds is not self._bounds_of_snapshot:  # each snapshot has its own, mostly equal bounds
            if snapshot.bounds == bounds:
                self._bounds_of_snapshot = snapshot.bounds
            else:
                bounds = snapshot.bounds
        surroundings = self._surroundings(now_s, snapshot, bounds)
        if surroundings is None:
            self._brake_memory.track_point_ne_m = None
        requested = requested if self._held_without_sensor is None else self._held_without_sensor
        is_unchanged = requested is self._unlimited and bounds is self._bounds
        if is_unchanged and surroundings is None and not bounds.depends_on_position:
            return LimitResult(self.sent, self.limited)
        dt_s = max(0.0, now_s - self._limited_s)
        result = apply_limits(requested, bounds, _motion(now_s, snapshot), self.sent, dt_s, surroundings)
        self._unlimited, self._limited_s, self._braked = requested, now_s, result.braked
        self._bounds, self._bounds_of_snapshot = bounds, snapshot.bounds
        self.limited, self._brake_memory.track_point_ne_m = result.notes, result.track_point_ne_m
        for note in result.notes:
            if now_s - self._reported_s.get(note, -math.inf) > REPORT_PERIOD_S:
                self._reports.append(StreamEvent("limited", NOTICE, f"Setpoint limited: {note}."))
            self._reported_s[note] = now_s
        if result.setpoint is not None:
            if result.setpoint != self.sent:
                self._loader.load(result.setpoint)
            self.sent = result.setpoint
        return result

    def _surroundings(self, now_s: float, snapshot: Snapshot, bounds: Bounds) -> Surroundings | None:
        """The surroundings for the brake. None if the brake is off, or no sensor sends measurements.
        While avoidance is on, the brake is on, too.
        """
        measures_nothing = not snapshot.scans and not self._brake_has_scans
        if measures_nothing or (not bounds.obstacle_brake and self._way(snapshot) is None):
            return None
        has_scans = any(measures_outwards(scan) for scan in recent_scans(snapshot.scans, now_s, SCAN_VALID_S))
        position, velocity = snapshot.position_at(now_s), snapshot.velocity_ned_m_s or (0.0, 0.0, 0.0)
        if self._brake_has_scans and not has_scans:
            consequence = "the obstacle brake has no measurements"
            if self._braked:
                consequence = (
                    "the vehicle keeps its position before an obstacle until the sensor sends again or a new "
                    "setpoint arrives"
                )
                held_setpoint = Velocity((0.0, 0.0, 0.0), yaw_rate_ned_rad_s=0.0)
                self._held_without_sensor = (
                    held_setpoint if position is None else Position(position, snapshot.yaw_ned_rad)
                )
            text = f"No data from the obstacle sensor for {SCAN_VALID_S:g} s: {consequence}."
            self._reports.append(StreamEvent("obstacle_sensor_lost", WARNING, text))
        self._brake_has_scans = has_scans
        if not has_scans:
            return None
        self._held_without_sensor = None
        return self._brake_memory.update(now_s, snapshot.scans, position, velocity)


def thrust_of(setpoint: Attitude | Rates | ThrustTorque | Actuators) -> float:
    """The collective thrust of a setpoint, 0 to 1."""
    if isinstance(setpoint, ThrustTorque):
        return min(1.0, max(0.0, -setpoint.thrust_frd[2]))
    if isinstance(setpoint, Actuators):
        values = [max(0.0, value or 0.0) for value in setpoint.motors]
        return sum(values) / max(1, len(values))
    return setpoint.thrust


def level_attitude(yaw_ned_rad: float | None, thrust: float) -> Attitude:
    """A level attitude setpoint."""
    half = (yaw_ned_rad or 0.0) / 2.0
    return Attitude((math.cos(half), 0.0, 0.0, math.sin(half)), thrust)


def _motion(now_s: float, snapshot: Snapshot) -> VehicleMotion | None:
    """Current motion of the vehicle; None if its position is unknown."""
    position = snapshot.position_at(now_s)
    if position is None:
        return None
    velocity = snapshot.velocity_ned_m_s or (0.0, 0.0, 0.0)
    return VehicleMotion(position, velocity, snapshot.yaw_ned_rad, snapshot.q_ned_frd)
