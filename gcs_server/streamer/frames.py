"""Converts a requested setpoint to a kind that a message can carry: adds the heading to keep, rotates
offsets, and adds the position of a followed vehicle.
"""

from __future__ import annotations

import math
from dataclasses import replace

from gcs_server.streamer.values.snapshot import Leader, Snapshot
from missions.curves import PathCurve
from missions.frames import Vector3, ned_from_heading
from missions.runner.sampler import ScriptSampler
from missions.runner.script import Script
from missions.setpoints import (
    Attitude,
    DirectSetpoint,
    Follow,
    FollowDevice,
    Path,
    Position,
    PositionBody,
    PositionGlobal,
    Rates,
    Setpoint,
    Trajectory,
    Velocity,
    VelocityBody,
)

LEADER_TIMEOUT_S = 1.0
"""Maximum age of the followed vehicle's position [s]."""
DEVICE_EXTRAPOLATION_S = 1.5
"""Time for which the position of a device is extrapolated [s]; phones report theirs about once a second."""
KINDS_TO_RESOLVE = frozenset(kind.type for kind in (PositionBody, Path, Follow, FollowDevice))
"""Kinds that this module converts into a kind that can be sent."""
NON_LOCAL_KINDS = frozenset(kind.type for kind in (VelocityBody, PositionGlobal))
"""Kinds in other frames; this module converts them for links that carry only the local frame (ROS 2)."""


class ResolvedSetpoint:
    """One accepted setpoint; computes the setpoint to send at any time until the next one is accepted.

    Args:
        setpoint: the requested setpoint.
        now_s: time at which the setpoint was accepted.
        snapshot: state of the vehicle at that time.
        yaw_kept_rad: the heading to keep if the setpoint has none.

    Raises:
        ValueError: the setpoint cannot be flown by the vehicle or sent over the link. The client already
            received this error when it sent the setpoint.
    """

    def __init__(
        self,
        setpoint: Setpoint | Script,
        now_s: float,
        snapshot: Snapshot,
        yaw_kept_rad: float | None,
    ) -> None:
        self._yaw_kept_rad = yaw_kept_rad
        self._path_start_s = now_s
        self._curve: PathCurve | None = None
        self._follow: Follow | None = None
        self._device: FollowDevice | None = None
        self._device_s = now_s
        """Time of the device's position [s, monotonic]."""
        self.sampler: ScriptSampler | None = None
        """Samples the script of an offboard mission; None for other setpoints."""
        self._fixed: DirectSetpoint | None = None
        self._local: DirectSetpoint | None = None
        """`_fixed` in the local frame, for links that carry only the local frame."""
        if isinstance(setpoint, Script):
            self.sampler = ScriptSampler(setpoint, now_s)
        elif isinstance(setpoint, Path):
            self._curve = PathCurve.of(setpoint, yaw_kept_rad)
        elif isinstance(setpoint, Follow):
            self._follow = setpoint
        elif isinstance(setpoint, FollowDevice):
            self._device, self._device_s = setpoint, now_s - setpoint.age_s
            self._fixed = self._beside_device(now_s, snapshot)
            if self._fixed is None:
                raise ValueError("follow_device needs a fresh global position and home")
        else:
            self._fixed = _fixed_setpoint(setpoint, now_s, snapshot, yaw_kept_rad)
            if snapshot.local_only and _to_local(self._fixed, snapshot) is None:
                raise ValueError(f"{setpoint.type} needs a fresh estimate to be sent in the local frame")

    @property
    def followed_vehicle(self) -> str | None:
        """Id of the followed vehicle; None if none is followed."""
        return None if self._follow is None else self._follow.vehicle

    def restart_path(self, now_s: float) -> None:
        """Starts the path now. Before this call, only its first point was sent."""
        self._path_start_s = now_s
        if self.sampler is not None:
            self.sampler.restart_time(now_s)

    def at(self, now_s: float, snapshot: Snapshot, *, waiting: bool = False) -> DirectSetpoint | None:
        """The setpoint to send; None if the followed vehicle sends no position.

        Args:
            now_s: monotonic time.
            snapshot: the newest snapshot of the vehicle.
            waiting: whether the vehicle has not confirmed Offboard yet; a path then stays at its first point.
        """
        if self.sampler is not None:
            position, velocity = snapshot.position_at(now_s), snapshot.velocity_ned_m_s
            return self.sampler.at(now_s, position, velocity, waiting=waiting)
        if self._curve is not None:
            return self._curve.at(0.0 if waiting else now_s - self._path_start_s)
        if self._follow is not None:
            return _follow_setpoint(self._follow, now_s, snapshot, self._yaw_kept_rad)
        if self._device is not None:
            self._fixed = self._beside_device(now_s, snapshot) or self._fixed
            return self._fixed
        if snapshot.local_only and self._fixed is not None:
            self._local = _to_local(self._fixed, snapshot) or self._local
            return self._local
        return self._fixed

    def later(self, now_s: float, at_s: float, snapshot: Snapshot) -> DirectSetpoint | None:
        """The setpoint that will be sent at the later time `at_s`, as predicted now; None if the setpoint
        does not change with time. Changes no state."""
        if self.sampler is not None:
            return self.sampler.setpoint_ahead(at_s - now_s)
        if self._curve is not None:
            return self._curve.at(at_s - self._path_start_s)
        if self._follow is not None:
            return _follow_setpoint(self._follow, at_s, snapshot, self._yaw_kept_rad)
        return None if self._device is None else self._beside_device(at_s, snapshot)

    def _beside_device(self, at_s: float, snapshot: Snapshot) -> Trajectory | None:
        """The setpoint beside the followed device at a time; None if the local frame or home is not known."""
        device, origin, home_amsl_m = self._device, snapshot.bounds.origin, snapshot.home_alt_amsl_m
        if device is None or origin is None or home_amsl_m is None:
            return None
        north, east, down = origin.to_ned(device.lat_deg, device.lon_deg, home_amsl_m + device.alt_home_m)
        velocity = device.velocity_ne_m_s or (0.0, 0.0)
        ahead_s = min(max(at_s - self._device_s, 0.0), DEVICE_EXTRAPOLATION_S)
        moves = at_s - self._device_s < DEVICE_EXTRAPOLATION_S
        north_m, east_m = device.offset_ne_m
        return Trajectory(
            (north + velocity[0] * ahead_s + north_m, east + velocity[1] * ahead_s + east_m, down),
            (velocity[0], velocity[1], 0.0) if moves else (0.0, 0.0, 0.0),
            yaw_ned_rad=math.atan2(-east_m, -north_m) if device.yaw == "face" else self._yaw_kept_rad,
        )


def keeps_heading(setpoint: Setpoint | Script) -> bool:
    """Whether the setpoint has neither yaw nor yaw rate."""
    if isinstance(setpoint, PositionBody):
        return setpoint.yaw_offset_rad is None
    if isinstance(setpoint, Path):
        return setpoint.points[0].yaw_ned_rad is None
    if isinstance(setpoint, Follow | FollowDevice):
        return setpoint.yaw == "keep"
    if isinstance(setpoint, Script | Attitude | Rates) or not hasattr(setpoint, "yaw_ned_rad"):
        return False
    return setpoint.yaw_ned_rad is None and setpoint.yaw_rate_ned_rad_s is None  # type: ignore[union-attr]


def _fixed_setpoint(
    setpoint: Setpoint, now_s: float, snapshot: Snapshot, yaw_kept_rad: float | None
) -> DirectSetpoint:
    if isinstance(setpoint, PositionBody):
        position, yaw = snapshot.position_at(now_s), snapshot.yaw_ned_rad
        if position is None or yaw is None:
            raise ValueError("position_body needs a fresh position and heading")
        n, e, d = ned_from_heading(setpoint.offset_frd_m, yaw)
        heading = yaw_kept_rad if setpoint.yaw_offset_rad is None else yaw + setpoint.yaw_offset_rad
        return Position((position[0] + n, position[1] + e, position[2] + d), heading)
    if isinstance(setpoint, PositionGlobal) and setpoint.alt_home_m is not None:
        if snapshot.home_alt_amsl_m is None:
            raise ValueError("alt_home_m needs a home position")
        alt_amsl_m = snapshot.home_alt_amsl_m + setpoint.alt_home_m
        setpoint = replace(setpoint, alt_amsl_m=alt_amsl_m, alt_home_m=None)
    assert isinstance(setpoint, DirectSetpoint)
    if keeps_heading(setpoint):
        return replace(setpoint, yaw_ned_rad=yaw_kept_rad)  # type: ignore[call-arg]
    return setpoint


def _to_local(setpoint: DirectSetpoint, snapshot: Snapshot) -> DirectSetpoint | None:
    """Converts a setpoint to the local frame; None if the heading or the frame's origin is not known."""
    if isinstance(setpoint, VelocityBody):
        yaw = snapshot.yaw_ned_rad
        if yaw is None:
            return None
        velocity = ned_from_heading(setpoint.velocity_frd_m_s, yaw)
        return Velocity(velocity, setpoint.yaw_ned_rad, setpoint.yaw_rate_ned_rad_s)
    if isinstance(setpoint, PositionGlobal):
        origin, alt_amsl_m = snapshot.bounds.origin, setpoint.alt_amsl_m
        if origin is None or alt_amsl_m is None:
            return None
        position = origin.to_ned(setpoint.lat_deg, setpoint.lon_deg, alt_amsl_m)
        return Position(position, setpoint.yaw_ned_rad, setpoint.yaw_rate_ned_rad_s)
    return setpoint


def follow_offset_ned_m(follow: Follow, leader: Leader) -> Vector3 | None:
    """The offset from the followed vehicle; None: it depends on that vehicle's heading, which is unknown."""
    if follow.offset_ned_m is not None:
        return follow.offset_ned_m
    if leader.yaw_ned_rad is None or follow.offset_frd_m is None:
        return None
    return ned_from_heading(follow.offset_frd_m, leader.yaw_ned_rad)


def _follow_setpoint(
    follow: Follow, at_s: float, snapshot: Snapshot, yaw_kept_rad: float | None
) -> DirectSetpoint | None:
    """The setpoint beside the followed vehicle at a time; None if its position is unknown or too old."""
    leader = snapshot.leader
    if leader is None or at_s - leader.received_s > LEADER_TIMEOUT_S:
        return None
    offset = follow_offset_ned_m(follow, leader)
    if offset is None:
        return None
    age_s = max(at_s - leader.received_s, 0.0)
    n, e, d = (
        position + velocity * age_s + axis_offset
        for position, velocity, axis_offset in zip(
            leader.position_ned_m, leader.velocity_ned_m_s, offset, strict=True
        )
    )
    if leader.lowest_down_m is not None:
        d = min(d, leader.lowest_down_m)  # the leader may land: its follower stays above the ground
    yaw = yaw_kept_rad
    if follow.yaw == "same" and leader.yaw_ned_rad is not None:
        yaw = leader.yaw_ned_rad
    elif follow.yaw == "face" and math.hypot(offset[0], offset[1]) > 0.5:
        yaw = math.atan2(-offset[1], -offset[0])
    return Trajectory((n, e, d), leader.velocity_ned_m_s, yaw_ned_rad=yaw)
