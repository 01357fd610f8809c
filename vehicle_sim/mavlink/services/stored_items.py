"""How PX4 stores an item of the mission protocol, and what it returns of it in a download.

PX4 keeps of each command only the fields that it uses: other parameters come back as 0, a heading comes back
between 0 and 360 degrees, flags as 0 or 1, counts as 16-bit integers. A fence point keeps its command,
position and first parameter only. All arithmetic is in single precision, as in PX4.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from vehicle_sim.autopilot.mission.items import (
    AMSL_FRAMES,
    JUMP,
    LAND,
    LOITER_TIME,
    LOITER_TO_ALTITUDE,
    LOITER_UNLIMITED,
    RALLY_POINT,
    RELATIVE_FRAMES,
    ROI,
    TAKEOFF,
    VTOL_LAND,
    VTOL_TAKEOFF,
    WAYPOINT,
    Item,
)
from vehicle_sim.px4_version import DEFAULT, Px4Version

ACCEPTED, ERROR, UNSUPPORTED_FRAME, UNSUPPORTED, NO_SPACE, INVALID_PARAM1 = 0, 1, 2, 3, 4, 6
CANCELLED = 15
"""MAV_MISSION_RESULT."""
MISSION, FENCE, RALLY, ALL = 0, 1, 2, 255
"""MAV_MISSION_TYPE."""
CAPACITY = {MISSION: 10_000, FENCE: 64, RALLY: 32}
"""Number of items that PX4 can store in SITL."""

FRAME_MISSION = 2
GLOBAL_FRAME, RELATIVE_FRAME, GLOBAL_INT_FRAME, RELATIVE_INT_FRAME = 0, 3, 5, 6
_FLOAT_FRAMES = frozenset({GLOBAL_FRAME, RELATIVE_FRAME, FRAME_MISSION})
"""Frames that PX4 accepts in MISSION_ITEM; in MISSION_ITEM_INT also the two INT frames."""
_POLYGON_VERTICES = frozenset({5001, 5002})
_CIRCLES = frozenset({5003, 5004})
_NOT_IN_MISSIONS = _POLYGON_VERTICES | _CIRCLES | {RALLY_POINT}
_MIN_POLYGON_VERTICES = 3
_NAV_ROI = 80
"""MAV_CMD_NAV_ROI, which PX4 stores as DO_SET_ROI."""
_ROI_NONE, _ROI_NEXT_WAYPOINT, _ROI_WAYPOINT, _ROI_LOCATION = 0, 1, 2, 3
"""MAV_ROI."""
_GLOBAL_COMMANDS = _NOT_IN_MISSIONS | {16, 17, 19, 21, 22, 31, 80, 84, 85, 195, 201, 4501, 5000}
"""Commands that PX4 accepts only in a global frame; the two ROI commands also without a position."""
_MISSION_FRAME_COMMANDS = frozenset(
    {20, 80, 93, 112, 114, 177, 178, 179, 187, 189, 196, 197, 200, 201, 203, 204, 205, 206, 211, 214, 260,
     530, 532, 534, 1000, 1001, 2000, 2001, 2003, 2500, 2501, 3000, 42600}
)  # fmt: skip
"""Commands that PX4 accepts only in the frame MAV_FRAME_MISSION."""
_ARM_DISARM = 400
"""Accepted in missions from PX4 v1.17 on."""
_INT32_MIN, _INT32_MAX = -(2**31), 2**31 - 1

Parameters = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class StoredItem:
    """One stored item: what a download returns, and the item that the vehicle flies."""

    command: int
    relative: bool
    autocontinue: int
    parameters: Parameters
    """param1..param4 of the download."""
    x: float
    y: float
    """1e-7 degrees; in the frame MAV_FRAME_MISSION the parameters 5 and 6."""
    z: float
    item: Item

    def message_fields(self, *, as_int: bool) -> dict[str, Any]:
        """Fields of MISSION_ITEM_INT or MISSION_ITEM, except sequence number, `current` and addresses."""
        p1, p2, p3, p4 = self.parameters
        x, y, frame = self.x, self.y, FRAME_MISSION
        if self.item.frame != FRAME_MISSION:
            frame = RELATIVE_INT_FRAME if self.relative else GLOBAL_INT_FRAME
            if not as_int:
                frame = RELATIVE_FRAME if self.relative else GLOBAL_FRAME
                x, y = x / 1e7, y / 1e7
        if as_int:
            x, y = _int32(_rounded(x)), _int32(_rounded(y))
        return {
            "frame": frame, "command": self.command, "autocontinue": self.autocontinue,
            "param1": p1, "param2": p2, "param3": p3, "param4": p4, "x": x, "y": y, "z": self.z,
        }  # fmt: skip


def store(
    mission_type: int, fields: Mapping[str, Any], *, as_int: bool, px4: Px4Version = DEFAULT
) -> tuple[int, StoredItem | None]:
    """PX4's MAV_MISSION_RESULT for an item (fields of MISSION_ITEM or MISSION_ITEM_INT), and the stored item
    if PX4 accepts the item."""
    frame, command = fields["frame"], fields["command"]
    is_global = frame in AMSL_FRAMES | RELATIVE_FRAMES
    if not (frame in _FLOAT_FRAMES or (as_int and is_global)):
        return UNSUPPORTED_FRAME, None
    arms = command == _ARM_DISARM and px4.arms_by_mission_item and not is_global
    if not arms and command not in (_GLOBAL_COMMANDS if is_global else _MISSION_FRAME_COMMANDS):
        return UNSUPPORTED, None
    sent: Parameters = fields["param1"], fields["param2"], fields["param3"], fields["param4"]
    if command in (ROI, _NAV_ROI):
        command = ROI
        allowed = (_ROI_LOCATION,) if is_global else (_ROI_NEXT_WAYPOINT, _ROI_WAYPOINT)
        if _int32(sent[0]) not in (_ROI_NONE, *allowed):
            return INVALID_PARAM1, None
    if (mission_type == MISSION and command in _NOT_IN_MISSIONS) or (
        mission_type == FENCE
        and command in _POLYGON_VERTICES
        and _uint16(sent[0] + 0.5) < _MIN_POLYGON_VERTICES
    ):
        return ERROR, None
    x, y = _position(fields, is_global=is_global, as_int=as_int)
    returned = _returned_parameters(command, sent) if is_global else _generic_parameters(command, sent)
    flown, relative, autocontinue = returned, frame in RELATIVE_FRAMES, int(fields["autocontinue"]) & 1
    if mission_type == FENCE:
        returned = flown = _fence_parameters(command, sent, is_global=is_global)
        relative, autocontinue = False, 0
    elif command == ROI and is_global:
        flown = (float(_int32(sent[0])), 0.0, 0.0, 0.0)
    elif command == LOITER_TIME:
        flown = (*returned[:3], yaw_deg(sent[3]))
    elif command == LOITER_TO_ALTITUDE:
        flown = (*returned[:3], 0.0)  # PX4 stores no heading, and so flies it with the nose to the north
    item = Item(frame, command, bool(autocontinue), flown, x * 1e-7, y * 1e-7, fields["z"])
    return ACCEPTED, StoredItem(command, relative, autocontinue, returned, x, y, fields["z"], item)


def _returned_parameters(command: int, sent: Parameters) -> Parameters:
    """param1..param4 that PX4 returns for an item with a global position."""
    p1, p2, p3, p4 = sent
    if command == WAYPOINT:
        return p1, p2, 0.0, yaw_deg(p4)
    if command == LOITER_UNLIMITED:
        return 0.0, 0.0, p3, yaw_deg(p4)
    if command == LOITER_TIME:
        return p1, _flag(p2), p3, _flag(p4)
    if command == LAND:
        return 0.0, float(_uint16(p2)), 0.0, yaw_deg(p4)
    if command in (TAKEOFF, VTOL_TAKEOFF, VTOL_LAND):
        return 0.0, 0.0, 0.0, yaw_deg(p4)
    if command == LOITER_TO_ALTITUDE:
        return _flag(p1), p2, 0.0, _flag(p4)
    if command in _CIRCLES:
        return p1, 0.0, 0.0, 0.0
    if command in _POLYGON_VERTICES:
        return float(_uint16(p1 + 0.5)), 0.0, 0.0, 0.0
    return 0.0, 0.0, 0.0, 0.0


def _generic_parameters(command: int, sent: Parameters) -> Parameters:
    """param1..param4 that PX4 returns for an item without a position."""
    if command == JUMP:
        return float(_int16(sent[0])), float(_uint16(sent[1])), sent[2], sent[3]
    return sent


def _fence_parameters(command: int, sent: Parameters, *, is_global: bool) -> Parameters:
    """param1..param4 of a fence point, which stores a single number: a count or a radius."""
    p1 = sent[0]
    if command in _POLYGON_VERTICES:
        return float(_uint16(p1 + 0.5)), 0.0, 0.0, 0.0
    keeps_first = command in _CIRCLES | {WAYPOINT, LOITER_TIME} or (not is_global and command != JUMP)
    return (p1 if keeps_first else 0.0), 0.0, 0.0, 0.0


def _position(fields: Mapping[str, Any], *, is_global: bool, as_int: bool) -> tuple[float, float]:
    x, y = fields["x"], fields["y"]
    if not is_global:
        return float(np.float32(x)), float(np.float32(y))
    return (x, y) if as_int else (float(np.float32(x)) * 1e7, float(np.float32(y)) * 1e7)


def yaw_deg(sent_deg: float) -> float:
    """A heading as PX4 returns it: 0 to 360 degrees with the rounding of single precision; NaN: none."""
    if not math.isfinite(sent_deg):
        return math.nan
    pi, half_turn = np.float32(math.pi), np.float32(180.0)
    turn = np.float32(math.tau)
    yaw = np.float32(sent_deg) * (pi / half_turn)
    if not 0.0 <= yaw < turn:
        yaw -= turn * np.floor(yaw * (np.float32(1.0) / turn))
    return float(yaw * (half_turn / pi))


def _flag(value: float) -> float:
    return 1.0 if value > 0.0 else 0.0


def _rounded(value: float) -> float:
    return math.copysign(math.floor(abs(value) + 0.5), value) if math.isfinite(value) else value


def _int32(value: float) -> int:
    """The integer part, as a processor converts it: the smallest integer if the value does not fit."""
    if not math.isfinite(value):
        return _INT32_MIN
    whole = math.trunc(value)
    return whole if _INT32_MIN <= whole <= _INT32_MAX else _INT32_MIN


def _uint16(value: float) -> int:
    return _int32(value) & 0xFFFF


def _int16(value: float) -> int:
    return (_uint16(value) ^ 0x8000) - 0x8000
