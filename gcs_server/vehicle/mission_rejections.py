"""PX4's reasons not to fly a mission that it has stored.

PX4 acknowledges each upload whose items it can store. Then it checks the whole mission, and states by events
alone that it will not fly it. It does not repeat these events.
"""

from __future__ import annotations

import struct

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
