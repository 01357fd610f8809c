"""The state of a vehicle for its stream: an immutable value, which the event loop passes to the scheduler ten
times a second."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from gcs_server.streamer.values.limit_values import UNBOUNDED, Bounds
from missions.avoidance.scans import Scan
from missions.avoidance.values import AvoidanceWay
from missions.frames import Quaternion, Vector3

MAX_EXTRAPOLATION_S = 1.0
"""Maximum age of an estimate that is extrapolated [s]."""
MAX_DISTANCE_M = 1e6
"""A local position farther from the origin is implausible [m]."""
MAX_SPEED_M_S = 500.0
"""A faster velocity is implausible [m/s]."""


@dataclass(frozen=True, slots=True)
class Leader:
    """The followed vehicle, in the local frame of the follower."""

    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    yaw_ned_rad: float | None
    received_s: float
    lowest_down_m: float | None = None
    """The largest down coordinate that the following vehicle may have as a target, because of the ground;
    None: unknown [m]."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The newest state of the vehicle."""

    taken_s: float
    mode: str
    position_ned_m: Vector3 | None
    """None: no fresh estimate."""
    velocity_ned_m_s: Vector3 | None
    yaw_ned_rad: float | None
    """None: no fresh attitude."""
    mode_requested_by: str | None = None
    """The command of this server that caused the current mode, with its client, as text."""
    estimate_s: float | None = None
    """Time at which the position was received [s, monotonic]; None: `taken_s`. Code reads `received_s`."""
    armed: bool = False
    local_only: bool = False
    """Whether the link carries setpoints in the local frame only (ROS 2)."""
    lost: bool = False
    """Whether the link is lost."""
    home_alt_amsl_m: float | None = None
    hover_thrust: float | None = None
    """MPC_THR_HOVER, if known."""
    q_ned_frd: Quaternion | None = None
    bounds: Bounds = UNBOUNDED
    """Combined limits, in the vehicle's local frame."""
    leader: Leader | None = None
    """The vehicle that this vehicle follows."""
    accuracy_m: float | None = None
    """Accuracy of the position: one sigma, the larger of horizontal and vertical [m]; None if not
    reported."""
    scans: tuple[Scan, ...] = ()
    """Newest scans of the vehicle's distance sensors."""
    avoidance: AvoidanceWay | None = None
    """What avoidance tries first (over or around); None: avoidance is off."""
    failsafe: bool = False
    """Whether the vehicle itself has left Offboard or its registered mode, and returns to it when the cause
    ends."""
    mission_avoidance: AvoidanceWay | None = None
    """Not None: the steps of the mission may use avoidance; each step defines what avoidance tries first."""

    @property
    def received_s(self) -> float:
        """Time at which the position was received."""
        return self.taken_s if self.estimate_s is None else self.estimate_s

    def plausible(self) -> Snapshot:
        """A copy in which implausible numbers are unknown."""
        position, velocity, leader = self.position_ned_m, self.velocity_ned_m_s, self.leader
        scalars = (self.yaw_ned_rad, self.hover_thrust, self.home_alt_amsl_m, self.accuracy_m)
        numbers = [number for number in (*scalars, *(self.q_ned_frd or ())) if number is not None]
        velocity_valid = velocity is None or _within(velocity, MAX_SPEED_M_S)
        position_valid = position is None or (velocity_valid and _within(position, MAX_DISTANCE_M))
        leader_valid = leader is None or (
            _within(leader.position_ned_m, MAX_DISTANCE_M)
            and _within(leader.velocity_ned_m_s, MAX_SPEED_M_S)
            and (leader.yaw_ned_rad is None or math.isfinite(leader.yaw_ned_rad))
            and (leader.lowest_down_m is None or math.isfinite(leader.lowest_down_m))
        )
        scans = tuple([scan for scan in self.scans if scan.plausible])
        all_valid = velocity_valid and position_valid and leader_valid and len(scans) == len(self.scans)
        if all_valid and all(map(math.isfinite, numbers)):
            return self
        return replace(
            self,
            position_ned_m=position if position_valid else None,
            velocity_ned_m_s=velocity if velocity_valid else None,
            yaw_ned_rad=_finite(self.yaw_ned_rad),
            home_alt_amsl_m=_finite(self.home_alt_amsl_m),
            hover_thrust=_finite(self.hover_thrust),
            q_ned_frd=self.q_ned_frd if _within(self.q_ned_frd or (), 2.0) else None,
            leader=leader if leader_valid else None,
            accuracy_m=_finite(self.accuracy_m),
            scans=scans,
        )

    def position_at(self, now_s: float) -> Vector3 | None:
        """The position extrapolated with its velocity; None if the estimate is too old."""
        age_s = max(now_s - self.received_s, 0.0)
        if self.position_ned_m is None or age_s > MAX_EXTRAPOLATION_S:
            return None
        n, e, d = self.position_ned_m
        vn, ve, vd = self.velocity_ned_m_s or (0.0, 0.0, 0.0)
        return (n + vn * age_s, e + ve * age_s, d + vd * age_s)


def _within(values: tuple[float, ...], limit: float) -> bool:
    """Whether all numbers are finite and at most this large."""
    for value in values:  # a loop takes half the time of `all` with a generator  # noqa: SIM110
        if not -limit <= value <= limit:
            return False
    return True


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else value
