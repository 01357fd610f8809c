"""The heading in a mission: the item's yaw, a region of interest, otherwise MPC_YAW_MODE."""

from __future__ import annotations

import math

from vehicle_sim.autopilot.mission.items import ROI, ROI_LOCATION, ROI_NEXT_WAYPOINT, ROI_NONE, Item
from vehicle_sim.autopilot.path import Path
from vehicle_sim.geodesy import is_position, to_local
from vehicle_sim.home import Home
from vehicle_sim.vehicle_view import Vector, VehicleView

TOWARDS_WAYPOINT, TOWARDS_HOME, AWAY_FROM_HOME, ALONG_TRAJECTORY, YAW_FIRST, FIXED = range(6)
"""MPC_YAW_MODE."""
OLD_ROI_NEXT, OLD_ROI_LOCATION = 1, 3
"""MAV_ROI of DO_SET_ROI's first parameter."""


class Heading:
    """The heading of one vehicle in Mission mode."""

    def __init__(self, view: VehicleView, path: Path, home: Home) -> None:
        self._view, self._path, self._home = view, path, home
        self.item_yaw_rad = math.nan
        self._roi_ne_m: tuple[float, float] | None = None
        """North and east of the region of interest."""

    def reset(self) -> None:
        """Clears the item's heading and keeps a region of interest, as PX4 does."""
        self.item_yaw_rad = math.nan

    def handle_item(self, item: Item, command_parameters: tuple[float, ...]) -> None:
        """Handles items that set or clear the region of interest.

        Args:
            item: the item.
            command_parameters: the parameters of its command, with latitude and longitude in degrees.
        """
        if item.command == ROI_LOCATION or (item.command == ROI and item.parameters[0] == OLD_ROI_LOCATION):
            self.look_at(command_parameters[4], command_parameters[5])
        elif item.command in (ROI_NONE, ROI_NEXT_WAYPOINT, ROI):
            self._roi_ne_m = None

    def look_at(self, lat_deg: float, lon_deg: float) -> None:
        """Points the nose at a position."""
        if is_position(lat_deg, lon_deg):
            origin_lat, origin_lon, _ = self._view.origin
            n, e = to_local(lat_deg, lon_deg, origin_lat, origin_lon)  # type: ignore[arg-type]
            self._roi_ne_m = (float(n), float(e))

    @property
    def has_roi(self) -> bool:
        """Whether a region of interest determines the heading."""
        return self._roi_ne_m is not None

    def setpoint_rad(self, target_ned_m: Vector, acceptance_m: float) -> float:
        """The heading setpoint [rad, NED]; the last one if neither item nor parameters define it."""
        x, y, _ = self._path.position_ned_m
        if self._roi_ne_m is not None:
            return self._towards(self._roi_ne_m[0] - x, self._roi_ne_m[1] - y, 0.5)
        if math.isfinite(self.item_yaw_rad):
            return self.item_yaw_rad
        mode = self._view.choice("MPC_YAW_MODE")
        home_n, home_e, _ = self._home.position_ned_m
        if mode in (TOWARDS_WAYPOINT, YAW_FIRST):
            return self._towards(target_ned_m[0] - x, target_ned_m[1] - y, acceptance_m)
        if mode == TOWARDS_HOME:
            return self._towards(home_n - x, home_e - y, acceptance_m)
        if mode == AWAY_FROM_HOME:
            return self._towards(x - home_n, y - home_e, acceptance_m)
        if mode == ALONG_TRAJECTORY:
            return self._towards(self._path.x.velocity_m_s, self._path.y.velocity_m_s, 0.5)
        return self._path.yaw_target_rad

    def fixed_target(self, target_ned_m: Vector, acceptance_m: float) -> tuple[float, float, float] | None:
        """The fixed point that the nose faces: north [m], east [m], minimum distance [m].

        Closer than the minimum distance, the vehicle keeps its heading (infinite: it always keeps it). None:
        the heading depends on the motion, so no fixed point exists.
        """
        mode = self._view.choice("MPC_YAW_MODE")
        if self._roi_ne_m is not None:
            return (*self._roi_ne_m, 0.5)
        if math.isfinite(self.item_yaw_rad):
            return (0.0, 0.0, math.inf)
        if mode in (TOWARDS_WAYPOINT, YAW_FIRST):
            return (target_ned_m[0], target_ned_m[1], acceptance_m)
        if mode == TOWARDS_HOME:
            return (*self._home.position_ned_m[:2], acceptance_m)
        return None if mode in (AWAY_FROM_HOME, ALONG_TRAJECTORY) else (0.0, 0.0, math.inf)

    def _towards(self, north: float, east: float, min_distance_m: float) -> float:
        if math.hypot(north, east) <= min_distance_m:
            return self._path.yaw_target_rad
        return math.atan2(east, north)
