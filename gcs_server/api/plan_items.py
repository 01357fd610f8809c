"""The MAVLink items of a waypoint plan, which plan work makes."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from gcs_server.api.documents import UnreadDocument
from gcs_server.api.station import Station
from gcs_server.vehicle.services.mission_dialogue import Part
from gcs_server.vehicle.services.mission_on_vehicle import Items
from missions.formats.mavlink_items import WireItem

_decoder = msgspec.msgpack.Decoder(dict[Part, tuple[WireItem, ...]])


async def mavlink_items(
    station: Station, plan: UnreadDocument, subject: str = ""
) -> tuple[Items, Sequence[int]]:
    """The items of a plan, and the index in the plan's `items` of each mission item.

    Args:
        station: the running server.
        plan: the plan.
        subject: begin of an error's text, for a plan that is not in the request.

    Raises:
        InvalidRequest: the plan cannot be used, or the MAVLink mission protocol cannot represent it.
        Refused: this takes too much memory or time, or too many tasks are waiting.
    """
    answer = await station.plan_work.run("items", {"plan": plan.text}, small=plan.small, subject=subject)
    return _decoder.decode(answer.body), answer.values["rows"]
