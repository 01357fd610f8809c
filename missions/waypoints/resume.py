"""The item at which an interrupted flight of a plan resumes, and the settings that PX4 does not restore.

PX4 v1.16 starts a mission at any item. From the ground, the vehicle climbs to the altitude of the first
waypoint after that item and flies straight to it. PX4 then repeats the last speed, camera mode and gimbal
angles of the earlier items, and the camera trigger when the vehicle has reached that waypoint. PX4 reads
these settings from the stored mission, so it repeats them also after the vehicle was switched off. PX4 does
not repeat other settings.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from missions.items import (
    ChangeSpeed,
    Gate,
    Jump,
    Land,
    LandStart,
    PlacedItem,
    ReturnHome,
    Takeoff,
)
from missions.plan import Plan, SimpleItem
from missions.route import is_flown_to
from missions.values import HomePosition

NOT_REPEATED: dict[str, tuple[str, str]] = {
    "roi_location": ("roi", "the region of interest"),
    "roi": ("roi", "the region of interest"),
    "roi_next_waypoint": ("roi", "the region of interest"),
    "roi_none": ("roi", ""),
    "mount_configure": ("mount mode", "the mount mode"),
    "mount_control": ("mount", "the mount angles"),
    "video_start": ("video", "the video recording"),
    "video_stop": ("video", ""),
    "control_video": ("video", "the video recording"),
    "camera_zoom": ("zoom", "the zoom"),
    "camera_focus": ("focus", "the focus"),
    "trigger_interval": ("interval", "the interval of the camera trigger"),
    "oblique_survey": ("oblique", "the oblique survey photos"),
    "set_servo": ("servo", "the servo output"),
    "set_actuator": ("actuator", "the actuator output"),
    "gripper": ("gripper", "the gripper"),
    "winch": ("winch", "the winch"),
}
"""Items that PX4 does not repeat: kind → the setting that it changes, and its name (empty: switched off)."""
SPEEDS = {0.0: "speed", 1.0: "speed", 2.0: "climb speed", 3.0: "descent speed"}
"""Name of the speed that each `speed_type` sets."""
REPORTED_DISTANCE_M = 10.0
"""The server warns the operator if the new take-off is farther than this from the first take-off [m]."""


@dataclass(frozen=True, slots=True)
class ResumePoint:
    """The item at which a flight resumes."""

    item: int
    """Index of the item in upload order."""
    first: PlacedItem
    """The item whose position the vehicle flies to first: `item` or a later one."""
    not_restored: tuple[str, ...]
    """Sentences about the settings of earlier items that PX4 does not restore."""


def is_waypoint(item: SimpleItem) -> bool:
    """Whether the vehicle flies to the position of this item; a gate is only crossed."""
    return is_flown_to(item) and not isinstance(item, Gate)


def leg_start(items: Sequence[SimpleItem], item: int, first: int | None) -> int | None:
    """Index of the item at which the interrupted leg is flown again from its beginning.

    Args:
        items: items in upload order.
        item: index of the item that the vehicle was flying to.
        first: index of the item at which the interrupted flight began; None: not known.

    Returns:
        None: no leg was flown after the take-off, so the flight starts again at the beginning of the plan.
    """
    waypoint_indices = [index for index, each in enumerate(items[:item]) if is_waypoint(each)]
    reached = waypoint_indices[-1] if waypoint_indices else None
    if reached is not None and isinstance(items[reached], Takeoff):
        reached = None
    if first is not None and 0 < first <= item and (reached is None or first > reached):
        reached = first
    return reached


def resume_point(plan: Plan, item: int) -> ResumePoint | str:
    """The start at an item from the ground, or the reason why PX4 cannot start at this item, as a sentence.

    Args:
        plan: the plan on the vehicle.
        item: index of the item as uploaded.
    """
    items = [each for _, each in plan.simple_items()]
    first = next((each for each in items[item:] if is_waypoint(each) or isinstance(each, ReturnHome)), None)
    if not isinstance(first, PlacedItem) or isinstance(first, Land):
        return "No waypoint follows."
    if item == len(items) - 1:
        return "After a landing, PX4 begins again at the first item instead of the last item."
    return ResumePoint(item, first, tuple(_not_restored(items, item)))


def resume_after(plan: Plan, item: int, interrupted_item: int) -> ResumePoint | str:
    """The point at which an interrupted flight resumes, or the reason why it cannot resume, as a sentence.

    Args:
        plan: the plan on the vehicle.
        item: index of the item at which the interrupted leg begins.
        interrupted_item: index of the item that the vehicle was flying to.
    """
    items = [each for _, each in plan.simple_items()]
    if interrupted_item < len(items) and isinstance(items[interrupted_item], ReturnHome):
        return "Only the return to home remains."
    return resume_point(plan, item)


def remaining_plan(plan: Plan, item: int, position: HomePosition) -> Plan:
    """The plan from an item on, for checks of the resumed flight; the items keep their numbers.

    Args:
        plan: the plan on the vehicle, with its fence and obstacles.
        item: index of the item as uploaded.
        position: the vehicle's position on the ground, which becomes home.
    """
    items = tuple(
        LandStart() if index < item else each for index, (_, each) in enumerate(plan.simple_items())
    )  # a LandStart has no effect
    return plan.model_copy(update={"items": items, "planned_home": position, "original": None})


def _not_restored(items: Sequence[SimpleItem], item: int) -> Iterator[str]:
    settings: dict[str, tuple[int, str]] = {}
    speeds: dict[str, int] = {}
    for index, each in enumerate(items[:item]):
        setting, name = NOT_REPEATED.get(each.kind, (None, ""))
        if setting is not None:
            settings.pop(setting, None)
            settings[setting] = (index, name)
        if isinstance(each, ChangeSpeed):
            kind = SPEEDS.get(each.speed_type or 0.0, "speed")
            speeds.pop(kind, None)
            speeds[kind] = index
    for kind in list(speeds)[:-1]:  # PX4 repeats only the last change of a speed, of any type
        settings[kind] = (speeds[kind], f"the {kind}")
    for index, name in settings.values():
        if name:
            yield f"PX4 does not repeat item {index + 1}: set {name} yourself, or start at an earlier item."
    for index, each in enumerate(items):
        if isinstance(each, Jump) and index >= item >= each.target_index:
            yield (
                f"Item {index + 1} repeats items from item {each.target_index + 1} on. PX4 counts the "
                "repeats itself, and may repeat these items more or less often than planned."
            )
