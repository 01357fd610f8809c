"""Predicts the positions of a group's vehicles from their setpoints, and whether they stay apart. No I/O.

A vehicle follows a path exactly. It approaches a position as PX4's position controller does: the speed is
proportional to the distance, within the limits of speed and acceleration. A velocity setpoint moves the
vehicle until the setpoint expires. Acceleration, attitude and rate setpoints have no position: the vehicle is
assumed to stay at its position, and only the guard protects it in flight. Wind and pilot actions are not
predicted.

Ten long paths take a second to compute. Therefore the search is a generator that yields after each small
piece, so that the event loop can do other work.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gcs_server.streamer.frames import ResolvedSetpoint
from gcs_server.streamer.separation import motion_of, pairs_of
from gcs_server.streamer.values.snapshot import Snapshot
from missions.curves import PathCurve
from missions.frames import Vector3, ned_from_heading
from missions.geodesy import LocalOrigin
from missions.separation import (
    MovingVehicle,
    Vectors,
    braking_distance_m,
    closest_m,
    margin_m,
    sample_count,
)
from missions.setpoints import (
    Follow,
    Partial3,
    Path,
    Position,
    PositionGlobal,
    Setpoint,
    Trajectory,
    Velocity,
    VelocityBody,
    complete_vector,
)

STEP_S = 0.25
STEPS_PER_YIELD = 100
"""Number of steps of predicted tracks between two yields, about 4 ms."""
SAMPLES_PER_YIELD = 12_000
"""Number of samples of the braking distance between two yields."""
MAX_PREDICTION_S = 600.0
MAX_VELOCITY_PREDICTION_S = 120.0
"""Maximum time for which a velocity setpoint is predicted [s]."""
SPEED_M_S, CLIMB_M_S = 12.0, 3.0
"""Assumed speed and climb rate if the vehicle's limits are unknown [m/s]."""
ACCELERATION_M_S2 = 3.0
"""Acceleration towards a position or velocity (default of MPC_ACC_HOR)."""
STOPPED_M_S = 0.05
"""Speed below which a predicted vehicle counts as stopped."""
LOCAL_ORIGIN_NED_M: Vector3 = (0.0, 0.0, 0.0)
"""The origin of a local frame."""
UNCONTROLLED: Partial3 = (None, None, None)
"""A target position or velocity that controls no axis."""


@dataclass(frozen=True, slots=True)
class PredictedMember:
    """One member and the setpoint that it will fly."""

    vehicle: str
    setpoint: Setpoint | None
    """The setpoint; None: the vehicle stays at its position."""
    snapshot: Snapshot
    duration_s: float
    """Time until the setpoint expires [s]."""
    elapsed_s: float = 0.0
    """Time for which the setpoint has already been flown; a path continues from there [s]."""


@dataclass(frozen=True, slots=True)
class Conflict:
    """Two vehicles that come too close; positions are in the local frame of the first vehicle."""

    vehicles: tuple[str, str]
    after_s: float
    distance_m: float
    position_ned_m: Vector3
    """Position of the first vehicle at that time."""
    while_stopping: bool
    """Whether the vehicles would keep the minimum if both continue, but not if both are stopped."""
    margin_m: float = 0.0
    """Margin added to the minimum, for the uncertainty of both positions [m]."""

    def text(self, minimum_m: float) -> str:
        """The conflict as a sentence."""
        a, b = self.vehicles
        n, e, d = self.position_ned_m
        position_text = f"at {n:.1f} m north, {e:.1f} m east, {d:.1f} m down of vehicle {a}'s local origin"
        required = f"the minimum is {minimum_m:g} m, plus {self.margin_m:.1f} m of margin"
        if self.after_s == 0.0 and not self.while_stopping:
            return (
                f"Vehicles {a} and {b} are {self.distance_m:.1f} m apart now ({required}), "
                f"vehicle {a} {position_text}."
            )
        if self.while_stopping:
            return (
                f"After {self.after_s:.1f} s vehicles {a} and {b} would be so close and so fast that "
                f"stopping both leaves {self.distance_m:.1f} m between them ({required}), "
                f"vehicle {a} {position_text}."
            )
        return (
            f"After {self.after_s:.1f} s vehicles {a} and {b} would come within {self.distance_m:.1f} m of "
            f"each other ({required}), vehicle {a} {position_text}."
        )


def first_conflict(
    members: Sequence[PredictedMember], now_s: float, minimum_m: float
) -> Generator[None, None, Conflict | None]:
    """Finds the earliest conflict: two vehicles closer than the minimum; returns None if all stay apart.

    Yields after every few milliseconds of work; counts steps instead of measuring the time.

    Args:
        members: members with a position and an origin in their snapshots.
        now_s: current time [s, monotonic].
        minimum_m: the minimum separation, braking distance included.
    """
    predictions: list[_PredictedTrack] = []
    for member in members:
        predictions.append(_PredictedTrack(member, now_s))
        yield
    by_id = {prediction.member.vehicle: prediction for prediction in predictions}
    t_s, steps = 0.0, 0
    min_duration_s = max(prediction.min_duration_s for prediction in predictions)
    while t_s < MAX_PREDICTION_S and (
        t_s <= min_duration_s or any(prediction.moves for prediction in predictions)
    ):
        for prediction in predictions:
            prediction.step(t_s, by_id)
            steps += 1
            if steps % STEPS_PER_YIELD == 0:
                yield
        t_s += STEP_S
    tracks: list[tuple[Vectors, Vectors]] = []
    for prediction in predictions:
        yield
        tracks.append(prediction.take_track())
    conflicts: list[Conflict] = []
    for (a, track_a), (b, track_b) in itertools.combinations(zip(predictions, tracks, strict=True), 2):
        yield
        conflict = yield from _conflict_between(a, track_a, b, track_b, minimum_m, now_s)
        if conflict is not None:
            conflicts.append(conflict)
    return min(conflicts, key=lambda conflict: conflict.after_s, default=None)


def too_near_now(members: Sequence[PredictedMember], now_s: float, minimum_m: float) -> Conflict | None:
    """A pair of vehicles that are too close now, or too fast to be stopped at the minimum separation; None if
    all are far enough apart. Computed without yielding, because this is fast.

    Args:
        members: members with a position and an origin in their snapshots.
        now_s: current time [s, monotonic].
        minimum_m: the minimum separation, braking distance included.
    """
    positions = {member.vehicle: _position_and_origin(member, now_s) for member in members}
    _, common = next(iter(positions.values()))
    motions: dict[str, MovingVehicle] = {}
    for member in members:
        position, origin = positions[member.vehicle]
        in_common_frame = origin.to_frame_of(common, position)
        motions[member.vehicle] = motion_of(member.snapshot, now_s, in_common_frame, member.setpoint)
    for pair in pairs_of(motions, minimum_m):
        required_m = minimum_m + pair.margin_m
        if pair.closest_m < required_m:
            while_stopping = pair.distance_m >= required_m
            distance_m = pair.closest_m if while_stopping else pair.distance_m
            position = positions[pair.vehicles[0]][0]
            return Conflict(pair.vehicles, 0.0, distance_m, position, while_stopping, pair.margin_m)
    return None


def _position_and_origin(member: PredictedMember, now_s: float) -> tuple[Vector3, LocalOrigin]:
    position, origin = member.snapshot.position_at(now_s), member.snapshot.bounds.origin
    if position is None or origin is None:
        raise ValueError(f"vehicle {member.vehicle} has no valid global position")
    return position, origin


def _conflict_between(
    a: _PredictedTrack,
    track_a: tuple[Vectors, Vectors],
    b: _PredictedTrack,
    track_b: tuple[Vectors, Vectors],
    minimum_m: float,
    now_s: float,
) -> Generator[None, None, Conflict | None]:
    motion_a, motion_b = (
        motion_of(prediction.member.snapshot, now_s, LOCAL_ORIGIN_NED_M, prediction.member.setpoint)
        for prediction in (a, b)
    )
    margin = margin_m(motion_a, motion_b)
    required_m = minimum_m + margin
    positions_a, velocity_a = track_a
    positions_b, velocity_b = (
        track_b[0] + np.array(b.origin.to_frame_of(a.origin, LOCAL_ORIGIN_NED_M)),
        track_b[1],
    )
    distances: Vectors = np.sqrt(np.sum((positions_a - positions_b) ** 2, axis=-1))
    closest = distances.copy()
    speed_a, speed_b = (np.sqrt(np.sum(velocity**2, axis=-1)) for velocity in (velocity_a, velocity_b))
    reach_m = braking_distance_m(speed_a, motion_a.decel_m_s2)
    reach_m = reach_m + braking_distance_m(speed_b, motion_b.decel_m_s2)
    # at all other steps the vehicles are far enough apart
    candidates = np.nonzero(distances - reach_m < required_m)[0]
    longest_s = max(
        float(np.max(speed_a)) / motion_a.decel_m_s2, float(np.max(speed_b)) / motion_b.decel_m_s2
    )
    batch_size = max(1, SAMPLES_PER_YIELD // sample_count(longest_s))
    for begin in range(0, len(candidates), batch_size):
        yield
        batch = candidates[begin : begin + batch_size]
        closest[batch] = closest_m(
            positions_a[batch], velocity_a[batch], positions_b[batch], velocity_b[batch],
            motion_a.decel_m_s2, motion_b.decel_m_s2,
        )  # fmt: skip
        if np.any(closest[batch] < required_m):
            break  # only the first conflict is reported
    conflicting = np.nonzero(closest < required_m)[0]
    if not len(conflicting):
        return None
    too_near = np.nonzero(distances < required_m)[0]
    index = int(conflicting[0])
    while_stopping = not len(too_near)
    if not while_stopping:
        begin = int(too_near[0])
        end = begin + int(np.argmax(np.append(distances[begin:] >= required_m, True)))
        index = begin + int(np.argmin(distances[begin:end]))
        if begin == 0:
            index = 0
    n, e, d = (float(x) for x in positions_a[index])
    distance_m = float(closest[index] if while_stopping else distances[index])
    return Conflict(
        (a.member.vehicle, b.member.vehicle), index * STEP_S, distance_m, (n, e, d), while_stopping, margin
    )


class _PredictedTrack:
    """One member's predicted positions and velocities, step by step, in its own local frame."""

    def __init__(self, member: PredictedMember, now_s: float) -> None:
        snapshot, setpoint = member.snapshot, member.setpoint
        position, self.origin = _position_and_origin(member, now_s)
        self.member = member
        self.positions: list[Vector3] = []
        self.velocities: list[Vector3] = []
        self.moves = True
        self._position = position
        self._velocity: Vector3 = snapshot.velocity_ned_m_s or (0.0, 0.0, 0.0)
        bounds = snapshot.bounds
        self._speed = min(bounds.speed_m_s, bounds.approach_m_s, SPEED_M_S)
        self._climb = min(bounds.climb_m_s, bounds.approach_climb_m_s, CLIMB_M_S)
        self._descent = min(bounds.descent_m_s, bounds.approach_descent_m_s, CLIMB_M_S)
        self._gains = (bounds.position_gain, bounds.position_gain, bounds.vertical_gain)
        self._expires_s = min(member.duration_s, MAX_VELOCITY_PREDICTION_S)
        self._curve: PathCurve | None = None
        self._follow = setpoint if isinstance(setpoint, Follow) else None
        self._target, self._feed_forward = UNCONTROLLED, UNCONTROLLED
        self.min_duration_s = 0.0
        """Minimum time for which the track is predicted [s]."""
        if isinstance(setpoint, Path):
            self._curve = PathCurve.of(setpoint, None)
            self.min_duration_s = self._curve.duration_s - member.elapsed_s
            begin = complete_vector(self._curve.at(member.elapsed_s).position_ned_m) or position
            self._offset = (position[0] - begin[0], position[1] - begin[1], position[2] - begin[2])
        elif setpoint is not None and self._follow is None:
            self._target, self._feed_forward = self._target_of(setpoint, now_s)
            if self._feed_forward != UNCONTROLLED and self._target == UNCONTROLLED:
                self.min_duration_s = self._expires_s

    def step(self, t_s: float, others: Mapping[str, _PredictedTrack]) -> None:
        """Stores the current position, and advances by `STEP_S`."""
        if self._curve is not None:
            self._follow_path(t_s)
            return
        self.positions.append(self._position)
        self.velocities.append(self._velocity)
        target, feed_forward = self._target_at(t_s, others)
        velocity = [
            (0.0 if position is None else gain * (position - current)) + (speed or 0.0)
            for position, speed, current, gain in zip(
                target, feed_forward, self._position, self._gains, strict=True
            )
        ]
        ground_speed = math.hypot(velocity[0], velocity[1])
        scale = min(1.0, self._speed / ground_speed) if ground_speed > 0 else 1.0
        velocity = [
            velocity[0] * scale,
            velocity[1] * scale,
            min(self._descent, max(-self._climb, velocity[2])),
        ]
        change = [target - current for target, current in zip(velocity, self._velocity, strict=True)]
        size, max_change = math.hypot(*change), ACCELERATION_M_S2 * STEP_S
        scale = min(1.0, max_change / size) if size > 0 else 1.0
        before = self._velocity
        n, e, d = (current + axis_change * scale for current, axis_change in zip(before, change, strict=True))
        self._velocity = (n, e, d)
        n, e, d = (
            position + (old + new) / 2.0 * STEP_S
            for position, old, new in zip(self._position, before, self._velocity, strict=True)
        )
        self._position = (n, e, d)
        self.moves = math.hypot(*self._velocity) > STOPPED_M_S and t_s < MAX_PREDICTION_S

    def take_track(self) -> tuple[Vectors, Vectors]:
        """Returns the predicted positions and velocities, and frees the lists. Called for one track per
        yield, because freeing all tracks at once takes long."""
        track = np.array(self.positions), np.array(self.velocities)
        self.positions, self.velocities = [], []
        return track

    @property
    def velocity(self) -> Vector3:
        """Velocity at the current step."""
        return self._velocity

    def position_in(self, origin: LocalOrigin) -> Vector3:
        """Position at the current step, in another member's frame."""
        return self.origin.to_frame_of(origin, self._position)

    def _follow_path(self, t_s: float) -> None:
        """Stores a position on the path; the vehicle's initial distance from the path decreases with time."""
        assert self._curve is not None
        sample = self._curve.at(self.member.elapsed_s + t_s)
        position, velocity = complete_vector(sample.position_ned_m), complete_vector(sample.velocity_ned_m_s)
        assert position is not None
        assert velocity is not None
        remaining = math.exp(-self._gains[0] * t_s)
        n, e, d = (at + offset * remaining for at, offset in zip(position, self._offset, strict=True))
        self._position, self._velocity = (n, e, d), velocity
        self.positions.append(self._position)
        self.velocities.append(velocity)
        self.moves = False  # the path ends after `min_duration_s`

    def _target_of(self, setpoint: Setpoint, now_s: float) -> tuple[Partial3, Partial3]:
        """Target position and velocity of the setpoint, in the local frame."""
        snapshot = self.member.snapshot
        if isinstance(setpoint, VelocityBody):
            yaw = snapshot.yaw_ned_rad
            return UNCONTROLLED, UNCONTROLLED if yaw is None else ned_from_heading(
                setpoint.velocity_frd_m_s, yaw
            )
        sent = ResolvedSetpoint(setpoint, now_s, snapshot, snapshot.yaw_ned_rad).at(now_s, snapshot)
        if isinstance(sent, Position):
            return sent.position_ned_m, UNCONTROLLED
        if isinstance(sent, PositionGlobal) and sent.alt_amsl_m is not None:
            return self.origin.to_ned(sent.lat_deg, sent.lon_deg, sent.alt_amsl_m), UNCONTROLLED
        if isinstance(sent, Trajectory):
            return sent.position_ned_m, sent.velocity_ned_m_s
        if isinstance(sent, Velocity):
            return UNCONTROLLED, sent.velocity_ned_m_s
        return UNCONTROLLED, UNCONTROLLED

    def _target_at(self, t_s: float, others: Mapping[str, _PredictedTrack]) -> tuple[Partial3, Partial3]:
        if self._follow is not None:
            return self._target_beside_leader(self._follow, t_s, others)
        return self._target, self._feed_forward if t_s < self._expires_s else UNCONTROLLED

    def _target_beside_leader(
        self, follow: Follow, t_s: float, others: Mapping[str, _PredictedTrack]
    ) -> tuple[Partial3, Partial3]:
        leader, reported = others.get(follow.vehicle), self.member.snapshot.leader
        yaw = reported.yaw_ned_rad if reported is not None else None
        offset = follow.offset_ned_m or ned_from_heading(follow.offset_frd_m or (0.0, 0.0, 0.0), yaw or 0.0)
        if leader is not None:
            position, velocity = leader.position_in(self.origin), leader.velocity
        elif reported is not None:
            moved_s = min(t_s, self._expires_s)
            n, e, d = (
                at + speed * moved_s
                for at, speed in zip(reported.position_ned_m, reported.velocity_ned_m_s, strict=True)
            )
            position, velocity = (n, e, d), reported.velocity_ned_m_s
        else:
            return UNCONTROLLED, UNCONTROLLED
        return (position[0] + offset[0], position[1] + offset[1], position[2] + offset[2]), velocity
