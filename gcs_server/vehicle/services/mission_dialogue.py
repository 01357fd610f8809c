"""The mission protocol as pure state machines: messages and time are input, messages are output.

One dialogue transfers one part of a plan (mission, fence or rally points) in one direction. PX4 requests each
item of an upload, and repeats the request every 0.25 s. After 5 s without a message PX4 cancels the transfer,
with a STATUSTEXT but without an acknowledgement. PX4 replaces its previous items only when the last item has
arrived. https://mavlink.io/en/services/mission.html
"""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from gcs_server.errors import NoReply, Rejected
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.dialect import MAVLink_message
from gcs_server.mavlink.mailbox import Reply
from missions.formats.mavlink_items import WireItem
from missions.formats.px4_storage import Part

PARTS: tuple[Part, ...] = ("fence", "rally", "mission")
"""In the order of an upload, so that the vehicle never flies a new mission with an older fence."""
MISSION_TYPE_OF: dict[Part, int] = {
    "mission": d.MAV_MISSION_TYPE_MISSION,
    "fence": d.MAV_MISSION_TYPE_FENCE,
    "rally": d.MAV_MISSION_TYPE_RALLY,
}
NAME_OF: dict[Part, str] = {"mission": "mission", "fence": "geofence", "rally": "rally points"}
"""Names in texts for the operator."""

RESEND_S = 0.5
"""Period of the first message of a dialogue until the vehicle replies [s]."""
ITEM_RESEND_S = 0.3
"""Period of item requests in a download [s]; the protocol suggests 0.25 s."""
FIRST_ITEM_S = 1.5
"""If the first item is still missing after this time [s], the vehicle has taken a late message of an earlier
transfer for the end of this download."""
BUSY_RETRIES_S = (1.0, 1.0, 6.0)
"""Waiting times after "busy" [s]. The last time is longer than PX4's timeout, so that an abandoned transfer
of another station has ended."""
NO_REPLY_S = 8.0
"""Time without a message after which a dialogue has ended on both sides [s]; PX4's timeout is 5 s."""
LOST_ACK_S = 3.0
"""Time without a request after which the last acknowledgement was lost [s]; PX4 would have repeated a request
ten times."""
MAX_RESTARTS = 3
MAX_ITEMS = 10_000
"""Maximum number of items of a download."""

RESULT_TEXT = {
    d.MAV_MISSION_ERROR: "not accepted",
    d.MAV_MISSION_UNSUPPORTED_FRAME: "its altitude reference (frame) is not supported",
    d.MAV_MISSION_UNSUPPORTED: "this command is not supported in a mission",
    d.MAV_MISSION_NO_SPACE: "there is no room for that many items",
    d.MAV_MISSION_INVALID: "a value is invalid",
    d.MAV_MISSION_INVALID_SEQUENCE: "out of sequence",
    d.MAV_MISSION_DENIED: "denied",
    d.MAV_MISSION_OPERATION_CANCELLED: "the vehicle cancelled the transfer",
    **{
        getattr(d, f"MAV_MISSION_INVALID_PARAM{name}"): f"parameter {name[0]} is invalid"
        for name in ("1", "2", "3", "4", "5_X", "6_Y", "7")
    },
}
_float32 = struct.Struct("<f")


@dataclass(frozen=True, slots=True)
class Target:
    """The vehicle of a dialogue."""

    vehicle_id: str
    system_id: int
    component_id: int


class Dialogue(ABC):
    """Base of upload, download and clearing."""

    def __init__(self, target: Target, part: Part) -> None:
        self.target = target
        self.part: Part = part
        self.mission_type = MISSION_TYPE_OF[part]
        self.done = False
        self.wake_s = float("inf")
        """When `tick` is due [s, monotonic]."""
        self.opaque_id: int | None = None
        """The vehicle's id of its stored items; None: not sent."""
        self._received_s = float("-inf")
        self._start_s = float("-inf")

    @property
    @abstractmethod
    def count(self) -> int | None:
        """Number of items; None if not known yet."""

    @property
    @abstractmethod
    def transferred(self) -> int:
        """Number of items transferred so far."""

    def concerns(self, message: Reply) -> bool:
        """Whether a message to this station belongs to this dialogue."""
        return message.mission_type == self.mission_type

    def start(self, now_s: float) -> list[MAVLink_message]:
        """The first messages."""
        self._start_s = self._received_s = now_s
        return self.tick(now_s)

    @abstractmethod
    def tick(self, now_s: float) -> list[MAVLink_message]:
        """Messages to send again.

        Raises:
            NoReply: the vehicle has sent nothing for too long.
            Rejected: the vehicle is busy for too long.
        """

    @abstractmethod
    def take(self, message: Reply, now_s: float) -> list[MAVLink_message]:
        """Handles a message of the vehicle; returns the messages to send.

        Raises:
            Rejected: the vehicle refuses.
        """

    def cancel(self) -> list[MAVLink_message]:
        """The message that cancels the transfer on the vehicle; PX4 does not acknowledge it."""
        return [self._ack(d.MAV_MISSION_OPERATION_CANCELLED)]

    def _ack(self, result: int) -> MAVLink_message:
        return d.MAVLink_mission_ack_message(*self._address(), result, self.mission_type)

    def _address(self) -> tuple[int, int]:
        return self.target.system_id, self.target.component_id

    def _no_reply(self, phase: str) -> NoReply:
        return NoReply(
            f"Vehicle {self.target.vehicle_id} did not answer for {NO_REPLY_S:g} s {phase}.",
            deadline_s=NO_REPLY_S,
            remedy="Check the link, then try again.",
        )


class Upload(Dialogue):
    """Sends the items of one part when the vehicle requests them; the part has at least one item."""

    def __init__(self, target: Target, part: Part, items: Sequence[WireItem]) -> None:
        super().__init__(target, part)
        self._items = items
        self._highest_requested = -1
        """Highest item that the vehicle has requested."""
        self._busy_count = 0
        self.confirmed = False
        """Whether the vehicle acknowledged the upload; if not, only a download shows the result."""

    @property
    def count(self) -> int:
        return len(self._items)

    @property
    def transferred(self) -> int:
        return max(0, self._highest_requested)

    @property
    def _all_sent(self) -> bool:
        return self._highest_requested == len(self._items) - 1

    def concerns(self, message: Reply) -> bool:
        if super().concerns(message):
            return True
        # "Busy" has the type of the transfer that keeps PX4 busy, not the type of this upload.
        is_error = message.get_msgId() == d.MAVLINK_MSG_ID_MISSION_ACK and message.type == d.MAV_MISSION_ERROR
        return is_error and self._highest_requested < 0

    def tick(self, now_s: float) -> list[MAVLink_message]:
        no_message_s = now_s - self._received_s
        if self._all_sent:
            self.done = no_message_s >= LOST_ACK_S
            self.wake_s = self._received_s + LOST_ACK_S
            return []
        if no_message_s >= NO_REPLY_S:
            phase_text = (
                f"after item {self._highest_requested + 1} of {self.count}"
                if self._highest_requested >= 0
                else "to the upload"
            )
            raise self._no_reply(f"{phase_text} of the {NAME_OF[self.part]}")
        if self._highest_requested >= 0:
            self.wake_s = self._received_s + NO_REPLY_S
            return []
        self.wake_s = now_s + RESEND_S
        begin = d.MAVLink_mission_count_message(*self._address(), len(self._items), self.mission_type)
        # Cancels an earlier transfer whose last message was lost, because it may keep the vehicle busy.
        return [*self.cancel(), begin] if self._busy_count else [begin]

    def take(self, message: Reply, now_s: float) -> list[MAVLink_message]:
        if message.get_msgId() == d.MAVLINK_MSG_ID_MISSION_ACK:
            self._take_ack(message, now_s)
            return []
        seq: int = message.seq
        if seq >= len(self._items) or seq > self._highest_requested + 1:
            return []
        self._received_s, self._highest_requested = now_s, max(self._highest_requested, seq)
        self.wake_s = now_s + (LOST_ACK_S if self._all_sent else NO_REPLY_S)
        return [item_message(self._items[seq], self._address(), self.mission_type)]

    def _take_ack(self, message: Reply, now_s: float) -> None:
        result: int = message.type
        if result == d.MAV_MISSION_ACCEPTED:
            if self._all_sent:
                self.done = self.confirmed = True
                self.opaque_id = message.opaque_id or None
            return  # an earlier acknowledgement belongs to an older dialogue
        if result == d.MAV_MISSION_ERROR and self._highest_requested < 0:
            self._take_busy(now_s)
        elif result == d.MAV_MISSION_ERROR and self._all_sent:
            self.done = True  # the item arrived twice, or was refused; a download shows the result
        elif result != d.MAV_MISSION_INVALID_SEQUENCE:
            # after INVALID_SEQUENCE, the vehicle requests the right item
            raise self._refused(result)

    def _take_busy(self, now_s: float) -> None:
        if self._busy_count >= len(BUSY_RETRIES_S):
            raise Rejected(
                f"Vehicle {self.target.vehicle_id} is busy with another transfer and does not accept the "
                f"{NAME_OF[self.part]}.",
                remedy="Another ground station may be uploading: wait until it is done.",
            )
        self._received_s = now_s
        self.wake_s = now_s + BUSY_RETRIES_S[self._busy_count]
        self._busy_count += 1

    def _refused(self, result: int) -> Rejected:
        reason = RESULT_TEXT.get(result, f"result {result}")
        vehicle, name = self.target.vehicle_id, NAME_OF[self.part]
        if self._highest_requested < 0:
            return Rejected(f"Vehicle {vehicle} refused the {name}: {reason}.", reasons=(reason,))
        return Rejected(
            f"Vehicle {vehicle} refused item {self._highest_requested + 1} of the {name} "
            f"(command {self._items[self._highest_requested].command}): {reason}.",
            reasons=(reason,),
            remedy="Change or remove the item; the vehicle keeps its previous items.",
        )


class Download(Dialogue):
    """Requests the items of one part, one after the other."""

    def __init__(self, target: Target, part: Part) -> None:
        super().__init__(target, part)
        self.items: list[WireItem] = []
        self._count: int | None = None
        self._restarts = 0

    @property
    def count(self) -> int | None:
        return self._count

    @property
    def transferred(self) -> int:
        return len(self.items)

    def tick(self, now_s: float) -> list[MAVLink_message]:
        no_message_s = now_s - self._received_s
        if no_message_s >= NO_REPLY_S:
            if not self.items or self._restarts >= MAX_RESTARTS:
                progress_text = (
                    "" if self._count is None else f" after item {len(self.items)} of {self._count}"
                )
                raise self._no_reply(f"to the download of the {NAME_OF[self.part]}{progress_text}")
            self._restart(now_s)
        elif self._count is not None and not self.items and no_message_s >= FIRST_ITEM_S:
            self._count = None
        is_repetition = self._count is None and now_s > self._start_s
        self.wake_s = now_s + (RESEND_S if self._count is None else ITEM_RESEND_S)
        # Cancels an earlier transfer whose last message was lost, because it may keep the vehicle busy.
        return [*self.cancel(), self._request()] if is_repetition else [self._request()]

    def take(self, message: Reply, now_s: float) -> list[MAVLink_message]:
        match message.get_msgId():
            case d.MAVLINK_MSG_ID_MISSION_COUNT:
                return self._take_count(message, now_s)
            case d.MAVLINK_MSG_ID_MISSION_ITEM_INT:
                return self._take_item(message, now_s)
            case d.MAVLINK_MSG_ID_MISSION_ACK if message.type != d.MAV_MISSION_ACCEPTED:
                return self._take_refusal(message, now_s)
            case _:
                return []

    def _request(self) -> MAVLink_message:
        if self._count is None:
            return d.MAVLink_mission_request_list_message(*self._address(), self.mission_type)
        return d.MAVLink_mission_request_int_message(*self._address(), len(self.items), self.mission_type)

    def _next(self, now_s: float) -> list[MAVLink_message]:
        self._received_s = now_s
        if len(self.items) == self._count:
            self.done = True
            return [self._ack(d.MAV_MISSION_ACCEPTED)]  # also of none: PX4 waits for it, and is busy for 5 s
        self.wake_s = now_s + ITEM_RESEND_S
        return [self._request()]

    def _take_count(self, message: Reply, now_s: float) -> list[MAVLink_message]:
        if self._count is not None:
            return []
        if message.count > MAX_ITEMS:
            raise Rejected(
                f"Vehicle {self.target.vehicle_id} reports that its {NAME_OF[self.part]} has {message.count} "
                f"items; more than {MAX_ITEMS} are not read."
            )
        self._count, self.opaque_id = message.count, message.opaque_id or None
        return self._next(now_s)

    def _take_item(self, message: Reply, now_s: float) -> list[MAVLink_message]:
        if self._count is None or self.done or message.seq != len(self.items):
            return []
        self.items.append(wire_item(message))
        return self._next(now_s)

    def _take_refusal(self, message: Reply, now_s: float) -> list[MAVLink_message]:
        """Starts again, because the vehicle has ended the transfer or its mission has changed."""
        if self._restarts >= MAX_RESTARTS:
            reason = RESULT_TEXT.get(message.type, f"result {message.type}")
            raise Rejected(
                f"Vehicle {self.target.vehicle_id} ended the download of the {NAME_OF[self.part]}: {reason}.",
                reasons=(reason,),
            )
        self._restart(now_s)
        self.wake_s = now_s + RESEND_S
        return []

    def _restart(self, now_s: float) -> None:
        self._restarts += 1
        self.items, self._count = [], None
        self._received_s = now_s


class Clear(Dialogue):
    """Clears one part; a repeated request has no effect."""

    @property
    def count(self) -> int:
        return 0

    @property
    def transferred(self) -> int:
        return 0

    def tick(self, now_s: float) -> list[MAVLink_message]:
        if now_s - self._start_s >= NO_REPLY_S:
            raise self._no_reply(f"to the request to clear the {NAME_OF[self.part]}")
        self.wake_s = now_s + RESEND_S
        # Cancels an earlier transfer whose last message was lost, because it may keep the vehicle busy.
        cancel_messages = self.cancel() if now_s > self._start_s else []
        return [*cancel_messages, d.MAVLink_mission_clear_all_message(*self._address(), self.mission_type)]

    def take(self, message: Reply, now_s: float) -> list[MAVLink_message]:
        if message.get_msgId() == d.MAVLINK_MSG_ID_MISSION_ACK:
            if message.type == d.MAV_MISSION_ACCEPTED:
                self.done = True
            elif message.type != d.MAV_MISSION_ERROR:
                reason = RESULT_TEXT.get(message.type, f"result {message.type}")
                raise Rejected(
                    f"Vehicle {self.target.vehicle_id} did not clear its {NAME_OF[self.part]}: {reason}.",
                    reasons=(reason,),
                )
        return []


def item_message(item: WireItem, address: tuple[int, int], mission_type: int) -> MAVLink_message:
    """MISSION_ITEM_INT of an item."""
    return d.MAVLink_mission_item_int_message(
        *address,
        item.seq,
        item.frame,
        item.command,
        int(item.current),
        int(item.autocontinue),
        item.param1,
        item.param2,
        item.param3,
        item.param4,
        item.x,
        item.y,
        item.z,
        mission_type,
    )


def wire_item(message: Reply) -> WireItem:
    """The item in a MISSION_ITEM_INT."""
    return WireItem(
        message.seq,
        message.frame,
        message.command,
        message.param1,
        message.param2,
        message.param3,
        message.param4,
        message.x,
        message.y,
        message.z,
        bool(message.autocontinue),
        bool(message.current),
    )
