"""Destination and route of a return: home, a rally point or the mission's landing, by RTL_TYPE."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.autopilot.mission.items import LAND, LAND_START, RALLY_POINT, RETURN, Item
from vehicle_sim.autopilot.plans import RALLY, Plans
from vehicle_sim.geodesy import to_local
from vehicle_sim.home import Home
from vehicle_sim.vehicle_view import Vector, VehicleView

HOME_OR_RALLY, LANDING_OR_RALLY, MISSION_PATH, ANY_DESTINATION, SHORTER_MISSION_PATH = range(5)
"""Values of RTL_TYPE: the closest home or rally point; the closest mission landing or rally point; along the
mission; the closest of all destinations; along the mission, forward or back, with fewer waypoints."""
RALLY_FRAMES = (0, 3)
"""Frames of rally points that PX4's return supports; points in other frames are reported and not used."""


class DestinationKind(Enum):
    """What the vehicle returns to."""

    HOME = "home"
    RALLY = "rally"
    MISSION_LANDING = "mission landing"


@dataclass(frozen=True, slots=True)
class Destination:
    """A position to land at, and the route to it."""

    kind: DestinationKind
    position_ned_m: Vector
    """Position on the ground; for a mission landing, the position of a waypoint."""
    yaw_ned_rad: float
    route_ned_m: tuple[Vector, ...] = ()
    """Waypoints to fly through; the vehicle lands at the last one."""
    climbs: bool = True
    """Whether the vehicle first climbs to the return altitude."""


class DestinationChooser:
    """Chooses the destination of one vehicle's return."""

    def __init__(self, view: VehicleView, announcer: Announcer, home: Home, plans: Plans) -> None:
        self._view, self._announcer, self._home, self._plans = view, announcer, home, plans

    def choose(self, mission_seq: int) -> Destination:
        """Chooses by RTL_TYPE; `mission_seq` is the mission item that was current."""
        rtl_type = self._view.choice("RTL_TYPE")
        home = Destination(DestinationKind.HOME, self._home.position_ned_m, self._home.yaw_ned_rad)
        landing = self._landing()
        if rtl_type in (MISSION_PATH, SHORTER_MISSION_PATH):
            return self._mission_route(rtl_type, mission_seq, landing, home)
        candidates = self._rally_points()
        if landing is not None and rtl_type in (LANDING_OR_RALLY, ANY_DESTINATION):
            candidates.append(landing)
        if rtl_type != LANDING_OR_RALLY or not candidates:
            candidates.insert(0, home)
        return min(candidates, key=self._distance_m)

    def _distance_m(self, destination: Destination) -> float:
        north, east, _ = self._view.estimate.position_ned_m
        return math.hypot(destination.position_ned_m[0] - north, destination.position_ned_m[1] - east)

    def _rally_points(self) -> list[Destination]:
        points: list[Destination] = []
        unsupported_frame: int | None = None
        for item in self._plans.items(RALLY):
            if item.command != RALLY_POINT:
                continue
            if item.frame in RALLY_FRAMES:
                points.append(
                    Destination(DestinationKind.RALLY, self._local_position(item), self._home.yaw_ned_rad)
                )
            elif unsupported_frame is None:
                unsupported_frame = item.frame
        if unsupported_frame is not None:
            self._announcer.announce(
                2, "RTL: unsupported MAV_FRAME", "rtl_unsupported_mav_frame", "B", unsupported_frame
            )
        return points

    def _landing(self) -> Destination | None:
        """The mission's landing: from DO_LAND_START if present, else its LAND item."""
        items = self._plans.mission
        land_seq = next((seq for seq, item in enumerate(items) if item.command == LAND), None)
        if land_seq is None:
            return None
        starts = (seq for seq, item in enumerate(items[:land_seq]) if item.command == LAND_START)
        landing_items = items[next(starts, land_seq) : land_seq + 1]
        route = tuple(self._local_position(item) for item in landing_items if item.is_position)
        yaw = items[land_seq].yaw_rad()
        return Destination(
            DestinationKind.MISSION_LANDING,
            route[0],
            yaw if math.isfinite(yaw) else self._home.yaw_ned_rad,
            route,
        )

    def _mission_route(
        self, rtl_type: int, mission_seq: int, landing: Destination | None, home: Destination
    ) -> Destination:
        items = self._plans.mission
        flown_items = reversed(items[:mission_seq])
        reverse_route = [self._local_position(item) for item in flown_items if _is_route_waypoint(item)]
        return_home = Destination(
            DestinationKind.HOME,
            home.position_ned_m,
            home.yaw_ned_rad,
            (*reverse_route, home.position_ned_m),
            climbs=not reverse_route,
        )
        if landing is None:
            return return_home
        land_seq = next(seq for seq, item in enumerate(items) if item.command == LAND)
        items_ahead = items[mission_seq : land_seq + 1]
        route = tuple(self._local_position(item) for item in items_ahead if item.is_position)
        if not route:
            return landing
        if rtl_type == SHORTER_MISSION_PATH and len(reverse_route) < len(route) - 1:
            return return_home
        return Destination(
            DestinationKind.MISSION_LANDING, route[-1], landing.yaw_ned_rad, route, climbs=False
        )

    def _local_position(self, item: Item) -> Vector:
        origin_lat, origin_lon, origin_alt = self._view.origin
        n, e = to_local(item.lat_deg, item.lon_deg, origin_lat, origin_lon)  # type: ignore[arg-type]
        return (float(n), float(e), origin_alt - item.alt_amsl_m(self._home.alt_amsl_m))

    def report_unsupported(self) -> bool:
        """Reports rally points in an unsupported frame; False: there are none."""
        return len(self._rally_points()) < sum(
            item.command == RALLY_POINT for item in self._plans.items(RALLY)
        )


def _is_route_waypoint(item: Item) -> bool:
    return item.is_position and item.command not in (LAND, RETURN)
