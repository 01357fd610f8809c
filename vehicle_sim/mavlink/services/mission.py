"""The mission protocol: upload, download and clearing of missions, fences and rally points.

As in PX4, each link has its own transfer, and all links share the stored plans.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Any

from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import Message
from vehicle_sim.mavlink.link import Link
from vehicle_sim.mavlink.services import mission_items
from vehicle_sim.mavlink.services.mission_items import ACCEPTED, ALL, CAPACITY, ERROR, MISSION, NO_SPACE

RETRY_S = 0.26
"""Recorded interval of repeated requests; PX4 configures 0.25 s."""
TIMEOUT_S = 5.0
REACHED_EVERY_S, REACHED_FOR_S = 1.0, 10.0
CRITICAL_SEVERITY = 2
"""MAV_SEVERITY_CRITICAL."""
ITEM_FIELDS = ("frame", "command", "current", "autocontinue", "param1", "param2", "param3", "param4", "x",
               "y", "z")  # fmt: skip
_INT_FRAMES, _FLOAT_FRAMES = {0: 5, 3: 6}, {5: 0, 6: 3}
"""Frame of an item in MISSION_ITEM_INT and in MISSION_ITEM, where the frame differs from the stored frame."""
UNEXPECTED = "WPM: REJ. CMD: Req. WP was unexpected"
BUSY = "WPM: REJ. CMD: Busy"


class _State(Enum):
    IDLE = auto()
    RECEIVING = auto()
    SENDING = auto()


@dataclass(slots=True)
class _Transfer:
    """The current transfer of one link."""

    link: Link
    state: _State = _State.IDLE
    partner: tuple[int, int] = (0, 0)
    mission_type: int = MISSION
    count: int = 0
    seq: int = 0
    """Index of the next item to receive or to send."""
    items: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])
    as_int: bool = False
    """Whether items are sent as MISSION_ITEM_INT, as in the partner's last message; initially False."""
    received_at_s: float = 0.0
    requested_at_s: float = 0.0

    def end(self) -> None:
        self.state = _State.IDLE
        self.items = []


class MissionService:
    """Handles MISSION_* for missions, fences and rally points."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._plans: dict[int, list[dict[str, Any]]] = {mission_type: [] for mission_type in CAPACITY}
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
            transfer = self._transfers[link.name] = _Transfer(link)
        return transfer

    def _report(self, text: str, event: str) -> None:
        self._context.autopilot.announcer.announce(CRITICAL_SEVERITY, text, event)

    def send_current(self, link: Link) -> None:
        """Sends MISSION_CURRENT; called at 1 Hz by default."""
        count = len(self._plans[MISSION])
        link.send(
            "MISSION_CURRENT", seq=self._mission.current if count else 0, total=count or 65535,
            mission_id=self._plan_ids[MISSION], fence_id=self._plan_ids[mission_items.FENCE],
            rally_points_id=self._plan_ids[mission_items.RALLY],
        )  # fmt: skip

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
        if not self._context.addresses_autopilot(message):
            return
        transfer, mission_type = self._transfer(link), message.mission_type
        if transfer.state is _State.RECEIVING or (transfer.state is _State.SENDING and transfer.seq):
            self._report("Mission download request ignored, already active", "mavlink_mission_req_ignored")
            return
        plan = self._plans.get(mission_type, [])
        transfer.received_at_s = self._context.view.time_s
        if plan:
            transfer.state, transfer.partner = _State.SENDING, message.sender
            transfer.mission_type, transfer.count, transfer.seq = mission_type, len(plan), 0
        link.send(
            "MISSION_COUNT", target_system=message.system_id, target_component=message.component_id,
            count=len(plan), mission_type=mission_type, opaque_id=self._plan_ids.get(mission_type, 0),
        )  # fmt: skip

    def request_item(self, link: Link, message: Message) -> None:
        """Sends one stored item in the requested message, MISSION_ITEM or MISSION_ITEM_INT."""
        if not self._context.addresses_autopilot(message):
            return
        transfer = self._transfer(link)
        transfer.as_int = message.name == "MISSION_REQUEST_INT"
        if message.sender != transfer.partner:
            if transfer.state is not _State.IDLE:
                self._report("WPM: REJ. CMD: Partner id mismatch", "mavlink_mission_partner_id_mismatch2")
            return
        if transfer.state is _State.RECEIVING:
            self._report(BUSY, "mavlink_mission_mis_req_ignored_busy")
        if transfer.state is not _State.SENDING or message.mission_type != transfer.mission_type:
            return
        transfer.received_at_s = self._context.view.time_s
        plan, seq = self._plans[transfer.mission_type], message.seq
        if seq not in (transfer.seq, transfer.seq - 1) or seq >= min(transfer.count, len(plan)):
            transfer.end()
            self._ack(link, message.sender, ERROR, transfer.mission_type)
            self._report(UNEXPECTED, "mavlink_mission_wp_unexpected")
            return
        transfer.seq = seq + 1
        fields = dict(plan[seq])
        frames = _INT_FRAMES if transfer.as_int else _FLOAT_FRAMES
        fields["frame"] = frames.get(fields["frame"], fields["frame"])
        if not transfer.as_int:
            fields["x"], fields["y"] = fields["x"] / 1e7, fields["y"] / 1e7
        link.send(
            "MISSION_ITEM_INT" if transfer.as_int else "MISSION_ITEM", target_system=message.system_id,
            target_component=message.component_id, seq=seq, mission_type=transfer.mission_type, **fields,
        )  # fmt: skip

    # --- upload ----------------------------------------------------------------------------------------

    def start_upload(self, link: Link, message: Message) -> None:
        """Starts an upload."""
        if not self._context.addresses_autopilot(message):
            return
        transfer, mission_type = self._transfer(link), message.mission_type
        transfer.received_at_s = self._context.view.time_s
        if transfer.state is _State.SENDING or (transfer.state is _State.RECEIVING and transfer.seq):
            self._ack(link, message.sender, ERROR, mission_type)
            if message.sender == transfer.partner:
                self._report(BUSY, "mavlink_mission_ignore_mis_count")
            return
        other_transfers = [each for each in self._transfers.values() if each is not transfer]
        if any(other.state is _State.RECEIVING for other in other_transfers):
            self._ack(link, message.sender, ERROR, mission_type)
            return
        if message.count > CAPACITY.get(mission_type, 0):
            self._ack(link, message.sender, NO_SPACE, mission_type)
            return
        if message.count == 0:
            if mission_type in CAPACITY:
                self._store(mission_type, [])
            self._ack(link, message.sender, ACCEPTED, mission_type)
            return
        transfer.state, transfer.partner = _State.RECEIVING, message.sender
        transfer.mission_type, transfer.count = mission_type, message.count
        transfer.seq, transfer.items = 0, []
        self._request_next(transfer)

    def receive_item(self, link: Link, message: Message) -> None:
        """Stores the next item of an upload; ignores any other item, and requests the expected item
        again."""
        if not self._context.addresses_autopilot(message):
            return
        transfer = self._transfer(link)
        transfer.as_int = message.name == "MISSION_ITEM_INT"
        if transfer.state is not _State.RECEIVING:
            self._ack(link, message.sender, ERROR, message.mission_type)
            if transfer.state is _State.SENDING:
                self._report("IGN MISSION_ITEM: Busy", "mavlink_mission_mis_item_busy")
            else:
                self._report("IGN MISSION_ITEM: No transfer", "mavlink_mission_no_transfer")
            return
        if message.mission_type != transfer.mission_type:
            return
        transfer.received_at_s = self._context.view.time_s
        if message.seq != transfer.seq:
            return
        fields = {name: getattr(message, name) for name in ITEM_FIELDS}
        result = mission_items.check_item(transfer.mission_type, fields, as_int=transfer.as_int)
        if result != ACCEPTED:
            transfer.end()
            self._ack(link, message.sender, result, transfer.mission_type)
            if result != ERROR:
                self._report("IGN MISSION_ITEM: Invalid item", "mavlink_mission_mis_item_invalid")
            return
        transfer.items.append(fields)
        transfer.seq += 1
        if transfer.seq < transfer.count:
            self._request_next(transfer)
            return
        self._store(transfer.mission_type, transfer.items)
        transfer.end()
        self._ack(link, message.sender, ACCEPTED, transfer.mission_type)

    def clear(self, link: Link, message: Message) -> None:
        """Clears plans; clearing an unknown type also succeeds."""
        if not self._context.addresses_autopilot(message):
            return
        transfer, mission_type = self._transfer(link), message.mission_type
        if transfer.state is not _State.IDLE:
            self._report("WPM: IGN WP CLEAR CMD: Busy", "mavlink_mission_ignore_clear")
            return
        transfer.received_at_s = self._context.view.time_s
        for cleared_type in CAPACITY if mission_type == ALL else (mission_type,):
            if cleared_type in CAPACITY:
                self._store(cleared_type, [])
        self._ack(link, message.sender, ACCEPTED, mission_type)

    def set_current(self, link: Link, message: Message) -> None:
        """Sets the current item."""
        if not self._context.addresses_autopilot(message):
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
        if not self._context.addresses_autopilot(message) or message.sender != transfer.partner:
            return
        if transfer.state is _State.RECEIVING and message.type == mission_items.UNSUPPORTED:
            transfer.as_int = not transfer.as_int
            self._request_next(transfer)
            return
        if transfer.state is _State.SENDING or message.type == mission_items.CANCELLED:
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

    def _store(self, mission_type: int, plan: list[dict[str, Any]]) -> None:
        self._plan_ids[mission_type] = mission_items.opaque_id(plan)
        for item in plan:
            if isinstance(item["x"], float):
                item["x"], item["y"] = _to_1e7_degrees(item["x"]), _to_1e7_degrees(item["y"])
        self._plans[mission_type] = plan
        self._context.autopilot.plans.store(mission_type, plan)

    def _ack(self, link: Link, recipient: tuple[int, int], result: int, mission_type: int) -> None:
        link.send(
            "MISSION_ACK", target_system=recipient[0], target_component=recipient[1], type=result,
            mission_type=mission_type,
            opaque_id=self._plan_ids.get(mission_type, 0) if result == ACCEPTED else 0,
        )  # fmt: skip


def _to_1e7_degrees(degrees: float) -> int:
    """Converts degrees in single precision to 1e-7 degrees; 0 for an invalid position."""
    value = struct.unpack("<f", struct.pack("<f", degrees))[0] * 1e7
    return round(value) if abs(value) < 2**31 else 0
