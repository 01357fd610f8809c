"""The mission items that PX4 v1.16 executes for a multicopter, one class each; `kind` tells them apart.

`COMMAND` is the item's MAV_CMD, `SLOTS` says which field each MAVLink parameter carries (a number: the
parameter is not used and normally has this value; None: not used, normally NaN). Placed items have
four slots, their place is parameters 5 to 7; the others have seven. Yaw is clockwise from true north in
degrees, None leaves it to the autopilot. MAVLink common message set: https://mavlink.io/en/messages/common.html
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from missions.values import Altitude, LatDeg, LonDeg, Model, Number

Slot = str | float | None
Unset = Number | None


class Item(Model):
    """What all mission items share."""

    COMMAND: ClassVar[int]
    SLOTS: ClassVar[tuple[Slot, ...]]

    autocontinue: bool = True
    """Go on to the next item when this one is done."""
    spare_params: tuple[tuple[Annotated[int, Field(ge=1, le=7)], Unset], ...] = ()
    """MAVLink parameters (number, value) that this kind does not use, where they have unusual values."""
    original: str | None = None
    """JSON text of this item in the .plan file it was read from, with whatever is not modelled here."""


class PlacedItem(Item):
    """An item with a place: WGS84 degrees and an altitude with its reference."""

    lat_deg: LatDeg
    lon_deg: LonDeg
    altitude: Altitude


class Takeoff(PlacedItem):
    """Climb to the altitude, then fly to the place."""

    COMMAND = 22
    SLOTS = ("pitch_deg", 0.0, 0.0, "yaw_ned_deg")
    kind: Literal["takeoff"] = "takeoff"
    pitch_deg: Unset = 0.0
    yaw_ned_deg: Unset = None


class Waypoint(PlacedItem):
    """Fly to the place; wait there if `hold_s` is set. A radius of 0 is PX4's NAV_ACC_RAD."""

    COMMAND = 16
    SLOTS = ("hold_s", "acceptance_radius_m", "pass_radius_m", "yaw_ned_deg")
    kind: Literal["waypoint"] = "waypoint"
    hold_s: Unset = 0.0
    acceptance_radius_m: Unset = 0.0
    pass_radius_m: Unset = 0.0
    yaw_ned_deg: Unset = None


class LoiterUnlimited(PlacedItem):
    """Fly to the place and hold there until told otherwise; the mission does not go on."""

    COMMAND = 17
    SLOTS = (0.0, 0.0, "radius_m", "yaw_ned_deg")
    kind: Literal["loiter_unlimited"] = "loiter_unlimited"
    radius_m: Unset = 0.0
    yaw_ned_deg: Unset = None


class LoiterTime(PlacedItem):
    """Fly to the place and hold there for a time."""

    COMMAND = 19
    SLOTS = ("hold_s", 0.0, "radius_m", "exit_xtrack")
    kind: Literal["loiter_time"] = "loiter_time"
    hold_s: Unset
    radius_m: Unset = 0.0
    exit_xtrack: Unset = 0.0


class LoiterToAltitude(PlacedItem):
    """Fly to the place, then climb or descend to the altitude."""

    COMMAND = 31
    SLOTS = ("leave_towards_next", "radius_m", 0.0, "exit_xtrack")
    kind: Literal["loiter_to_altitude"] = "loiter_to_altitude"
    leave_towards_next: Unset = 0.0
    radius_m: Unset = 0.0
    exit_xtrack: Unset = 0.0


class Land(PlacedItem):
    """Fly to the place and land. `precision`: 0 off, 1 where a target is seen, 2 required."""

    COMMAND = 21
    SLOTS = ("abort_altitude_m", "precision", 0.0, "yaw_ned_deg")
    kind: Literal["land"] = "land"
    abort_altitude_m: Unset = 0.0
    precision: Unset = 0.0
    yaw_ned_deg: Unset = None


class RoiLocation(PlacedItem):
    """Point the camera at a place from here on."""

    COMMAND = 195
    SLOTS = ("gimbal_id", 0.0, 0.0, 0.0)
    kind: Literal["roi_location"] = "roi_location"
    gimbal_id: Unset = 0.0


class LegacyRoi(PlacedItem):
    """The older form of `roi_location`. `mode` is MAV_ROI: 0 none, 1 next waypoint, 3 location."""

    COMMAND = 201
    SLOTS = ("mode", "target", "index", 0.0)
    kind: Literal["roi"] = "roi"
    mode: Unset = 3.0
    target: Unset = 0.0
    index: Unset = 0.0


class Gate(PlacedItem):
    """Wait until the vehicle has flown through this place, at right angles to the path."""

    COMMAND = 4501
    SLOTS = ("geometry", "use_altitude", 0.0, 0.0)
    kind: Literal["gate"] = "gate"
    geometry: Unset = 0.0
    use_altitude: Unset = 0.0


class ReturnHome(Item):
    """Return to launch: home or a rally point, as the vehicle is set up."""

    COMMAND = 20
    SLOTS = (0.0,) * 7
    kind: Literal["return_home"] = "return_home"


class Delay(Item):
    """Wait here for `delay_s`, or with -1 until a time of day in UTC."""

    COMMAND = 93
    SLOTS = ("delay_s", "hour_utc", "minute_utc", "second_utc", 0.0, 0.0, 0.0)
    kind: Literal["delay"] = "delay"
    delay_s: Unset
    hour_utc: Unset = 0.0
    minute_utc: Unset = 0.0
    second_utc: Unset = 0.0


class Jump(Item):
    """Go on at another item, `repeat` times (-1: without end). Items count from 0, as uploaded."""

    COMMAND = 177
    SLOTS = ("target_index", "repeat", 0.0, 0.0, 0.0, 0.0, 0.0)
    kind: Literal["jump"] = "jump"
    target_index: Annotated[int, Field(ge=0, le=100_000)]
    repeat: Annotated[int, Field(ge=-1, le=65_535)]


class ChangeSpeed(Item):
    """Fly at another speed from here on. `speed_type`: 0 air, 1 ground, 2 climb, 3 descent."""

    COMMAND = 178
    SLOTS = ("speed_type", "speed_m_s", "throttle_percent", 0.0, 0.0, 0.0, 0.0)
    kind: Literal["change_speed"] = "change_speed"
    speed_type: Unset = 1.0
    speed_m_s: Unset
    throttle_percent: Unset = -1.0


class SetHome(Item):
    """Make the vehicle's place its home (`use_current` 1; PX4 takes no other place in a mission)."""

    COMMAND = 179
    SLOTS = ("use_current", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    kind: Literal["set_home"] = "set_home"
    use_current: Unset = 1.0


class LandStart(Item):
    """The landing begins here: return modes may go on from here."""

    COMMAND = 189
    SLOTS = (0.0,) * 7
    kind: Literal["land_start"] = "land_start"


class RoiNextWaypoint(Item):
    """Point the camera along the path. Pitch and roll offset are whole degrees, as the protocol has them."""

    COMMAND = 196
    SLOTS = ("gimbal_id", 0.0, 0.0, 0.0, "pitch_offset_deg", "roll_offset_deg", "yaw_offset_deg")
    kind: Literal["roi_next_waypoint"] = "roi_next_waypoint"
    gimbal_id: Unset = 0.0
    pitch_offset_deg: Unset = 0.0
    roll_offset_deg: Unset = 0.0
    yaw_offset_deg: Unset = 0.0


class RoiNone(Item):
    """Stop pointing the camera at a place."""

    COMMAND = 197
    SLOTS = ("gimbal_id", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    kind: Literal["roi_none"] = "roi_none"
    gimbal_id: Unset = 0.0


class SetServo(Item):
    """Set a servo output, pulse width in microseconds."""

    COMMAND = 183
    SLOTS = ("servo", "pulse_us", 0.0, 0.0, 0.0, 0.0, 0.0)
    kind: Literal["set_servo"] = "set_servo"
    servo: Unset
    pulse_us: Unset


class SetActuator(Item):
    """Set actuators 1 to 4 of a set, -1 to 1; None leaves one as it is."""

    COMMAND = 187
    SLOTS = ("actuator_1", "actuator_2", "actuator_3", "actuator_4", 0.0, 0.0, "set_index")
    kind: Literal["set_actuator"] = "set_actuator"
    actuator_1: Unset = None
    actuator_2: Unset = None
    actuator_3: Unset = None
    actuator_4: Unset = None
    set_index: Unset = 0.0


class Gripper(Item):
    """Open (action 0) or close (action 1) a gripper."""

    COMMAND = 211
    SLOTS = ("gripper", "action", 0.0, 0.0, 0.0, 0.0, 0.0)
    kind: Literal["gripper"] = "gripper"
    gripper: Unset
    action: Unset


class Winch(Item):
    """Move a winch: `action` is MAVLink's WINCH_ACTIONS; line in metres, rate in m/s."""

    COMMAND = 42600
    SLOTS = ("winch", "action", "length_m", "rate_m_s", 0.0, 0.0, 0.0)
    kind: Literal["winch"] = "winch"
    winch: Unset
    action: Unset
    length_m: Unset = 0.0
    rate_m_s: Unset = 0.0


class CommandItem(Model):
    """Any other item of a foreign file or vehicle, kept as it is; PX4 refuses most of them.

    `params` are MAVLink's seven parameters, degrees in 5 and 6 where `frame` is global; None is NaN.
    """

    kind: Literal["command"] = "command"
    command: Annotated[int, Field(ge=0, le=65_535)]
    frame: Annotated[int, Field(ge=0, le=255)]
    params: tuple[Unset, Unset, Unset, Unset, Unset, Unset, Unset]
    autocontinue: bool = True
    original: str | None = None
    """JSON text of this item in the .plan file it was read from."""
