"""The mission items that PX4 v1.16 executes for a multicopter, one class each; `kind` distinguishes them.

`COMMAND` is the item's MAV_CMD. `SLOTS` contains the field of each MAVLink parameter. A number instead of a
field means that the parameter is unused and normally has this value; None means unused and normally NaN.
Items with a position have four slots, because parameters 5 to 7 are the position; all other items have seven.
Yaw is in degrees clockwise from true north; None: the autopilot decides on the yaw. MAVLink common message
set: https://mavlink.io/en/messages/common.html
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from missions.values import Altitude, LatDeg, LonDeg, Model, Number

Slot = str | float | None
NumberOrNone = Number | None


class Item(Model):
    """Base class of all mission items."""

    COMMAND: ClassVar[int]
    SLOTS: ClassVar[tuple[Slot, ...]]

    autocontinue: bool = True
    """Continue with the next item when this item is done."""
    spare_params: tuple[tuple[Annotated[int, Field(ge=1, le=7)], NumberOrNone], ...] = ()
    """MAVLink parameters (number, value) that this kind does not use but that have unusual values."""
    original: str | None = None
    """JSON text of this item in the .plan file that the item was read from, including fields not modelled
    here."""


class PlacedItem(Item):
    """An item with a position: WGS84 degrees, and an altitude with its reference."""

    lat_deg: LatDeg
    lon_deg: LonDeg
    altitude: Altitude


class Takeoff(PlacedItem):
    """Climb to the altitude, then fly to the position."""

    COMMAND = 22
    SLOTS = ("pitch_deg", 0.0, 0.0, "yaw_ned_deg")
    kind: Literal["takeoff"] = "takeoff"
    pitch_deg: NumberOrNone = 0.0
    yaw_ned_deg: NumberOrNone = None


class Waypoint(PlacedItem):
    """Fly to the position and hold it for `hold_s`. A radius of 0 means PX4's NAV_ACC_RAD."""

    COMMAND = 16
    SLOTS = ("hold_s", "acceptance_radius_m", "pass_radius_m", "yaw_ned_deg")
    kind: Literal["waypoint"] = "waypoint"
    hold_s: NumberOrNone = 0.0
    acceptance_radius_m: NumberOrNone = 0.0
    pass_radius_m: NumberOrNone = 0.0
    yaw_ned_deg: NumberOrNone = None


class LoiterUnlimited(PlacedItem):
    """Fly to the position and hold it; the mission does not continue by itself."""

    COMMAND = 17
    SLOTS = (0.0, 0.0, "radius_m", "yaw_ned_deg")
    kind: Literal["loiter_unlimited"] = "loiter_unlimited"
    radius_m: NumberOrNone = 0.0
    yaw_ned_deg: NumberOrNone = None


class LoiterTime(PlacedItem):
    """Fly to the position and hold it for `hold_s`."""

    COMMAND = 19
    SLOTS = ("hold_s", 0.0, "radius_m", "exit_xtrack")
    kind: Literal["loiter_time"] = "loiter_time"
    hold_s: NumberOrNone
    radius_m: NumberOrNone = 0.0
    exit_xtrack: NumberOrNone = 0.0


class LoiterToAltitude(PlacedItem):
    """Fly to the position, then climb or descend to the altitude."""

    COMMAND = 31
    SLOTS = ("leave_towards_next", "radius_m", 0.0, "exit_xtrack")
    kind: Literal["loiter_to_altitude"] = "loiter_to_altitude"
    leave_towards_next: NumberOrNone = 0.0
    radius_m: NumberOrNone = 0.0
    exit_xtrack: NumberOrNone = 0.0


class Land(PlacedItem):
    """Fly to the position and land. `precision` is PRECISION_LAND_MODE: 0 off, 1 if a target is visible,
    2 required."""

    COMMAND = 21
    SLOTS = ("abort_altitude_m", "precision", 0.0, "yaw_ned_deg")
    kind: Literal["land"] = "land"
    abort_altitude_m: NumberOrNone = 0.0
    precision: NumberOrNone = 0.0
    yaw_ned_deg: NumberOrNone = None


class RoiLocation(PlacedItem):
    """Point the camera at a position from now on."""

    COMMAND = 195
    SLOTS = ("gimbal_id", 0.0, 0.0, 0.0)
    kind: Literal["roi_location"] = "roi_location"
    gimbal_id: NumberOrNone = 0.0


class LegacyRoi(PlacedItem):
    """Deprecated form of `roi_location`. `mode` is MAV_ROI: 0 none, 1 next waypoint, 3 location."""

    COMMAND = 201
    SLOTS = ("mode", "target", "index", 0.0)
    kind: Literal["roi"] = "roi"
    mode: NumberOrNone = 3.0
    target: NumberOrNone = 0.0
    index: NumberOrNone = 0.0


class Gate(PlacedItem):
    """Delay the next item until the vehicle has crossed the line through this position, perpendicular to the
    path."""

    COMMAND = 4501
    SLOTS = ("geometry", "use_altitude", 0.0, 0.0)
    kind: Literal["gate"] = "gate"
    geometry: NumberOrNone = 0.0
    use_altitude: NumberOrNone = 0.0


class ReturnHome(Item):
    """Return to home or to a rally point, according to the vehicle's parameters."""

    COMMAND = 20
    SLOTS = (0.0,) * 7
    kind: Literal["return_home"] = "return_home"


class Delay(Item):
    """Wait for `delay_s`, or until a time of day in UTC if `delay_s` is -1."""

    COMMAND = 93
    SLOTS = ("delay_s", "hour_utc", "minute_utc", "second_utc", 0.0, 0.0, 0.0)
    kind: Literal["delay"] = "delay"
    delay_s: NumberOrNone
    hour_utc: NumberOrNone = 0.0
    minute_utc: NumberOrNone = 0.0
    second_utc: NumberOrNone = 0.0


class Jump(Item):
    """Continue at another item, `repeat` times (-1: endless). `target_index` counts from 0 in upload
    order."""

    COMMAND = 177
    SLOTS = ("target_index", "repeat", 0.0, 0.0, 0.0, 0.0, 0.0)
    kind: Literal["jump"] = "jump"
    target_index: Annotated[int, Field(ge=0, le=100_000)]
    repeat: Annotated[int, Field(ge=-1, le=65_535)]


class ChangeSpeed(Item):
    """Set the speed for the following items. `speed_type`: 0 air, 1 ground, 2 climb, 3 descent."""

    COMMAND = 178
    SLOTS = ("speed_type", "speed_m_s", "throttle_percent", 0.0, 0.0, 0.0, 0.0)
    kind: Literal["change_speed"] = "change_speed"
    speed_type: NumberOrNone = 1.0
    speed_m_s: NumberOrNone
    throttle_percent: NumberOrNone = -1.0


class SetHome(Item):
    """Set home to the vehicle's position. `use_current` must be 1: PX4 accepts no other position in a
    mission."""

    COMMAND = 179
    SLOTS = ("use_current", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    kind: Literal["set_home"] = "set_home"
    use_current: NumberOrNone = 1.0


class LandStart(Item):
    """Marks the start of the landing. Return mode may continue the mission from this item (RTL_TYPE)."""

    COMMAND = 189
    SLOTS = (0.0,) * 7
    kind: Literal["land_start"] = "land_start"


class RoiNextWaypoint(Item):
    """Point the camera along the path. Pitch and roll offset are whole degrees in the protocol."""

    COMMAND = 196
    SLOTS = ("gimbal_id", 0.0, 0.0, 0.0, "pitch_offset_deg", "roll_offset_deg", "yaw_offset_deg")
    kind: Literal["roi_next_waypoint"] = "roi_next_waypoint"
    gimbal_id: NumberOrNone = 0.0
    pitch_offset_deg: NumberOrNone = 0.0
    roll_offset_deg: NumberOrNone = 0.0
    yaw_offset_deg: NumberOrNone = 0.0


class RoiNone(Item):
    """Stop pointing the camera at a position."""

    COMMAND = 197
    SLOTS = ("gimbal_id", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    kind: Literal["roi_none"] = "roi_none"
    gimbal_id: NumberOrNone = 0.0


class SetServo(Item):
    """Set a servo output, pulse width in microseconds."""

    COMMAND = 183
    SLOTS = ("servo", "pulse_us", 0.0, 0.0, 0.0, 0.0, 0.0)
    kind: Literal["set_servo"] = "set_servo"
    servo: NumberOrNone
    pulse_us: NumberOrNone


class SetActuator(Item):
    """Set actuators 1 to 4 of a set to -1 … 1; None: unchanged."""

    COMMAND = 187
    SLOTS = ("actuator_1", "actuator_2", "actuator_3", "actuator_4", 0.0, 0.0, "set_index")
    kind: Literal["set_actuator"] = "set_actuator"
    actuator_1: NumberOrNone = None
    actuator_2: NumberOrNone = None
    actuator_3: NumberOrNone = None
    actuator_4: NumberOrNone = None
    set_index: NumberOrNone = 0.0


class Gripper(Item):
    """Open (action 0) or close (action 1) a gripper."""

    COMMAND = 211
    SLOTS = ("gripper", "action", 0.0, 0.0, 0.0, 0.0, 0.0)
    kind: Literal["gripper"] = "gripper"
    gripper: NumberOrNone
    action: NumberOrNone


class Winch(Item):
    """Move a winch: `action` is MAVLink's WINCH_ACTIONS; line in metres, rate in m/s."""

    COMMAND = 42600
    SLOTS = ("winch", "action", "length_m", "rate_m_s", 0.0, 0.0, 0.0)
    kind: Literal["winch"] = "winch"
    winch: NumberOrNone
    action: NumberOrNone
    length_m: NumberOrNone = 0.0
    rate_m_s: NumberOrNone = 0.0


class CommandItem(Model):
    """Any other item of a file or vehicle, kept unchanged; PX4 refuses most items of this kind.

    `params` are MAVLink's seven parameters; None means NaN. If `frame` is global, parameters 5 and 6 are in
    degrees.
    """

    kind: Literal["command"] = "command"
    command: Annotated[int, Field(ge=0, le=65_535)]
    frame: Annotated[int, Field(ge=0, le=255)]
    params: tuple[
        NumberOrNone,
        NumberOrNone,
        NumberOrNone,
        NumberOrNone,
        NumberOrNone,
        NumberOrNone,
        NumberOrNone,
    ]
    autocontinue: bool = True
    original: str | None = None
    """JSON text of this item in the .plan file that the item was read from."""
