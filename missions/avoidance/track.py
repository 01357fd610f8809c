"""Keeps a vehicle that climbs over an obstacle, or descends behind it, on the track that it flew before.

The vehicle is then controlled by velocity. Without a correction, wind or the error of the
velocity estimate would move the vehicle sideways by metres during the climb.
"""

from __future__ import annotations

import math

from missions.avoidance.values import MotionState, WantedMotion
from missions.fence import NorthEast

MAX_DISTANCE_M = 3.0
"""If the vehicle is farther than this from its track [m], because its position estimate was reset or it was
pushed away, a new track begins at its position."""
TO_TRACK_M_S, TO_TRACK_PER_S = 1.0, 0.95
"""Largest speed towards the track [m/s], and speed for each metre of distance from the track [1/s]: PX4's
default position gain (MPC_XY_P)."""
MIN_GOAL_DISTANCE_M = 0.5
"""The track does not turn towards a goal that is nearer than this [m]."""


class Track:
    """The straight track of one detour, from the start of the detour to the goal, which may move."""

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
