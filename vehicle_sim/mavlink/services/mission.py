"""The mission protocol: upload, download and clearing of missions, fences and rally points.

As in PX4, each link has its own transfer, and all links share the stored plans.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Any

from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import Message
from vehicle_sim.mavlink.link import Link
from vehicle_sim.mavlink.services import stored_items
from vehicle_sim.mavlink.services.stored_items import (
    ACCEPTED,
    ALL,
    CANCELLED,
    CAPACITY,
    ERROR,
    FENCE,
    MISSION,
    NO_SPACE,
    RALLY,
    UNSUPPORTED,
    StoredItem,
)

RETRY_S = 0.26
"""Recorded interval of repeated requests; PX4 configures 0.25 s."""
TIMEOUT_S = 5.0
REACHED_EVERY_S, REACHED_FOR_S = 1.0, 10.0
CRITICAL_SEVERITY, INFO_SEVERITY = 2, 6
"""MAV_SEVERITY."""
PLANNER_COMPONENT = 190
"""MAV_COMP_ID_MISSIONPLANNER, at which PX4's mission protocol also answers."""
UNEXPECTED = "WPM: REJ. CMD: Req. WP was unexpected"
BUSY = "WPM: REJ. CMD: Busy"
_NO_MISSION, _NOT_STARTED, _ACTIVE, _PAUSED, _COMPLETE = range(1, 6)
"""MISSION_STATE."""
_MISSION_MODES = (NavState.MISSION, NavState.TAKEOFF, NavState.LAND)
"""Modes in which PX4 calls the mission active."""
_INT_ITEM, _FLOAT_ITEM = struct.Struct("<BHB4fiif"), struct.Struct("<BHB7f")
_ALL_BITS = 0xFFFFFFFF


def add_to_id(plan_id: int, item: Mapping[str, Any]) -> int:
    """PX4's id of a stored plan with one more item (fields of MISSION_ITEM or MISSION_ITEM_INT).

    A CRC32 over the items as received, with start value and final XOR zero: an empty plan has the id 0. It
    covers positions in 1e-7 degrees, or in degrees if they were sent as floats.
    """
    layout = _INT_ITEM if isinstance(item["x"], int) else _FLOAT_ITEM
    packed = layout.pack(
        item["frame"], item["command"], item["autocontinue"], item["param1"], item["param2"],
        item["param3"], item["param4"], item["x"], item["y"], item["z"],
    )  # fmt: skip
    return zlib.crc32(packed, plan_id ^ _ALL_BITS) ^ _ALL_BITS


class _State(Enum):
    IDLE = auto()
    RECEIVING = auto()
    SENDING = auto()


@dataclass(slots=True)
class _Transfer:
    """The current or last transfer of one link."""

    link: Link
    as_int: bool
    """Whether items are sent and requested as MISSION_ITEM_INT, as in the partner's last message."""
    state: _State = _State.IDLE
    partner: tuple[int, int] = (0, 0)
    mission_type: int = MISSION
    count: int = 0
    seq: int = 0
    """Index of the next item to receive or to send."""
    items: list[StoredItem] = field(default_factory=list[StoredItem])
    current_seq: int | None = None
    """Index of the last received item that is marked as current."""
    plan_id: int = 0
    """Id of the received items."""
    received_at_s: float = 0.0
    requested_at_s: float = 0.0

    def begin(self, state: _State, message: Message, count: int) -> None:
        self.state, self.partner = state, message.sender
        self.mission_type, self.count = message.mission_type, count
        self.seq, self.current_seq, self.plan_id = 0, None, 0
        self.items = []

    def end(self) -> None:
        self.state = _State.IDLE
        self.items = []


class MissionService:
    """Handles MISSION_* for missions, fences and rally points."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._plans: dict[int, list[StoredItem]] = {mission_type: [] for mission_type in CAPACITY}
        self._plan_ids: dict[int, int] = dict.fromkeys(CAPACITY, 0)
        self._mission = context.autopilot.navigator.mission
        self._reported_reached_count = 0
        self._next_reached_at_s = self._reached_until_s = 0.0
        self._transfers: dict[str, _Transfer] = {}
        self.handlers = {
            "MISSION_REQUEST_LIST": self.request_list,
            "MISSION_REQUEST_INT": self.request_item,
            "MISSION_REQUEST": self.request_item,
            "MISSION_COUNT": self.start_upload,
            "MISSION_ITEM_INT": self.receive_item,
            "MISSION_ITEM": self.receive_item,
            "MISSION_CLEAR_ALL": self.clear,
            "MISSION_SET_CURRENT": self.set_current,
            "MISSION_ACK": self.receive_ack,
        }

    def _transfer(self, link: Link) -> _Transfer:
        transfer = self._transfers.get(link.name)
        if transfer is None or transfer.link is not link:
            transfer = self._transfers[link.name] = _Transfer(link, self._context.view.px4.requests_int_first)
        return transfer

    def _addressed(self, message: Message) -> bool:
        if self._context.addresses_autopilot(message):
            return True
        target = message.target_system, message.target_component
        return target == (self._context.system_id, PLANNER_COMPONENT)

    def _report(self, text: str, event: str, severity: int = CRITICAL_SEVERITY) -> None:
        self._context.autopilot.announcer.announce(severity, text, event)

    def send_current(self, link: Link) -> None:
        """Sends MISSION_CURRENT; called at 1 Hz by default."""
        count = len(self._plans[MISSION])
        link.send(
            "MISSION_CURRENT", seq=self._mission.current if count else 0, total=count or 65535,
            mission_id=self._plan_ids[MISSION], fence_id=self._plan_ids[FENCE],
            rally_points_id=self._plan_ids[RALLY], **self._progress(count),
        )  # fmt: skip

    def _progress(self, count: int) -> dict[str, int]:
        """`mission_state` and `mission_mode` of MISSION_CURRENT; PX4 v1.16 leaves them at zero."""
        if not self._context.view.px4.reports_mission_state:
            return {}
        mission = self._mission
        state = _NOT_STARTED
        if not count:
            state = _NO_MISSION
        elif mission.finished:
            state = _COMPLETE
        elif mission.active:
            state = _ACTIVE
        elif mission.current:
            state = _PAUSED
        in_mission_mode = self._context.autopilot.commander.active in _MISSION_MODES
        return {"mission_state": state, "mission_mode": 1 if in_mission_mode else 2}

    def _send_reached(self) -> None:
        """Sends MISSION_ITEM_REACHED when an item is reached, then once per second for REACHED_FOR_S."""
        mission, now_s = self._mission, self._context.view.time_s
        if self._reported_reached_count != mission.reached_count:
            self._reported_reached_count = mission.reached_count
            if mission.reached is None:
                return
            self._reached_until_s = now_s + REACHED_FOR_S
        self._next_reached_at_s = now_s + REACHED_EVERY_S
        self._context.broadcast("MISSION_ITEM_REACHED", seq=mission.reached)

    # --- download --------------------------------------------------------------------------------------

    def request_list(self, link: Link, message: Message) -> None:
        """Sends the number of items and the plan's id."""
        if not self._addressed(message):
            return
        transfer, mission_type = self._transfer(link), message.mission_type
        if transfer.seq == len(self._plans.get(transfer.mission_type, ())):
            transfer.end()  # all items were sent, only the acknowledgement is missing
        same = message.sender == transfer.partner and mission_type == transfer.mission_type
        if transfer.state is not _State.IDLE and not (transfer.state is _State.SENDING and same):
            text = "Mission download request ignored, already active"
            self._report(text, "mavlink_mission_req_ignored", INFO_SEVERITY)
            return
        transfer.received_at_s = self._context.view.time_s
        count = len(self._plans.get(mission_type, ()))
        transfer.begin(_State.SENDING, message, count)
        link.send(
            "MISSION_COUNT", target_system=message.system_id, target_component=message.component_id,
            count=count, mission_type=mission_type, opaque_id=self._plan_ids.get(mission_type, 0),
        )  # fmt: skip

    def request_item(self, link: Link, message: Message) -> None:
        """Sends one stored item in the requested message, MISSION_ITEM or MISSION_ITEM_INT."""
        if not self._addressed(message):
            return
        transfer = self._transfer(link)
        transfer.as_int = message.name == "MISSION_REQUEST_INT"
        if message.sender != transfer.partner:
            self._report("WPM: REJ. CMD: partner id mismatch", "mavlink_mission_partner_id_mismatch2")
            return
        if transfer.state is _State.RECEIVING:
            self._report(BUSY, "mavlink_mission_mis_req_ignored_busy")
        if transfer.state is not _State.SENDING or message.mission_type != transfer.mission_type:
            return
        transfer.received_at_s = self._context.view.time_s
        plan, seq = self._plans.get(transfer.mission_type, []), message.seq
        if seq not in (transfer.seq, transfer.seq - 1) or seq >= min(transfer.count, len(plan)):
            transfer.end()
            self._ack(link, message.sender, ERROR, transfer.mission_type)
            self._report(UNEXPECTED, "mavlink_mission_wp_unexpected")
            return
        transfer.seq = seq + 1
        link.send(
            "MISSION_ITEM_INT" if transfer.as_int else "MISSION_ITEM", target_system=message.system_id,
            target_component=message.component_id, seq=seq, mission_type=transfer.mission_type,
            current=int(seq == self._mission.current),  # also in fences and rally points
            **plan[seq].message_fields(as_int=transfer.as_int),
        )  # fmt: skip

    # --- upload ----------------------------------------------------------------------------------------

    def start_upload(self, link: Link, message: Message) -> None:
        """Starts an upload; answers a repeated MISSION_COUNT with the first request."""
        if not self._addressed(message):
            return
        transfer, mission_type = self._transfer(link), message.mission_type
        if transfer.state is _State.SENDING:
            self._report("WPM: IGN MISSION_COUNT: Busy", "mavlink_mission_ignore_mis_count")
            self._ack(link, message.sender, ERROR, transfer.mission_type)
            return
        transfer.received_at_s = self._context.view.time_s
        if transfer.state is _State.RECEIVING:
            if message.sender == transfer.partner and transfer.seq == 0:
                self._request_next(transfer)
                return
            if message.sender == transfer.partner:
                self._report(BUSY, "mavlink_mission_getlist_busy")
            self._ack(link, message.sender, ERROR, transfer.mission_type)
            return
        other_transfers = [each for each in self._transfers.values() if each is not transfer]
        if any(other.state is _State.RECEIVING for other in other_transfers):
            self._ack(link, message.sender, ERROR, transfer.mission_type)
            return
        transfer.partner, transfer.mission_type = message.sender, mission_type
        if message.count > CAPACITY.get(mission_type, 0):
            self._ack(link, message.sender, NO_SPACE, mission_type)
            return
        if message.count == 0:
            self._clear(mission_type)
            self._ack(link, message.sender, ACCEPTED, mission_type)
            return
        transfer.begin(_State.RECEIVING, message, message.count)
        self._request_next(transfer)

    def receive_item(self, link: Link, message: Message) -> None:
        """Stores the next item of an upload; ignores any other item, and requests the expected item
        again."""
        if not self._addressed(message):
            return
        transfer = self._transfer(link)
        transfer.as_int = message.name == "MISSION_ITEM_INT"
        if message.sender != transfer.partner:
            self._report("REJ. MIS ITEM: partner id mismatch", "mavlink_mission_item_partner_id_mismatch")
            return
        if message.mission_type != transfer.mission_type:
            self._ack(link, message.sender, ERROR, transfer.mission_type)
            return
        if transfer.state is not _State.RECEIVING:
            self._ack(link, message.sender, ERROR, message.mission_type)
            if transfer.state is _State.SENDING:
                self._report("IGN MISSION_ITEM: Busy", "mavlink_mission_mis_item_busy")
            else:
                self._report("IGN MISSION_ITEM: No transfer", "mavlink_mission_no_transfer")
            return
        transfer.received_at_s = self._context.view.time_s
        if message.seq != transfer.seq:
            return
        result, item = stored_items.store(
            transfer.mission_type, message.values, as_int=transfer.as_int, px4=self._context.view.px4
        )
        if item is None:
            transfer.end()
            self._ack(link, message.sender, result, transfer.mission_type)
            if result != ERROR:
                self._report("IGN MISSION_ITEM: Invalid item", "mavlink_mission_mis_item_invalid")
            return
        transfer.items.append(item)
        transfer.plan_id = add_to_id(transfer.plan_id, message.values)
        if message.current:
            transfer.current_seq = transfer.seq
        transfer.seq += 1
        if transfer.seq < transfer.count:
            self._request_next(transfer)
            return
        if transfer.plan_id != self._plan_ids[transfer.mission_type]:  # the same plan again changes nothing
            self._store(transfer.mission_type, transfer.items, transfer.plan_id, transfer.current_seq)
        transfer.end()
        self._ack(link, message.sender, ACCEPTED, transfer.mission_type)

    def clear(self, link: Link, message: Message) -> None:
        """Clears plans; clearing an unknown type also succeeds."""
        if not self._addressed(message):
            return
        transfer, mission_type = self._transfer(link), message.mission_type
        if transfer.state is not _State.IDLE:
            self._report("WPM: IGN CLEAR CMD: Busy", "mavlink_mission_ignore_clear")
            return
        transfer.received_at_s = self._context.view.time_s
        transfer.mission_type = mission_type
        for cleared_type in CAPACITY if mission_type == ALL else (mission_type,):
            self._clear(cleared_type)
        self._ack(link, message.sender, ACCEPTED, mission_type)

    def set_current(self, link: Link, message: Message) -> None:
        """Sets the current item."""
        if not self._addressed(message):
            return
        transfer = self._transfer(link)
        if transfer.state is not _State.IDLE:
            self._report("WPM: IGN WP CURR CMD: Busy", "mavlink_mission_state_busy")
        elif message.seq < len(self._plans[MISSION]):
            self._mission.set_current(message.seq)
        else:
            self._report("WPM: WP CURR CMD: Not in list", "mavlink_mission_seq_out_of_bounds")

    def receive_ack(self, link: Link, message: Message) -> None:
        """Handles MISSION_ACK: ends a download, or cancels an upload.

        If the partner of an upload does not support the requested message, requests MISSION_ITEM instead of
        MISSION_ITEM_INT, or the reverse.
        """
        transfer = self._transfer(link)
        if not self._addressed(message):
            return
        if message.sender != transfer.partner:
            self._report("REJ. WP CMD: partner id mismatch", "mavlink_mission_partner_id_mismatch")
            return
        if transfer.state is _State.RECEIVING and message.type == UNSUPPORTED:
            transfer.as_int = not transfer.as_int
            self._request_next(transfer)
            return
        if transfer.state is _State.SENDING or message.type == CANCELLED:
            transfer.end()

    # --- each step -------------------------------------------------------------------------------------

    @property
    def has_pending(self) -> bool:
        """Whether a reached item must be reported."""
        mission = self._mission
        if self._reported_reached_count != mission.reached_count:
            return True
        next_s, until_s = self._next_reached_at_s, self._reached_until_s
        return mission.reached is not None and next_s <= self._context.view.time_s <= until_s

    @property
    def busy(self) -> bool:
        """Whether a transfer is active, or a reached item must be reported."""
        return self.has_pending or any(
            transfer.state is not _State.IDLE for transfer in self._transfers.values()
        )

    def step(self) -> None:
        """Repeats requests, and ends transfers after a timeout."""
        for transfer in self._transfers.values():
            if transfer.state is not _State.IDLE:
                self._step_transfer(transfer)
        if self.has_pending:
            self._send_reached()

    def _step_transfer(self, transfer: _Transfer) -> None:
        now_s = self._context.view.time_s
        if transfer.link not in self._context.links:
            transfer.end()
        elif now_s - transfer.received_at_s > TIMEOUT_S:
            transfer.end()
            self._report("Operation timeout", "mavlink_mission_op_timeout")
        elif transfer.state is _State.RECEIVING and now_s - transfer.requested_at_s >= RETRY_S:
            self._request_next(transfer)

    def _request_next(self, transfer: _Transfer) -> None:
        transfer.requested_at_s = self._context.view.time_s
        transfer.link.send(
            "MISSION_REQUEST_INT" if transfer.as_int else "MISSION_REQUEST",
            target_system=transfer.partner[0], target_component=transfer.partner[1], seq=transfer.seq,
            mission_type=transfer.mission_type,
        )  # fmt: skip

    def _clear(self, mission_type: int) -> None:
        if mission_type in CAPACITY:
            self._store(mission_type, [], 0, 0)

    def _store(
        self, mission_type: int, plan: list[StoredItem], plan_id: int, current_seq: int | None
    ) -> None:
        self._plan_ids[mission_type], self._plans[mission_type] = plan_id, plan
        self._context.autopilot.plans.store(mission_type, [each.item for each in plan], current_seq)

    def _ack(self, link: Link, recipient: tuple[int, int], result: int, mission_type: int) -> None:
        link.send(
            "MISSION_ACK", target_system=recipient[0], target_component=recipient[1], type=result,
            mission_type=mission_type,
            opaque_id=self._plan_ids.get(mission_type, 0) if result == ACCEPTED else 0,
        )  # fmt: skip
