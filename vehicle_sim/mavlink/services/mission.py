"""The mission protocol, so that stations can connect, upload, download and clear plans.

Plans are stored with the ids PX4 gives them (CRC32 of the items). Flying them is not offered: Mission mode
counts as unavailable.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field
from typing import Any

from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import Message
from vehicle_sim.mavlink.link import Link

ACCEPTED, ERROR, UNSUPPORTED_FRAME, UNSUPPORTED, INVALID_SEQUENCE = 0, 1, 2, 3, 13
"""MAV_MISSION_RESULT."""
TYPES = (0, 1, 2)
ALL_TYPES = 255
RETRY_S = 0.25
TIMEOUT_S = 5.0
ITEM_FIELDS = ("frame", "command", "current", "autocontinue", "param1", "param2", "param3", "param4", "x",
               "y", "z")  # fmt: skip


@dataclass(slots=True)
class _Upload:
    link: Link
    sender: tuple[int, int]
    kind: int
    count: int
    started_s: float
    items: list[dict[str, Any]] = field(default_factory=list)
    as_int: bool = True
    asked_s: float = 0.0


class MissionService:
    """MISSION_* for missions, fences and rally points."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._plans: dict[int, list[dict[str, Any]]] = {kind: [] for kind in TYPES}
        self._ids: dict[int, int] = dict.fromkeys(TYPES, 0)
        self._current = 0
        self._upload: _Upload | None = None
        self.handlers = {
            "MISSION_REQUEST_LIST": self.request_list,
            "MISSION_REQUEST_INT": self.request_item,
            "MISSION_REQUEST": self.request_item,
            "MISSION_COUNT": self.count,
            "MISSION_ITEM_INT": self.item,
            "MISSION_ITEM": self.item,
            "MISSION_CLEAR_ALL": self.clear,
            "MISSION_SET_CURRENT": self.set_current,
            "MISSION_ACK": self.acknowledged,
        }

    def send_current(self, link: Link) -> None:
        """MISSION_CURRENT, 1 Hz."""
        count = len(self._plans[0])
        link.send(
            "MISSION_CURRENT", seq=self._current, total=count or 65535, mission_id=self._ids[0],
            fence_id=self._ids[1], rally_points_id=self._ids[2],
        )  # fmt: skip

    def request_list(self, link: Link, message: Message) -> None:
        """How many items there are, and the plan's id."""
        if not self._context.is_for_me(message):
            return
        kind = message.mission_type
        if kind not in TYPES:
            self._ack(link, message.sender, 4, kind)
            return
        link.send(
            "MISSION_COUNT", target_system=message.system_id, target_component=message.component_id,
            count=len(self._plans[kind]), mission_type=kind, opaque_id=self._ids[kind],
        )  # fmt: skip

    def request_item(self, link: Link, message: Message) -> None:
        """One stored item, in the form it was asked for."""
        if not self._context.is_for_me(message) or message.mission_type not in TYPES:
            return
        plan = self._plans[message.mission_type]
        if message.seq >= len(plan):
            self._ack(link, message.sender, INVALID_SEQUENCE, message.mission_type)
            return
        fields = dict(plan[message.seq])
        name = "MISSION_ITEM_INT"
        if message.name == "MISSION_REQUEST":
            name = "MISSION_ITEM"
            fields["x"], fields["y"] = fields["x"] / 1e7, fields["y"] / 1e7
        link.send(
            name, target_system=message.system_id, target_component=message.component_id, seq=message.seq,
            mission_type=message.mission_type, **fields,
        )  # fmt: skip

    def count(self, link: Link, message: Message) -> None:
        """Somebody wants to upload."""
        if not self._context.is_for_me(message):
            return
        kind = message.mission_type
        if kind not in TYPES:
            self._ack(link, message.sender, 4, kind)
            return
        if self._upload is not None:
            self._context.autopilot.announcer.text(2, "WPM: REJ. CMD: Busy\t")
            self._ack(link, message.sender, ERROR, kind)
            return
        if message.count == 0:
            self._store(kind, [])
            self._ack(link, message.sender, ACCEPTED, kind)
            return
        now_s = self._context.body.time_s
        self._upload = _Upload(link, message.sender, kind, message.count, now_s)
        self._ask()

    def item(self, link: Link, message: Message) -> None:
        """The next item of an upload; others are ignored and asked for again."""
        upload = self._upload
        if upload is None or not self._context.is_for_me(message) or message.sender != upload.sender:
            return
        upload.as_int = message.name == "MISSION_ITEM_INT"
        if message.seq != len(upload.items) or message.mission_type != upload.kind:
            return
        fields = {name: getattr(message, name) for name in ITEM_FIELDS}
        if not upload.as_int:
            fields["x"], fields["y"] = round(fields["x"] * 1e7), round(fields["y"] * 1e7)
        upload.items.append(fields)
        upload.started_s = self._context.body.time_s
        if len(upload.items) < upload.count:
            self._ask()
            return
        self._upload = None
        self._store(upload.kind, upload.items)
        self._ack(link, message.sender, ACCEPTED, upload.kind)

    def clear(self, link: Link, message: Message) -> None:
        """Forget plans."""
        if not self._context.is_for_me(message):
            return
        kind = message.mission_type
        if kind not in (*TYPES, ALL_TYPES):
            self._ack(link, message.sender, 4, kind)
            return
        for each in TYPES if kind == ALL_TYPES else (kind,):
            self._store(each, [])
        self._ack(link, message.sender, ACCEPTED, kind)

    def set_current(self, link: Link, message: Message) -> None:
        """Which item counts as current."""
        if self._context.is_for_me(message) and message.seq < len(self._plans[0]):
            self._current = message.seq
            self.send_current(link)

    def acknowledged(self, link: Link, message: Message) -> None:
        """The other side cancels an upload."""
        upload = self._upload
        if upload and message.sender == upload.sender and message.type != ACCEPTED:
            self._upload = None

    def step(self) -> None:
        """Ask again, or give up."""
        upload = self._upload
        if upload is None:
            return
        now_s = self._context.body.time_s
        if now_s - upload.started_s > TIMEOUT_S:
            self._upload = None
            self._context.autopilot.announcer.text(2, "Operation timeout\t")
        elif now_s - upload.asked_s > RETRY_S:
            self._ask()

    def _ask(self) -> None:
        upload = self._upload
        if upload is None:
            return
        upload.asked_s = self._context.body.time_s
        upload.link.send(
            "MISSION_REQUEST_INT" if upload.as_int else "MISSION_REQUEST",
            target_system=upload.sender[0], target_component=upload.sender[1], seq=len(upload.items),
            mission_type=upload.kind,
        )  # fmt: skip

    def _store(self, kind: int, items: list[dict[str, Any]]) -> None:
        self._plans[kind] = items
        self._current = 0 if kind == 0 else self._current
        content = b"".join(
            struct.pack("<BHffffiif", i["frame"], i["command"], i["param1"], i["param2"], i["param3"],
                        i["param4"], i["x"], i["y"], i["z"])
            for i in items
        )  # fmt: skip
        self._ids[kind] = zlib.crc32(content) if items else 0

    def _ack(self, link: Link, to: tuple[int, int], result: int, kind: int) -> None:
        link.send(
            "MISSION_ACK", target_system=to[0], target_component=to[1], type=result, mission_type=kind,
            opaque_id=self._ids.get(kind, 0),
        )  # fmt: skip
