"""Converts a waypoint plan to an offboard mission: the same positions, flown as a trajectory by setpoints."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from missions.camera_items import GimbalPitchYaw, PhotoStart, TriggerDistance
from missions.errors import PlanError
from missions.items import (
    ChangeSpeed,
    Delay,
    Land,
    LegacyRoi,
    LoiterTime,
    LoiterToAltitude,
    LoiterUnlimited,
    PlacedItem,
    ReturnHome,
    RoiLocation,
    RoiNone,
    Takeoff,
    Waypoint,
)
from missions.offboard import steps as s
from missions.offboard.document import OffboardMission
from missions.offboard.places import Place
from missions.plan import Plan, SimpleItem
from missions.route import follow, is_flown_to
from missions.values import Altitude
from missions.vehicle import VehicleModel

WAIT_S = 3600.0
"""How long an unlimited loiter waits for a person."""
LOWEST_TAKEOFF_M = 2.5
FASTEST_M_S = 100.0
LONGEST_S = 86_400.0
MAX_POINTS = 5000


@dataclass(frozen=True, slots=True)
class Converted:
    """A mission made of a plan."""

    mission: OffboardMission
    notes: tuple[str, ...]
    """Notes about parts of the plan that the mission does not have."""


@dataclass(slots=True)
class _Maker:
    plan: Plan
    vehicle: VehicleModel
    steps: list[s.MissionStep] = field(default_factory=list)
    points: list[s.FlyPoint] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    speed_m_s: float | None = None
    photo_every_m: float | None = None
    up: bool = False

    def flush(self) -> None:
        """The points so far as one step."""
        if self.points:
            self.steps.append(
                s.Fly(points=tuple(self.points), speed_m_s=self.speed_m_s, photo_every_m=self.photo_every_m)
            )
            self.points = []

    def add(self, step: s.MissionStep) -> None:
        """A step after the points so far."""
        self.flush()
        self.steps.append(step)

    def point(self, item: PlacedItem, altitude: Altitude | None = None, **rest: Any) -> None:
        """Fly to the place of an item."""
        yaw_deg = getattr(item, "yaw_ned_deg", None)
        yaw_rad = _radians(yaw_deg)
        named = bool(self.points) and any(point.yaw_ned_rad is not None for point in self.points)
        if len(self.points) == MAX_POINTS or (self.points and named != (yaw_rad is not None)):
            self.flush()
        place = _place(item, altitude or item.altitude)
        corner_m = self.vehicle.acceptance_m
        self.points.append(s.FlyPoint(**place, yaw_ned_rad=yaw_rad, corner_m=corner_m, **rest))


def from_plan(plan: Plan, name: str, vehicle: VehicleModel | None = None) -> Converted:
    """The mission that flies a plan's items as PX4 would, jumps written out.

    Raises:
        PlanError: The plan has no item that can be flown, repeats without end, or has a terrain altitude
            without elevation data.
    """
    vehicle = vehicle or VehicleModel()
    route = follow(plan)
    if route.endless or route.truncated or route.stalled_row is not None:
        raise PlanError("the plan", "it repeats without end", "Give its jumps a number of repeats.")
    speed_m_s = None if plan.hover_speed_m_s is None else min(FASTEST_M_S, plan.hover_speed_m_s)
    maker = _Maker(plan, vehicle, speed_m_s=speed_m_s)
    for step in route.steps:
        _item(maker, step.item, f"item {step.row + 1} ({step.item.kind.replace('_', ' ')})")
    maker.flush()
    if len(maker.steps) > s.MAX_STEPS:
        reason = f"it becomes {len(maker.steps)} steps, the maximum is {s.MAX_STEPS}"
        raise PlanError("the plan", reason, "Split the plan.")
    if not any(isinstance(step, s.Fly) for step in maker.steps):
        raise PlanError("the plan", "it has no item that is flown to", "Add a waypoint.")
    mission = OffboardMission(
        name=name, home=plan.planned_home, fence=plan.fence[:100], steps=tuple(maker.steps), missions={}
    )
    if plan.rally_points:
        maker.notes.append("Rally points are left out: they belong to the vehicle.")
    if len(plan.fence) > 100:
        maker.notes.append("Only the first 100 fence zones are kept.")
    return Converted(mission, tuple(dict.fromkeys(maker.notes)))


def _item(maker: _Maker, item: SimpleItem, what: str) -> None:
    if isinstance(item, PlacedItem) and is_flown_to(item):
        _placed(maker, item, what)
    elif isinstance(item, Delay):
        if (item.delay_s or 0.0) < 0.0:
            maker.notes.append(f"{what.capitalize()} waits for a time of day; it is left out.")
        else:
            maker.add(s.Hold(duration_s=min(LONGEST_S, item.delay_s or 0.0)))
    elif isinstance(item, ChangeSpeed) and (item.speed_m_s or 0.0) > 0.0 and item.speed_type in (0.0, 1.0):
        maker.flush()
        maker.speed_m_s = min(FASTEST_M_S, item.speed_m_s or 0.0)
    elif isinstance(item, ReturnHome):
        _return(maker, what)
    elif isinstance(item, TriggerDistance):
        maker.flush()
        maker.photo_every_m = min(10_000.0, item.distance_m or 0.0) or None
    elif isinstance(item, PhotoStart):
        count = max(1, int(item.count or 0))
        if not item.count:
            maker.notes.append(f"{what.capitalize()} takes pictures until stopped; one is taken.")
        maker.add(s.Photo(count=min(count, 10_000), interval_s=min(3600.0, max(0.1, item.interval_s or 1.0))))
    elif isinstance(item, RoiLocation) or (isinstance(item, LegacyRoi) and item.mode == 3.0):
        place = Place(**_place(item, item.altitude))
        maker.add(s.Gimbal(track="look_at", place=place))
    elif isinstance(item, GimbalPitchYaw):
        pitch, yaw = _radians(item.pitch_deg or 0.0), _radians(item.yaw_deg or 0.0)
        maker.add(s.Gimbal(track="fixed", pitch_rad=pitch or 0.0, yaw_rad=yaw or 0.0))
    elif isinstance(item, RoiNone):
        maker.add(s.Gimbal(track="release"))
    else:
        maker.notes.append(f"{what.capitalize()} is left out.")


def _placed(maker: _Maker, item: PlacedItem, what: str) -> None:
    if not maker.up:
        _take_off(maker, item, what)
    if isinstance(item, Takeoff):
        maker.point(item, stop=True)
    elif isinstance(item, Land):
        here = Altitude(value_m=maker.vehicle.return_alt_m, reference="home")
        before = maker.points[-1] if maker.points else _last_point(maker)
        if before is None:
            maker.point(item, here)
        else:
            level = before.model_dump(include={"alt_amsl_m", "alt_home_m"}, exclude_none=True)
            yaw = _radians(item.yaw_ned_deg)
            if (yaw is None) == any(p.yaw_ned_rad is not None for p in maker.points):
                maker.flush()
            maker.points.append(
                s.FlyPoint(lat_deg=item.lat_deg, lon_deg=item.lon_deg, yaw_ned_rad=yaw, **level)
            )
        maker.add(s.Land())
        maker.up = False
    elif isinstance(item, LoiterUnlimited):
        maker.point(item, stop=True)
        maker.add(s.Wait(until="person", message="Go on?", timeout_s=WAIT_S, on_timeout="return"))
    elif isinstance(item, LoiterTime | Waypoint):
        hold_s = min(LONGEST_S, max(0.0, item.hold_s or 0.0))
        maker.point(item, hold_s=hold_s)
    else:
        maker.point(item)
        if not isinstance(item, LoiterToAltitude):
            maker.notes.append(f"{what.capitalize()} is flown as a point.")


def _last_point(maker: _Maker) -> s.FlyPoint | None:
    flown = [step for step in maker.steps if isinstance(step, s.Fly)]
    return flown[-1].points[-1] if flown else None


def _take_off(maker: _Maker, item: PlacedItem, what: str) -> None:
    """The climb before the first place: to the take-off's height, else to that of the first place."""
    home = maker.plan.planned_home
    height_m = item.altitude.value_m
    if item.altitude.reference != "home":
        amsl_m = item.altitude.amsl_m(None)
        if home is None or amsl_m is None:
            raise PlanError(what, "its height above home is not known", "Set the planned home.")
        height_m = amsl_m - home.alt_amsl_m
    maker.steps.append(s.TakeOff(height_m=min(500.0, max(LOWEST_TAKEOFF_M, height_m))))
    maker.up = True


def _return(maker: _Maker, what: str) -> None:
    home = maker.plan.planned_home
    if home is None:
        raise PlanError(what, "the plan has no home to return to", "Set the planned home.")
    maker.flush()
    maker.points.append(
        s.FlyPoint(
            lat_deg=home.lat_deg, lon_deg=home.lon_deg, alt_home_m=maker.vehicle.return_alt_m, stop=True
        )
    )
    maker.add(s.Land())
    maker.up = False


def _radians(angle_deg: float | None) -> float | None:
    return None if angle_deg is None else math.remainder(math.radians(angle_deg), math.tau)


def _place(item: PlacedItem, altitude: Altitude) -> dict[str, Any]:
    found: dict[str, Any] = {"lat_deg": item.lat_deg, "lon_deg": item.lon_deg}
    if altitude.reference == "home":
        return found | {"alt_home_m": altitude.value_m}
    amsl_m = altitude.amsl_m(None)
    if amsl_m is None:
        where = f"the place at {item.lat_deg:.5f}, {item.lon_deg:.5f}"
        raise PlanError(where, "its terrain altitude is not resolved", "Resolve it with elevation data.")
    return found | {"alt_amsl_m": amsl_m}
