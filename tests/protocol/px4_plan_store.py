"""A scripted PX4 that accepts, stores, returns and rejects plans as a real one does.

Its rules are written from recordings of a real PX4 v1.16, independently of the server and of the simulator.
"""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np

from gcs_server.vehicle.services.mission_on_vehicle import PlanReference
from missions.formats import mavlink_items
from missions.values import HomePosition
from tests.protocol.fake_autopilot import LATENCY_S, ON_GROUND, FakeAutopilot
from tests.protocol.memory_testbed import MemoryTestbed
from vehicle_sim.mavlink import generated_dialect as sim

HOME = HomePosition(lat_deg=47.397742, lon_deg=8.545594, alt_amsl_m=489.0)
REFERENCE = PlanReference("abc", 1, "Tower")
MISSION, FENCE, RALLY = 0, 1, 2
CAPACITY = {MISSION: 10_000, FENCE: 64, RALLY: 32}
ACCEPTED, ERROR, BAD_FRAME, UNSUPPORTED, NO_SPACE, BAD_PARAM1, CANCELLED = 0, 1, 2, 3, 4, 6, 15
GLOBAL_FRAMES = {0: 5, 3: 6, 5: 5, 6: 6}
WITH_POSITION = {16, 17, 19, 21, 22, 31, 80, 84, 85, 195, 201, 4501, 5000}
WITHOUT_POSITION = {
    20, 93, 112, 114, 177, 178, 179, 187, 189, 196, 197, 200, 201, 203, 204, 205, 206, 211, 214, 260, 530,
    532, 534, 1000, 1001, 2000, 2001, 2003, 2500, 2501, 3000, 42600,
}  # fmt: skip
NOT_BEFORE_TAKEOFF = {16, 17, 19, 20, 21, 22, 31, 187, 211, 4501, 42600}
ONLY_FOR_VTOL = {84, 85, 3000}
NOT_FLOWN = {112, 114, 5000}
STARTS_WITH_LANDING, TOO_LOW, NOT_FIRST, VTOL_ITEMS, UNSUPPORTED_COMMAND = (
    22901736, 28985965, 33440290, 28298937, 25552931
)  # fmt: skip
REQUEST_PERIOD_S, TRANSFER_TIMEOUT_S = 0.25, 5.0
CHECKED_AFTER_S = 0.04
"""Time from the acknowledgement to the events of the feasibility check, the longest recorded."""

Stored = dict[str, float]
"""The fields of MISSION_ITEM_INT."""


@dataclass
class _Receiving:
    """An upload in progress."""

    kind: int
    count: int
    partner: tuple[int, int]
    items: list[Stored] = field(default_factory=list[Stored])
    checksum: int = 0
    last_s: float = 0.0


class Px4PlanStore(FakeAutopilot):
    """Speaks the mission protocol over a link that may lose packets; flies nothing."""

    def __init__(self, link: Any, **options: Any) -> None:
        super().__init__(link, **options)
        self.stored: dict[int, list[Stored]] = {MISSION: [], FENCE: [], RALLY: []}
        self.ids = {MISSION: 0, FENCE: 0, RALLY: 0}
        self.results: list[int] = []
        """The acknowledgements of uploads, in order."""
        self._receiving: _Receiving | None = None
        self._last_delivery_s = 0.0
        self._events: dict[int, Any] = {}
        self._every(REQUEST_PERIOD_S, self._repeat_request)
        self._every(1.0, self._send_mission_current)
        self._every(3.0, self._send_event_sequence)

    # --- messages -------------------------------------------------------------------------------------

    def receive(self, data: bytes) -> None:
        """Delivers the messages of a packet after the latency, in the order of the packets."""
        if self.random.random() >= self.loss:
            for message in self.parser.parse_buffer(data) or []:
                self._last_delivery_s = max(self.loop.time() + LATENCY_S, self._last_delivery_s + 1e-6)
                self.loop.call_at(self._last_delivery_s, self.handle, message)

    def handle(self, message: Any) -> None:
        handlers = {
            "MISSION_COUNT": self._begin, "MISSION_ITEM_INT": self._take, "MISSION_ACK": self._take_ack,
            "MISSION_CLEAR_ALL": self._clear, "MISSION_REQUEST_LIST": self._send_count,
            "MISSION_REQUEST_INT": self._send_item, "REQUEST_EVENT": self._repeat_events,
        }  # fmt: skip
        handler = handlers.get(message.get_type())
        if handler is not None:
            handler(message)
        else:
            super().handle(message)

    def send_requested_message(self, msg_id: int) -> None:
        if msg_id == sim.MAVLINK_MSG_ID_MISSION_CURRENT:
            self._send_mission_current()
            self.send_ack(sim.MAV_CMD_REQUEST_MESSAGE, 0)
        else:
            super().send_requested_message(msg_id)

    def _send_mission_current(self) -> None:
        count = len(self.stored[MISSION])
        ids = self.ids[MISSION], self.ids[FENCE], self.ids[RALLY]
        self.send(sim.MAVLink_mission_current_message(0, count or 65_535, 0, 0, *ids))

    def _ack(self, partner: tuple[int, int], kind: int, result: int, opaque_id: int = 0) -> None:
        self.send(sim.MAVLink_mission_ack_message(*partner, result, kind, opaque_id))

    # --- uploads --------------------------------------------------------------------------------------

    def _begin(self, message: Any) -> None:
        partner = message.get_srcSystem(), message.get_srcComponent()
        kind, count = message.mission_type, message.count
        receiving = self._receiving
        if receiving is not None:
            if not receiving.items and (receiving.kind, receiving.count) == (kind, count):
                self._request()
            return
        if count > CAPACITY[kind]:
            self.results.append(NO_SPACE)
            self._ack(partner, kind, NO_SPACE)
        elif count == 0:
            self._store(kind, [], 0)
            self._ack(partner, kind, ACCEPTED)
        else:
            self._receiving = _Receiving(kind, count, partner, last_s=self.loop.time())
            self._request()

    def _request(self) -> None:
        receiving = self._receiving
        assert receiving is not None
        seq = len(receiving.items)
        self.send(sim.MAVLink_mission_request_int_message(*receiving.partner, seq, receiving.kind))

    def _repeat_request(self) -> None:
        receiving = self._receiving
        if receiving is None:
            return
        if self.loop.time() - receiving.last_s > TRANSFER_TIMEOUT_S:
            self._receiving = None
        else:
            self._request()

    def _take(self, message: Any) -> None:
        receiving = self._receiving
        if receiving is None or message.seq != len(receiving.items):
            return
        receiving.last_s = self.loop.time()
        result = self._result(receiving.kind, message)
        if result != ACCEPTED:
            self._receiving = None
            self.results.append(result)
            self._ack(receiving.partner, receiving.kind, result)
            return
        receiving.items.append(stored_form(receiving.kind, message))
        receiving.checksum = zlib.crc32(bytes(message.get_msgbuf())[10:-2], receiving.checksum)
        if len(receiving.items) < receiving.count:
            self._request()
            return
        self._receiving = None
        changed = receiving.checksum != self.ids[receiving.kind]
        if changed:
            self._store(receiving.kind, receiving.items, receiving.checksum)
        self.results.append(ACCEPTED)
        self._ack(receiving.partner, receiving.kind, ACCEPTED, receiving.checksum)
        if changed and receiving.kind == MISSION:
            self.loop.call_later(CHECKED_AFTER_S, self._check_feasibility)

    def _store(self, kind: int, items: list[Stored], checksum: int) -> None:
        self.stored[kind], self.ids[kind] = items, checksum

    def _take_ack(self, message: Any) -> None:
        if message.type == CANCELLED:
            self._receiving = None

    def _clear(self, message: Any) -> None:
        if self._receiving is None:
            self._store(message.mission_type, [], 0)
            self._ack((message.get_srcSystem(), message.get_srcComponent()), message.mission_type, ACCEPTED)

    @staticmethod
    def _result(kind: int, item: Any) -> int:
        command, frame = item.command, item.frame
        if frame not in GLOBAL_FRAMES:
            if frame != 2:
                return BAD_FRAME
            if kind != MISSION or command not in WITHOUT_POSITION:
                return UNSUPPORTED
            has_mode = math.isfinite(item.param1) and _whole(item.param1) in (0, 1, 2)
            return BAD_PARAM1 if command == 201 and not has_mode else ACCEPTED
        if kind == RALLY:
            return ACCEPTED if command == 5100 else UNSUPPORTED
        if kind == FENCE:
            if command in (5001, 5002):
                return ERROR if _corners(item.param1) < 3 else ACCEPTED
            return ACCEPTED if command in (5000, 5003, 5004) else UNSUPPORTED
        if command in (80, 201) and not (_whole(item.param1) in (0, 3) and math.isfinite(item.param1)):
            return BAD_PARAM1
        if 5001 <= command <= 5004 or command == 5100:
            return ERROR
        return ACCEPTED if command in WITH_POSITION else UNSUPPORTED

    # --- downloads ------------------------------------------------------------------------------------

    def _send_count(self, message: Any) -> None:
        partner, kind = (message.get_srcSystem(), message.get_srcComponent()), message.mission_type
        if self._receiving is None:
            self.send(
                sim.MAVLink_mission_count_message(*partner, len(self.stored[kind]), kind, self.ids[kind])
            )

    def _send_item(self, message: Any) -> None:
        kind, seq = message.mission_type, message.seq
        if self._receiving is None and seq < len(self.stored[kind]):
            partner = message.get_srcSystem(), message.get_srcComponent()
            values = self.stored[kind][seq]
            self.send(
                sim.MAVLink_mission_item_int_message(
                    *partner, seq, **values, current=int(seq == 0), mission_type=kind
                )
            )

    # --- the check after an upload --------------------------------------------------------------------

    def _check_feasibility(self) -> None:
        items = self.stored[MISSION]
        commands = [int(item["command"]) for item in items]
        earlier: set[int] = set()
        for number, command in enumerate(commands, start=1):
            if command in NOT_FLOWN:
                self.send_event(UNSUPPORTED_COMMAND, 67, struct.pack("<HH", number, command))
                break
            if number == 1 and command == 21 and self.landed_state == ON_GROUND:
                self.send_event(STARTS_WITH_LANDING, 99)
                break
        for command, item in zip(commands, items, strict=True):
            if command in (22, 84):
                home_m = 0.0 if item["frame"] == 6 else self.home[2]
                if item["z"] - home_m <= 0.0:
                    self.send_event(TOO_LOW, 99, struct.pack("<f", 0.0))
                    break
                if earlier & NOT_BEFORE_TAKEOFF:
                    self.send_event(NOT_FIRST, 99)
                    break
            earlier.add(command)
        if ONLY_FOR_VTOL & set(commands):
            self.send_event(VTOL_ITEMS, 99)

    def send_event(self, event_id: int, levels: int, arguments: bytes = b"") -> None:
        data = list(arguments.ljust(40, b"\0"))
        self.event_sequence += 1
        self._events[self.event_sequence] = event_id, self.boot_ms(), self.event_sequence, levels, data
        self._send_stored_event(self.event_sequence)

    def _send_stored_event(self, sequence: int) -> None:
        self.send(sim.MAVLink_event_message(0, 0, *self._events[sequence]))

    def _repeat_events(self, message: Any) -> None:
        for sequence in range(message.first_sequence, message.last_sequence + 1):
            if sequence in self._events:
                self._send_stored_event(sequence)
            else:
                oldest = min(self._events, default=0)
                partner = message.get_srcSystem(), message.get_srcComponent()
                self.send(sim.MAVLink_response_event_error_message(*partner, sequence, oldest, 0))

    def _send_event_sequence(self) -> None:
        self.send(sim.MAVLink_current_event_sequence_message(self.event_sequence, 0 if self._events else 1))


def stored_form(kind: int, item: Any) -> Stored:
    """An accepted item as it is returned."""
    p1, p2, p3, p4 = item.param1, item.param2, item.param3, item.param4
    command, frame, x, y = item.command, item.frame, item.x, item.y
    autocontinue = item.autocontinue & 1
    if kind == RALLY:
        p1 = p2 = p3 = p4 = 0.0
    elif kind == FENCE:
        polygon, circle = command in (5001, 5002), command in (5003, 5004)
        p1 = float(_corners(p1)) if polygon else p1 if circle else 0.0
        p2 = p3 = p4 = 0.0
        frame, autocontinue = 5, 0
    elif frame == 2:
        x, y = (_int32(struct.unpack("<f", struct.pack("<f", v))[0]) for v in (x, y))
        if command == 177:
            p1, p2 = _int16(p1), float(_whole(p2) & 0xFFFF)
    elif command == 16:
        p3, p4 = 0.0, _yaw(p4)
    elif command == 17:
        p1, p2, p4 = 0.0, 0.0, _yaw(p4)
    elif command == 19:
        p2, p4 = float(p2 > 0), float(p4 > 0)
    elif command == 21:
        p1, p2, p3, p4 = 0.0, float(_whole(p2) & 0xFFFF), 0.0, _yaw(p4)
    elif command in (22, 84, 85):
        p1, p2, p3, p4 = 0.0, 0.0, 0.0, _yaw(p4)
    elif command == 31:
        p1, p3, p4 = float(p1 > 0), 0.0, float(p4 > 0)
    else:
        p1 = p2 = p3 = p4 = 0.0
        command = 201 if command == 80 else command
    return {
        "frame": GLOBAL_FRAMES.get(frame, frame), "command": command, "autocontinue": autocontinue,
        "param1": p1, "param2": p2, "param3": p3, "param4": p4, "x": x, "y": y, "z": item.z,
    }  # fmt: skip


def _whole(value: float) -> int:
    return math.trunc(value) if math.isfinite(value) else 0


def _corners(value: float) -> int:
    return _whole(value + 0.5) & 0xFFFF


def _int16(value: float) -> float:
    low = _whole(value) & 0xFFFF
    return float(low - 0x10000 if low >= 0x8000 else low)


def _int32(value: float) -> int:
    return -(2**31) if value >= 2**31 else int(value)


def _yaw(value: float) -> float:
    """PX4 calculates with 32-bit floats."""
    if not math.isfinite(value):
        return math.nan
    turn, angle = np.float32(math.tau), np.float32(value) * np.float32(math.pi / 180)
    if not 0 <= angle < turn:
        angle -= turn * np.floor(angle * (np.float32(1) / turn))
    return float(angle * np.float32(180 / math.pi))


# --- a server beside it ---------------------------------------------------------------------------------


def items_of(plan):
    return {
        "mission": mavlink_items.mission_items(plan),
        "fence": mavlink_items.fence_items(plan),
        "rally": mavlink_items.rally_items(plan),
    }


def run_with_px4(run_simulated, scenario, *, loss=0.0, seed=0):
    async def run():
        testbed = MemoryTestbed()
        link = testbed.link()
        px4 = link.autopilots["peer"] = Px4PlanStore(link, seed=seed)
        try:
            vehicle = await testbed.wait_for_vehicle()
            px4.send_event(26266355, 102)  # so that the server knows the sequence of the events
            await testbed.clock.sleep(0.1)
            px4.loss = loss
            await scenario(SimpleNamespace(vehicle=vehicle, mission=vehicle.mission, px4=px4))
        finally:
            px4.alive = False
            await testbed.close()

    run_simulated(run)
