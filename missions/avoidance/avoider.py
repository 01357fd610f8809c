"""Flies over or around obstacles, then returns to the path behind the obstacles.

The straight line to the wanted position, and the path after this position, must be clear of recent
measurements. If an obstacle blocks the path, the vehicle climbs above the highest measured point, flies on,
and descends when the sensors measure nothing below. If the obstacle is too high, or `way` is "around", the
vehicle flies on the clear heading nearest to the direction of the goal. The vehicle moves only in directions
that a sensor measures. If no direction is allowed, or no measurements arrive, the vehicle stops and reports
the reason.

Altitudes (`up_m`, `highest_m`, …) are above the origin of the local frame. The space below each remembered
point counts as solid (`memory.py`). A sensor with a single ray measures along one line only and does not
detect obstacles beside this line.
"""

from __future__ import annotations

import math

from missions.avoidance.corridor import (
    BLOCKING_BELOW_M,
    CLEARANCE_M,
    TOP_CLEARANCE_M,
    BlockingObstacles,
    blocking_obstacles,
)
from missions.avoidance.detour import Side, choose_heading
from missions.avoidance.memory import ObstacleMemory
from missions.avoidance.scans import Scan, measures_down, measures_level, recent_scans, sensor_range_m
from missions.avoidance.values import (
    AdjustedMotion,
    AvoidanceState,
    AvoidanceWay,
    DetourLimits,
    MotionState,
    WantedMotion,
    braking_speed,
)
from missions.fence import NorthEast
from missions.frames import Vector3
from missions.setpoints import Position, Velocity

FRESH_S = 1.0
"""Older measurements are ignored [s]."""
MAX_CLIMB_M = 15.0
"""Largest climb above the wanted altitude; the vehicle flies around higher obstacles."""
CEILING_MARGIN_M = 0.7
"""The vehicle stays this far below the upper altitude limit."""
DETOUR_M_S, DETOUR_CLIMB_M_S, DETOUR_DESCENT_M_S = 2.0, 1.5, 1.0
"""Maximum horizontal speed, climb and descent speed of a detour."""
CLEAR_FOR_S = 0.5
"""The direct path must be clear for this long before the vehicle returns to it."""
RETURNED_WITHIN_M = 1.0
"""The detour ends when the vehicle is this close to the wanted position, horizontally."""
LEVEL_WITHIN_M, LEVEL_WITHIN_M_S = 0.2, 0.1
"""Height above or below the path, and vertical speed relative to it, at which the vehicle has reached the
path's altitude. Before, its sensors measure above the obstacles that reach the path."""
LEAVE_M_S = 1.0
"""Speed at which the vehicle leaves an obstacle that no longer blocks the path, before it descends: wind must
not move it back over the obstacle."""
MEASURED_WITHIN_S = 0.5
"""Above an obstacle the vehicle moves only if the last measurement is younger than this [s], because the
obstacle may be higher ahead."""
GOAL_MOVED_M = 2.0
"""If no clear heading was found, the search is repeated when the goal has moved this far."""
MIN_MOTION_M, MIN_MOTION_M_S = 0.5, 0.3
"""Below this distance to the goal [m] and this speed [m/s], the vehicle has no direction of travel."""
STOPPED_M_S = 0.3
"""A slower vehicle has stopped."""
MAX_DISTANCE_M = 3.0
"""If the vehicle is farther than this from its track [m], because its position estimate was reset or it was
pushed away, a new track begins at its position."""
TO_TRACK_M_S, TO_TRACK_PER_S = 1.0, 0.95
"""Largest speed towards the track [m/s], and speed for each metre of distance from the track [1/s]: PX4's
default position gain (MPC_XY_P)."""
MIN_GOAL_DISTANCE_M = 0.5
"""The track does not turn towards a goal that is nearer than this [m]."""


class Track:
    """The straight track of one detour, from the start of the detour to the goal, which may move.

    It keeps a vehicle that climbs over an obstacle, or descends behind it, on the track that it flew before.
    The vehicle is then controlled by velocity: without a correction, wind or the error of the velocity
    estimate would move it sideways by metres during the climb.
    """

    def __init__(self) -> None:
        self._point_ne: NorthEast | None = None
        """The point of the track that is nearest to the vehicle."""

    def end(self) -> None:
        """Ends the track; the next detour begins a new one."""
        self._point_ne = None

    def nearest(self, current: MotionState, wanted: WantedMotion) -> NorthEast:
        """The point of the track nearest to the vehicle, in the local frame [m]. A new track begins at the
        vehicle."""
        north, east, _ = current.position_ned_m
        if self._point_ne is None or math.dist(self._point_ne, (north, east)) > MAX_DISTANCE_M:
            self._point_ne = (north, east)
        start_n, start_e = self._point_ne
        goal_n, goal_e, _ = wanted.position_ned_m
        length_m = math.dist(self._point_ne, (goal_n, goal_e))
        if length_m > MIN_GOAL_DISTANCE_M:
            un, ue = (goal_n - start_n) / length_m, (goal_e - start_e) / length_m
            along_m = (north - start_n) * un + (east - start_e) * ue
            self._point_ne = (start_n + un * along_m, start_e + ue * along_m)
        return self._point_ne


def velocity_towards(current: MotionState, point_ne: NorthEast) -> NorthEast:
    """Horizontal velocity that returns the vehicle to a point of its track [m/s]."""
    north, east = point_ne[0] - current.position_ned_m[0], point_ne[1] - current.position_ned_m[1]
    away_m = math.hypot(north, east)
    if away_m == 0.0:
        return 0.0, 0.0
    speed_m_s = min(TO_TRACK_M_S, TO_TRACK_PER_S * away_m)
    return north / away_m * speed_m_s, east / away_m * speed_m_s


class Avoider:
    """Obstacle avoidance of one vehicle; exists only while avoidance is enabled.

    Args:
        way: whether to climb over obstacles first, or to fly around them.
    """

    def __init__(self, way: AvoidanceWay = "over") -> None:
        self.way: AvoidanceWay = way
        self._memory = ObstacleMemory()
        self._stored_scans: set[tuple[float, Vector3, int]] = set()
        self._state: AvoidanceState = "clear"
        self._clear_since_s: float | None = None
        self._side: Side | None = None
        self._turned_back = False
        """Whether the side was already changed in this detour."""
        self._unreachable_goal: Vector3 | None = None
        self._last_scan_up_m: float | None = None
        self._top_uncertainty_m = 0.0
        """Climb between two measurements; the top of the obstacle may be anywhere between them."""
        self._detour_up_m = 0.0
        """Altitude at which the vehicle flies around the obstacle."""
        self._hold_position: Vector3 | None = None
        self._reached_level = False
        """Whether the vehicle has reached the path's altitude during its return to the path."""
        self._track = Track()

    def adjust(
        self,
        now_s: float,
        current: MotionState,
        wanted: WantedMotion,
        scans: tuple[Scan, ...],
        limits: DetourLimits,
    ) -> AdjustedMotion:
        """The motion to fly instead of the wanted one.

        Args:
            now_s: monotonic time, on the same clock as the scans.
            current: the vehicle's position and motion.
            wanted: the motion without obstacles.
            scans: the newest scan of each sensor.
            limits: limits of speed, altitude and position.
        """
        adjusted = self._choose_motion(now_s, current, wanted, recent_scans(scans, now_s, FRESH_S), limits)
        self._state = adjusted.state
        if adjusted.state != "stopped" and adjusted.state != "turning":
            self._hold_position = None
        if adjusted.state not in ("over", "back"):
            self._track.end()
        if adjusted.state != "back":
            self._reached_level = False
        return adjusted

    def _choose_motion(
        self,
        now_s: float,
        current: MotionState,
        wanted: WantedMotion,
        scans: tuple[Scan, ...],
        limits: DetourLimits,
    ) -> AdjustedMotion:
        if not any(measures_level(scan) for scan in scans):
            return self._stop_and_hold(
                current, wanted, f"No obstacle measurement for {FRESH_S:g} s: the vehicle holds its position."
            )
        up_m, goal_up_m = -current.position_ned_m[2], -wanted.position_ned_m[2]
        low_m = min(up_m, goal_up_m) - BLOCKING_BELOW_M
        self._remember(now_s, current, scans, low_m - TOP_CLEARANCE_M / 2)
        heading = _heading(current, wanted)
        yaw = self._yaw_to_measure(current, wanted, scans, heading)
        points = self._memory.columns_above(low_m, now_s)
        blocking = blocking_obstacles(points, current, wanted, self._top_uncertainty_m)
        if blocking is not None:
            self._clear_since_s = None
            return self._detour(now_s, current, wanted, scans, limits, blocking, yaw)
        self._side, self._turned_back, self._unreachable_goal, self._top_uncertainty_m = (
            None,
            False,
            None,
            0.0,
        )
        if self._clear_since_s is None:
            self._clear_since_s = now_s
        if heading is not None and sensor_range_m(scans, heading) is None:
            return self._turn(current, wanted, heading)
        # Not directly above the goal, a descent needs a sensor that measures downward.
        must_descend = goal_up_m < up_m - BLOCKING_BELOW_M and _distance(current, wanted) > MIN_MOTION_M
        if self._state in ("clear", "turning") and not must_descend:
            return AdjustedMotion("clear", yaw_ned_rad=yaw)
        return self._return_to_path(now_s, current, wanted, scans, limits, yaw)

    def _remember(self, now_s: float, current: MotionState, scans: tuple[Scan, ...], lowest_m: float) -> None:
        """Stores the points of each new scan, measured from the position that the vehicle had at the time of
        the scan."""
        keys = {
            (scan.measured_s, scan.directions_ned[0], len(scan.directions_ned)): scan
            for scan in scans
            if scan.directions_ned
        }
        for key, scan in keys.items():
            if key in self._stored_scans:
                continue
            at_ned_m = _position_before(current, now_s - scan.measured_s)
            self._memory.add(scan, at_ned_m, lowest_m)
            if measures_level(scan):
                before_m, self._last_scan_up_m = self._last_scan_up_m, -at_ned_m[2]
                if before_m is not None and self._state in ("over", "stopped"):
                    self._top_uncertainty_m = max(self._top_uncertainty_m, self._last_scan_up_m - before_m)
        self._stored_scans = set(keys)

    def _yaw_to_measure(
        self, current: MotionState, wanted: WantedMotion, scans: tuple[Scan, ...], heading: float | None
    ) -> float | None:
        """The heading that points the sensors in the direction of travel; None if the sensors already measure
        that direction at the wanted yaw."""
        if heading is None:
            return None
        yaw = current.yaw_ned_rad if wanted.yaw_ned_rad is None else wanted.yaw_ned_rad
        return None if sensor_range_m(scans, heading, yaw - current.yaw_ned_rad) is not None else heading

    # --- actions ------------------------------------------------------------------------------------

    def _detour(
        self,
        now_s: float,
        current: MotionState,
        wanted: WantedMotion,
        scans: tuple[Scan, ...],
        limits: DetourLimits,
        blocking: BlockingObstacles,
        yaw: float | None,
    ) -> AdjustedMotion:
        up_m, goal_up_m = -current.position_ned_m[2], -wanted.position_ned_m[2]
        required_up_m = blocking.highest_m + TOP_CLEARANCE_M
        max_up_m = min(goal_up_m + MAX_CLIMB_M, -limits.region.down_min_m - CEILING_MARGIN_M)
        is_flying_around = self._side is not None or self._unreachable_goal is not None
        if self.way == "around" or required_up_m > max_up_m or is_flying_around:
            if not is_flying_around:
                self._detour_up_m = up_m
            return self._fly_around(now_s, current, wanted, scans, limits, blocking.clearance_m)
        # No descent over obstacles: the tops of those ahead may be higher than measured from below.
        climb = _limited_climb(max(required_up_m, min(max(up_m, goal_up_m), max_up_m)) - up_m, limits)
        heading = _heading(current, wanted)
        measured_m = None if heading is None else sensor_range_m(scans, heading)
        outdated = all(now_s - scan.measured_s > MEASURED_WITHIN_S for scan in scans if measures_level(scan))
        speed = 0.0
        if measured_m is not None and not outdated:
            free_m = min(blocking.first_m, measured_m) - CLEARANCE_M
            speed = min(DETOUR_M_S, limits.speed_m_s, _distance(current, wanted), braking_speed(free_m))
        is_ahead = math.isfinite(blocking.first_m)
        text = "Obstacle ahead: climbing over it." if is_ahead else "Above an obstacle: flying over it."
        correction_ne_m_s = self._velocity_to_track(now_s, current, wanted)
        return self._fly("over", text, current, wanted, heading, speed, climb, yaw, correction_ne_m_s)

    def _fly_around(
        self,
        now_s: float,
        current: MotionState,
        wanted: WantedMotion,
        scans: tuple[Scan, ...],
        limits: DetourLimits,
        clearance_m: float,
    ) -> AdjustedMotion:
        too_high = "" if self.way == "around" else " and too high to climb over"
        blocked_text = f"Obstacle ahead{too_high}, and the sensors measure no clear way around it."
        goal = wanted.position_ned_m
        if self._unreachable_goal is not None and math.dist(self._unreachable_goal, goal) < GOAL_MOVED_M:
            return self._stop_and_hold(current, wanted, blocked_text)
        nearby = self._memory.columns_above(-current.position_ned_m[2] - BLOCKING_BELOW_M, now_s)
        chosen = choose_heading(nearby, current, wanted, scans, limits, self._side, clearance_m)
        if chosen is None and self._side is not None and not self._turned_back:
            self._turned_back, self._side = True, "left" if self._side == "right" else "right"
            chosen = choose_heading(nearby, current, wanted, scans, limits, self._side, clearance_m)
        if chosen is None:
            self._unreachable_goal, self._side, self._turned_back = goal, None, False
            return self._stop_and_hold(current, wanted, blocked_text)
        self._unreachable_goal = None
        heading, self._side, free_m = chosen
        speed = min(DETOUR_M_S, limits.speed_m_s, braking_speed(free_m))
        climb = _limited_climb(self._detour_up_m + current.position_ned_m[2], limits)
        where = "" if self._side is None else f" on the {self._side}"
        text = f"Obstacle ahead: flying around it{where}."
        return self._fly("around", text, current, wanted, heading, speed, climb, None)

    def _return_to_path(
        self,
        now_s: float,
        current: MotionState,
        wanted: WantedMotion,
        scans: tuple[Scan, ...],
        limits: DetourLimits,
        yaw: float | None,
    ) -> AdjustedMotion:
        """Returns to the path: descends if nothing is below, then flies level to the wanted position."""
        assert self._clear_since_s is not None
        descent_m = wanted.position_ned_m[2] - current.position_ned_m[2]
        path_descent_m_s = wanted.velocity_ned_m_s[2]
        must_wait = now_s - self._clear_since_s < CLEAR_FOR_S
        is_above = descent_m > LEVEL_WITHIN_M
        vertical_m_s = abs(current.velocity_ned_m_s[2] - path_descent_m_s)
        if abs(descent_m) < LEVEL_WITHIN_M and vertical_m_s < LEVEL_WITHIN_M_S:
            self._reached_level = True
        elif descent_m > BLOCKING_BELOW_M:
            self._reached_level = False
        is_level = self._reached_level
        goal_moves = math.hypot(*wanted.velocity_ned_m_s) > MIN_MOTION_M_S
        if is_level and not must_wait and (not goal_moves or _distance(current, wanted) < RETURNED_WITHIN_M):
            return AdjustedMotion("clear", yaw_ned_rad=yaw)
        below_unmeasured = not any(measures_down(scan) for scan in scans)
        text = "The way is clear: returning to the path."
        climb = _limited_climb(-descent_m - path_descent_m_s, limits)
        if is_above:
            text = "Descending to the path."
            if below_unmeasured:
                text = "No sensor measures below: the vehicle stays above the path."
        if must_wait or below_unmeasured:
            climb = max(climb, 0.0)
        n, e = self._velocity_to_track(now_s, current, wanted)
        if must_wait or is_level or descent_m < 0.0 or below_unmeasured:
            n, e, _ = wanted.velocity_ned_m_s
            approach_m_s, heading = min(DETOUR_M_S, _distance(current, wanted)), _heading(current, wanted)
            if must_wait and is_above:
                n, e, approach_m_s = 0.0, 0.0, min(approach_m_s, LEAVE_M_S)
            if heading is not None:
                n, e = n + approach_m_s * math.cos(heading), e + approach_m_s * math.sin(heading)
        speed = min(math.hypot(n, e), limits.speed_m_s)
        return self._fly("back", text, current, wanted, math.atan2(e, n), speed, climb, yaw)

    def _velocity_to_track(self, now_s: float, current: MotionState, wanted: WantedMotion) -> NorthEast:
        """Velocity back to the track of this detour [m/s]; zero if an obstacle blocks the line to the
        track."""
        point = self._track.nearest(current, wanted)
        to_point = WantedMotion((*point, current.position_ned_m[2]))
        nearby = self._memory.columns_above(-current.position_ned_m[2] - BLOCKING_BELOW_M, now_s)
        if blocking_obstacles(nearby, current, to_point, 0.0) is not None:
            return 0.0, 0.0
        return velocity_towards(current, point)

    def _fly(
        self,
        state: AvoidanceState,
        text: str,
        current: MotionState,
        wanted: WantedMotion,
        heading: float | None,
        speed_m_s: float,
        climb_m_s: float,
        yaw: float | None,
        correction_ne_m_s: NorthEast = (0.0, 0.0),
    ) -> AdjustedMotion:
        n, e = correction_ne_m_s
        if heading is not None:
            n, e = n + speed_m_s * math.cos(heading), e + speed_m_s * math.sin(heading)
        yaw = _wanted_yaw(current, wanted) if yaw is None else yaw
        return AdjustedMotion(state, text, Velocity((n, e, -climb_m_s), yaw), yaw)

    def _turn(self, current: MotionState, wanted: WantedMotion, heading: float) -> AdjustedMotion:
        text = "Turning: the obstacle sensor does not measure in the direction of travel."
        stopped = self._stop_and_hold(current, wanted, text, heading)
        return AdjustedMotion("turning", text, stopped.motion, heading)

    def _stop_and_hold(
        self, current: MotionState, wanted: WantedMotion, text: str, yaw: float | None = None
    ) -> AdjustedMotion:
        """Slows down, then holds the position where the vehicle stopped."""
        yaw = _wanted_yaw(current, wanted) if yaw is None else yaw
        if self._hold_position is None and math.hypot(*current.velocity_ned_m_s) < STOPPED_M_S:
            self._hold_position = current.position_ned_m
        motion = (
            Velocity((0.0, 0.0, 0.0), yaw)
            if self._hold_position is None
            else Position(self._hold_position, yaw)
        )
        return AdjustedMotion("stopped", text, motion, yaw)


def _heading(current: MotionState, wanted: WantedMotion) -> float | None:
    """Direction of travel [rad]; None: no horizontal motion."""
    north, east = (wanted.position_ned_m[i] - current.position_ned_m[i] for i in (0, 1))
    if math.hypot(north, east) > MIN_MOTION_M:
        return math.atan2(east, north)
    vn, ve, _ = wanted.velocity_ned_m_s
    return math.atan2(ve, vn) if math.hypot(vn, ve) > MIN_MOTION_M_S else None


def _distance(current: MotionState, wanted: WantedMotion) -> float:
    return math.dist(current.position_ned_m[:2], wanted.position_ned_m[:2])


def _position_before(current: MotionState, age_s: float) -> Vector3:
    """Position of the vehicle `age_s` ago, at constant velocity."""
    n, e, d = (p - v * age_s for p, v in zip(current.position_ned_m, current.velocity_ned_m_s, strict=True))
    return (n, e, d)


def _wanted_yaw(current: MotionState, wanted: WantedMotion) -> float:
    return current.yaw_ned_rad if wanted.yaw_ned_rad is None else wanted.yaw_ned_rad


def _limited_climb(climb_m_s: float, limits: DetourLimits) -> float:
    """The climb speed, limited to that of a detour and of the vehicle; negative: descent."""
    return max(
        -min(DETOUR_DESCENT_M_S, limits.descent_m_s), min(climb_m_s, DETOUR_CLIMB_M_S, limits.climb_m_s)
    )
