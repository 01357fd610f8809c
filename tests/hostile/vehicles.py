"""Hostile vehicles on a UDP link: `python -m tests.hostile.vehicles ATTACK PORT [SEED] [COUNT]`.

Every frame is well-formed MAVLink 2 with a correct checksum; only its content is hostile.
"""

from __future__ import annotations

import itertools
import math
import random
import socket
import struct
import sys
import time
from collections.abc import Callable, Iterator

from vehicle_sim.mavlink import generated_dialect as d

Address = tuple[str, int]
FLOATS = (math.nan, math.inf, -math.inf, 1e38, -1e38, 0.0, -0.0, 1e-45, 3.4e38)
INTEGERS = (
    0,
    1,
    -1,
    127,
    -128,
    255,
    32767,
    -32768,
    65535,
    2**31 - 1,
    -(2**31),
    2**32 - 1,
    2**63 - 1,
    2**64 - 1,
)
HOSTILE_ID = 66
"""System id of the hostile vehicle."""
FRAMES_PER_S = 5000
REQUEST_MESSAGE, COMPONENT_METADATA = 512, 397
"""The command MAV_CMD_REQUEST_MESSAGE, and the id of COMPONENT_METADATA."""
FTP_HEADER = struct.Struct("<HBBBBBBI")
OPEN, READ, BURST, ACK = 4, 5, 15, 128
REPORTED_FILE_BYTES = 900_000


class Sender:
    """A socket that sends messages with any system id, at a limited rate."""

    def __init__(self, port: int, frames_per_s: float = FRAMES_PER_S) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.target: Address = ("127.0.0.1", port)
        self._encoders: dict[tuple[int, int], d.MAVLink] = {}
        self._period_s = 1.0 / frames_per_s
        self._next_send_s = time.monotonic()
        self.sent_count = 0

    def send(self, message: d.MAVLink_message, system: int = HOSTILE_ID, component: int = 1) -> None:
        """Packs and sends a message."""
        encoder = self._encoders.get((system, component))
        if encoder is None:
            encoder = self._encoders[system, component] = d.MAVLink(None, system, component)
        raw = bytes(message.pack(encoder))
        encoder.seq = (encoder.seq + 1) % 256
        self.send_raw(raw)

    def send_raw(self, data: bytes) -> None:
        """Sends a datagram at the limited rate."""
        # After a delay, at most 50 ms of datagrams are sent without a wait.
        self._next_send_s = max(self._next_send_s + self._period_s, time.monotonic() - 0.05)
        wait_s = self._next_send_s - time.monotonic()
        if wait_s > 0.002:
            time.sleep(wait_s)
        self.socket.sendto(data, self.target)
        self.sent_count += 1

    def heartbeat(self, system: int = HOSTILE_ID, component: int = 1) -> None:
        """Sends the heartbeat of a PX4 quadrotor in Offboard."""
        mode = 6 << 16
        self.send(d.MAVLink_heartbeat_message(2, 12, 128 | 1, mode, 4, 3), system, component)

    def receive(self, timeout_s: float) -> Iterator[d.MAVLink_message]:
        """Received messages, until no datagram arrives for this time."""
        parser = d.MAVLink(None, HOSTILE_ID, 1)
        parser.robust_parsing = True
        self.socket.settimeout(timeout_s)
        while True:
            try:
                data = self.socket.recv(2048)
            except TimeoutError:
                return
            yield from parser.parse_buffer(data) or ()


def payload(message_class: type[d.MAVLink_message], value_for: Callable[[str], object]) -> bytes:
    """The payload of a message; `value_for` returns a value for the struct type code of an element."""
    packer = message_class.unpacker
    values = [value_for(code) for code in _type_codes(packer.format)]
    return packer.pack(*values)


def _type_codes(layout: str) -> Iterator[str]:
    count = ""
    for letter in layout.lstrip("<"):
        if letter.isdigit():
            count += letter
        elif letter == "s":
            yield f"{count or 1}s"
            count = ""
        else:
            yield from letter * int(count or 1)
            count = ""


def _wrap_integer(code: str, value: int) -> int:
    bits = struct.calcsize("<" + code) * 8
    value &= (1 << bits) - 1
    return value - (1 << bits) if code.islower() and value >= 1 << bits - 1 else value


def _random_text(code: str, rng: random.Random) -> bytes:
    size = int(code[:-1])
    return rng.choice(
        (b"\xff" * size, b"\0" * size, b"<a " * size, bytes(rng.randrange(256) for _ in range(size)))
    )[:size]


def frame(
    message_class: type[d.MAVLink_message], body: bytes, seq: int, system: int, component: int
) -> bytes:
    """A MAVLink 2 frame with this payload and its checksum."""
    body = body.rstrip(b"\0") or body[:1]
    msg_id = message_class.id
    header = struct.pack(
        "<BBBBBBBHB", 0xFD, len(body), 0, 0, seq & 255, system, component, msg_id & 0xFFFF, msg_id >> 16
    )
    crc = d.x25crc(header[1:] + body)
    crc.accumulate(bytes((message_class.crc_extra,)))
    return header + body + struct.pack("<H", crc.crc)


def extremes(sender: Sender, rng: random.Random, count: int) -> None:
    """Every message of the dialect; in each round all fields have the next extreme value."""
    seq = itertools.count()
    message_classes = list(d.mavlink_map.values())
    for round_number in range(count):
        float_, integer = FLOATS[round_number % len(FLOATS)], INTEGERS[round_number % len(INTEGERS)]

        def value_for(code: str, float_: float = float_, integer: int = integer) -> object:
            if code.endswith("s"):
                return _random_text(code, rng)
            if code == "c":
                return b"\xff"
            return float_ if code in "fd" else _wrap_integer(code, integer)

        for message_class in message_classes:
            if message_class.id % 16 == 0:
                sender.heartbeat()
            sender.send_raw(frame(message_class, payload(message_class, value_for), next(seq), HOSTILE_ID, 1))


def fuzz(sender: Sender, rng: random.Random, count: int) -> None:
    """Random messages with random contents from a few systems and components."""
    seq = itertools.count()
    message_classes = list(d.mavlink_map.values())

    def value_for(code: str) -> object:
        if code.endswith("s"):
            return _random_text(code, rng)
        if code == "c":
            return bytes((rng.randrange(256),))
        if code in "fd":
            return rng.choice(FLOATS) if rng.random() < 0.5 else rng.gauss(0.0, 1000.0)
        return _wrap_integer(code, rng.choice(INTEGERS) if rng.random() < 0.5 else rng.getrandbits(64))

    while sender.sent_count < count:
        message_class = rng.choice(message_classes)
        system, component = (
            rng.choice((HOSTILE_ID, HOSTILE_ID, HOSTILE_ID + 1, rng.randrange(1, 256))),
            rng.choice((1, 1, 154, 100)),
        )
        if system == 101:
            continue  # the system id of the attacked flight: another test covers it
        if rng.random() < 0.02:
            sender.heartbeat(system, component)
        sender.send_raw(frame(message_class, payload(message_class, value_for), next(seq), system, component))


def sources(sender: Sender, rng: random.Random, count: int) -> None:
    """Heartbeats of many vehicles: many system ids and components, from many addresses."""
    for _ in range(count):
        source = Sender(sender.target[1])
        for _ in range(20):
            source.heartbeat(rng.randrange(1, 101), rng.randrange(1, 256))
        source.socket.close()
        sender.sent_count += source.sent_count


def texts(sender: Sender, rng: random.Random, count: int) -> None:
    """Parts of status texts that never end, and unknown events."""
    for n in range(count):
        if n % 500 == 0:
            sender.heartbeat()
        if n % 2:
            sender.send(d.MAVLink_statustext_message(rng.randrange(8), b"<a " * 16, 1 + n % 60000, n % 200))
        else:
            arguments = [rng.randrange(256) for _ in range(40)]
            sender.send(
                d.MAVLink_event_message(
                    0, 0, rng.getrandbits(32), 1000 + n, n % 65536, rng.randrange(256), arguments
                )
            )


def files(sender: Sender, rng: random.Random, count: int) -> None:
    """A vehicle whose files never end and whose parameters are invalid, for `count` seconds."""
    end_s = time.monotonic() + count
    while time.monotonic() < end_s:
        sender.heartbeat()
        for message in sender.receive(0.2):
            _reply(sender, rng, message)
            if time.monotonic() > end_s:
                break


def _reply(sender: Sender, rng: random.Random, message: d.MAVLink_message) -> None:
    message_type = message.get_type()
    if message_type == "FILE_TRANSFER_PROTOCOL":
        sequence, session, opcode, _, _, _, _, offset = FTP_HEADER.unpack_from(bytes(message.payload))
        if opcode == OPEN:
            _send_ftp_reply(sender, sequence + 1, session, opcode, 0, struct.pack("<I", REPORTED_FILE_BYTES))
        elif opcode == BURST:
            for n in range(200):
                _send_ftp_reply(sender, sequence + 1 + n, session, opcode, offset + n, b"<")
        elif opcode == READ:
            _send_ftp_reply(sender, sequence + 1, session, opcode, offset, b"<")
        else:
            _send_ftp_reply(sender, sequence + 1, session, opcode, 0, b"")
    elif message_type == "COMMAND_LONG":
        sender.send(d.MAVLink_command_ack_message(message.command, 0))
        if message.command == REQUEST_MESSAGE and int(message.param1) == COMPONENT_METADATA:
            uri = b"mftp://etc/extras/parameters.json.xz"
            sender.send(d.MAVLink_component_metadata_message(0, rng.getrandbits(32), uri))
    elif message_type == "PARAM_REQUEST_LIST":
        for n in range(3000):
            name = bytes(rng.randrange(1, 256) for _ in range(16))
            sender.send(
                d.MAVLink_param_value_message(
                    name, rng.choice(FLOATS), rng.choice((6, 9, 0, 255)), 65535, n * 7 % 65536
                )
            )
        sender.send(d.MAVLink_param_value_message(b"_HASH_CHECK", math.nan, 5, 65535, 65535))
    elif message_type == "PARAM_REQUEST_READ":
        sender.send(d.MAVLink_param_value_message(b"COM_OBL_RC_ACT", math.nan, 255, 1, 0))


def _send_ftp_reply(
    sender: Sender, sequence: int, session: int, request_opcode: int, offset: int, data: bytes
) -> None:
    header = FTP_HEADER.pack(
        sequence & 0xFFFF, session, ACK, len(data), request_opcode, 0, 0, offset & 0xFFFFFFFF
    )
    sender.send(
        d.MAVLink_file_transfer_protocol_message(0, 255, 190, list((header + data).ljust(251, b"\0")))
    )


ATTACKS = {f.__name__: f for f in (extremes, fuzz, sources, texts, files)}


def main(name: str, port: str, seed: str = "0", count: str = "1000") -> None:
    """Runs one attack; prints the number of sent datagrams."""
    sender = Sender(int(port))
    sender.heartbeat()
    ATTACKS[name](sender, random.Random(int(seed)), int(count))
    print(sender.sent_count)


if __name__ == "__main__":
    main(*sys.argv[1:])
