"""Writes ULogs for tests: every type of field, instances, parameters, texts, dropouts, appended data."""

import math
import random
import struct

MAGIC = b"ULog\x01\x12\x35\x01"
START_US = 2_000_000
UTC_US = 1_795_222_000_000_000
"""The GPS receiver's time when the log starts."""
SYNC = bytes.fromhex("2f731320250cbb12")
TYPES = {
    "int8_t": "b",
    "uint8_t": "B",
    "int16_t": "h",
    "uint16_t": "H",
    "int32_t": "i",
    "uint32_t": "I",
    "int64_t": "q",
    "uint64_t": "Q",
    "float": "f",
    "double": "d",
    "bool": "?",
    "char": "c",
}
LARGEST_FIRST = sorted(TYPES, key=lambda kind: -struct.calcsize(TYPES[kind]))
ALL_TYPES = "uint64_t timestamp;" + "".join(
    f"{kind} {kind.removesuffix('_t')}_value;" for kind in LARGEST_FIRST
)


def message(letter, body):
    return struct.pack("<HB", len(body), ord(letter)) + body


def key_value(letter, key, value, before=b""):
    return message(letter, before + bytes([len(key)]) + key.encode() + value)


def text_info(name, text):
    return key_value("I", f"char[{len(text)}] {name}", text.encode())


def parameter(name, value):
    kind, code = ("int32_t", "<i") if isinstance(value, int) else ("float", "<f")
    return key_value("P", f"{kind} {name}", struct.pack(code, value))


def text(level, t_us, words):
    return message("L", bytes([ord("0") + level]) + struct.pack("<Q", t_us) + words.encode())


def dropout(duration_ms):
    return message("O", struct.pack("<H", duration_ms))


def subscription(number, instance, name):
    return message("A", bytes([instance]) + struct.pack("<H", number) + name.encode())


def sample(number, body):
    return message("D", struct.pack("<H", number) + body)


def all_types_row(t_us, step):
    values = {
        "int8_t": -(step % 100),
        "uint8_t": step % 256,
        "int16_t": -step,
        "uint16_t": step,
        "int32_t": -100_000 - step,
        "uint32_t": 4_000_000_000 + step,
        "int64_t": -(10**15) - step,
        "uint64_t": 10**15 + step,
        "float": math.sin(step / 10),
        "double": math.cos(step / 10),
        "bool": step % 2 == 0,
        "char": bytes([65 + step % 26]),
    }
    return struct.pack(
        "<Q" + "".join(TYPES[kind] for kind in LARGEST_FIRST), t_us, *(values[kind] for kind in LARGEST_FIRST)
    )


def definitions(flags=b""):
    status = "uint64_t timestamp;uint8_t nav_state;uint8_t arming_state;bool failsafe;uint8_t[5] _padding0;"
    return b"".join(
        (
            MAGIC + struct.pack("<Q", START_US),
            flags or message("B", bytes(40)),
            message("F", f"all_types:{ALL_TYPES}".encode()),
            message("F", f"vehicle_status:{status}".encode()),
            message("F", b"point:float x;float[2] yz;"),
            message("F", b"path:uint64_t timestamp;point[2] points;float length;uint8_t[4] _padding0;"),
            message("F", b"sensor_gps:uint64_t timestamp;uint64_t time_utc_usec;uint8_t fix_type;"),
            text_info("sys_name", "PX4"),
            text_info("ver_hw", "TEST_BOARD"),
            key_value("I", "uint32_t ver_sw_release", struct.pack("<I", 0x011000FF)),
            parameter("MAV_SYS_ID", 7),
            parameter("MPC_XY_VEL_MAX", 12.0),
        )
    )


def data(steps=200, seed=1):
    """The data section: 10 samples a second, two instances of `all_types`."""
    rng = random.Random(seed)
    parts = [
        subscription(0, 0, "all_types"),
        subscription(1, 1, "all_types"),
        subscription(2, 0, "vehicle_status"),
        subscription(3, 0, "path"),
        subscription(4, 0, "sensor_gps"),
        text(6, START_US, "logger started"),
    ]
    for step in range(steps):
        t_us = START_US + step * 100_000
        parts.append(sample(0, all_types_row(t_us, step)))
        if step % 2:
            parts.append(sample(1, all_types_row(t_us + 500, 1000 + step)))
        if step % 10 == 0:
            armed = 2 if 50 <= step < 150 else 1
            mode = 17 if 50 <= step < 80 else 4
            parts.append(sample(2, struct.pack("<QBB?", t_us, mode, armed, 100 <= step < 120)))
            parts.append(sample(3, struct.pack("<Q7f", t_us, *(rng.uniform(-5, 5) for _ in range(7)))))
            parts.append(sample(4, struct.pack("<QQB", t_us, UTC_US + step * 100_000, 3)))
        if step == 60:
            parts.append(text(4, t_us, "Low battery\t"))
            parts.append(parameter("MPC_XY_VEL_MAX", 5.0))
        if step == 120:
            parts += [dropout(250), message("S", SYNC)]
    return b"".join(parts)


def ulog(steps=200, seed=1):
    return definitions() + data(steps, seed)


def appended():
    """A log with appended data, such as PX4 adds after a hard fault."""
    first, second = data(100), message("L", b"3" + struct.pack("<Q", START_US + 9_000_000) + b"appended text")
    flags_size = len(message("B", bytes(40)))
    whole = len(definitions()) + len(first)
    flags = message("B", bytes(8) + b"\x01" + bytes(7) + struct.pack("<QQQ", whole, 0, 0))
    assert len(flags) == flags_size
    return definitions(flags) + first + second


def mutated(content, seed):
    """A damaged copy: bytes changed, cut, repeated, left out or inserted."""
    rng = random.Random(seed)
    damaged = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 5, 20))):
        if not damaged:
            break
        at = rng.randrange(min(len(damaged), rng.choice((60, 800, len(damaged)))))
        size = rng.choice((1, 2, 3, 8, 64, 500))
        kind = rng.randrange(6)
        if kind == 0:
            damaged[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            damaged[at : at + size] = rng.randbytes(len(damaged[at : at + size]))
        elif kind == 2:
            del damaged[at : at + size]
        elif kind == 3:
            damaged[at:at] = rng.randbytes(size)
        elif kind == 4:
            damaged[at:at] = damaged[at : at + size]
        else:
            del damaged[rng.randrange(len(damaged)) :]
    return bytes(damaged)
