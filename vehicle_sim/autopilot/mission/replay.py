"""Settings of earlier items that PX4 repeats when a mission is started at an item, or continued.

The settings are read from the mission, so PX4 also repeats them after a reboot. PX4 does not repeat other
items, for example a region of interest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from vehicle_sim.autopilot.mission.items import (
    CAMERA_MODE,
    CAMERA_TRIGGER_DISTANCE,
    CHANGE_SPEED,
    GIMBAL_CONFIGURE,
    GIMBAL_PITCH_YAW,
    PICTURES_START,
    PICTURES_STOP,
    TRIGGER_CONTROL,
    Item,
)

CAMERA_TRIGGERS = frozenset({CAMERA_TRIGGER_DISTANCE, TRIGGER_CONTROL, PICTURES_START, PICTURES_STOP})


class Replay:
    """The earlier items whose settings one vehicle repeats.

    Args:
        issue: sends the command of an item.
    """

    def __init__(self, issue: Callable[[Item], None]) -> None:
        self._issue = issue
        self._gimbal_items: list[Item] = []
        self._at_first_item: list[Item] = []
        """Items to repeat when the first item is reached."""
        self._start_seq = 0
        """Index of the item at which the mission was started."""
        self.left_at_seq: int | None = None
        """Index of the current item when the mission was left; None: the current item has changed since."""

    def begin(self, items: Sequence[Item], current: int) -> int:
        """Called when the mission is started or continued.

        Returns:
            Index of the item to fly: usually `current`. If the camera was triggering when the vehicle left
            the mission: the last position item before `left_at_seq`, so that no picture of this leg is lost.
        """
        earlier_items, left_at_seq = items[:current], self.left_at_seq
        self.left_at_seq = None
        trigger, speed = _last_item(earlier_items, *CAMERA_TRIGGERS), _last_item(earlier_items, CHANGE_SPEED)
        trigger_items = [trigger] if trigger is not None and takes_pictures(trigger) else []
        immediate_items = [] if speed is None else [speed]
        self._at_first_item = trigger_items
        if trigger_items and left_at_seq is not None:
            previous = next((seq for seq in range(left_at_seq - 1, -1, -1) if items[seq].is_position), None)
            if previous is not None:
                current, self._at_first_item, immediate_items = previous, immediate_items + trigger_items, []
        configure = _last_item(earlier_items, GIMBAL_CONFIGURE)
        self._gimbal_items = _without_none(configure, _last_item(earlier_items, GIMBAL_PITCH_YAW))
        self._start_seq = current
        for item in immediate_items + _without_none(_last_item(earlier_items, CAMERA_MODE)):
            self._issue(item)
        return current

    def after_climb(self) -> None:
        """Repeats the gimbal's settings; called when the climb before the first item has ended."""
        gimbal_items, self._gimbal_items = self._gimbal_items, []
        for item in gimbal_items:
            self._issue(item)

    def reached(self, current: int) -> None:
        """Repeats the remaining settings when the first item has been reached.

        Args:
            current: index of the item that is now the current item.
        """
        if self._at_first_item and current > self._start_seq:
            settings, self._at_first_item = self._at_first_item, []
            for item in settings:
                self._issue(item)


def takes_pictures(item: Item) -> bool:
    """Whether the camera triggers after this item, one of `CAMERA_TRIGGERS`."""
    if item.command == CAMERA_TRIGGER_DISTANCE:
        return item.parameters[0] > 0.0
    if item.command == TRIGGER_CONTROL:
        return round(item.parameters[0]) == 1
    return item.command == PICTURES_START


def _last_item(items: Sequence[Item], *commands: int) -> Item | None:
    return next((item for item in reversed(items) if item.command in commands), None)


def _without_none(*items: Item | None) -> list[Item]:
    return [item for item in items if item is not None]
