"""The simulator keeps working with any input: garbage, damaged frames, extreme values, floods."""

import os
import random
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.unit.vehicle_sim.sim_station import GCS_AND_API_LINKS, HOLD_MODE, Station
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.mavlink.dialect import BY_NAME, LAYOUTS, Layout, pack
from vehicle_sim.mavlink.framing import FrameParser, frame_v2
from vehicle_sim.world.files import load_world

pytestmark = pytest.mark.flight

SEEDS = int(os.environ.get("FUZZ_SEEDS", "1"))
"""Number of seeds; more with `make nightly`."""
EXTREME_FLOATS = (
    0.0,
    -0.0,
    1.0,
    -1.0,
    1e-40,
    3.4e38,
    -3.4e38,
    float("inf"),
    float("-inf"),
    float("nan"),
    255.0,
    1e9,
)
INTEGER_LIMITS = {"b": (-128, 127), "B": (0, 255), "h": (-(2**15), 2**15 - 1), "H": (0, 2**16 - 1)}
INTEGER_LIMITS |= {"i": (-(2**31), 2**31 - 1), "I": (0, 2**32 - 1)}
INTEGER_LIMITS |= {"q": (-(2**63), 2**63 - 1), "Q": (0, 2**64 - 1)}


def extreme_payload(layout: Layout, rng: random.Random) -> bytes:
    """A payload with values at and beyond the limits of its fields, usually addressed to the vehicle."""
    format_letters = layout.packer.format.lstrip("<")
    values, kinds, count_digits = [], [], ""
    for letter in format_letters:
        if letter.isdigit():
            count_digits += letter
            continue
        kinds += [letter] if letter == "s" else [letter] * int(count_digits or 1)
        if letter == "s":
            values.append(rng.randbytes(int(count_digits or 1)))
        else:
            values += [_extreme_value(letter, rng) for _ in range(int(count_digits or 1))]
        count_digits = ""
    index = 0
    for name, length, is_text in layout.slots:
        if name in ("target_system", "target") and rng.random() < 0.9:
            values[index] = 1
        if name == "target_component" and rng.random() < 0.9:
            values[index] = rng.choice((0, 1, 100))
        if name == "command" and rng.random() < 0.8:
            values[index] = rng.choice(COMMANDS)
        index += 1 if is_text or not length else length
    assert len(values) == len(kinds)
    return layout.packer.pack(*values)


COMMANDS = (
    16,
    20,
    21,
    22,
    34,
    176,
    178,
    179,
    192,
    195,
    197,
    201,
    203,
    205,
    206,
    211,
    241,
    245,
    300,
    310,
    400,
    401,
)
COMMANDS += (420, 500, 510, 511, 512, 521, 526, 530, 531, 1000, 1001, 2000, 2001, 2002, 42429, 43004, 65535)


def _extreme_value(letter: str, rng: random.Random) -> float:
    if letter in "fd":
        return rng.choice((*EXTREME_FLOATS, rng.uniform(-1e3, 1e3), float(rng.randrange(0, 600))))
    low, high = INTEGER_LIMITS[letter]
    return rng.choice((low, high, max(low, min(high, 0)), max(low, min(high, 1)), rng.randint(low, high)))


def is_working(sim: SimulatedFleet) -> bool:
    """Whether the vehicle's state is finite, and the simulator still streams telemetry and replies to
    requests."""
    truth = sim.simulation.truth
    state_is_finite = all(
        np.isfinite(rows).all() for rows in (truth.position_ned_m, truth.q_ned_frd, truth.rates_frd_rad_s)
    )
    sim.drain(0, "gcs")
    request = {"target_system": 1, "target_component": 1, "param_id": "SYS_AUTOSTART", "param_index": -1}
    layout, payload = pack("PARAM_REQUEST_READ", **request)
    # Zeros complete a frame that was cut; then the parser must find the next frame.
    sim.feed(0, "gcs", bytes(600) + frame_v2(layout, payload, 0, 255, 190))
    sim.step(1.5)
    names = [message.name for message in FrameParser().feed(sim.drain(0, "gcs"))]
    return state_is_finite and "HEARTBEAT" in names and "PARAM_VALUE" in names


@pytest.fixture(scope="module")
def station() -> Station:
    station = Station(camera=True, links=GCS_AND_API_LINKS)
    station.take_off_and_hover(5.0)
    return station


@pytest.mark.story
@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.binary(max_size=400))
def test_garbage_does_not_affect_a_flight(station: Station, data: bytes) -> None:
    station.sim.feed(0, "gcs", data)
    station.sim.feed(0, "api", b"\xfd" + data)
    station.run(0.04)
    assert station.armed
    assert station.active_mode == HOLD_MODE
    assert 3.0 < station.height_m < 7.0


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(0, 2**31), st.integers(0, 40), st.integers(0, 255))
def test_damaged_frames_do_not_affect_a_flight(station: Station, seed: int, cut: int, flip: int) -> None:
    rng = random.Random(seed)
    layout, payload = pack("COMMAND_LONG", target_system=1, target_component=1, command=400, param2=21196.0)
    frame = bytearray(frame_v2(layout, payload, 0, 255, 190))
    frame[rng.randrange(1, len(frame))] ^= flip or 1
    station.sim.feed(0, "gcs", bytes(frame[: len(frame) - cut]) + bytes(300))
    station.run(0.04)
    assert station.armed


def test_frames_with_unknown_ids_are_skipped_completely(station: Station) -> None:
    unknown_id = next(number for number in range(60000, 70000) if number not in LAYOUTS)
    header = struct.pack("<BBBBBBBHB", 0xFD, 9, 0, 0, 1, 255, 190, unknown_id & 0xFFFF, unknown_id >> 16)
    link = station.sim.nodes[0].context.links[0]
    unknown_count = link.parser.counts.unknown
    station.sim.feed(0, "gcs", (header + bytes(11)) * 50)
    station.run(0.1)
    assert link.parser.counts.unknown == unknown_count + 50
    assert station.armed


@pytest.mark.parametrize("seed", range(SEEDS))
def test_the_simulator_works_after_extreme_values_in_every_message(seed: int) -> None:
    rng = random.Random(seed)
    sim = SimulatedFleet(camera=True, world=load_world("yard"), seed=seed, log=False)
    sim.step(6.0)
    layouts = list(LAYOUTS.values())
    for _ in range(3):
        rng.shuffle(layouts)
        for n, layout in enumerate(layouts):
            payload = extreme_payload(layout, rng)
            if rng.random() < 0.2:
                payload = payload[: rng.randrange(1, len(payload) + 1)]
            sender = rng.choice(((255, 190), (1, 1), (1, 191), (0, 0), (254, 1)))
            sim.feed(0, rng.choice(("gcs", "api")), frame_v2(layout, payload, n & 0xFF, *sender))
            if n % 10 == 0:
                sim.step(0.02)
    assert is_working(sim)


SERVICES = (
    "COMMAND_LONG", "COMMAND_INT", "PARAM_SET", "PARAM_REQUEST_READ", "PARAM_REQUEST_LIST", "MISSION_COUNT",
    "MISSION_ITEM_INT", "MISSION_ITEM", "MISSION_REQUEST_LIST", "MISSION_REQUEST_INT", "MISSION_ACK",
    "MISSION_SET_CURRENT", "MISSION_WRITE_PARTIAL_LIST", "FILE_TRANSFER_PROTOCOL", "SERIAL_CONTROL",
    "LOG_REQUEST_LIST", "LOG_REQUEST_DATA", "LOG_ERASE", "LOG_REQUEST_END", "MANUAL_CONTROL", "PING",
    "SET_POSITION_TARGET_LOCAL_NED", "SET_POSITION_TARGET_GLOBAL_INT", "SET_ATTITUDE_TARGET", "TIMESYNC",
    "GIMBAL_MANAGER_SET_ATTITUDE", "GIMBAL_MANAGER_SET_MANUAL_CONTROL", "SET_GPS_GLOBAL_ORIGIN", "ODOMETRY",
    "VISION_POSITION_ESTIMATE", "SYSTEM_TIME", "SET_MODE", "RC_CHANNELS_OVERRIDE", "FOLLOW_TARGET",
    "REQUEST_EVENT",
)  # fmt: skip


@pytest.mark.parametrize("seed", range(SEEDS))
def test_the_simulator_works_after_extreme_values_to_every_service_in_flight(seed: int) -> None:
    rng = random.Random(1000 + seed)
    station = Station(camera=True, seed=seed)
    station.take_off_and_hover(5.0)
    sim = station.sim
    for n in range(500):
        layout = BY_NAME[rng.choice(SERVICES)]
        sim.feed(0, "gcs", frame_v2(layout, extreme_payload(layout, rng), n & 0xFF, 255, 190))
        if n % 5 == 0:
            sim.step(0.02)
    assert is_working(sim)


@pytest.mark.story
def test_a_flood_takes_limited_memory_and_the_simulator_works_afterwards() -> None:
    sim = SimulatedFleet()
    sim.step(1.0)
    layout, payload = pack("PARAM_REQUEST_LIST", target_system=1, target_component=1)
    flood = b"".join(frame_v2(layout, payload, n & 0xFF, 255, 190) for n in range(2000))
    for _ in range(20):
        sim.feed(0, "gcs", flood)
        sim.step(0.02)
    link = sim.nodes[0].context.links[0]
    assert link._outbox_bytes < 4_100_000
    assert is_working(sim)
