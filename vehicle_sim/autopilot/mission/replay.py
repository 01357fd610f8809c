"""Settings of earlier items that PX4 repeats when a mission is started at an item, or continued.

They are read from the mission, so they also apply after a reboot. PX4 repeats no other items, not even a
region of interest.
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

TRIGGERS = frozenset({CAMERA_TRIGGER_DISTANCE, TRIGGER_CONTROL, PICTURES_START, PICTURES_STOP})


class Replay:
    """The items that one vehicle repeats.

    Args:
        issue: sends the command of an item.
    """

    def __init__(self, issue: Callable[[Item], None]) -> None:
        self._issue = issue
        self._gimbal: list[Item] = []
        self._at_first: list[Item] = []
        """Items to repeat when the first item is reached."""
        self._start = 0
        """Index of the item at which the mission was started."""
        self.left_at: int | None = None
        """Index of the current item when the mission was left; None: the current item has changed since."""

    def begin(self, items: Sequence[Item], current: int) -> int:
        """Called when the mission is started or continued.

        Returns:
            The item to fly: the current one. If pictures were taken when the mission was left, it is the last
            position item before the one flown then, so that no picture is lost.
        """
        earlier, pause = items[:current], self.left_at
        self.left_at = None
        trigger, speed = _last(earlier, *TRIGGERS), _last(earlier, CHANGE_SPEED)
        pictures = [trigger] if trigger is not None and takes_pictures(trigger) else []
        at_once = [] if speed is None else [speed]
        self._at_first = pictures
        if pictures and pause is not None:
            back = next((seq for seq in range(pause - 1, -1, -1) if items[seq].is_position), None)
            if back is not None:
                current, self._at_first, at_once = back, at_once + pictures, []
        self._gimbal = _known(_last(earlier, GIMBAL_CONFIGURE), _last(earlier, GIMBAL_PITCH_YAW))
        self._start = current
        for item in at_once + _known(_last(earlier, CAMERA_MODE)):
            self._issue(item)
        return current

    def after_climb(self) -> None:
        """Repeats the gimbal's settings once the vehicle does not climb to the first item any more."""
        gimbal, self._gimbal = self._gimbal, []
        for item in gimbal:
            self._issue(item)

    def reached(self, current: int) -> None:
        """Repeats the remaining settings once the first item is reached."""
        if self._at_first and current > self._start:
            at_first, self._at_first = self._at_first, []
            for item in at_first:
                self._issue(item)


def takes_pictures(item: Item) -> bool:
    """Whether pictures are taken after this item of `TRIGGERS`."""
    if item.command == CAMERA_TRIGGER_DISTANCE:
        return item.parameters[0] > 0.0
    if item.command == TRIGGER_CONTROL:
        return round(item.parameters[0]) == 1
    return item.command == PICTURES_START


def _last(items: Sequence[Item], *commands: int) -> Item | None:
    return next((item for item in reversed(items) if item.command in commands), None)


def _known(*items: Item | None) -> list[Item]:
    return [item for item in items if item is not None]
