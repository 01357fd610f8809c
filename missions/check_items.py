"""Checks of single items and their order: what PX4 refuses, take-off, jumps, speeds, altitudes."""

from __future__ import annotations

from collections.abc import Iterator

from missions.check_context import Context, Finding, item_name
from missions.errors import PlanError
from missions.estimates import GROUND_SPEED_TYPES
from missions.formats.mavlink_items import CLASS_OF_COMMAND, WireItem, fence_items, mission_items
from missions.formats.px4_storage import Refusal, refusal
from missions.items import (
    ChangeSpeed,
    CommandItem,
    Gate,
    Gripper,
    Jump,
    Land,
    LoiterUnlimited,
    PlacedItem,
    ReturnHome,
    SetActuator,
    SetHome,
    SetServo,
    Takeoff,
    Winch,
)
from missions.plan import ComplexItem, Plan, SimpleItem
from missions.route import is_flown_to

FENCE_CAPACITY, RALLY_CAPACITY = 64, 32
"""Items that PX4 v1.16 can store; each corner of a fence polygon is one item."""
TAKEOFF_MARGIN_M = 1.0
NOT_BEFORE_TAKEOFF = (ReturnHome, SetActuator, Gripper, Winch, Gate)
"""Items without a position that PX4 v1.16 does not allow before the take-off; a delay is allowed."""


def _completeness(context: Context) -> Iterator[Finding]:
    if not context.items:
        yield Finding("plan_empty", "The plan has no items.", fix="Add a take-off and a waypoint.")
    if context.plan.planned_home is None and context.items:
        message = "The plan has no home, so altitudes and distances from home cannot be checked."
        yield Finding("home_missing", message, fix="Set the planned home position.")
    for row, item in enumerate(context.plan.items):
        if isinstance(item, ComplexItem) and not item.items:
            message = f"Item {row + 1} ({item.complex_type}) contains no mission items; PX4 would not fly it."
            yield Finding(
                "complex_without_items", message, row, fix="Replace it with a pattern of this program."
            )
    corners, points = len(fence_items(context.plan)), len(context.plan.rally_points)
    if corners > FENCE_CAPACITY:
        message = f"The geofence has {corners} corners and circles; PX4 has room for {FENCE_CAPACITY}."
        yield Finding("too_many_items", message, fix="Remove corners.")
    if points > RALLY_CAPACITY:
        message = f"The plan has {points} rally points; PX4 has room for {RALLY_CAPACITY}."
        yield Finding("too_many_items", message, fix="Remove rally points.")


def _refused_items(context: Context) -> Iterator[Finding]:
    for row, item in context.items:
        name = item_name(row, item)
        try:
            (sent,) = mission_items(Plan(items=(item,)))
        except PlanError as error:
            message = f"{name} cannot be sent: {error.place.partition(', ')[2]}: {error.reason}."
            yield Finding("value_not_sendable", message, row, fix=error.fix)
            sent = None
        refused = None if sent is None else refusal(sent)
        if isinstance(item, CommandItem) and _lacks_position(item):
            message = f"Item {row + 1} (command {item.command}) has no latitude, longitude or altitude."
            yield Finding("place_missing", message, row, fix="Set its position.")
        elif isinstance(item, PlacedItem) and item.lat_deg == item.lon_deg == 0.0:
            yield Finding(
                "place_missing", f"{name} is at latitude 0, longitude 0.", row, fix="Set its position."
            )
        elif isinstance(item, SetHome) and item.use_current != 1.0:
            message = f"{name} names a position; PX4 accepts only the vehicle's own position."
            fix = "Set home to the vehicle's position (use_current 1)."
            yield Finding("set_home_place", message, row, fix=fix)
        elif (
            isinstance(item, PlacedItem)
            and item.altitude.reference == "terrain"
            and item.altitude.resolved_amsl_m is None
        ):
            message = f"{name} has a terrain altitude, which PX4 refuses."
            yield Finding("terrain_unresolved", message, row, fix="Resolve it with elevation data.")
        elif refused is not None and sent is not None:
            yield _refused_item(row, item, sent, refused)


def _refused_item(row: int, item: SimpleItem, sent: WireItem, refused: Refusal) -> Finding:
    subject = item_name(row, item).lower()
    if isinstance(item, CommandItem):
        subject = f"item {row + 1} (command {item.command}, frame {item.frame})"
    if refused == "vtol":
        message = f"I{subject[1:]} is for VTOL aircraft only."
        return Finding("vtol_item", message, row, fix="Use take-off and land.")
    if refused == "parameter":
        message = f"PX4 refuses mode {sent.param1:g} of {subject}."
        fix = "Use mode 3 for a position, mode 0 to end it, or an item without a position."
        return Finding("value_refused", message, row, fix=fix)
    if refused == "not flown":
        message = f"PX4 stores {subject}, and then rejects the mission."
        return Finding("command_refused", message, row, fix="Remove this item.")
    fix = "Use a set-actuator item." if isinstance(item, SetServo) else "Remove this item."
    return Finding("command_refused", f"PX4 refuses {subject}.", row, fix=fix)


def _lacks_position(item: CommandItem) -> bool:
    cls = CLASS_OF_COMMAND.get(item.command)
    return cls is not None and issubclass(cls, PlacedItem) and None in item.params[4:7]


def _takeoff(context: Context) -> Iterator[Finding]:
    earlier: str | None = None
    recommended_m = context.vehicle.altitude_acceptance_m + TAKEOFF_MARGIN_M
    for index, (row, item) in enumerate(context.items):
        if isinstance(item, Takeoff):
            above_home_m = context.altitude_home_m(item)
            if above_home_m is not None and above_home_m < recommended_m:
                is_rejected = above_home_m <= 0.0
                near_m = context.vehicle.altitude_acceptance_m
                reason = (
                    "PX4 rejects that"
                    if is_rejected
                    else f"the vehicle flies on when it is {near_m:.1f} m below that"
                )
                yield Finding(
                    "takeoff_too_low" if is_rejected else "takeoff_low",
                    f"{item_name(row, item)} climbs to {above_home_m:.1f} m above home; {reason}.",
                    row,
                    fix=f"Increase the altitude to {recommended_m:.1f} m.",
                    limit=recommended_m,
                )
            if earlier is not None:
                message = f"PX4 requires the take-off before {earlier}."
                yield Finding("takeoff_not_first", message, row, fix="Move the take-off to the start.")
        elif index == 0 and isinstance(item, Land):
            message = f"{item_name(row, item)} is the first item; PX4 rejects that on the ground."
            yield Finding("starts_with_landing", message, row, fix="Add a take-off before it.")
        if is_flown_to(item) or isinstance(item, NOT_BEFORE_TAKEOFF):
            earlier = earlier or item_name(row, item).lower()


def _takeoff_and_landing(context: Context) -> Iterator[Finding]:
    """MIS_TKO_LAND_REQ: 1 requires a take-off, 2 a landing, 3 both, 4 and 5 both or neither."""
    takeoff = any(isinstance(item, Takeoff) for _, item in context.items)
    landing = any(isinstance(item, Land) for _, item in context.items)
    required = context.vehicle.takeoff_land_required
    if required in (4, 5) and takeoff != landing:
        present, missing = ("take-off", "landing") if takeoff else ("landing", "take-off")
        message = f"The plan has a {present} but no {missing}, and the vehicle requires both or neither."
        yield Finding("takeoff_landing_mismatch", message, fix=f"Add a {missing}.")
        return
    if required in (2, 3) and not landing:
        yield Finding(
            "landing_missing", "The vehicle requires a landing in the mission.", fix="Add a landing."
        )
    if not takeoff and context.items:
        message = (
            "The plan has no take-off; on the ground the vehicle climbs to its own take-off altitude first."
        )
        yield Finding("takeoff_missing", message, fix="Add a take-off.", is_error=required in (1, 3))


def _jumps(context: Context) -> Iterator[Finding]:
    for row, item in context.items:
        if not isinstance(item, Jump):
            continue
        if item.target_index >= len(context.items):
            message = f"{item_name(row, item)} jumps to item {item.target_index + 1}, which does not exist."
            yield Finding("jump_target_missing", message, row, fix="Choose another item.")
        elif item.repeat < 0:
            subject = item_name(row, item)
            message = f"{subject} repeats without end; only the operator or an empty battery ends the loop."
            yield Finding("jump_endless", message, row, fix="Give it a number of repeats.")
    if context.route.stalled_row is not None:
        row = context.route.stalled_row
        message = f"The jumps around item {row + 1} repeat without flying or waiting anywhere."
        yield Finding("jump_stalls", message, row, fix="Remove the jump, or put a waypoint into the loop.")


def _unreachable_items(context: Context) -> Iterator[Finding]:
    last = context.route.steps[-1] if context.route.steps else None
    if last is None or last.seq + 1 >= len(context.items):
        return
    if isinstance(last.item, Land | LoiterUnlimited | ReturnHome) or not last.item.autocontinue:
        unreachable = len(context.items) - last.seq - 1
        subject = item_name(last.row, last.item)
        message = f"{subject} ends the mission; {unreachable} later items may never be reached."
        yield Finding("items_never_reached", message, last.row, fix="Move or remove what comes after.")


def _speeds(context: Context) -> Iterator[Finding]:
    max_m_s = context.vehicle.speed_max_m_s
    for row, item in context.items:
        if not isinstance(item, ChangeSpeed):
            continue
        speed = item.speed_m_s
        if speed is None or (speed <= 0.0 and speed not in (-1.0, -2.0)):
            message = f"{item_name(row, item)} requests {speed} m/s."
            yield Finding(
                "speed_invalid", message, row, fix="Set a speed above 0, or -2 (the vehicle's default speed)."
            )
        elif item.speed_type in GROUND_SPEED_TYPES and speed > max_m_s:
            message = (
                f"{item_name(row, item)} requests {speed:g} m/s; the vehicle's maximum is {max_m_s:g} m/s."
            )
            yield Finding("speed_too_high", message, row, fix=f"Set {max_m_s:g} m/s or less.", limit=max_m_s)
    planned = context.plan.hover_speed_m_s
    if planned is not None and planned > max_m_s:
        message = f"The planned speed is {planned:g} m/s; the vehicle flies {max_m_s:g} m/s at most."
        yield Finding("speed_too_high", message, fix=f"Plan {max_m_s:g} m/s or less.", limit=max_m_s)


def _altitudes(context: Context) -> Iterator[Finding]:
    max_m, fence_m = context.limits.altitude_home_max_m, context.vehicle.fence_height_m
    for row, item in context.items:
        if not isinstance(item, PlacedItem) or not is_flown_to(item):
            continue
        above_home_m = context.altitude_home_m(item)
        if above_home_m is None:
            if context.plan.planned_home is not None:
                message = f"{item_name(row, item)} has an altitude that cannot be compared with home."
                yield Finding("altitude_unknown", message, row, fix="Resolve it with elevation data.")
            continue
        if fence_m > 0.0 and above_home_m > fence_m:
            subject = item_name(row, item)
            message = f"{subject} is {above_home_m:.0f} m above home; the geofence limit is {fence_m:.0f} m."
            fix = f"Lower the altitude to {fence_m:.0f} m or less."
            yield Finding("altitude_fence", message, row, fix=fix, limit=fence_m)
        elif max_m is not None and above_home_m > max_m:
            message = (
                f"{item_name(row, item)} is {above_home_m:.0f} m above home; the limit is {max_m:.0f} m."
            )
            fix = f"Lower the altitude to {max_m:.0f} m or less."
            yield Finding("altitude_too_high", message, row, fix=fix, limit=max_m)
        elif above_home_m <= 0.0 and not isinstance(item, Land):
            message = f"{item_name(row, item)} is at or below the altitude of home ({above_home_m:.1f} m)."
            yield Finding(
                "altitude_below_home",
                message,
                row,
                fix="Increase the altitude, or add elevation data that show lower ground there.",
                is_error=above_home_m < -context.vehicle.landing_height_m,
            )


RULES = (
    _completeness,
    _refused_items,
    _takeoff,
    _takeoff_and_landing,
    _jumps,
    _unreachable_items,
    _speeds,
    _altitudes,
)
