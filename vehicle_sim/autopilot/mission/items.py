"""Items of uploaded missions, geofences and rally points, and their MAV_CMD numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

WAYPOINT, LOITER_UNLIMITED, LOITER_TIME, RETURN, LAND, TAKEOFF = 16, 17, 19, 20, 21, 22
LOITER_TO_ALTITUDE = 31
VTOL_TAKEOFF, VTOL_LAND, DELAY, JUMP, CHANGE_SPEED, SET_HOME, GATE = 84, 85, 93, 177, 178, 179, 4501
VTOL_TRANSITION = 3000
LAND_START, ROI_LOCATION, ROI_NEXT_WAYPOINT, ROI_NONE, ROI, SET_ACTUATOR = 189, 195, 196, 197, 201, 187
CAMERA_TRIGGER_DISTANCE, CAMERA_TRIGGER_INTERVAL, TRIGGER_CONTROL = 206, 214, 2003
CAMERA_MODE, PICTURES_START, PICTURES_STOP = 530, 2000, 2001
MOUNT_CONFIGURE, MOUNT_CONTROL, GIMBAL_PITCH_YAW, GIMBAL_CONFIGURE = 204, 205, 1000, 1001
GRIPPER, WINCH = 211, 42600
RALLY_POINT = 5100

POSITION_ITEMS = frozenset(
    {WAYPOINT, LOITER_UNLIMITED, LOITER_TIME, LAND, TAKEOFF, LOITER_TO_ALTITUDE, VTOL_TAKEOFF, VTOL_LAND}
)
"""Items with a position to which the vehicle flies."""
GIMBAL_ITEMS = frozenset(
    {MOUNT_CONFIGURE, MOUNT_CONTROL, GIMBAL_PITCH_YAW, GIMBAL_CONFIGURE, ROI, ROI_LOCATION, ROI_NEXT_WAYPOINT,
     ROI_NONE}
)  # fmt: skip
TRIGGER_ITEMS = frozenset({CAMERA_TRIGGER_DISTANCE, CAMERA_TRIGGER_INTERVAL, TRIGGER_CONTROL})
# Numbers without a constant: 183 servo, 200 video control, 203 digital camera, 260 oblique survey, 531 zoom,
# 400 arming (from PX4 v1.17 on), 532 focus, 534 camera source, 2500 and 2501 video start and stop.
SUPPORTED = POSITION_ITEMS | GIMBAL_ITEMS | TRIGGER_ITEMS | frozenset(
    {RETURN, DELAY, JUMP, CHANGE_SPEED, SET_HOME, GATE, LAND_START, 183, SET_ACTUATOR, 200, 203, GRIPPER, 260,
     400, CAMERA_MODE, 531, 532, 534, PICTURES_START, PICTURES_STOP, 2500, 2501, VTOL_TRANSITION, WINCH}
)  # fmt: skip
"""Items that the feasibility check accepts for a multicopter. PX4 rejects all other items, either at the
upload or in the feasibility check."""

AMSL_FRAMES = frozenset({0, 5})
RELATIVE_FRAMES = frozenset({3, 6})
"""Values of MAV_FRAME for global positions whose altitude is AMSL, or relative to home."""


@dataclass(frozen=True, slots=True)
class Item:
    """One item; degrees and metres; the altitude is AMSL or relative to home."""

    frame: int
    command: int
    autocontinue: bool
    parameters: tuple[float, float, float, float]
    """param1..param4; NaN: not given."""
    lat_deg: float
    lon_deg: float
    alt_m: float

    @property
    def is_position(self) -> bool:
        """Whether the vehicle flies to the item's position."""
        return self.command in POSITION_ITEMS

    @property
    def relative(self) -> bool:
        """Whether the altitude is relative to home."""
        return self.frame in RELATIVE_FRAMES

    def alt_amsl_m(self, home_alt_amsl_m: float) -> float:
        """The altitude AMSL."""
        return self.alt_m + home_alt_amsl_m if self.relative else self.alt_m

    def command_parameters(self, home_alt_amsl_m: float) -> tuple[float, ...]:
        """The seven parameters of the command that the autopilot sends for this item.

        In frames without a global position, parameters 5 and 6 are the uploaded integers.
        """
        if self.frame not in AMSL_FRAMES | RELATIVE_FRAMES:
            return (*self.parameters, self.lat_deg * 1e7, self.lon_deg * 1e7, self.alt_m)
        return (*self.parameters, self.lat_deg, self.lon_deg, self.alt_amsl_m(home_alt_amsl_m))

    def hold_time_s(self) -> float:
        """Hold time (param1 of waypoints, timed loiters and delays)."""
        hold_s = self.parameters[0]
        return hold_s if self.command in (WAYPOINT, LOITER_TIME, DELAY) and math.isfinite(hold_s) else 0.0

    def yaw_rad(self) -> float:
        """The heading (param4), -pi to pi; NaN: none."""
        yaw_deg = self.parameters[3]
        if not self.is_position or not math.isfinite(yaw_deg):
            return math.nan
        return math.remainder(math.radians(yaw_deg), math.tau)


def next_position(items: Sequence[Item], seq: int, jump_counts: Mapping[int, int]) -> Item | None:
    """The next position item after item `seq`; None: the vehicle stops at item `seq`.

    Args:
        items: the mission's items.
        seq: index of the current item.
        jump_counts: how often each jump was executed, by index of the jump.
    """
    new_counts = dict(jump_counts)
    for _ in range(len(items)):
        seq += 1
        if seq >= len(items):
            return None
        item = items[seq]
        if item.command == JUMP:
            target, repeats = int(item.parameters[0]), int(item.parameters[1])
            if 0 <= target < len(items) and (repeats < 0 or new_counts.get(seq, 0) < repeats):
                new_counts[seq] = new_counts.get(seq, 0) + 1
                seq = target - 1
            continue
        if item.command in (DELAY, RETURN):
            return None
        if item.is_position:
            return item
    return None
