"""How PX4 stores an uploaded item, and therefore what a download returns. Recorded from v1.16.

PX4 converts each item to a structure of its own, and formats a MAVLink item from it again: yaw is wrapped to
0…360°, flags become 0 or 1, and a parameter that PX4 does not use is lost. Both forms are the same item to
PX4: `stored_items` is idempotent, and items with equal stored forms are flown alike, whoever sent them.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

from missions.formats import mavlink_items as m
from missions.formats.mavlink_items import WireItem

Part = Literal["mission", "fence", "rally"]
INT_FRAMES = {
    m.MAV_FRAME_GLOBAL: m.MAV_FRAME_GLOBAL_INT,
    m.MAV_FRAME_GLOBAL_RELATIVE_ALT: m.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
    m.MAV_FRAME_GLOBAL_TERRAIN_ALT: m.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT,
}
"""PX4 returns items in these frames if the ground station uses MISSION_ITEM_INT."""
STORED_FRAMES = frozenset({0, 3, 5, 6})
"""Frames with a position that PX4 stores; it refuses terrain and local frames."""
VTOL_COMMANDS = frozenset({84, 85, 3000})
ROI_MODES_WITHOUT_POSITION = (0.0, 1.0, 2.0)
_STORED_ONLY = frozenset({112, 114, 5000})
_WITHOUT_POSITION = frozenset(
    {
        20, 93, 177, 178, 179, 187, 189, 196, 197, 200, 203, 204, 205, 206, 211, 214, 260, 530, 532, 534,
        1000, 1001, 2000, 2001, 2003, 2500, 2501, 42600,
    }
)  # fmt: skip
"""Commands that PX4 flies in MAV_FRAME_MISSION."""
DO_JUMP, NAV_ROI, DO_SET_ROI, ROI_LOCATION = 177, 80, 201, 3.0
_float32_layout = struct.Struct("<f")


def stored_items(part: Part, items: Sequence[WireItem]) -> list[WireItem]:
    """The items as PX4 returns them after it has accepted them; `current`, which marks the next item, is as
    sent."""
    return [_stored(part, item) for item in items]


def as_flown(item: WireItem) -> WireItem:
    """A downloaded mission item with what PX4 stores but does not return.

    The mode of a region of interest with a position is "location", and as many repeats as PX4 can count are
    an endless jump.
    """
    if item.command == DO_JUMP and item.param2 == m.MOST_REPEATS:
        return replace(item, param2=-1.0)
    if item.command == DO_SET_ROI and item.frame in m.REFERENCE_OF_FRAME and (item.x or item.y):
        return replace(item, param1=ROI_LOCATION)
    return item


Refusal = Literal["frame", "command", "parameter", "not flown", "vtol"]


def refusal(item: WireItem) -> Refusal | None:
    """Why PX4 does not fly a mission item; None: it does.

    frame, command, parameter: PX4 refuses the upload. not flown, vtol: PX4 stores the item and then rejects
    the mission.
    """
    if item.command in VTOL_COMMANDS:
        return "vtol"
    if item.frame == m.MAV_FRAME_MISSION:
        if item.command in _STORED_ONLY:
            return "not flown"
        if item.command in (NAV_ROI, DO_SET_ROI):
            return None if _roi_mode(item.param1) in ROI_MODES_WITHOUT_POSITION else "parameter"
        return None if item.command in _WITHOUT_POSITION else "command"
    if item.frame not in STORED_FRAMES:
        return "frame"
    if item.command in _STORED_ONLY:
        return "not flown"
    if item.command in (NAV_ROI, DO_SET_ROI):
        return None if _roi_mode(item.param1) in (0.0, ROI_LOCATION) else "parameter"
    return None if item.command in _WITH_POSITION else "command"


# --- what becomes of a parameter ----------------------------------------------------------------------


def _float32(value: float) -> float:
    return _float32_layout.unpack(_float32_layout.pack(value))[0]


def _kept(value: float) -> float:
    return value


def _lost(_: float) -> float:
    return 0.0


def _not_returned(_: float) -> float:
    return 0.0


def _corners(value: float) -> float:
    return _uint16(value + 0.5)


def _flag(value: float) -> float:
    return float(value > 0.0)


def _yaw(value_deg: float) -> float:
    """PX4 stores an angle of 0…2π; large angles lose digits, because PX4 calculates with 32-bit floats."""
    if not math.isfinite(value_deg):
        return math.nan
    turn, degree = _float32(2 * math.pi), _float32(math.pi / 180)
    angle = _float32(degree * value_deg)
    if not 0.0 <= angle < turn:
        angle = _float32(angle - _float32(turn * math.floor(_float32(angle * _float32(1 / turn)))))
    return _float32(angle * _float32(180 / _float32(math.pi)))


def _uint16(value: float) -> float:
    return float(math.trunc(value) % 2**16) if math.isfinite(value) else 0.0


def _roi_mode(value: float) -> float | None:
    return float(math.trunc(value)) if math.isfinite(value) else None


def _int16(value: float) -> float:
    return (_uint16(value) + 2**15) % 2**16 - 2**15


def _int32_of_float32(value: int) -> int:
    return (int(_float32(value)) + 2**31) % 2**32 - 2**31


_Parameter = Callable[[float], float]
_Parameters = tuple[_Parameter, _Parameter, _Parameter, _Parameter]
_ALL_KEPT: _Parameters = (_kept, _kept, _kept, _kept)
_ALL_LOST: _Parameters = (_lost, _lost, _lost, _lost)
_JUMP: _Parameters = (_int16, _uint16, _kept, _kept)
_ROI: _Parameters = (_not_returned, _lost, _lost, _lost)
_YAW_ONLY: _Parameters = (_lost, _lost, _lost, _yaw)
_WITH_POSITION: dict[int, _Parameters] = {
    16: (_kept, _kept, _lost, _yaw),
    17: (_lost, _lost, _kept, _yaw),
    19: (_kept, _flag, _kept, _flag),
    21: (_lost, _uint16, _lost, _yaw),
    22: _YAW_ONLY,
    31: (_flag, _kept, _lost, _flag),
    NAV_ROI: _ROI,
    84: _YAW_ONLY,
    85: _YAW_ONLY,
    195: _ALL_LOST,
    DO_SET_ROI: _ROI,
    4501: _ALL_LOST,
    5000: _ALL_LOST,
}
"""By MAV_CMD, what becomes of the four parameters of an item with a position; PX4 refuses other commands."""
_FENCE: dict[int, _Parameters] = {
    m.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION: (_corners, _lost, _lost, _lost),
    m.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION: (_corners, _lost, _lost, _lost),
    m.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION: (_kept, _lost, _lost, _lost),
    m.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION: (_kept, _lost, _lost, _lost),
}


def is_lost(part: Part, item: WireItem, number: int) -> bool:
    """Whether PX4 loses a parameter (1 to 4) of an item."""
    return _rules(part, item)[number - 1] is _lost


def is_yaw(part: Part, item: WireItem, number: int) -> bool:
    """Whether a parameter (1 to 4) is a yaw: PX4 returns it with the error of a 32-bit angle in radians."""
    return _rules(part, item)[number - 1] is _yaw


def _rules(part: Part, item: WireItem) -> _Parameters:
    if part == "rally":
        return _ALL_LOST
    if part == "fence":
        return _FENCE.get(item.command, _ALL_LOST)
    if item.frame == m.MAV_FRAME_MISSION:
        return _JUMP if item.command == DO_JUMP else _ALL_KEPT
    return _WITH_POSITION.get(item.command, _ALL_KEPT)


def _stored(part: Part, item: WireItem) -> WireItem:
    first, second, third, fourth = _rules(part, item)
    result = replace(
        item,
        command=DO_SET_ROI if item.command == NAV_ROI else item.command,
        frame=INT_FRAMES.get(item.frame, item.frame),
        param1=first(item.param1),
        param2=second(item.param2),
        param3=third(item.param3),
        param4=fourth(item.param4),
    )
    if part == "fence":
        # The altitude of a fence point has no meaning; PX4 therefore has one frame for all of them.
        return replace(result, frame=m.MAV_FRAME_GLOBAL_INT, autocontinue=False)
    if item.frame == m.MAV_FRAME_MISSION:
        return replace(result, x=_int32_of_float32(item.x), y=_int32_of_float32(item.y))
    return result
