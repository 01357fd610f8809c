"""A MAVLink link of one vehicle: sequence numbers, parser, stream schedule and send queue."""

from __future__ import annotations

import heapq
import math
from typing import Any, Final

from vehicle_sim.mavlink.dialect import BY_NAME, Layout, Message, pack
from vehicle_sim.mavlink.framing import FrameParser, frame_v2

NEVER_US = 1 << 62
OUTBOX_LIMIT_BYTES = 4_000_000
"""Maximum of queued bytes; a longer queue is dropped completely, similar to a full UDP buffer."""
LATE_INTERVAL_US = 4000
"""A stream that is late by an interval or more sends its next message after this time at most."""


GCS: Final[dict[str, float]] = {
    "HEARTBEAT": 1.0,
    "SYS_STATUS": 1.0,
    "PING": 0.1,
    "LINK_NODE_STATUS": 1.0,
    "GPS_RAW_INT": 5.0,
    "SCALED_PRESSURE": 1.0,
    "ATTITUDE": 50.0,
    "ATTITUDE_QUATERNION": 50.0,
    "LOCAL_POSITION_NED": 50.0,
    "GLOBAL_POSITION_INT": 50.0,
    "SERVO_OUTPUT_RAW": 50.0,
    "MISSION_CURRENT": 1.0,
    "VFR_HUD": 4.0,
    "ATTITUDE_TARGET": 50.0,
    "POSITION_TARGET_LOCAL_NED": 50.0,
    "POSITION_TARGET_GLOBAL_INT": 1.0,
    "DISTANCE_SENSOR": 0.5,
    "ALTITUDE": 1.0,
    "BATTERY_STATUS": 0.5,
    "ESTIMATOR_STATUS": 0.5,
    "VIBRATION": 0.1,
    "HOME_POSITION": 0.5,
    "EXTENDED_SYS_STATE": 1.0,
    "MOUNT_ORIENTATION": 10.0,
    "GIMBAL_MANAGER_STATUS": 0.5,
    "GIMBAL_DEVICE_ATTITUDE_STATUS": 1.0,
    "TIME_ESTIMATE_TO_TARGET": 0.5,
    "CURRENT_EVENT_SEQUENCE": 1.0 / 3.0,
    "CURRENT_MODE": 0.5,
    "ORBIT_EXECUTION_STATUS": 2.0,
    "OPEN_DRONE_ID_LOCATION": 1.0,
    "OPEN_DRONE_ID_SYSTEM": 1.0,
}

API: Final[dict[str, float]] = GCS | {
    "SYS_STATUS": 5.0,
    "SYSTEM_TIME": 1.0,
    "PING": 1.0,
    "GPS_RAW_INT": 8.0,
    "ATTITUDE": 100.0,
    "LOCAL_POSITION_NED": 30.0,
    "SERVO_OUTPUT_RAW": 10.0,
    "VFR_HUD": 10.0,
    "ATTITUDE_TARGET": 10.0,
    "POSITION_TARGET_LOCAL_NED": 10.0,
    "POSITION_TARGET_GLOBAL_INT": 10.0,
    "HIGHRES_IMU": 50.0,
    "TIMESYNC": 10.0,
    "DISTANCE_SENSOR": 10.0,
    "ALTITUDE": 10.0,
    "ESTIMATOR_STATUS": 1.0,
    "VIBRATION": 0.5,
    "EXTENDED_SYS_STATE": 5.0,
    "ODOMETRY": 30.0,
}

PROFILES: Final[dict[str, dict[str, float]]] = {"gcs": GCS, "api": API}
"""Messages that PX4 streams by default on its two default links, and the rates that it configures [Hz];
measured rates of a real vehicle are up to 1 % lower. Others are streamed once a client sets an interval."""

INTEGRITY_HZ: Final = {"GNSS_INTEGRITY": 1.0}
"""Added to both links by PX4 v1.17."""

RESTORED_HZ: Final[dict[str, float]] = {"ATTITUDE": 15.0}
"""Rates after a client has set interval 0 ("default"), if they differ from the rates at boot."""

FIXED_INTERVAL: Final = frozenset({"HEARTBEAT", "CURRENT_EVENT_SEQUENCE", "EVENT"})
"""Messages for which PX4 accepts no interval."""


class Link:
    """A link that streams by `profile` ("gcs" or "api").

    `streams_integrity`: whether it streams GNSS_INTEGRITY too.
    """

    def __init__(self, name: str, profile: str, system_id: int, *, streams_integrity: bool = False) -> None:
        self.name = name
        self._default_hz = PROFILES[profile] | (INTEGRITY_HZ if streams_integrity else {})
        self.profile = profile
        self.system_id = system_id
        self.parser = FrameParser()
        self.gcs_heartbeat_at_s = -math.inf
        self.known_senders: set[tuple[int, int]] = set()
        """(system id, component id) of all senders on this link so far."""
        self.ports: tuple[int, int | None] | None = None
        """Local and remote port, without a remote port for TCP; None: the link has no socket."""
        self.sent_frames = 0
        self.sent_bytes = 0
        self.received_bytes = 0
        self.tx_rate = 0
        self.rx_rate = 0
        self.ping_sequence = 0
        self._sequence = 0
        self._component_sequences: dict[int, int] = {}
        self._outbox: list[bytes] = []
        self._outbox_bytes = 0
        self._intervals_us: dict[int, int] = {}
        self._schedule: list[tuple[int, int, int]] = []
        """(due time [µs], message id, generation)."""
        self._generation = 0
        self._generations: dict[int, int] = {}
        """Generation of the newest interval, by message id; entries of earlier generations are not sent."""
        for message_name, hz in self._default_hz.items():
            self.set_interval(BY_NAME[message_name].id, int(1e6 / hz), 0)

    # --- sending ---------------------------------------------------------------------------------------

    def send(self, name: str, /, **fields: Any) -> None:
        """Queues one message."""
        layout, payload = pack(name, **fields)
        self.send_payload(layout, payload)

    def send_payload(self, layout: Layout, payload: bytes) -> None:
        """Queues a packed payload."""
        self.send_raw(frame_v2(layout, payload, self._sequence, self.system_id, 1))
        self._sequence = (self._sequence + 1) & 0xFF

    def send_from(self, component_id: int, name: str, /, **fields: Any) -> None:
        """Queues one message of another component of the vehicle, with that component's sequence number."""
        layout, payload = pack(name, **fields)
        sequence = self._component_sequences.get(component_id, 0)
        self._component_sequences[component_id] = (sequence + 1) & 0xFF
        self.send_raw(frame_v2(layout, payload, sequence, self.system_id, component_id))

    def send_raw(self, frame: bytes) -> None:
        """Queues a frame unchanged, so that a forwarded frame keeps its sender."""
        if self._outbox_bytes > OUTBOX_LIMIT_BYTES:
            self._outbox.clear()
            self._outbox_bytes = 0
        self._outbox.append(frame)
        self._outbox_bytes += len(frame)
        self.sent_frames += 1
        self.sent_bytes += len(frame)

    def drain(self) -> list[bytes]:
        """Returns all queued frames and clears the queue."""
        frames, self._outbox, self._outbox_bytes = self._outbox, [], 0
        return frames

    def feed(self, data: bytes) -> list[Message]:
        """Parses received bytes; returns the messages."""
        self.received_bytes += len(data)
        return self.parser.feed(data)

    # --- streams ---------------------------------------------------------------------------------------

    def interval_us(self, msg_id: int) -> int:
        """Interval of a stream; 0: not streamed."""
        return self._intervals_us.get(msg_id, 0)

    def set_interval(self, msg_id: int, interval_us: int, now_us: int) -> None:
        """Streams a message at this interval; 0 or less stops the stream."""
        self._generation += 1
        self._generations[msg_id] = self._generation
        if interval_us <= 0:
            self._intervals_us.pop(msg_id, None)
            return
        self._intervals_us[msg_id] = interval_us
        heapq.heappush(self._schedule, (now_us + interval_us, msg_id, self._generation))

    def streamed_ids(self) -> frozenset[int]:
        """Ids of all messages that the link streams."""
        return frozenset(self._intervals_us)

    def restore_interval(self, name: str, now_us: int) -> None:
        """Restores PX4's default interval of this link."""
        hz = RESTORED_HZ.get(name, self._default_hz.get(name, 0.0))
        self.set_interval(BY_NAME[name].id, int(1e6 / hz) if hz else 0, now_us)

    @property
    def next_due_us(self) -> int:
        """Time at which the next message is due."""
        return self._schedule[0][0] if self._schedule else NEVER_US

    def due(self, now_us: int) -> list[int]:
        """Ids of the messages that are due; the call schedules each of them again."""
        schedule = self._schedule
        if not schedule or schedule[0][0] > now_us:
            return []
        due_ids: list[int] = []
        while schedule and schedule[0][0] <= now_us:
            due_us, msg_id, generation = heapq.heappop(schedule)
            interval_us = self._intervals_us.get(msg_id)
            if interval_us is None or self._generations[msg_id] != generation:
                continue
            due_ids.append(msg_id)
            next_us = due_us + interval_us
            if next_us <= now_us:
                next_us = now_us + min(interval_us, LATE_INTERVAL_US)
            heapq.heappush(schedule, (next_us, msg_id, generation))
        return due_ids
