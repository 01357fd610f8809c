"""The frame parser and encoder compared with pymavlink, with frames in pieces and garbage between them."""

import math
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_server.mavlink import codec, dialect
from gcs_server.mavlink.tables import LAYOUTS, TARGET_SYSTEM_OFFSET
from vehicle_sim.mavlink import generated_dialect as sim_dialect

RANGES = {
    "uint8_t": (0, 255),
    "int8_t": (-128, 127),
    "uint16_t": (0, 65535),
    "int16_t": (-(2**15), 2**15 - 1),
    "uint32_t": (0, 2**32 - 1),
    "int32_t": (-(2**31), 2**31 - 1),
    "uint64_t": (0, 2**64 - 1),
    "int64_t": (-(2**63), 2**63 - 1),
    "uint8_t_mavlink_version": (0, 255),
}


def field_values(field_type, length):
    """Values of a field; length 0: no array."""
    if field_type == "char":
        return st.binary(min_size=length, max_size=length) if length else st.binary(min_size=1, max_size=1)
    if field_type in ("float", "double"):
        value = st.floats(width=32 if field_type == "float" else 64, allow_nan=False)
    else:
        value = st.integers(*RANGES[field_type])
    return st.lists(value, min_size=length, max_size=length) if length else value


@st.composite
def messages(draw, module=sim_dialect):
    message_class = module.mavlink_map[draw(st.sampled_from(sorted(LAYOUTS.keys() & module.mavlink_map)))]
    array_lengths = dict(zip(message_class.ordered_fieldnames, message_class.array_lengths, strict=True))
    return message_class(
        *[
            draw(field_values(field_type, array_lengths[name]))
            for name, field_type in zip(message_class.fieldnames, message_class.fieldtypes, strict=True)
        ]
    )


def pack_frame(message, seq, *, v1=False, system=3, component=7):
    mav = sim_dialect.MAVLink(None, srcSystem=system, srcComponent=component)
    mav.seq = seq
    return message.pack(mav, force_mavlink1=v1)


@settings(max_examples=300, deadline=None)
@given(messages(), st.integers(0, 255))
def test_frames_of_pymavlink_are_read_and_packed_identically(message, seq):
    raw = pack_frame(message, seq)
    (frame,) = codec.FrameParser().feed(raw, 5.0)
    assert (frame.msg_id, frame.system_id, frame.component_id, frame.seq) == (message.get_msgId(), 3, 7, seq)
    assert (frame.raw, frame.received_monotonic_s) == (raw, 5.0)
    decoded = codec.decode(frame)
    assert codec.encode_frame(message.get_msgId(), codec.encode_payload(decoded), seq, 3, 7) == raw
    expected = sim_dialect.MAVLink(None).decode(bytearray(raw))
    for name in message.get_fieldnames():
        value = getattr(decoded, name)
        assert value == getattr(expected, name) or value != value  # NaN differs from itself
    assert (decoded.get_srcSystem(), decoded.get_srcComponent(), decoded.get_seq()) == (3, 7, seq)


@settings(max_examples=80, deadline=None)
@given(st.lists(messages(), min_size=1, max_size=6), st.data())
def test_frames_are_found_in_data_in_pieces_and_between_garbage(batch, data):
    raws, stream, garbage_bytes = [], b"", 0
    for number, message in enumerate(batch):
        garbage = data.draw(
            st.binary(max_size=20).map(lambda b: b.replace(b"\xfd", b"").replace(b"\xfe", b""))
        )
        garbage_bytes += len(garbage)
        raws.append(pack_frame(message, number))
        stream += garbage + raws[-1]
    parser = codec.FrameParser()
    frames = []
    while stream:
        size = data.draw(st.integers(1, max(1, len(stream))))
        frames += parser.feed(stream[:size], 0.0)
        stream = stream[size:]
    assert [f.raw for f in frames] == raws
    assert parser.bytes_skipped == garbage_bytes
    assert not parser.lost


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=600))
def test_garbage_raises_no_error_and_the_next_frame_is_found(garbage):
    parser = codec.FrameParser()
    parser.feed(garbage, 0.0)
    valid = pack_frame(sim_dialect.MAVLink_heartbeat_message(2, 12, 29, 0, 4, 3), 9)
    valid_frames = []
    for _ in range(40):  # enough bytes to complete a frame with a false header
        valid_frames += [f for f in parser.feed(valid, 0.0) if f.raw == valid]
    assert len(valid_frames) >= 25  # a false header takes at most 280 bytes, 14 frames


@settings(max_examples=150, deadline=None)
@given(messages(), st.data())
def test_a_damaged_frame_is_dropped_and_the_next_frame_is_kept(message, data):
    raw = bytearray(pack_frame(message, 1))
    index = data.draw(st.integers(1, len(raw) - 1))
    raw[index] ^= data.draw(st.integers(1, 255))
    # Enough pings to complete a frame with a false header.
    valid_frames = [pack_frame(sim_dialect.MAVLink_ping_message(n, n, 0, 0), 2 + n) for n in range(14)]
    frames = codec.FrameParser().feed(bytes(raw) + b"".join(valid_frames), 0.0)
    assert valid_frames[-1] in [f.raw for f in frames]
    assert not any(f.raw == bytes(raw) and f.known for f in frames)


def test_mavlink_1_and_signed_frames_are_read():
    heartbeat = sim_dialect.MAVLink_heartbeat_message(2, 12, 29, 50593792, 4, 3)
    mavlink_1 = pack_frame(heartbeat, 4, v1=True)
    mav = sim_dialect.MAVLink(None, srcSystem=3, srcComponent=7)
    mav.signing.secret_key, mav.signing.sign_outgoing = b"k" * 32, True
    signed = heartbeat.pack(mav)
    assert len(signed) == 21 + 13
    frames = codec.FrameParser().feed(mavlink_1 + signed + mavlink_1, 0.0)
    assert [f.raw for f in frames] == [mavlink_1, signed, mavlink_1]
    assert {codec.decode(f).custom_mode for f in frames} == {50593792}


def test_an_unknown_message_is_kept_as_bytes():
    raw = b"\xfd\x03\x00\x00\x05\x01\x01\xff\xff\x0a" + b"abc" + b"\x12\x34"
    valid = pack_frame(sim_dialect.MAVLink_ping_message(1, 2, 0, 0), 1)
    parser = codec.FrameParser()
    unknown, known = parser.feed(raw + valid, 0.0)
    assert (unknown.msg_id, unknown.payload, unknown.known) == (0x0AFFFF, b"abc", False)
    assert codec.decode(unknown) is None
    assert known.raw == valid
    assert parser.frames_unknown == 1


def test_lost_frames_are_counted_by_sender_also_when_the_sequence_number_wraps():
    parser = codec.FrameParser()
    ping = sim_dialect.MAVLink_ping_message(1, 2, 0, 0)
    for seq in (250, 251, 254, 0, 3, 2):
        parser.feed(pack_frame(ping, seq), 0.0)
    parser.feed(pack_frame(ping, 77, component=9), 0.0)
    assert parser.lost == {(3, 7): 2 + 1 + 2}  # 252 and 253; 255; 1 and 2


def test_crc_errors_are_counted():
    raw = bytearray(pack_frame(sim_dialect.MAVLink_ping_message(1, 2, 0, 0), 1))
    raw[-1] ^= 1
    parser = codec.FrameParser()
    assert parser.feed(bytes(raw), 0.0) == []
    assert parser.crc_errors == 1


def test_truncated_zeros_and_longer_payloads_are_decoded():
    payload = struct.pack("<IBB", 7, 2, 12)
    (frame,) = codec.FrameParser().feed(codec.encode_frame(0, payload, 0, 1, 1), 0.0)
    assert codec.full_payload(frame) == payload + b"\0" * 3
    assert codec.decode(frame).base_mode == 0
    longer_frame = codec.Frame(0, 1, 1, 0, codec.encode_frame(0, b"\1" * 12, 0, 1, 1), 0.0)
    assert codec.full_payload(longer_frame) == b"\1" * 9


def test_target_systems_are_found_at_their_offsets():
    for msg_id, offset in TARGET_SYSTEM_OFFSET.items():
        layout = LAYOUTS[msg_id]
        payload = bytearray(layout.unpacker.size)
        payload[offset] = 42
        raw = codec.encode_frame(msg_id, bytes(payload), 0, 1, 1)
        frame = codec.Frame(msg_id, 1, 1, 0, raw, 0.0)
        assert codec.decode(frame).target_system == 42
    assert dialect.MAVLINK_MSG_ID_COMMAND_LONG in TARGET_SYSTEM_OFFSET
    assert dialect.MAVLINK_MSG_ID_HEARTBEAT not in TARGET_SYSTEM_OFFSET


def test_nan_is_encoded_and_decoded():
    message = dialect.MAVLink_command_long_message(1, 1, 22, 0, math.nan, 1, 2, 3, 4, 5, math.nan)
    (frame,) = codec.FrameParser().feed(
        codec.encode_frame(dialect.MAVLINK_MSG_ID_COMMAND_LONG, codec.encode_payload(message), 0, 255, 190),
        0.0,
    )
    assert math.isnan(codec.decode(frame).param7)


@pytest.mark.parametrize("count", [200])
def test_parsing_a_frame_takes_less_than_15_us(count):
    import time

    raw = b"".join(
        pack_frame(sim_dialect.MAVLink_attitude_message(1, 0.1, 0.2, 0.3, 0, 0, 0), n & 255)
        for n in range(count)
    )
    parser, fastest_s = codec.FrameParser(), math.inf
    for _ in range(20):
        began_s = time.perf_counter()
        parser.feed(raw, 0.0)
        fastest_s = min(fastest_s, time.perf_counter() - began_s)
    assert fastest_s / count < 15e-6  # parsing takes about 1.5 µs; pymavlink takes 20 µs
