"""Stops a vehicle before an obstacle that its own sensors measure ahead of it.

The brake acts on horizontal motion, and on a climb towards an obstacle that an upward sensor measures. It
never acts on a descent, so that a downward sensor does not stop a landing. It uses the measurements of the
last two seconds, and acts only in directions that a sensor covers. If an obstacle is nearer than the margin,
the brake moves the vehicle back, because the integrator of PX4's controller still moves it forward, and
because an error of the velocity estimate moves it as well.

A braked target position stays on the straight track that the vehicle flew when braking began. Otherwise wind
and the noise of the position estimate would move the vehicle sideways, past the edge of the obstacle.

While the vehicle pitches forward, a lidar that is fixed to the body points at the foot of a wall or at the
ground. Therefore every point of a level sensor counts, no matter how far below the vehicle it is. As a result
the vehicle flies more slowly near the ground, but it does not hit the wall.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_server.streamer.limits.region import (
    BRAKE_DELAY_S,
    BRAKE_M_S2,
    BRAKE_VERTICAL_DELAY_S,
    BRAKE_VERTICAL_M_S2,
    MARGIN_M,
    MARGIN_VERTICAL_M,
    MAX_BACK_M_S,
    TAKEOVER_DELAY_S,
    TAKEOVER_M_S2,
)
from missions.avoidance.scans import DEFAULT_HALF_ANGLE_RAD, LEVEL_MAX_SINE, Scan, recent_scans
from missions.avoidance.values import braking_speed
from missions.fence import NorthEast
from missions.frames import Vector3

SCAN_VALID_S = 2.0
"""Maximum age of a measurement [s]; by default PX4 sends DISTANCE_SENSOR every two seconds."""
SAME_ALTITUDE_M = 1.0
"""A measurement is ignored if the vehicle's altitude has changed by more than this since the measurement
[m]."""
MAX_SCANS = 100
HALF_WIDTH_M, MIN_HALF_WIDTH_M = 0.8, 0.35
"""An obstacle nearer than HALF_WIDTH_M to the line of flight blocks the line [m]. Beside an obstacle that is
nearer to the vehicle, the half width is smaller, but at least MIN_HALF_WIDTH_M."""
BACK_PER_S = 2.0
"""Speed at which the vehicle is moved back from an obstacle nearer than the margin, per metre [1/s]. An error
of the velocity estimate moves the vehicle nearer by this error divided by BACK_PER_S: at 0.35 m/s, as in
flights of the simulator, 0.2 m."""
TAKEOVER_MARGIN_M = 0.3
MAX_CROSS_TRACK_M = 2.0
"""Maximum distance of the vehicle from its track [m]. Beyond this distance the vehicle gets a new track,
because its position estimate was reset or the vehicle was pushed away."""
MIN_TAKEOVER_M_S = 0.5
"""Minimum speed at which the brake takes over a vehicle that is flown by attitude or rates [m/s]."""

Points = NDArray[np.float64]
"""(N, 2), north and east [m]."""
NO_POINTS: Points = np.empty((0, 2))


@dataclass(frozen=True, slots=True)
class Surroundings:
    """The measured surroundings of the vehicle, and its velocity."""

    points_ne_m: Points
    """Measured points relative to the vehicle's current position, north and east [m]."""
    scans: tuple[Scan, ...]
    """Newest scan of each sensor."""
    velocity_ned_m_s: Vector3
    track_point_ne_m: NorthEast | None = None
    """Point of the track of a braked vehicle, in its local frame [m]; None: the vehicle is not braked."""


class BrakeMemory:
    """Measurements of one vehicle's sensors in the last seconds, in its local frame."""

    def __init__(self) -> None:
        self.track_point_ne_m: NorthEast | None = None
        """Point of the track that the brake keeps, from the last setpoint; None: the brake did not act."""
        self._recent_scans: deque[tuple[Scan, float, Points]] = deque(maxlen=MAX_SCANS)
        """Scan, down coordinate of the vehicle [m], points in the local frame."""

    def update(
        self, now_s: float, scans: tuple[Scan, ...], position_ned_m: Vector3 | None, velocity_ned_m_s: Vector3
    ) -> Surroundings:
        """Adds the newest scans and returns the vehicle's surroundings."""
        newest = recent_scans(scans, now_s, SCAN_VALID_S)
        if position_ned_m is None:
            self._recent_scans.clear()
            moved = [
                _level_points(scan) - _shift(velocity_ned_m_s, now_s - scan.measured_s) for scan in newest
            ]
            return Surroundings(np.vstack([NO_POINTS, *moved]), newest, velocity_ned_m_s)
        position = np.array(position_ned_m[:2])
        for scan in newest:
            if all(scan != stored for stored, _, _ in self._recent_scans):
                at = position - _shift(velocity_ned_m_s, now_s - scan.measured_s)
                self._recent_scans.append((scan, position_ned_m[2], _level_points(scan) + at))
        while self._recent_scans and now_s - self._recent_scans[0][0].measured_s > SCAN_VALID_S:
            self._recent_scans.popleft()
        points = [
            p for _, down_m, p in self._recent_scans if abs(down_m - position_ned_m[2]) <= SAME_ALTITUDE_M
        ]
        around_m = np.vstack([NO_POINTS, *points]) - position
        return Surroundings(around_m, newest, velocity_ned_m_s, self.track_point_ne_m)


def _level_points(scan: Scan) -> Points:
    """Horizontal points of a scan, without rays that point up or down."""
    points = [
        (n * distance_m, e * distance_m)
        for (n, e, d), distance_m in zip(scan.directions_ned, scan.distances_m, strict=True)
        if distance_m is not None and abs(d) <= LEVEL_MAX_SINE
    ]
    return np.array(points) if points else NO_POINTS


def _shift(velocity_ned_m_s: Vector3, age_s: float) -> Points:
    return np.array(velocity_ned_m_s[:2]) * max(0.0, age_s)


class ObstacleBrake:
    """The brake, for the setpoint of one moment.

    Args:
        surroundings: the measured surroundings; None if nothing is measured or the brake is off.
        notes: receives a text for each reduction.
    """

    def __init__(self, surroundings: Surroundings | None, notes: list[str]) -> None:
        self._notes = notes
        self.acted = False
        """Whether the brake has reduced the setpoint."""
        self.track_point_ne_m: NorthEast | None = None
        """Point of the track next to the vehicle, if the brake limits a position; None: the brake limits no
        position."""
        self._last_track_point = None if surroundings is None else surroundings.track_point_ne_m
        self._scans = () if surroundings is None else surroundings.scans
        self._points = NO_POINTS if surroundings is None else surroundings.points_ne_m
        self._velocity = (0.0, 0.0, 0.0) if surroundings is None else surroundings.velocity_ned_m_s

    def limit_velocity_ne(self, velocity: NorthEast) -> NorthEast:
        """Reduces the velocity so that the vehicle can stop before an obstacle."""
        speed = math.hypot(*velocity)
        if not self._scans or speed == 0.0:
            return velocity
        free_m, reason = self._free_m(velocity[0] / speed, velocity[1] / speed)
        max_m_s = braking_speed(free_m - MARGIN_M, BRAKE_M_S2, BRAKE_DELAY_S)
        if speed <= max_m_s:
            return velocity
        self._add_note(f"speed reduced {reason}")
        if free_m < MARGIN_M:
            max_m_s = -self._back_m_s(velocity[0] / speed, velocity[1] / speed, free_m)
        return (velocity[0] * max_m_s / speed, velocity[1] * max_m_s / speed)

    def limit_position_ne(
        self,
        target: NorthEast,
        feed_forward: NorthEast | None,
        position: Vector3 | None,
        gain: float,
        goal: NorthEast | None = None,
    ) -> tuple[NorthEast, NorthEast | None]:
        """Moves the target in front of the obstacle, and so close to the vehicle that PX4 approaches it at a
        speed from which it can stop.

        Args:
            target: target position in the local frame [m].
            feed_forward: velocity of the target [m/s]; None: the setpoint has none.
            position: the vehicle's position; None: unknown, so the target is not limited.
            gain: gain of PX4's position controller [1/s].
            goal: end of the track [m], if a limit has moved the target closer to the vehicle; None: the
                target.
        """
        if not self._scans or position is None:
            return target, feed_forward
        to_target_m = math.dist(target, position[:2])
        feed_m_s = math.hypot(*feed_forward) if feed_forward is not None else 0.0
        if to_target_m < 1e-3:
            return target, None if feed_forward is None else self.limit_velocity_ne(feed_forward)
        (dir_n, dir_e), vector_to_track = self._track(position, target if goal is None else goal)
        free_m, reason = min(self._free_m(dir_n, dir_e), self._free_m(dir_n, dir_e, vector_to_track))
        if free_m < MARGIN_M:
            self._add_note(f"position limited {reason}")
            ahead_m = -self._back_m_s(dir_n, dir_e, free_m) / gain
            no_feed = None if feed_forward is None else (0.0, 0.0)
            return self._on_track(
                position, (dir_n, dir_e), ahead_m, vector_to_track, to_target_m, gain
            ), no_feed
        stop_m = free_m - MARGIN_M
        max_m_s = braking_speed(stop_m, BRAKE_M_S2, BRAKE_DELAY_S)
        ahead_m = min(to_target_m, stop_m)
        commanded_m_s = gain * ahead_m + feed_m_s
        if ahead_m == to_target_m and commanded_m_s <= max_m_s:
            return target, feed_forward
        self._add_note(f"speed reduced {reason}" if ahead_m == to_target_m else f"position limited {reason}")
        scale = min(1.0, max_m_s / commanded_m_s) if commanded_m_s > 0.0 else 1.0
        ahead_m *= scale
        slowed = (
            None
            if feed_forward is None
            else self.limit_velocity_ne((feed_forward[0] * scale, feed_forward[1] * scale))
        )
        return self._on_track(position, (dir_n, dir_e), ahead_m, vector_to_track, to_target_m, gain), slowed

    def limit_climb(self, velocity_down_m_s: float) -> float:
        """Reduces the climb rate so that the vehicle can stop below an obstacle."""
        above_m = self._clearance_above_m() if velocity_down_m_s < 0.0 and self._scans else math.inf
        max_m_s = braking_speed(above_m - MARGIN_VERTICAL_M, BRAKE_VERTICAL_M_S2, BRAKE_VERTICAL_DELAY_S)
        if -velocity_down_m_s <= max_m_s:
            return velocity_down_m_s
        self._add_note("climb reduced to stop below an obstacle")
        return -max_m_s

    def limit_down(self, down_m: float, position: Vector3 | None) -> float:
        """Moves the target below an obstacle above the vehicle."""
        if position is None or down_m >= position[2] or not self._scans:
            return down_m
        highest = position[2] - max(0.0, self._clearance_above_m() - MARGIN_VERTICAL_M)
        if down_m >= highest:
            return down_m
        self._add_note("altitude limited to stay below an obstacle")
        return highest

    def stop_reason(self) -> str | None:
        """Why the stream must take over a flight without position control; None: the flight may continue."""
        if not self._scans:
            return None
        n, e, _ = self._velocity
        speed = math.hypot(n, e)
        if speed < MIN_TAKEOVER_M_S:
            return None
        free_m, _ = self._free_m(n / speed, e / speed, within_range=False)
        max_m_s = braking_speed(free_m - TAKEOVER_MARGIN_M, TAKEOVER_M_S2, TAKEOVER_DELAY_S)
        return "The vehicle would hit an obstacle" if speed > max_m_s else None

    # --- inside -------------------------------------------------------------------------------------

    def _add_note(self, note: str) -> None:
        self._notes.append(note)
        self.acted = True

    def _track(self, position: Vector3, goal: NorthEast) -> tuple[NorthEast, NorthEast]:
        """Direction of the track to the goal, and the vector from the vehicle to the nearest point of the
        track [m]: zero if braking begins now.
        """
        start = self._last_track_point
        if start is None or math.dist(start, goal) < 1e-3:
            start = (position[0], position[1])
        length_m = math.dist(start, goal)
        if length_m < 1e-3:
            return (1.0, 0.0), (0.0, 0.0)
        dir_n, dir_e = (goal[0] - start[0]) / length_m, (goal[1] - start[1]) / length_m
        across_m = (start[1] - position[1]) * dir_n - (start[0] - position[0]) * dir_e
        if abs(across_m) <= MAX_CROSS_TRACK_M:
            return (dir_n, dir_e), (-dir_e * across_m, dir_n * across_m)
        away_m = math.dist(goal, position[:2])
        return ((goal[0] - position[0]) / away_m, (goal[1] - position[1]) / away_m), (0.0, 0.0)

    def _on_track(
        self,
        position: Vector3,
        along: NorthEast,
        ahead_m: float,
        vector_to_track: NorthEast,
        max_m: float,
        gain: float,
    ) -> NorthEast:
        """Point of the track ahead of the vehicle, at most `max_m` away. If an obstacle is between vehicle
        and track, the point lies on the vehicle's side of the track.
        """
        self.track_point_ne_m = (position[0] + vector_to_track[0], position[1] + vector_to_track[1])
        north, east = position[0] + along[0] * ahead_m, position[1] + along[1] * ahead_m
        to_track_m = math.hypot(*vector_to_track)
        if to_track_m == 0.0:
            return north, east
        free_m, _ = self._free_m(
            vector_to_track[0] / to_track_m, vector_to_track[1] / to_track_m, within_range=False
        )
        max_m_s = braking_speed(free_m - MARGIN_M, BRAKE_M_S2, BRAKE_DELAY_S)
        max_side_m = math.sqrt(max(0.0, max_m**2 - ahead_m**2))
        fraction = min(
            1.0,
            max(0.0, free_m - MARGIN_M) / to_track_m,
            max_m_s / (gain * to_track_m),
            max_side_m / to_track_m,
        )
        return north + vector_to_track[0] * fraction, east + vector_to_track[1] * fraction

    def _back_m_s(self, dir_n: float, dir_e: float, free_m: float) -> float:
        """Speed at which the vehicle is moved back to the margin [m/s]; less if an obstacle is behind the
        vehicle."""
        behind_m, _ = self._free_m(-dir_n, -dir_e, within_range=False)
        return min(MAX_BACK_M_S, BACK_PER_S * max(0.0, min(MARGIN_M - free_m, behind_m - MARGIN_M)))

    def _free_m(
        self, dir_n: float, dir_e: float, start_ne: NorthEast = (0.0, 0.0), *, within_range: bool = True
    ) -> tuple[float, str]:
        """Free distance in a direction, from a point relative to the vehicle [m], and the reason as text.
        With `within_range`, the distance is at most the range of the sensor.
        """
        obstacle_m = math.inf
        if len(self._points):
            north, east = self._points[:, 0], self._points[:, 1]
            half_width_m = max(MIN_HALF_WIDTH_M, min(HALF_WIDTH_M, float(np.hypot(north, east).min()) - 0.1))
            north, east = north - start_ne[0], east - start_ne[1]
            along = north * dir_n + east * dir_e
            ahead = along[(along > 0.0) & (np.abs(east * dir_n - north * dir_e) < half_width_m)]
            obstacle_m = float(ahead.min()) if len(ahead) else math.inf
        range_m = self._range_m(dir_n, dir_e) if within_range else math.inf
        if obstacle_m <= range_m:
            return obstacle_m, "to stop before an obstacle"
        return range_m, "to the range of the obstacle sensor"

    def _range_m(self, dir_n: float, dir_e: float) -> float:
        """Range of the sensor that covers this direction; infinite if no sensor covers it."""
        range_m: float | None = None
        for scan in self._scans:
            min_cosine = math.cos(max(scan.half_angle_rad, DEFAULT_HALF_ANGLE_RAD))
            for n, e, d in scan.directions_ned:
                if abs(d) <= LEVEL_MAX_SINE and n * dir_n + e * dir_e >= min_cosine * math.hypot(n, e):
                    range_m = scan.range_m if range_m is None else max(range_m, scan.range_m)
                    break
        return math.inf if range_m is None else range_m

    def _clearance_above_m(self) -> float:
        """Distance to the nearest obstacle above the vehicle."""
        return min(
            (
                -d * distance_m
                for scan in self._scans
                for (_, _, d), distance_m in zip(scan.directions_ned, scan.distances_m, strict=True)
                if distance_m is not None and d < -LEVEL_MAX_SINE
            ),
            default=math.inf,
        )
