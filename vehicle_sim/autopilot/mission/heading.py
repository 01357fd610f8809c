"""The heading in a mission: a region of interest, otherwise the item's yaw, otherwise MPC_YAW_MODE."""

from __future__ import annotations

import math

from vehicle_sim.autopilot.mission.items import ROI, ROI_LOCATION, ROI_NEXT_WAYPOINT, ROI_NONE, Item
from vehicle_sim.autopilot.path import Path
from vehicle_sim.geodesy import is_position, to_local
from vehicle_sim.home import Home
from vehicle_sim.vehicle_view import Vector, VehicleView

TOWARDS_WAYPOINT, TOWARDS_HOME, AWAY_FROM_HOME, ALONG_TRAJECTORY, YAW_FIRST, FIXED = range(6)
"""MPC_YAW_MODE."""
MAV_ROI_LOCATION = 3
"""First parameter of DO_SET_ROI for a position."""
_MIN_ROI_DISTANCE_M = 0.5
_MIN_TRAJECTORY_SPEED_M_S = 0.5


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
        if item.command == ROI_LOCATION or (item.command == ROI and item.parameters[0] == MAV_ROI_LOCATION):
            self.look_at(command_parameters[4], command_parameters[5])
        elif item.command in (ROI_NONE, ROI_NEXT_WAYPOINT, ROI):
            self._roi_ne_m = None

    def look_at(self, lat_deg: float, lon_deg: float) -> None:
        """Sets the region of interest, to which the nose then points; ignores an invalid position."""
        if is_position(lat_deg, lon_deg):
            origin_lat, origin_lon, _ = self._view.origin
            north_m, east_m = to_local(lat_deg, lon_deg, origin_lat, origin_lon)  # type: ignore[arg-type]
            self._roi_ne_m = (float(north_m), float(east_m))

    @property
    def has_roi(self) -> bool:
        """Whether a region of interest determines the heading."""
        return self._roi_ne_m is not None

    def setpoint_rad(self, target_ned_m: Vector, acceptance_m: float) -> float:
        """The heading setpoint [rad, NED]; unchanged if neither item nor parameters define a heading."""
        north, east, _ = self._path.position_ned_m
        point = self.fixed_target(target_ned_m, acceptance_m)
        if point is not None:
            point_n, point_e, min_distance_m = point
            if math.isinf(min_distance_m) and math.isfinite(self.item_yaw_rad):
                return self.item_yaw_rad
            return self._direction_rad(point_n - north, point_e - east, min_distance_m)
        if self._view.choice("MPC_YAW_MODE") == AWAY_FROM_HOME:
            home_n, home_e, _ = self._home.position_ned_m
            return self._direction_rad(north - home_n, east - home_e, acceptance_m)
        vn, ve = self._path.x.velocity_m_s, self._path.y.velocity_m_s
        return self._direction_rad(vn, ve, _MIN_TRAJECTORY_SPEED_M_S)

    def fixed_target(self, target_ned_m: Vector, acceptance_m: float) -> tuple[float, float, float] | None:
        """The fixed point that the nose points to: north [m], east [m], minimum distance [m].

        The heading is constant within the minimum distance, and always if this distance is infinite. None: no
        fixed point, because the heading depends on the motion.
        """
        mode = self._view.choice("MPC_YAW_MODE")
        if self._roi_ne_m is not None:
            return (*self._roi_ne_m, _MIN_ROI_DISTANCE_M)
        if math.isfinite(self.item_yaw_rad):
            return (0.0, 0.0, math.inf)
        if mode in (TOWARDS_WAYPOINT, YAW_FIRST):
            return (target_ned_m[0], target_ned_m[1], acceptance_m)
        if mode == TOWARDS_HOME:
            return (*self._home.position_ned_m[:2], acceptance_m)
        return None if mode in (AWAY_FROM_HOME, ALONG_TRAJECTORY) else (0.0, 0.0, math.inf)

    def _direction_rad(self, north: float, east: float, min_length: float) -> float:
        """Direction of a vector; the kept heading if the vector is not longer than `min_length`."""
        if math.isinf(min_length):
            return self._path.yaw_target_rad
        if math.hypot(north, east) <= min_length:
            return self._path.kept_heading_rad
        return math.atan2(east, north)
