"""What a stream knows of its vehicle, as a frozen value that the event loop hands over ten times a second."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from gcs_server.streamer.values.bounds import UNBOUNDED, Bounds
from missions.avoidance.scans import Scan
from missions.avoidance.values import AvoidanceWay
from missions.frames import Quaternion, Vector3

LONGEST_EXTRAPOLATION_S = 1.0
"""An estimate older than this says nothing of where the vehicle is."""
FARTHEST_M = 1e6
"""A local position beyond this is no position."""
FASTEST_M_S = 500.0
"""A velocity beyond this is none."""


@dataclass(frozen=True, slots=True)
class Leader:
    """The vehicle that is followed, in the local frame of the one that follows."""

    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    yaw_ned_rad: float | None
    heard_s: float


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The vehicle as the event loop last saw it."""

    taken_s: float
    mode: str
    position_ned_m: Vector3 | None
    """None where there is no fresh estimate."""
    velocity_ned_m_s: Vector3 | None
    yaw_ned_rad: float | None
    """None where the vehicle's attitude is not heard: it is silent."""
    mode_asked_by: str | None = None
    """Where a command of ours brought the vehicle into this mode: which, and whose."""
    estimate_s: float | None = None
    """When the position was heard; with the snapshot, unless given."""
    armed: bool = False
    lost: bool = False
    """No heartbeat for so long that the link counts as lost."""
    home_alt_amsl_m: float | None = None
    hover_thrust: float | None = None
    """MPC_THR_HOVER, where the vehicle told it."""
    q_ned_frd: Quaternion | None = None
    bounds: Bounds = UNBOUNDED
    """The limits, in its local frame."""
    leader: Leader | None = None
    """Where this vehicle follows another."""
    accuracy_m: float | None = None
    """Of the position, one sigma: the worse of horizontal and vertical; None where it reports none."""
    scans: tuple[Scan, ...] = ()
    """What its distance sensors measured last."""
    avoidance: AvoidanceWay | None = None
    """Switched on for this vehicle, and what it tries first; None: off."""
    mission_avoidance: AvoidanceWay | None = None
    """In the steps of a mission that ask for it; None: there are none, or it is switched off for them."""

    @property
    def heard_s(self) -> float:
        """When the position was heard."""
        return self.taken_s if self.estimate_s is None else self.estimate_s

    def plausible(self) -> Snapshot:
        """Without numbers that cannot be: they count as not known, as if the vehicle had not told them."""
        position, velocity, leader = self.position_ned_m, self.velocity_ned_m_s, self.leader
        told = (self.yaw_ned_rad, self.hover_thrust, self.home_alt_amsl_m, self.accuracy_m)
        numbers = (*told, *(self.q_ned_frd or ()))
        moves = velocity is None or _within(velocity, FASTEST_M_S)
        here = position is None or (moves and _within(position, FARTHEST_M))
        led = leader is None or (
            _within(leader.position_ned_m, FARTHEST_M)
            and _within(leader.velocity_ned_m_s, FASTEST_M_S)
            and (leader.yaw_ned_rad is None or math.isfinite(leader.yaw_ned_rad))
        )
        scans = tuple(scan for scan in self.scans if scan.plausible)
        whole = moves and here and led and len(scans) == len(self.scans)
        if whole and all(number is None or math.isfinite(number) for number in numbers):
            return self
        return replace(
            self,
            position_ned_m=position if here else None,
            velocity_ned_m_s=velocity if moves else None,
            yaw_ned_rad=_finite(self.yaw_ned_rad),
            home_alt_amsl_m=_finite(self.home_alt_amsl_m),
            hover_thrust=_finite(self.hover_thrust),
            q_ned_frd=self.q_ned_frd if _within(self.q_ned_frd or (), 2.0) else None,
            leader=leader if led else None,
            accuracy_m=_finite(self.accuracy_m),
            scans=scans,
        )

    def position_at(self, now_s: float) -> Vector3 | None:
        """The estimate carried on with its velocity over its age; None where it is too old for that."""
        age_s = max(now_s - self.heard_s, 0.0)
        if self.position_ned_m is None or age_s > LONGEST_EXTRAPOLATION_S:
            return None
        n, e, d = self.position_ned_m
        vn, ve, vd = self.velocity_ned_m_s or (0.0, 0.0, 0.0)
        return (n + vn * age_s, e + ve * age_s, d + vd * age_s)


def _within(values: tuple[float, ...], most: float) -> bool:
    """Whether all are numbers of at most this size; infinity and NaN are not."""
    return all(-most <= value <= most for value in values)


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else value
