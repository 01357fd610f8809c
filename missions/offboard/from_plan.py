"""Converts a waypoint plan to an offboard mission: the same positions, flown as a trajectory by setpoints."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from missions.camera_items import GimbalPitchYaw, PhotoStart, TriggerDistance
from missions.errors import PlanError
from missions.estimates import GROUND_SPEED_TYPES
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
from missions.offboard.positions import MissionPosition
from missions.plan import Plan, SimpleItem
from missions.route import is_flown_to, route_of
from missions.values import Altitude
from missions.vehicle import VehicleModel

LOITER_TIMEOUT_S = 3600.0
"""Timeout of an unlimited loiter, which waits for the pilot."""
ROI_LOCATION = 3.0
"""MAV_ROI_LOCATION: the mode of a legacy region of interest that is a position."""
MIN_TAKEOFF_M = 2.5
MAX_SPEED_M_S = 100.0
MAX_HOLD_S = 86_400.0
MAX_POINTS = 5000


@dataclass(frozen=True, slots=True)
class ConvertedPlan:
    """A mission converted from a plan."""

    mission: OffboardMission
    notes: tuple[str, ...]
    """Differences between the mission and the plan, as sentences."""


@dataclass(slots=True)
class _MissionBuilder:
    plan: Plan
    vehicle: VehicleModel
    steps: list[s.MissionStep] = field(default_factory=list)
    points: list[s.FlyPoint] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    speed_m_s: float | None = None
    photo_every_m: float | None = None
    in_air: bool = False

    def flush(self) -> None:
        """Makes one step of the collected points."""
        if self.points:
            self.steps.append(
                s.Fly(points=tuple(self.points), speed_m_s=self.speed_m_s, photo_every_m=self.photo_every_m)
            )
            self.points = []

    def add(self, step: s.MissionStep) -> None:
        """Adds a step after the collected points."""
        self.flush()
        self.steps.append(step)

    def add_point(self, item: PlacedItem, altitude: Altitude | None = None, **fields: Any) -> None:
        """Adds a point at the position of an item."""
        yaw_deg = getattr(item, "yaw_ned_deg", None)
        yaw_rad = _radians(yaw_deg)
        has_yaw = bool(self.points) and any(point.yaw_ned_rad is not None for point in self.points)
        if len(self.points) == MAX_POINTS or (self.points and has_yaw != (yaw_rad is not None)):
            self.flush()
        position = _position(item, altitude or item.altitude)
        corner_m = self.vehicle.acceptance_m
        self.points.append(s.FlyPoint(**position, yaw_ned_rad=yaw_rad, corner_m=corner_m, **fields))


def from_plan(plan: Plan, name: str, vehicle: VehicleModel | None = None) -> ConvertedPlan:
    """The mission that flies a plan's items as PX4 would; jumps become repeated steps.

    Raises:
        PlanError: The plan has no item that can be flown, repeats without end, or has a terrain altitude
            without elevation data.
    """
    builder = _build(plan, vehicle, in_air=False)
    mission = OffboardMission(
        name=name,
        home=plan.planned_home,
        fence=plan.fence[:100],
        obstacles=plan.obstacles,
        steps=tuple(builder.steps),
        missions={},
    )
    if plan.rally_points:
        builder.notes.append("Rally points are omitted, because the vehicle stores them.")
    if len(plan.fence) > 100:
        builder.notes.append("Only the first 100 geofence zones are kept.")
    return ConvertedPlan(mission, tuple(dict.fromkeys(builder.notes)))


def steps_in_air(
    items: Sequence[SimpleItem], vehicle: VehicleModel | None = None
) -> tuple[s.MissionStep, ...]:
    """The steps that fly these items, without a take-off, for a part of a mission that begins in the air.

    Raises:
        PlanError: The errors of `from_plan`.
    """
    return tuple(_build(Plan(items=tuple(items)), vehicle, in_air=True).steps)


def _build(plan: Plan, vehicle: VehicleModel | None, *, in_air: bool) -> _MissionBuilder:
    """The steps and notes of a plan."""
    vehicle = vehicle or VehicleModel()
    route = route_of(plan)
    if route.endless or route.truncated or route.stalled_row is not None:
        raise PlanError("the plan", "it repeats without end", "Give its jumps a number of repeats.")
    speed_m_s = None if plan.hover_speed_m_s is None else min(MAX_SPEED_M_S, plan.hover_speed_m_s)
    builder = _MissionBuilder(plan, vehicle, speed_m_s=speed_m_s, in_air=in_air)
    for step in route.steps:
        _add_item(builder, step.item, f"item {step.row + 1} ({step.item.kind.replace('_', ' ')})")
    builder.flush()
    if len(builder.steps) > s.MAX_STEPS:
        reason = f"it becomes {len(builder.steps)} steps, the maximum is {s.MAX_STEPS}"
        raise PlanError("the plan", reason, "Split the plan.")
    if not any(isinstance(step, s.Fly) for step in builder.steps):
        raise PlanError("the plan", "it has no item that is flown to", "Add a waypoint.")
    return builder


def _add_item(builder: _MissionBuilder, item: SimpleItem, description: str) -> None:
    if isinstance(item, PlacedItem) and is_flown_to(item):
        _add_placed_item(builder, item, description)
    elif isinstance(item, Delay):
        if (item.delay_s or 0.0) < 0.0:
            builder.notes.append(f"{description.capitalize()} waits for a time of day and is omitted.")
        else:
            builder.add(s.Hold(duration_s=min(MAX_HOLD_S, item.delay_s or 0.0)))
    elif (
        isinstance(item, ChangeSpeed)
        and (item.speed_m_s or 0.0) > 0.0
        and item.speed_type in GROUND_SPEED_TYPES
    ):
        builder.flush()
        builder.speed_m_s = min(MAX_SPEED_M_S, item.speed_m_s or 0.0)
    elif isinstance(item, ReturnHome):
        _add_return_home(builder, description)
    elif isinstance(item, TriggerDistance):
        builder.flush()
        # PX4 stops the trigger by any number that is not above 0.
        builder.photo_every_m = min(10_000.0, max(0.0, item.distance_m or 0.0)) or None
    elif isinstance(item, PhotoStart):
        count = max(1, int(item.count or 0))
        if not item.count:
            builder.notes.append(
                f"{description.capitalize()} takes photos until stopped; the mission takes one photo."
            )
        builder.add(
            s.Photo(count=min(count, 10_000), interval_s=min(3600.0, max(0.1, item.interval_s or 1.0)))
        )
    elif isinstance(item, RoiLocation) or (isinstance(item, LegacyRoi) and item.mode == ROI_LOCATION):
        builder.add(s.Gimbal(track="look_at", place=MissionPosition(**_position(item, item.altitude))))
    elif isinstance(item, GimbalPitchYaw):
        pitch, yaw = _radians(item.pitch_deg or 0.0), _radians(item.yaw_deg or 0.0)
        builder.add(s.Gimbal(track="fixed", pitch_rad=pitch or 0.0, yaw_rad=yaw or 0.0))
    elif isinstance(item, RoiNone):
        builder.add(s.Gimbal(track="release"))
    else:
        builder.notes.append(f"{description.capitalize()} is omitted.")


def _add_placed_item(builder: _MissionBuilder, item: PlacedItem, description: str) -> None:
    if not builder.in_air:
        _add_take_off(builder, item, description)
    if isinstance(item, Takeoff):
        builder.add_point(item, stop=True)
    elif isinstance(item, Land):
        return_altitude = Altitude(value_m=builder.vehicle.return_alt_m, reference="home")
        previous = builder.points[-1] if builder.points else _last_point(builder)
        if previous is None:
            builder.add_point(item, return_altitude)
        else:
            altitude = previous.model_dump(include={"alt_amsl_m", "alt_home_m"}, exclude_none=True)
            yaw = _radians(item.yaw_ned_deg)
            if (yaw is None) == any(p.yaw_ned_rad is not None for p in builder.points):
                builder.flush()
            builder.points.append(
                s.FlyPoint(lat_deg=item.lat_deg, lon_deg=item.lon_deg, yaw_ned_rad=yaw, **altitude)
            )
        builder.add(s.Land())
        builder.in_air = False
    elif isinstance(item, LoiterUnlimited):
        builder.add_point(item, stop=True)
        builder.add(s.Wait(until="person", message="Go on?", timeout_s=LOITER_TIMEOUT_S, on_timeout="return"))
    elif isinstance(item, LoiterTime | Waypoint):
        hold_s = min(MAX_HOLD_S, max(0.0, item.hold_s or 0.0))
        builder.add_point(item, hold_s=hold_s)
    else:
        builder.add_point(item)
        if not isinstance(item, LoiterToAltitude):
            builder.notes.append(f"{description.capitalize()} is flown as a point.")


def _last_point(builder: _MissionBuilder) -> s.FlyPoint | None:
    fly_steps = [step for step in builder.steps if isinstance(step, s.Fly)]
    return fly_steps[-1].points[-1] if fly_steps else None


def _add_take_off(builder: _MissionBuilder, item: PlacedItem, description: str) -> None:
    """Adds a take-off to the altitude of the first item."""
    home = builder.plan.planned_home
    height_m = item.altitude.value_m
    if item.altitude.reference != "home":
        amsl_m = item.altitude.amsl_m(None)
        if home is None or amsl_m is None:
            raise PlanError(description, "its altitude above home is unknown", "Set the planned home.")
        height_m = amsl_m - home.alt_amsl_m
    builder.steps.append(s.TakeOff(height_m=min(500.0, max(MIN_TAKEOFF_M, height_m))))
    builder.in_air = True


def _add_return_home(builder: _MissionBuilder, description: str) -> None:
    home = builder.plan.planned_home
    if home is None:
        raise PlanError(description, "the plan has no home to return to", "Set the planned home.")
    builder.flush()
    builder.points.append(
        s.FlyPoint(
            lat_deg=home.lat_deg, lon_deg=home.lon_deg, alt_home_m=builder.vehicle.return_alt_m, stop=True
        )
    )
    builder.add(s.Land())
    builder.in_air = False


def _radians(angle_deg: float | None) -> float | None:
    return None if angle_deg is None else math.remainder(math.radians(angle_deg), math.tau)


def _position(item: PlacedItem, altitude: Altitude) -> dict[str, Any]:
    position: dict[str, Any] = {"lat_deg": item.lat_deg, "lon_deg": item.lon_deg}
    if altitude.reference == "home":
        return position | {"alt_home_m": altitude.value_m}
    amsl_m = altitude.amsl_m(None)
    if amsl_m is None:
        place = f"the position {item.lat_deg:.5f}, {item.lon_deg:.5f}"
        raise PlanError(place, "its terrain altitude is not resolved", "Resolve it with elevation data.")
    return position | {"alt_amsl_m": amsl_m}
