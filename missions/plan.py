"""The document of a waypoint plan: items, geofence, rally points, obstacles, home and speeds.

Plans are immutable. Unknown parts of other programs' files are kept as JSON text (`original`), so that these
files can be written back without loss.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from missions import camera_items as c
from missions import items as i
from missions.bounded_json import decode, load
from missions.errors import PlanError, from_validation
from missions.pattern_settings import PatternDocument
from missions.values import FenceZone, HomePosition, Model, Obstacles, RallyPoint

MAX_ITEMS = 10_000
"""Maximum number of items of a mission, including those inside groups. PX4 has the same limit."""
MAX_FENCE_ZONES = 500
MAX_RALLY_POINTS = 500

TYPED_ITEMS: tuple[type[i.Item], ...] = (
    i.Takeoff, i.Waypoint, i.LoiterUnlimited, i.LoiterTime, i.LoiterToAltitude, i.Land, i.RoiLocation,
    i.LegacyRoi, i.Gate, i.ReturnHome, i.Delay, i.Jump, i.ChangeSpeed, i.SetHome, i.LandStart,
    i.RoiNextWaypoint, i.RoiNone, i.SetServo, i.SetActuator, i.Gripper, i.Winch,
    c.TriggerDistance, c.TriggerInterval, c.TriggerControl, c.PhotoStart, c.PhotoStop, c.VideoStart,
    c.VideoStop, c.CameraMode, c.CameraZoom, c.CameraFocus, c.ControlVideo, c.Digicam, c.ObliqueSurvey,
    c.GimbalPitchYaw, c.GimbalConfigure, c.MountConfigure, c.MountControl,
)  # fmt: skip
"""All items that PX4 v1.16 executes for a multicopter."""

SimpleItem = Annotated[
    i.Takeoff | i.Waypoint | i.LoiterUnlimited | i.LoiterTime | i.LoiterToAltitude | i.Land | i.RoiLocation
    | i.LegacyRoi | i.Gate | i.ReturnHome | i.Delay | i.Jump | i.ChangeSpeed | i.SetHome | i.LandStart
    | i.RoiNextWaypoint | i.RoiNone | i.SetServo | i.SetActuator | i.Gripper | i.Winch
    | c.TriggerDistance | c.TriggerInterval | c.TriggerControl | c.PhotoStart | c.PhotoStop | c.VideoStart
    | c.VideoStop | c.CameraMode | c.CameraZoom | c.CameraFocus | c.ControlVideo | c.Digicam | c.ObliqueSurvey
    | c.GimbalPitchYaw | c.GimbalConfigure | c.MountConfigure | c.MountControl | i.CommandItem,
    Field(discriminator="kind"),
]  # fmt: skip
"""One mission item as it is uploaded."""


class ItemGroup(Model):
    """A row of a plan that stands for several mission items."""

    items: Annotated[tuple[SimpleItem, ...], Field(max_length=MAX_ITEMS)] = ()
    """The mission items, as they are flown."""


class ComplexItem(ItemGroup):
    """A pattern of another program that this program does not know, kept unchanged.

    `items` are the mission items that the file contains for the pattern. Some files contain none. Such a plan
    can be stored and displayed, but not flown.
    """

    kind: Literal["complex"] = "complex"
    complex_type: Annotated[str, Field(max_length=100)]
    original: str
    """JSON text of the complex item in the file."""


class PatternItem(ItemGroup):
    """A pattern with its geometry and values; its lines follow every change of them.

    `items` follow from `pattern`, and `items_key` says from which values. `read` makes new items if the key
    is not that of the pattern, so that nobody flies the lines of earlier values: a client changes `pattern`
    and leaves the rest. The items of a file of another program are kept until something is changed.
    """

    kind: Literal["pattern"] = "pattern"
    pattern: PatternDocument
    items_key: Annotated[str, Field(max_length=64)] = ""
    """`pattern_key` of the pattern that the items were made from."""
    original: str | None = None
    """JSON text of the complex item in the .plan file that the pattern was read from."""

    @property
    def is_current(self) -> bool:
        """Whether the items belong to the pattern."""
        return bool(self.items) and self.items_key == pattern_key(self.pattern)


def pattern_key(pattern: PatternDocument) -> str:
    """A key of the values of a pattern: equal for equal values."""
    return hashlib.sha256(pattern.model_dump_json(exclude_defaults=True).encode()).hexdigest()[:16]


PlanItem = Annotated[SimpleItem | ComplexItem | PatternItem, Field(discriminator="kind")]
"""One row of a plan: a simple item, or a group of several mission items."""

Speed = Annotated[float, Field(gt=0.0, le=1000.0, allow_inf_nan=False)]


class Plan(Model):
    """A waypoint plan, flown by PX4."""

    format: Literal["offboard-gcs-plan"] = "offboard-gcs-plan"
    version: Literal[1] = 1
    planned_home: HomePosition | None = None
    cruise_speed_m_s: Speed | None = None
    """Planned speed of fixed-wing aircraft; unused, but kept because plan files contain it."""
    hover_speed_m_s: Speed | None = None
    """Planned speed of multicopters. Estimates use this speed; it is not uploaded. None: the vehicle's
    MPC_XY_CRUISE."""
    items: Annotated[tuple[PlanItem, ...], Field(max_length=MAX_ITEMS)] = ()
    fence: Annotated[tuple[FenceZone, ...], Field(max_length=MAX_FENCE_ZONES)] = ()
    rally_points: Annotated[tuple[RallyPoint, ...], Field(max_length=MAX_RALLY_POINTS)] = ()
    obstacles: Obstacles = ()
    """Obstacles for checks and dry runs; they are not uploaded, because PX4 does not store obstacles."""
    original: str | None = None
    """JSON text of the .plan file that the plan was read from, without the data of the fields above."""

    def simple_items(self) -> Iterator[tuple[int, SimpleItem]]:
        """The items in upload order, each with its row in `items`; a group yields its mission items."""
        for row, item in enumerate(self.items):
            if isinstance(item, ItemGroup):
                for inner in item.items:
                    yield row, inner
            else:
                yield row, item


def read(data: str | bytes) -> Plan:
    """Reads a plan from this project's JSON, and makes the items of patterns that have been changed.

    Raises:
        PlanError: The text is too large, not JSON, or not a plan, or a pattern has no path; the error names
            the field and the fix.
    """
    text = decode(data)
    load(text)
    try:
        plan = Plan.model_validate_json(text)
    except ValidationError as error:
        raise from_validation(error) from None
    if any(isinstance(item, PatternItem) and not item.is_current for item in plan.items):
        from missions.patterns.current import with_current_patterns  # shapely, 0.2 s to import

        plan = with_current_patterns(plan)
    return check_item_count(plan)


def check_item_count(plan: Plan) -> Plan:
    """Returns the plan if PX4 can store its items.

    Raises:
        PlanError: The plan has too many items.
    """
    count = sum(len(item.items) if isinstance(item, ItemGroup) else 1 for item in plan.items)
    if count > MAX_ITEMS:
        reason = f"{count} items, the maximum is {MAX_ITEMS}"
        raise PlanError("the plan", reason, "Split the plan into smaller ones.")
    return plan


def write(plan: Plan) -> bytes:
    """The plan as this project's JSON in UTF-8; `read` returns an equal plan."""
    return plan.model_dump_json(indent=1, exclude_defaults=False).encode()


def without_originals(plan: Plan) -> Plan:
    """A copy of the plan without the JSON text of the file that it was read from."""
    return plan.model_copy(
        update={
            "original": None,
            "items": tuple(_without_original(item) for item in plan.items),
            "fence": tuple(zone.model_copy(update={"original": None}) for zone in plan.fence),
        }
    )


def _without_original(item: PlanItem) -> PlanItem:
    if isinstance(item, ComplexItem):
        return item
    if isinstance(item, PatternItem):
        items = tuple(each.model_copy(update={"original": None}) for each in item.items)
        return item.model_copy(update={"original": None, "items": items})
    return item.model_copy(update={"original": None})
