"""Flies over or around obstacles, then returns to the path behind them.

The straight line to the wanted position, and the path after it, must be clear of recent measurements. If an
obstacle blocks them, the vehicle climbs above the highest measured point, flies on, and descends once nothing
was measured below. Alternatively it flies on the clear heading nearest to the direction of the goal. The
vehicle moves only in directions that a sensor measures. If no direction is allowed, or the sensors send
nothing, it stops and reports the reason.

The space below each remembered point counts as solid (`memory.py`). A sensor with a single ray measures
along one line only; it does not detect obstacles beside that line.
"""

from __future__ import annotations

import math

from missions.avoidance.corridor import BELOW_M, CLEARANCE_M, OVER_M, BlockingObstacles, blocking_obstacles
from missions.avoidance.detour import Side, choose_heading
from missions.avoidance.memory import ObstacleMemory
from missions.avoidance.scans import Scan, fresh, measures_down, measures_level, range_at_m
from missions.avoidance.stopping import braking_speed
from missions.avoidance.track import Track, velocity_towards
from missions.avoidance.values import (
    AdjustedMotion,
    AvoidanceState,
    AvoidanceWay,
    DetourLimits,
    MotionState,
    WantedMotion,
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
CLEAR_FOR_S = 0.5
"""The direct path must be clear for this long before the vehicle returns to it."""
RETURNED_WITHIN_M = 1.0
MEASURED_WITHIN_S = 0.5
"""Above an obstacle the vehicle moves only if the last measurement is younger than this [s]: the obstacle may
get higher."""
GOAL_MOVED_M = 2.0
"""If no way was found, the search is repeated when the goal has moved this far."""
MIN_MOTION_M, MIN_MOTION_M_S = 0.5, 0.3
"""Distance [m] and speed [m/s] below which no sensor must measure in the direction of travel."""
STOPPED_M_S = 0.3


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
        self._no_way_to: Vector3 | None = None
        self._scanned_at_m: float | None = None
        self._top_uncertainty_m = 0.0
        """Climb between two measurements; the top of the obstacle may be anywhere between them."""
        self._level_m = 0.0
        self._hold_position: Vector3 | None = None
        self._track = Track()

    def adjust(
        self,
        now_s: float,
        here: MotionState,
        wanted: WantedMotion,
        scans: tuple[Scan, ...],
        allowed: DetourLimits,
    ) -> AdjustedMotion:
        """The setpoint to fly instead of the wanted one.

        Args:
            now_s: monotonic, the clock of the scans.
            here: the vehicle's position and motion.
            wanted: the motion without obstacles.
            scans: the newest scan of each sensor.
            allowed: limits and allowed area.
        """
        adjusted = self._adjusted(now_s, here, wanted, fresh(scans, now_s, FRESH_S), allowed)
        self._state = adjusted.state
        if adjusted.state != "stopped" and adjusted.state != "turning":
            self._hold_position = None
        if adjusted.state not in ("over", "back"):
            self._track.end()
        return adjusted

    def _adjusted(
        self,
        now_s: float,
        here: MotionState,
        wanted: WantedMotion,
        seen: tuple[Scan, ...],
        allowed: DetourLimits,
    ) -> AdjustedMotion:
        if not any(measures_level(scan) for scan in seen):
            return self._stop_and_hold(
                here, wanted, f"No obstacle measurement for {FRESH_S:g} s: the vehicle holds its position."
            )
        up_m, goal_up_m = -here.position_ned_m[2], -wanted.position_ned_m[2]
        low_m = min(up_m, goal_up_m) - BELOW_M
        self._remember(now_s, here, seen, low_m - OVER_M / 2)
        heading = _heading(here, wanted)
        yaw = self._yaw_to_see(here, wanted, seen, heading)
        points = self._memory.above(low_m, now_s)
        blocking = blocking_obstacles(points, here, wanted, self._top_uncertainty_m)
        if blocking is not None:
            self._clear_since_s = None
            return self._detour(now_s, here, wanted, seen, allowed, blocking, yaw)
        self._side, self._turned_back, self._no_way_to, self._top_uncertainty_m = None, False, None, 0.0
        if self._clear_since_s is None:
            self._clear_since_s = now_s
        if heading is not None and range_at_m(seen, heading) is None:
            return self._turn(here, wanted, heading)
        below = goal_up_m < up_m - BELOW_M and _distance(here, wanted) > MIN_MOTION_M  # no sensor looks down
        if self._state in ("clear", "turning") and not below:
            return AdjustedMotion("clear", yaw_ned_rad=yaw)
        return self._return_to_path(now_s, here, wanted, seen, allowed, yaw)

    def _remember(self, now_s: float, here: MotionState, seen: tuple[Scan, ...], lowest_m: float) -> None:
        """Stores each new scan, taken from the vehicle's position at that time."""
        keys = {
            (scan.measured_s, scan.directions_ned[0], len(scan.directions_ned)): scan
            for scan in seen
            if scan.directions_ned
        }
        for key, scan in keys.items():
            if key in self._stored_scans:
                continue
            at_ned_m = _at(here, now_s - scan.measured_s)
            self._memory.add(scan, at_ned_m, lowest_m)
            if measures_level(scan):
                before_m, self._scanned_at_m = self._scanned_at_m, -at_ned_m[2]
                if before_m is not None and self._state in ("over", "stopped"):
                    self._top_uncertainty_m = max(self._top_uncertainty_m, self._scanned_at_m - before_m)
        self._stored_scans = set(keys)

    def _yaw_to_see(
        self, here: MotionState, wanted: WantedMotion, seen: tuple[Scan, ...], heading: float | None
    ) -> float | None:
        """The heading that points the sensors in the direction of travel; None if the wanted heading already
        does so."""
        if heading is None:
            return None
        yaw = here.yaw_ned_rad if wanted.yaw_ned_rad is None else wanted.yaw_ned_rad
        return None if range_at_m(seen, heading, yaw - here.yaw_ned_rad) is not None else heading

    # --- actions ------------------------------------------------------------------------------------

    def _detour(
        self,
        now_s: float,
        here: MotionState,
        wanted: WantedMotion,
        seen: tuple[Scan, ...],
        allowed: DetourLimits,
        blocking: BlockingObstacles,
        yaw: float | None,
    ) -> AdjustedMotion:
        up_m, goal_up_m = -here.position_ned_m[2], -wanted.position_ned_m[2]
        required_up_m = blocking.highest_m + OVER_M
        max_up_m = min(goal_up_m + MAX_CLIMB_M, -allowed.region.down_min_m - CEILING_MARGIN_M)
        started = self._side is not None or self._no_way_to is not None
        if self.way == "around" or required_up_m > max_up_m or started:
            if not started:
                self._level_m = up_m
            return self._fly_around(now_s, here, wanted, seen, allowed, blocking.clearance_m)
        climb = _clamp(max(required_up_m, min(goal_up_m, max_up_m)) - up_m, allowed)
        heading = _heading(here, wanted)
        measured_m = None if heading is None else range_at_m(seen, heading)
        outdated = all(now_s - scan.measured_s > MEASURED_WITHIN_S for scan in seen if measures_level(scan))
        speed = 0.0
        if measured_m is not None and not outdated:
            free_m = min(blocking.first_m, measured_m) - CLEARANCE_M
            speed = min(DETOUR_M_S, allowed.speed_m_s, _distance(here, wanted), braking_speed(free_m))
        is_ahead = math.isfinite(blocking.first_m)
        text = "Obstacle ahead: climbing over it." if is_ahead else "Above an obstacle: flying over it."
        to_track = self._to_track(now_s, here, wanted)
        return self._fly("over", text, here, wanted, heading, speed, climb, yaw, to_track)

    def _fly_around(
        self,
        now_s: float,
        here: MotionState,
        wanted: WantedMotion,
        seen: tuple[Scan, ...],
        allowed: DetourLimits,
        clearance_m: float,
    ) -> AdjustedMotion:
        too_high = "" if self.way == "around" else " and too high to climb over"
        no_way = f"Obstacle ahead{too_high}, and the sensors measure no clear way around it."
        goal = wanted.position_ned_m
        if self._no_way_to is not None and math.dist(self._no_way_to, goal) < GOAL_MOVED_M:
            return self._stop_and_hold(here, wanted, no_way)
        nearby = self._memory.above(-here.position_ned_m[2] - BELOW_M, now_s)
        chosen = choose_heading(nearby, here, wanted, seen, allowed, self._side, clearance_m)
        if chosen is None and self._side is not None and not self._turned_back:
            self._turned_back, self._side = True, "left" if self._side == "right" else "right"
            chosen = choose_heading(nearby, here, wanted, seen, allowed, self._side, clearance_m)
        if chosen is None:
            self._no_way_to, self._side, self._turned_back = goal, None, False
            return self._stop_and_hold(here, wanted, no_way)
        self._no_way_to = None
        heading, self._side, free_m = chosen
        speed = min(DETOUR_M_S, allowed.speed_m_s, braking_speed(free_m))
        climb = _clamp(self._level_m + here.position_ned_m[2], allowed)
        where = "" if self._side is None else f" on the {self._side}"
        text = f"Obstacle ahead: flying around it{where}."
        return self._fly("around", text, here, wanted, heading, speed, climb, None)

    def _return_to_path(
        self,
        now_s: float,
        here: MotionState,
        wanted: WantedMotion,
        seen: tuple[Scan, ...],
        allowed: DetourLimits,
        yaw: float | None,
    ) -> AdjustedMotion:
        """Returns to the path: descends if nothing is below, then flies level to the wanted position."""
        assert self._clear_since_s is not None
        down_m = wanted.position_ned_m[2] - here.position_ned_m[2]
        waits = now_s - self._clear_since_s < CLEAR_FOR_S
        moves = math.hypot(*wanted.velocity_ned_m_s) > MIN_MOTION_M_S
        if abs(down_m) < BELOW_M and not waits and (not moves or _distance(here, wanted) < RETURNED_WITHIN_M):
            return AdjustedMotion("clear", yaw_ned_rad=yaw)
        blind = not any(measures_down(scan) for scan in seen)
        text = "The way is clear: returning to the path."
        climb = _clamp(-down_m, allowed)
        if down_m > BELOW_M:
            text = "Descending to the path."
            if blind:
                text = "No sensor measures below: the vehicle stays above the path."
        if waits or blind:
            climb = max(climb, 0.0)
        n, e = self._to_track(now_s, here, wanted)
        if down_m <= BELOW_M or blind:
            n, e, _ = wanted.velocity_ned_m_s
            toward, heading = min(DETOUR_M_S, _distance(here, wanted)), _heading(here, wanted)
            if heading is not None:
                n, e = n + toward * math.cos(heading), e + toward * math.sin(heading)
        speed = min(math.hypot(n, e), allowed.speed_m_s)
        return self._fly("back", text, here, wanted, math.atan2(e, n), speed, climb, yaw)

    def _to_track(self, now_s: float, here: MotionState, wanted: WantedMotion) -> NorthEast:
        """Velocity back to the track of this detour; zero if an obstacle is on the way there [m/s]."""
        point = self._track.nearest(here, wanted)
        to_point = WantedMotion((*point, here.position_ned_m[2]))
        nearby = self._memory.above(-here.position_ned_m[2] - BELOW_M, now_s)
        if blocking_obstacles(nearby, here, to_point, 0.0) is not None:
            return 0.0, 0.0
        return velocity_towards(here, point)

    def _fly(
        self,
        state: AvoidanceState,
        text: str,
        here: MotionState,
        wanted: WantedMotion,
        heading: float | None,
        speed_m_s: float,
        climb_m_s: float,
        yaw: float | None,
        to_track: NorthEast = (0.0, 0.0),
    ) -> AdjustedMotion:
        n, e = to_track
        if heading is not None:
            n, e = n + speed_m_s * math.cos(heading), e + speed_m_s * math.sin(heading)
        yaw = _yaw(here, wanted) if yaw is None else yaw
        return AdjustedMotion(state, text, Velocity((n, e, -climb_m_s), yaw), yaw)

    def _turn(self, here: MotionState, wanted: WantedMotion, heading: float) -> AdjustedMotion:
        text = "Turning: the obstacle sensor does not measure in the direction of travel."
        stopped = self._stop_and_hold(here, wanted, text, heading)
        return AdjustedMotion("turning", text, stopped.motion, heading)

    def _stop_and_hold(
        self, here: MotionState, wanted: WantedMotion, text: str, yaw: float | None = None
    ) -> AdjustedMotion:
        """Slows down, then holds the position where the vehicle stopped."""
        yaw = _yaw(here, wanted) if yaw is None else yaw
        if self._hold_position is None and math.hypot(*here.velocity_ned_m_s) < STOPPED_M_S:
            self._hold_position = here.position_ned_m
        motion = (
            Velocity((0.0, 0.0, 0.0), yaw)
            if self._hold_position is None
            else Position(self._hold_position, yaw)
        )
        return AdjustedMotion("stopped", text, motion, yaw)


def _heading(here: MotionState, wanted: WantedMotion) -> float | None:
    """Direction of travel [rad]; None: no horizontal motion."""
    north, east = (wanted.position_ned_m[i] - here.position_ned_m[i] for i in (0, 1))
    if math.hypot(north, east) > MIN_MOTION_M:
        return math.atan2(east, north)
    vn, ve, _ = wanted.velocity_ned_m_s
    return math.atan2(ve, vn) if math.hypot(vn, ve) > MIN_MOTION_M_S else None


def _distance(here: MotionState, wanted: WantedMotion) -> float:
    return math.dist(here.position_ned_m[:2], wanted.position_ned_m[:2])


def _at(here: MotionState, age_s: float) -> Vector3:
    """Position of the vehicle at an earlier time."""
    n, e, d = (p - v * age_s for p, v in zip(here.position_ned_m, here.velocity_ned_m_s, strict=True))
    return (n, e, d)


def _yaw(here: MotionState, wanted: WantedMotion) -> float:
    return here.yaw_ned_rad if wanted.yaw_ned_rad is None else wanted.yaw_ned_rad


def _clamp(climb_m_s: float, allowed: DetourLimits) -> float:
    """A climb speed within the limits of the detour and of the vehicle."""
    return max(
        -min(DETOUR_DESCENT_M_S, allowed.descent_m_s), min(climb_m_s, DETOUR_CLIMB_M_S, allowed.climb_m_s)
    )
