"""Texts of PX4's EVENT messages, from the vehicle's metadata if available, or else from this server.

The ids are those of PX4 v1.16; the top byte is the component of the event's namespace (1: autopilot). The
first arguments of an arming check are a bit mask of the affected modes, and the health component.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from gcs_server.vehicle.event_definitions import Definitions
from gcs_server.vehicle.px4.checks import CHECKS
from gcs_server.vehicle.px4.modes import BY_CUSTOM_MODE, BY_NAV_STATE

_BOTH_OR_NEITHER = "and the vehicle requires both or neither (MIS_TKO_LAND_REQ)"
_REASONS: dict[int, tuple[str, str]] = {
    22901736: ("", "it starts with a landing, and the vehicle is on the ground"),
    18702382: ("", "it starts with a landing"),
    28985965: ("f", "the take-off is too low: it must be more than {:.1f} m above home"),
    33440290: ("", "the take-off is not the first item that the vehicle flies to"),
    22271714: ("", "the vehicle requires a take-off (MIS_TKO_LAND_REQ)"),
    25237137: ("", "the vehicle requires a landing (MIS_TKO_LAND_REQ)"),
    29001630: ("", "the vehicle requires a take-off and a landing (MIS_TKO_LAND_REQ)"),
    19546926: ("", f"it has a take-off but no landing, {_BOTH_OR_NEITHER}"),
    33286782: ("", f"it has a landing but no take-off, {_BOTH_OR_NEITHER}"),
    19619824: (
        "",
        "the vehicle is in the air, where it requires a landing in the mission (MIS_TKO_LAND_REQ)",
    ),
    28298937: ("", "it has items for VTOL aircraft"),
    25552931: ("HH", "item {} has the command {}, which the vehicle cannot fly"),
    20155474: ("h", "item {} has an altitude above home, and the vehicle has no home position"),
    19608877: ("h", "item {} is outside the geofence"),
    22572417: ("", "the geofence needs a home position, and the vehicle has none"),
    20230345: ("", "the geofence needs a home position, and the vehicle has none"),
    25102077: ("", "the vehicle does not know its position yet"),
    30155728: ("ff", "a gate is {:.2f} m from its waypoint; it needs at least {:.2f} m"),
    29545429: ("", "it has more than one start of a landing"),
    30733418: ("", "no landing follows the start of the landing"),
    24637881: ("", "a return home follows the start of a landing"),
}
"""By event id: types of the arguments, and the reason. The ids are those of PX4 v1.16."""


def rejection_reason(event_id: int, arguments: bytes) -> str | None:
    """Why PX4 will not fly its mission, as a clause; None: the event has another subject."""
    known = _REASONS.get(event_id)
    if known is None:
        return None
    types, text = known
    return text.format(*struct.unpack_from(f"<{types}", arguments))


def is_rejection(event_id: int) -> bool:
    """Whether an event states why PX4 will not fly its mission."""
    return event_id in _REASONS


_event = struct.Struct("<IIHBBB40s")

ARMING_SUMMARY_ID = 27825120
HEALTH_SUMMARY_ID = 18691879
LEVEL_PROTOCOL = 8
"""From this level on, events are for the protocol and not for people."""

TEXTS: dict[int, str] = {
    16910493: "Arming denied: the vehicle's checks failed",
    25868725: "Disarming denied: the vehicle has not landed",
    27280279: "The vehicle cannot switch to that mode now",
    19869445: "The vehicle does not know that mode",
    19217309: "The vehicle does not know that arming request",
    26266355: "Armed",
    32794487: "Disarmed",
    21054825: "Take-off detected",
    20656071: "Climbing to the default take-off altitude",
    19098816: "Already above the take-off altitude",
    20099806: "Landing at the current position",
    25087420: "Precision landing",
    20262116: "Returning to launch",
    22161044: "Return started",
    16962474: "Landing at the destination",
    22400324: "RC signal lost",
    27900317: "Connection to the onboard computer lost",
    31382480: "Failsafe active",
    30481910: "Failsafe: Hold before the failsafe action",
    26528394: "Failsafe active",
    29547634: "Failsafe active: the autopilot lost control of the mode",
    28993875: "Battery low: return advised",
    28329281: "A setpoint's frame is not supported",
    22427557: "A setpoint without position, velocity or acceleration was refused",
    27739955: "A global setpoint's frame is not supported",
    32375217: "Mission started",
    23844490: "Mission not started: the vehicle has no mission",
    24986204: "Climbing before the mission begins",
    18865022: "The orbit's radius is too large",
    27750677: "The geofence does not contain home",
    26128688: "The rally point's frame is not supported",
    30930440: "Manual speed was limited by the maximum speed",
}
SWITCH_REFUSED_ID = 27280279

COMPONENTS = {
    0: "common events", 1: "autopilot", 25: "user", 100: "camera", 154: "gimbal", 161: "parachute",
    169: "payload", 191: "onboard computer", 220: "GPS",
}  # fmt: skip
"""Names of MAVLink's component ids (MAV_COMPONENT)."""


@dataclass(frozen=True, slots=True)
class VehicleEvent:
    """One decoded EVENT."""

    id: int
    sequence: int
    level: int
    """MAV_SEVERITY; from `LEVEL_PROTOCOL` (8) on, the event is not for people."""
    text: str
    name: str
    """PX4's name of the event; `event_…` if unknown."""
    remedy: str | None
    """Remedy, if known."""
    boot_ms: int
    """Time of the event on the vehicle's boot clock [ms]."""
    arguments: bytes
    is_described: bool = True
    """Whether the vehicle's metadata or this server has a text for it."""


def decode_event(payload: bytes, definitions: Definitions | None = None) -> VehicleEvent:
    """Decodes a full EVENT payload.

    Args:
        payload: the payload.
        definitions: the vehicle's metadata, if available.
    """
    event_id, boot_ms, sequence, _component, _system, levels, arguments = _event.unpack(payload)
    text, name, remedy = describe(event_id, arguments, definitions)
    is_described = has_description(event_id, definitions)
    return VehicleEvent(
        event_id, sequence, levels & 0x0F, text, name, remedy, boot_ms, arguments, is_described
    )


def has_description(event_id: int, definitions: Definitions | None) -> bool:
    """Whether the vehicle's metadata or this server has a text for an event."""
    return (
        event_id in CHECKS
        or event_id in TEXTS
        or is_rejection(event_id)
        or (definitions is not None and event_id in definitions)
    )


def describe(
    event_id: int, arguments: bytes, definitions: Definitions | None = None
) -> tuple[str, str, str | None]:
    """(text, name, remedy) of an event, from the vehicle's metadata or from this server; otherwise a text
    with the id."""
    check = CHECKS.get(event_id)
    defined = definitions.get(event_id) if definitions else None
    if defined is not None:
        remedy = defined.remedy(arguments) if defined.is_check else None
        return defined.text(arguments), defined.name, remedy or (check.remedy if check else None)
    if check is not None:
        return check.cause, check.name, check.remedy
    reason = rejection_reason(event_id, arguments)
    text = TEXTS.get(event_id) or f"unknown event {event_id} from {component_text(event_id >> 24)}"
    if reason is not None:
        text = f"The vehicle will not fly its mission: {reason}"
    if event_id == SWITCH_REFUSED_ID:
        (custom_mode,) = struct.unpack_from("<I", arguments)
        mode = BY_NAV_STATE.get(arguments[4]) or BY_CUSTOM_MODE.get(custom_mode)
        text = f"The vehicle cannot switch to {mode.label} now" if mode else text
    return text, f"event_{event_id}", None


def component_text(number: int) -> str:
    """The component in an event id's top byte."""
    return f"component {number} ({COMPONENTS[number]})" if number in COMPONENTS else f"component {number}"
