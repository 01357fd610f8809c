"""Keeps a group's vehicles apart in flight, and starts them together. No I/O; the scheduler runs the guard.

    waiting ── start time ──► flying ── setpoints ──┐
       │                        │ ▲                 │
       └── problem ──► over ◄───┘ └─────────────────┘

The guard uses no clock, thread or socket: `check` receives the time and a view of each member, and returns
the requests to start and the members to stop. There are three kinds of problem: two vehicles come too close
(including braking distance), a member's position is unknown, or a member no longer follows its setpoints.
Before the common start, when no member has moved, any problem stops all members.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from gcs_server.streamer.values.snapshot import Snapshot
from gcs_server.streamer.values.stream_request import StreamRequest
from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.runner.script import Script
from missions.separation import (
    LEVEL_AFTER_S,
    NO_POSITION_CONTROL_SHARE,
    UNKNOWN_ACCURACY_M,
    MovingVehicle,
    VelocityTrend,
    braking_decel_m_s2,
    braking_separation_m,
    margin_m,
)
from missions.setpoints import Acceleration, Actuators, Attitude, Rates, Setpoint, ThrustTorque

CHECK_PERIOD_S = 0.05
MAX_START_DELAY_S = 1.0
"""Maximum delay of the first check after the common start [s]; after a longer delay no member starts."""
EXPIRY_TOLERANCE_S = 0.1
"""Tolerance of the group's expiry time: a member whose setpoints end this much earlier has expired with the
group [s]."""
FOLLOWING_PHASES = ("starting", "streaming")
"""Phases in which a member's stream follows the group's requests."""
MOTION = ("position_ned_m", "velocity_ned_m_s", "decel_m_s2")


@dataclass(frozen=True, slots=True)
class MemberView:
    """One member's stream, for the guard."""

    phase: str
    """Phase of the member's stream."""
    request: StreamRequest | None
    snapshot: Snapshot
    end_reason: str | None
    """Reason for the end of the stream; None while it runs."""


@dataclass(frozen=True, slots=True)
class Finding:
    """A problem in a group."""

    at_s: float
    code: str
    """separation, place_unknown, left (a member no longer follows its setpoints), late (the common start was
    missed), fault (the guard failed)."""
    vehicles: tuple[str, ...]
    """Affected vehicles."""
    held: tuple[str, ...]
    """Vehicles that were stopped because of the problem."""
    text: str
    distance_m: float | None = None


@dataclass(slots=True)
class Actions:
    """The actions that the streams must execute now."""

    new_requests: dict[str, StreamRequest] = field(default_factory=dict[str, StreamRequest])
    """The new request of each vehicle."""
    hold: dict[str, str] = field(default_factory=dict[str, str])
    """Vehicles to stop, with the reason."""
    code: str = "group"
    """Code of the stream's event about the stop: separation or group."""


@dataclass(frozen=True, slots=True)
class GuardState:
    """The state of a guard at one moment."""

    phase: str
    """waiting, flying, over."""
    until_s: float
    """Time at which all setpoints expire [s, monotonic]."""
    held: frozenset[str] = frozenset()
    """Members that no longer follow the group's requests."""
    nearest: tuple[str, str, float] | None = None
    """The two closest members and their distance [m]."""
    margin_m: float | None = None
    """Largest current margin of any two members [m]."""


class GroupGuard:
    """Monitors one group; the module's docstring shows the phases.

    A member without a request flies its part of a mission, from the beginning of the group: it has a setpoint
    stream only between take-off and landing, so the end of its stream does not mean that it has left. It is
    checked while it is armed, including PX4's own take-off and landing. The mission receives each finding,
    and stops the vehicles that have no stream.

    Args:
        name: name of the group.
        waiting_requests: the request of each member before the common start.
        requests: the first request of each member; None: the member flies its part of a mission.
        minimum_m: the minimum separation [m].
        start_s: the common start [s, monotonic].
        duration_s: time from the common start until all setpoints expire.
        others_go_on: whether members without a problem continue if one has a problem.
    """

    def __init__(
        self,
        name: str,
        waiting_requests: Mapping[str, StreamRequest],
        requests: Mapping[str, StreamRequest | None],
        *,
        minimum_m: float,
        start_s: float,
        duration_s: float,
        others_go_on: bool = False,
    ) -> None:
        self.name = name
        self._requests = dict(requests)
        self.phase = "flying" if self._flies_mission else "waiting"
        self.minimum_m = minimum_m
        self.start_s = start_s
        self.until_s = start_s + duration_s
        self.held: set[str] = set()
        """Members that no longer follow the group's requests."""
        self.nearest: tuple[str, str, float] | None = None
        """The two nearest members, and their distance [m]."""
        self.margin_m: float | None = None
        """Largest current margin of any two members [m]."""
        self.findings: deque[Finding] = deque(maxlen=50)
        self._waiting_requests = dict(waiting_requests)
        self._others_go_on = others_go_on
        self._next_check_s = -math.inf
        self._trends = {vehicle: VelocityTrend() for vehicle in requests}

    @property
    def _flies_mission(self) -> bool:
        return None in self._requests.values()

    @property
    def members(self) -> tuple[str, ...]:
        """Members, in the order of the request."""
        return tuple(self._requests)

    @property
    def due_s(self) -> float:
        """Time at which `check` must be called next."""
        if self.phase == "over":
            return math.inf
        return min(self._next_check_s, self.start_s) if self.phase == "waiting" else self._next_check_s

    def state(self) -> GuardState:
        """The state for the group's status and for updates."""
        return GuardState(self.phase, self.until_s, frozenset(self.held), self.nearest, self.margin_m)

    def pending_request(self, vehicle: str) -> StreamRequest | None:
        """A member's first request; None after the common start, and in a mission."""
        return self._requests[vehicle] if self.phase == "waiting" else None

    def set_expiry(self, until_s: float) -> None:
        """Sets the time at which all setpoints expire; called when new setpoints were accepted."""
        self.until_s = until_s

    def disable_guard(self) -> None:
        """Starts no more requests, and reports no ended stream as a finding; called when all members are
        being stopped."""
        self.held.update(self.members)
        if self.phase == "waiting":
            self.phase = "flying"

    def check(self, now_s: float, views: Mapping[str, MemberView]) -> Actions:
        """Returns the actions to execute now.

        Args:
            now_s: current time [s, monotonic].
            views: newest view of each member.
        """
        if now_s < self.due_s:
            return Actions()
        self._next_check_s = now_s + CHECK_PERIOD_S
        flying = [v for v in self.members if v not in self.held and self._is_checked(views[v])]
        if self._nothing_to_stop(now_s, flying, views):
            return Actions()
        actions = Actions()
        for vehicle in flying:
            reason = self._leave_reason(vehicle, views[vehicle])
            if reason is not None:
                self._stop(now_s, actions, "left", (vehicle,), reason)
        motions = self._moving_vehicles(now_s, views)
        for vehicle in flying:
            if vehicle not in self.held and vehicle not in motions:
                reason = (
                    f"The position of vehicle {vehicle} is not known (no message for 1 s, or no "
                    f"valid estimate)"
                )
                self._stop(now_s, actions, "place_unknown", (vehicle,), reason)
        self._keep_apart(now_s, actions, motions)
        if self.phase == "waiting" and now_s >= self.start_s:
            self._begin(now_s, actions)
        return actions

    def skip_check(self, now_s: float) -> None:
        """Makes the next check due at its normal time; called when a check failed."""
        self._next_check_s = now_s + CHECK_PERIOD_S

    def stop_on_fault(self, now_s: float, reason: str) -> Actions:
        """Stops all members after an unexpected error."""
        actions = Actions()
        self._others_go_on = False
        self._stop(now_s, actions, "fault", self.members, reason)
        return actions

    # --- inside -----------------------------------------------------------------------------------

    def _is_checked(self, view: MemberView) -> bool:
        """Whether the separation of this member is checked now."""
        return view.snapshot.armed or not self._flies_mission

    def _nothing_to_stop(self, now_s: float, flying: list[str], views: Mapping[str, MemberView]) -> bool:
        """Whether nothing must be stopped: no member follows the group's requests any more, or all requests
        expire now."""
        if self._flies_mission:
            return False
        if self.phase == "over":
            return True
        following = [v for v in flying if views[v].phase in FOLLOWING_PHASES]
        if not following and all(views[v].phase == "idle" for v in self.members):
            self.phase = "over"
            return True
        return (
            self.phase == "flying"
            and now_s >= self.until_s - EXPIRY_TOLERANCE_S
            and len(following) < len(flying)
        )

    def _leave_reason(self, vehicle: str, view: MemberView) -> str | None:
        """Why a member no longer flies its request; None while it flies the request, and in a mission."""
        if self._flies_mission:
            return None
        if view.phase not in FOLLOWING_PHASES:
            suffix = f": {view.end_reason.rstrip('.')}" if view.end_reason else ""
            return f"Vehicle {vehicle} no longer follows the group's setpoints{suffix}"
        if self.phase == "waiting" and view.request != self._waiting_requests[vehicle]:
            return f"Vehicle {vehicle} received another setpoint before the common start"
        return None

    def _moving_vehicles(self, now_s: float, views: Mapping[str, MemberView]) -> dict[str, MovingVehicle]:
        """Motion of the members with a known position, in the frame of the first member with a known
        origin."""
        common: LocalOrigin | None = None
        motions: dict[str, MovingVehicle] = {}
        for vehicle in self.members:
            if not self._is_checked(views[vehicle]):
                continue
            snapshot = views[vehicle].snapshot
            position, origin = snapshot.position_at(now_s), snapshot.bounds.origin
            if position is None or origin is None or snapshot.lost:
                continue
            common = common or origin
            request = views[vehicle].request
            setpoint = None if request is None or isinstance(request.setpoint, Script) else request.setpoint
            motion = motion_of(snapshot, now_s, origin.to_frame_of(common, position), setpoint)
            self._trends[vehicle].add(snapshot.received_s, motion.velocity_ned_m_s)
            if not has_velocity_control(setpoint):
                velocity_ned_m_s = self._trends[vehicle].extrapolated_ned_m_s(motion.age_s + LEVEL_AFTER_S)
                motion = replace(motion, velocity_ned_m_s=velocity_ned_m_s)
            motions[vehicle] = motion
        return motions

    def _keep_apart(self, now_s: float, actions: Actions, motions: Mapping[str, MovingVehicle]) -> None:
        pairs = pairs_of(motions, self.minimum_m)
        nearest = min(pairs, key=lambda pair: pair.distance_m, default=None)
        self.nearest = None if nearest is None else (*nearest.vehicles, nearest.distance_m)
        self.margin_m = max((pair.margin_m for pair in pairs), default=None)
        for pair in pairs:
            if pair.closest_m < self.minimum_m + pair.margin_m:
                reason = (
                    f"Vehicles {' and '.join(pair.vehicles)} are {pair.distance_m:.1f} m apart, and stopping "
                    f"both now leaves {pair.closest_m:.1f} m (the minimum is {self.minimum_m:g} m plus "
                    f"{pair.margin_m:.1f} m margin for estimation errors)"
                )
                self._stop(now_s, actions, "separation", pair.vehicles, reason, pair.distance_m)

    def _begin(self, now_s: float, actions: Actions) -> None:
        late_s = now_s - self.start_s
        if late_s > MAX_START_DELAY_S:
            reason = f"The common start was missed by {late_s:.1f} s (the server was stalled)"
            self._stop(now_s, actions, "late", self.members, reason)
            return
        self.phase = "flying"
        actions.new_requests = {v: request for v, request in self._requests.items() if request is not None}

    def _stop(
        self,
        now_s: float,
        actions: Actions,
        code: str,
        vehicles: tuple[str, ...],
        reason: str,
        distance_m: float | None = None,
    ) -> None:
        stops_all = not self._others_go_on or self.phase == "waiting"
        stopped = [v for v in (self.members if stops_all else vehicles) if v not in self.held]
        if not stopped:
            return
        self.held.update(stopped)
        actions.code = "separation" if code == "separation" else "group"
        actions.hold |= dict.fromkeys(stopped, reason)
        if self.phase == "waiting":
            self.phase = "flying"  # no more requests start, and the guard ends when all members have stopped
        self.findings.append(Finding(now_s, code, vehicles, tuple(stopped), f"{reason}.", distance_m))


def has_velocity_control(setpoint: Setpoint | None) -> bool:
    """Whether the velocity controller is active. Without it, wind and tilt accelerate the vehicle."""
    return not isinstance(setpoint, Acceleration | Attitude | Rates | ThrustTorque | Actuators)


def motion_of(
    snapshot: Snapshot, now_s: float, position: Vector3, setpoint: Setpoint | None
) -> MovingVehicle:
    """Motion of a vehicle for the separation check.

    Args:
        snapshot: snapshot of the vehicle, with a position.
        now_s: current time [s, monotonic].
        position: the vehicle's position in the common frame [m].
        setpoint: the setpoint that the vehicle flies.
    """
    accuracy_m = snapshot.accuracy_m
    return MovingVehicle(
        position,
        snapshot.velocity_ned_m_s or (0.0, 0.0, 0.0),
        UNKNOWN_ACCURACY_M if accuracy_m is None else accuracy_m,
        max(0.0, now_s - snapshot.received_s),
        braking_decel_m_s2(snapshot.bounds.tilt_rad)
        * (1.0 if has_velocity_control(setpoint) else NO_POSITION_CONTROL_SHARE),
    )


class Pair(NamedTuple):
    """Two vehicles of a group."""

    vehicles: tuple[str, str]
    distance_m: float
    margin_m: float
    """Margin that is added to the minimum separation [m]."""
    closest_m: float
    """Smallest distance if both vehicles brake now; exact only below minimum plus margin [m]."""


def pairs_of(motions: Mapping[str, MovingVehicle], minimum_m: float) -> list[Pair]:
    """Every two of the vehicles, whose motions are in a common frame."""
    pairs = list(itertools.combinations(motions, 2))
    if not pairs:
        return []
    sides = [[motions[vehicle] for vehicle in side] for side in zip(*pairs, strict=True)]
    margins_m = [margin_m(a, b) for a, b in zip(*sides, strict=True)]
    (pos_a, vel_a, decel_a), (pos_b, vel_b, decel_b) = (
        tuple(np.array([getattr(m, name) for m in side]) for name in MOTION) for side in sides
    )
    closest_m = braking_separation_m(
        pos_a, vel_a, pos_b, vel_b, minimum_m + np.array(margins_m), decel_a, decel_b
    )
    distances_m = np.linalg.norm(pos_a - pos_b, axis=-1)
    return [
        Pair(*row) for row in zip(pairs, distances_m.tolist(), margins_m, closest_m.tolist(), strict=True)
    ]
