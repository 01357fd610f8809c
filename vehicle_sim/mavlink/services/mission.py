"""The mission protocol, so that stations can upload, download and clear missions, fences and rally points.

Each link has its own exchange, as PX4's mission manager has one a link; what is stored is one for all.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Any

from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import Message
from vehicle_sim.mavlink.link import Link
from vehicle_sim.mavlink.services import mission_items as items
from vehicle_sim.mavlink.services.mission_items import ACCEPTED, ALL, CAPACITY, ERROR, MISSION, NO_SPACE

RETRY_S = 0.26
"""As measured between repeated requests; configured are 0.25 s."""
TIMEOUT_S = 5.0
REACHED_EVERY_S, REACHED_FOR_S = 1.0, 10.0
LOUD = 2
"""MAV_SEVERITY_CRITICAL."""
ITEM_FIELDS = ("frame", "command", "current", "autocontinue", "param1", "param2", "param3", "param4", "x",
               "y", "z")  # fmt: skip
_INT_FRAMES, _FLOAT_FRAMES = {0: 5, 3: 6}, {5: 0, 6: 3}
"""Items are given back in the frame of the form they are asked for in."""
UNEXPECTED = "WPM: REJ. CMD: Req. WP was unexpected"
BUSY = "WPM: REJ. CMD: Busy"


class _State(Enum):
    IDLE = auto()
    RECEIVING = auto()
    SENDING = auto()


@dataclass(slots=True)
class _Exchange:
    """What goes on over one link."""

    link: Link
    state: _State = _State.IDLE
    partner: tuple[int, int] = (0, 0)
    kind: int = MISSION
    count: int = 0
    seq: int = 0
    """The next item: expected, or to be asked for."""
    items: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])
    as_int: bool = False
    """Ask in the form that was used last; PX4 begins with floats."""
    heard_s: float = 0.0
    asked_s: float = 0.0

    def end(self) -> None:
        self.state = _State.IDLE
        self.items = []


class MissionService:
    """MISSION_* for missions, fences and rally points."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._plans: dict[int, list[dict[str, Any]]] = {kind: [] for kind in CAPACITY}
        self._ids: dict[int, int] = dict.fromkeys(CAPACITY, 0)
        self._flight = context.autopilot.navigator.mission
        self._told_reached = 0
        self._reached_again_s = self._reached_until_s = 0.0
        self._exchanges: dict[str, _Exchange] = {}
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

    def _exchange(self, link: Link) -> _Exchange:
        exchange = self._exchanges.get(link.name)
        if exchange is None or exchange.link is not link:
            exchange = self._exchanges[link.name] = _Exchange(link)
        return exchange

    def _say(self, text: str, event: str) -> None:
        self._context.autopilot.announcer.both(LOUD, text, event)

    def send_current(self, link: Link) -> None:
        """MISSION_CURRENT, 1 Hz."""
        count = len(self._plans[MISSION])
        link.send(
            "MISSION_CURRENT", seq=self._flight.current if count else 0, total=count or 65535,
            mission_id=self._ids[MISSION], fence_id=self._ids[items.FENCE],
            rally_points_id=self._ids[items.RALLY],
        )  # fmt: skip

    def _send_reached(self) -> None:
        """MISSION_ITEM_REACHED, at once and then every second for a while."""
        flight, now_s = self._flight, self._context.view.time_s
        if self._told_reached != flight.reached_count:
            self._told_reached = flight.reached_count
            if flight.reached is None:
                return
            self._reached_until_s = now_s + REACHED_FOR_S
        self._reached_again_s = now_s + REACHED_EVERY_S
        self._context.broadcast("MISSION_ITEM_REACHED", seq=flight.reached)

    # --- download --------------------------------------------------------------------------------------

    def request_list(self, link: Link, message: Message) -> None:
        """How many items there are, and the plan's id."""
        if not self._context.is_for_me(message):
            return
        exchange, kind = self._exchange(link), message.mission_type
        if exchange.state is _State.RECEIVING or (exchange.state is _State.SENDING and exchange.seq):
            self._say("Mission download request ignored, already active", "mavlink_mission_req_ignored")
            return
        plan = self._plans.get(kind, [])
        exchange.heard_s = self._context.view.time_s
        if plan:
            exchange.state, exchange.partner = _State.SENDING, message.sender
            exchange.kind, exchange.count, exchange.seq = kind, len(plan), 0
        link.send(
            "MISSION_COUNT", target_system=message.system_id, target_component=message.component_id,
            count=len(plan), mission_type=kind, opaque_id=self._ids.get(kind, 0),
        )  # fmt: skip

    def request_item(self, link: Link, message: Message) -> None:
        """One stored item, in the form it was asked for."""
        if not self._context.is_for_me(message):
            return
        exchange = self._exchange(link)
        exchange.as_int = message.name == "MISSION_REQUEST_INT"
        if message.sender != exchange.partner:
            if exchange.state is not _State.IDLE:
                self._say("WPM: REJ. CMD: Partner id mismatch", "mavlink_mission_partner_id_mismatch2")
            return
        if exchange.state is _State.RECEIVING:
            self._say(BUSY, "mavlink_mission_mis_req_ignored_busy")
        if exchange.state is not _State.SENDING or message.mission_type != exchange.kind:
            return
        exchange.heard_s = self._context.view.time_s
        plan, seq = self._plans[exchange.kind], message.seq
        if seq not in (exchange.seq, exchange.seq - 1) or seq >= min(exchange.count, len(plan)):
            exchange.end()
            self._ack(link, message.sender, ERROR, exchange.kind)
            self._say(UNEXPECTED, "mavlink_mission_wp_unexpected")
            return
        exchange.seq = seq + 1
        fields = dict(plan[seq])
        frames = _INT_FRAMES if exchange.as_int else _FLOAT_FRAMES
        fields["frame"] = frames.get(fields["frame"], fields["frame"])
        if not exchange.as_int:
            fields["x"], fields["y"] = fields["x"] / 1e7, fields["y"] / 1e7
        link.send(
            "MISSION_ITEM_INT" if exchange.as_int else "MISSION_ITEM", target_system=message.system_id,
            target_component=message.component_id, seq=seq, mission_type=exchange.kind, **fields,
        )  # fmt: skip

    # --- upload ----------------------------------------------------------------------------------------

    def count(self, link: Link, message: Message) -> None:
        """Somebody wants to upload."""
        if not self._context.is_for_me(message):
            return
        exchange, kind = self._exchange(link), message.mission_type
        exchange.heard_s = self._context.view.time_s
        if exchange.state is _State.SENDING or (exchange.state is _State.RECEIVING and exchange.seq):
            self._ack(link, message.sender, ERROR, kind)
            if message.sender == exchange.partner:
                self._say(BUSY, "mavlink_mission_ignore_mis_count")
            return
        others = [each for each in self._exchanges.values() if each is not exchange]
        if any(other.state is _State.RECEIVING for other in others):
            self._ack(link, message.sender, ERROR, kind)
            return
        if message.count > CAPACITY.get(kind, 0):
            self._ack(link, message.sender, NO_SPACE, kind)
            return
        if message.count == 0:
            if kind in CAPACITY:
                self._store(kind, [])
            self._ack(link, message.sender, ACCEPTED, kind)
            return
        exchange.state, exchange.partner, exchange.kind = _State.RECEIVING, message.sender, kind
        exchange.count, exchange.seq, exchange.items = message.count, 0, []
        self._ask(exchange)

    def item(self, link: Link, message: Message) -> None:
        """The next item of an upload; others are ignored and asked for again."""
        if not self._context.is_for_me(message):
            return
        exchange = self._exchange(link)
        exchange.as_int = message.name == "MISSION_ITEM_INT"
        if exchange.state is not _State.RECEIVING:
            self._ack(link, message.sender, ERROR, message.mission_type)
            if exchange.state is _State.SENDING:
                self._say("IGN MISSION_ITEM: Busy", "mavlink_mission_mis_item_busy")
            else:
                self._say("IGN MISSION_ITEM: No transfer", "mavlink_mission_no_transfer")
            return
        if message.mission_type != exchange.kind:
            return
        exchange.heard_s = self._context.view.time_s
        if message.seq != exchange.seq:
            return
        fields = {name: getattr(message, name) for name in ITEM_FIELDS}
        result = items.result_of(exchange.kind, fields, as_int=exchange.as_int)
        if result != ACCEPTED:
            exchange.end()
            self._ack(link, message.sender, result, exchange.kind)
            if result != ERROR:
                self._say("IGN MISSION_ITEM: Invalid item", "mavlink_mission_mis_item_invalid")
            return
        exchange.items.append(fields)
        exchange.seq += 1
        if exchange.seq < exchange.count:
            self._ask(exchange)
            return
        self._store(exchange.kind, exchange.items)
        exchange.end()
        self._ack(link, message.sender, ACCEPTED, exchange.kind)

    def clear(self, link: Link, message: Message) -> None:
        """Forget plans; a type that does not exist is cleared at once."""
        if not self._context.is_for_me(message):
            return
        exchange, kind = self._exchange(link), message.mission_type
        if exchange.state is not _State.IDLE:
            self._say("WPM: IGN WP CLEAR CMD: Busy", "mavlink_mission_ignore_clear")
            return
        exchange.heard_s = self._context.view.time_s
        for each in CAPACITY if kind == ALL else (kind,):
            if each in CAPACITY:
                self._store(each, [])
        self._ack(link, message.sender, ACCEPTED, kind)

    def set_current(self, link: Link, message: Message) -> None:
        """Which item counts as current."""
        if not self._context.is_for_me(message):
            return
        exchange = self._exchange(link)
        if exchange.state is not _State.IDLE:
            self._say("WPM: IGN WP CURR CMD: Busy", "mavlink_mission_state_busy")
        elif message.seq < len(self._plans[MISSION]):
            self._flight.set_current(message.seq)
        else:
            self._say("WPM: WP CURR CMD: Not in list", "mavlink_mission_seq_out_of_bounds")

    def acknowledged(self, link: Link, message: Message) -> None:
        """The other side ends a download, cancels an upload, or does not know the form it is asked in."""
        exchange = self._exchange(link)
        if not self._context.is_for_me(message) or message.sender != exchange.partner:
            return
        if exchange.state is _State.RECEIVING and message.type == items.UNSUPPORTED:
            exchange.as_int = not exchange.as_int
            self._ask(exchange)
            return
        if exchange.state is _State.SENDING or message.type == items.CANCELLED:
            exchange.end()

    # --- time ------------------------------------------------------------------------------------------

    @property
    def waits(self) -> bool:
        """Whether the flight has anything to tell."""
        flight = self._flight
        if self._told_reached != flight.reached_count:
            return True
        again_s, until_s = self._reached_again_s, self._reached_until_s
        return flight.reached is not None and again_s <= self._context.view.time_s <= until_s

    @property
    def busy(self) -> bool:
        """Whether anything is to be asked for or told."""
        return self.waits or any(exchange.state is not _State.IDLE for exchange in self._exchanges.values())

    def step(self) -> None:
        """Ask again, or give up."""
        for exchange in self._exchanges.values():
            if exchange.state is not _State.IDLE:
                self._tend(exchange)
        if self.waits:
            self._send_reached()

    def _tend(self, exchange: _Exchange) -> None:
        now_s = self._context.view.time_s
        if exchange.link not in self._context.links:
            exchange.end()
        elif now_s - exchange.heard_s > TIMEOUT_S:
            exchange.end()
            self._say("Operation timeout", "mavlink_mission_op_timeout")
        elif exchange.state is _State.RECEIVING and now_s - exchange.asked_s >= RETRY_S:
            self._ask(exchange)

    def _ask(self, exchange: _Exchange) -> None:
        exchange.asked_s = self._context.view.time_s
        exchange.link.send(
            "MISSION_REQUEST_INT" if exchange.as_int else "MISSION_REQUEST",
            target_system=exchange.partner[0], target_component=exchange.partner[1], seq=exchange.seq,
            mission_type=exchange.kind,
        )  # fmt: skip

    def _store(self, kind: int, plan: list[dict[str, Any]]) -> None:
        self._ids[kind] = items.opaque_id(plan)
        for item in plan:
            if isinstance(item["x"], float):
                item["x"], item["y"] = _scaled(item["x"]), _scaled(item["y"])
        self._plans[kind] = plan
        self._context.autopilot.plans.store(kind, plan)

    def _ack(self, link: Link, to: tuple[int, int], result: int, kind: int) -> None:
        link.send(
            "MISSION_ACK", target_system=to[0], target_component=to[1], type=result, mission_type=kind,
            opaque_id=self._ids.get(kind, 0) if result == ACCEPTED else 0,
        )  # fmt: skip


def _scaled(degrees: float) -> int:
    """Degrees in single precision as 1e7 degrees; what is no place is 0."""
    value = struct.unpack("<f", struct.pack("<f", degrees))[0] * 1e7
    return round(value) if abs(value) < 2**31 else 0
