"""The data that all checks of a plan use, and the table of finding codes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from missions.formats.mavlink_items import typed_plan
from missions.geodesy import LocalOrigin
from missions.items import PlacedItem
from missions.plan import Plan, SimpleItem
from missions.route import Leg, Route, legs, route_of
from missions.vehicle import PowerModel, VehicleModel

CODES: dict[str, tuple[Literal["error", "warning"], str]] = {
    "plan_empty": ("warning", "the plan has no items"),
    "home_missing": ("warning", "no planned home, so altitudes and distances from home are not known"),
    "takeoff_missing": ("warning", "no take-off (an error where MIS_TKO_LAND_REQ requires one)"),
    "takeoff_not_first": (
        "error",
        "a waypoint, return, actuator, gripper, winch or gate before take-off",
    ),
    "takeoff_too_low": ("error", "the take-off is not above home"),
    "takeoff_low": (
        "warning",
        "a take-off below NAV_MC_ALT_RAD + 1 m: the vehicle flies on near the ground",
    ),
    "starts_with_landing": ("error", "the plan starts with a landing, which PX4 rejects on the ground"),
    "landing_missing": ("error", "MIS_TKO_LAND_REQ requires a landing"),
    "takeoff_landing_mismatch": ("error", "MIS_TKO_LAND_REQ requires take-off and landing, or neither"),
    "command_refused": ("error", "PX4 refuses this command in a mission"),
    "value_refused": ("error", "PX4 refuses a value of this item"),
    "place_missing": ("error", "an item that needs a position has none, or is at latitude 0, longitude 0"),
    "vtol_item": ("error", "an item for VTOL aircraft only"),
    "value_not_sendable": ("error", "a value does not fit the mission message"),
    "set_home_place": ("error", "PX4 missions can set home only to the vehicle's own position"),
    "terrain_unresolved": ("error", "a terrain altitude without elevation data; PX4 refuses terrain frames"),
    "terrain_outdated": ("warning", "a resolved altitude that no longer agrees with the elevation data"),
    "terrain_hit": ("error", "the straight path between two items goes below the ground"),
    "terrain_near": ("warning", "the straight path between two items comes within 10 m of the ground"),
    "home_off_ground": ("warning", "the planned home differs by more than 10 m from the elevation data"),
    "complex_without_items": ("error", "a pattern of another program that contains no mission items"),
    "jump_target_missing": ("error", "a jump names an item that does not exist"),
    "jump_stalls": ("error", "a loop of jumps that neither flies nor waits"),
    "jump_endless": ("warning", "a jump repeats without end"),
    "items_never_reached": ("warning", "items after an item that ends the mission"),
    "speed_invalid": ("error", "an invalid speed"),
    "speed_too_high": ("warning", "a speed above MPC_XY_VEL_MAX; PX4 flies at MPC_XY_VEL_MAX"),
    "altitude_too_high": ("warning", "more than 120 m above home"),
    "altitude_fence": ("error", "above GF_MAX_VER_DIST"),
    "altitude_below_home": (
        "warning",
        "an item at or below the altitude of home (an error if it is lower by more than MPC_LAND_ALT3, "
        "unless elevation data show the ground there)",
    ),
    "altitude_unknown": ("warning", "an altitude that cannot be compared with home"),
    "first_waypoint_far": ("error", "the first item is farther from home than MIS_DIST_1WP"),
    "leg_too_long": ("error", "more than 2 km from the previous item"),
    "radius_exceeded": ("error", "farther from home than GF_MAX_HOR_DIST"),
    "fence_violation": ("error", "an item outside the geofence"),
    "fence_crossed": ("error", "the straight path between two items leaves the geofence"),
    "fence_home_outside": ("error", "home is outside the geofence"),
    "fence_invalid": ("error", "a fence polygon whose sides cross or that has no area"),
    "obstacle_hit": ("error", "the straight path between two items passes through an obstacle"),
    "obstacle_near": ("warning", "the straight path between two items comes within 2 m of an obstacle"),
    "obstacle_invalid": ("error", "an obstacle whose sides cross or that has no area"),
    "rally_outside_fence": ("warning", "a rally point outside the geofence"),
    "rally_terrain": ("error", "a rally point with a terrain altitude that is not resolved"),
    "too_many_items": ("error", "more fence or rally items than PX4 has room for"),
    "endurance_exceeded": ("error", "more energy than the battery provides"),
    "endurance_endless": ("error", "endless: no battery is large enough"),
    "separation": (
        "warning",
        "if the plan starts now, the vehicle may come too near to another vehicle; "
        "the server refuses the start",
    ),
    "separation_unknown": ("warning", "another vehicle is flying, and its path cannot be compared"),
    "parameters_unknown": ("warning", "vehicle parameters that are not known; PX4's defaults are used"),
    "check_failed": ("warning", "a check that could not be carried out"),
}
"""Severity and meaning of each code."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One problem of a plan."""

    code: str
    message: str
    """Message for the pilot."""
    row: int | None = None
    """Index in `Plan.items`; None: the finding is not about a single item."""
    zone: int | None = None
    """Index in `Plan.fence`."""
    rally_point: int | None = None
    """Index in `Plan.rally_points`."""
    obstacle: int | None = None
    """Index in `Plan.obstacles`."""
    fix: str | None = None
    """How to correct the problem."""
    is_error: bool = False
    """Whether this case of a warning is an error."""
    limit: float | None = None
    """The limit that was exceeded: altitude above home [m] or speed [m/s]; None: another kind of finding."""

    @property
    def severity(self) -> Literal["error", "warning"]:
        """error: PX4 refuses the plan, or the plan is unsafe; warning: the flight may differ from what the
        pilot expects."""
        return "error" if self.is_error else CODES[self.code][0]


@dataclass(frozen=True, slots=True)
class CheckLimits:
    """Limits of the checks; None: no limit."""

    altitude_home_max_m: float | None = 120.0
    """Above home; 120 m is the limit of the open category in the EU (Regulation 2019/947)."""
    leg_max_m: float | None = 2000.0
    vehicle: VehicleModel = field(default_factory=VehicleModel)
    power: PowerModel | None = None
    unknown_parameters: tuple[str, ...] = ()
    """PX4 names of the parameters that the checks need and that are not known for this vehicle."""


NAMED_PARAMETERS = 3
"""Maximum number of parameters that a message names."""
UNKNOWN_PARAMETERS_FIX = "Connect the vehicle and read its parameters, then check again."


def unknown_parameters_text(names: tuple[str, ...]) -> str:
    """The message of the finding `parameters_unknown`, which names the first parameters."""
    subject = "parameter is" if len(names) == 1 else "parameters are"
    shown = ", ".join(sorted(names)[:NAMED_PARAMETERS])
    more = f" and {len(names) - NAMED_PARAMETERS} more" if len(names) > NAMED_PARAMETERS else ""
    return f"The vehicle's {subject} not known, and PX4's defaults are used: {shown}{more}."


@dataclass(frozen=True, slots=True)
class Context:
    """A plan with values derived from it that several checks need."""

    plan: Plan
    limits: CheckLimits
    items: tuple[tuple[int, SimpleItem], ...]
    """Index of the row in `Plan.items`, and the item; in upload order."""
    route: Route
    legs: tuple[Leg, ...]
    origin: LocalOrigin | None
    """Origin of the local frame: home, otherwise the first position; None: the plan has no position."""

    @classmethod
    def from_plan(cls, plan: Plan, limits: CheckLimits) -> Context:
        """The plan with its items, route, legs and origin."""
        plan = typed_plan(plan)
        items = tuple(plan.simple_items())
        route = route_of(plan)
        return cls(plan, limits, items, route, legs(plan, route), _origin(plan, items))

    @property
    def vehicle(self) -> VehicleModel:
        """The vehicle that the plan is checked for."""
        return self.limits.vehicle

    @property
    def home_amsl_m(self) -> float | None:
        """Altitude of the planned home."""
        return None if self.plan.planned_home is None else self.plan.planned_home.alt_amsl_m

    def altitude_home_m(self, item: PlacedItem) -> float | None:
        """Altitude of an item above home; None: unknown."""
        if item.altitude.reference == "home":
            return item.altitude.value_m
        amsl_m = item.altitude.amsl_m(self.home_amsl_m)
        return None if amsl_m is None or self.home_amsl_m is None else amsl_m - self.home_amsl_m


def _origin(plan: Plan, items: tuple[tuple[int, SimpleItem], ...]) -> LocalOrigin | None:
    if plan.planned_home is not None:
        return LocalOrigin(plan.planned_home.lat_deg, plan.planned_home.lon_deg, plan.planned_home.alt_amsl_m)
    for _, item in items:
        if isinstance(item, PlacedItem):
            return LocalOrigin(item.lat_deg, item.lon_deg, 0.0)
    return None


def item_name(row: int, item: SimpleItem) -> str:
    """An item's name in messages: `Item 3 (waypoint)`."""
    return f"Item {row + 1} ({item.kind.replace('_', ' ')})"
