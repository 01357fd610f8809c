"""Setpoints of programs become this server's kinds, and mean the same."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import fields

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_server.errors import InvalidRequest
from gcs_server.guard.setpoints import convert
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame, decode
from gcs_server.streamer.transport.mavlink import MAVLINK_KINDS, encode
from missions import setpoints as s

TARGET = (1, 1)
metres, speeds, angles = st.floats(-1000, 1000), st.floats(-20, 20), st.floats(-3.1, 3.1)
rates = st.floats(-3.4, 3.4)


def triples(values):
    return st.tuples(values, values, values)


def partial(values):
    return st.tuples(*(st.none() | values for _ in range(3))).filter(lambda v: v != (None, None, None))


def with_heading(kind, **values):
    headings = st.one_of(
        st.just({}),
        angles.map(lambda yaw: {"yaw_ned_rad": yaw}),
        rates.map(lambda rate: {"yaw_rate_ned_rad_s": rate}),
    )
    return st.builds(lambda v, heading: kind(**v, **heading), st.fixed_dictionaries(values), headings)


quaternions = st.tuples(*(st.floats(-1, 1) for _ in range(4))).filter(lambda q: math.hypot(*q) > 0.1)
attitudes = st.builds(
    lambda q, thrust, rate: s.Attitude(tuple(x / math.hypot(*q) for x in q), thrust, rate),
    quaternions,
    st.floats(0, 1),
    st.none() | rates,
)
two_of_three = st.builds(
    lambda p, v, a, left_out: s.Trajectory(
        *(s.UNCONTROLLED if n == left_out else each for n, each in enumerate((p, v, a)))
    ),
    triples(metres),
    triples(speeds),
    triples(speeds),
    st.sampled_from([None, 0, 1, 2]),
)
KINDS = st.one_of(
    with_heading(s.Position, position_ned_m=partial(metres)),
    with_heading(s.Velocity, velocity_ned_m_s=partial(speeds)),
    with_heading(s.VelocityBody, velocity_frd_m_s=triples(speeds)),
    with_heading(s.Acceleration, acceleration_ned_m_s2=partial(speeds)),
    two_of_three,
    attitudes,
    st.builds(s.Rates, triples(rates), st.floats(0, 1)),
    with_heading(
        s.PositionGlobal,
        lat_deg=st.floats(-89, 89),
        lon_deg=st.floats(-179, 179),
        alt_amsl_m=st.floats(0, 9000),
    ),
)


def message_of(setpoint):
    msg_id, payload = encode(setpoint, TARGET)
    header = bytes((0xFD, len(payload), 0, 0, 0, 245, 190, msg_id, 0, 0))
    return decode(Frame(msg_id, 245, 190, 0, header + payload + b"\0\0", 0.0))


def names_of(setpoint):
    return [field.name for field in fields(setpoint)]


def close(a, b):
    if a is None or b is None:
        return a is b
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(close, a, b))
    return math.isclose(a, b, rel_tol=1e-5, abs_tol=1e-5)


@given(KINDS)
def test_what_the_server_sends_itself_is_read_as_the_same_setpoint(setpoint):
    converted = convert(message_of(setpoint))
    assert type(converted.setpoint) is type(setpoint)
    assert converted.left_out == ()
    for name in names_of(setpoint):
        assert close(getattr(converted.setpoint, name), getattr(setpoint, name)), name


def test_every_kind_that_mavlink_carries_is_converted():
    assert {"position", "velocity", "velocity_body", "acceleration", "trajectory", "attitude", "rates",
            "position_global"} == MAVLINK_KINDS  # fmt: skip


def local(frame=1, mask=0, position=(0, 0, 0), velocity=(0, 0, 0), acceleration=(0, 0, 0), yaw=0.0, rate=0.0):
    return d.MAVLink_set_position_target_local_ned_message(
        0, *TARGET, frame, mask, *position, *velocity, *acceleration, yaw, rate
    )


POSITION_ONLY, VELOCITY_ONLY = 0b110111111000, 0b110111000111


@given(st.integers(0, 4095), st.integers(0, 12), st.lists(st.floats(width=32), min_size=11, max_size=11))
def test_any_message_is_a_setpoint_within_limits_or_refused_by_a_field(mask, frame, values):
    message = d.MAVLink_set_position_target_local_ned_message(0, *TARGET, frame, mask, *values)
    setpoint = None
    with suppress(InvalidRequest):  # which names a field
        setpoint = convert(message).setpoint
    if setpoint is None:
        return
    assert s.contradiction_of(setpoint) is None
    numbers = [v for name in names_of(setpoint) if isinstance(v := getattr(setpoint, name), tuple)]
    assert all(math.isfinite(v) for each in numbers for v in each if v is not None)


@pytest.mark.parametrize(
    ("message", "field"),
    [
        (local(mask=POSITION_ONLY, position=(math.nan, 0, 0)), "x"),
        (local(mask=POSITION_ONLY & ~1024, yaw=math.inf), "yaw"),
        (local(frame=7, mask=POSITION_ONLY), "coordinate_frame"),
        (local(frame=8, mask=POSITION_ONLY), "type_mask"),
        (local(mask=0b110111111111), "type_mask"),
        (local(mask=VELOCITY_ONLY, velocity=(0, 30, 0)), "velocity_ned_m_s.1"),
        (d.MAVLink_set_attitude_target_message(0, *TARGET, 7, [2, 0, 0, 0], 0, 0, 0, 0.5), "q"),
        (d.MAVLink_set_attitude_target_message(0, *TARGET, 7, [1, 0, 0, 0], 0, 0, 0, 1.5), "thrust"),
        (d.MAVLink_set_attitude_target_message(0, *TARGET, 64, [1, 0, 0, 0], 0, 0, 0, 0.5), "type_mask"),
        (d.MAVLink_set_attitude_target_message(0, *TARGET, 129, [1, 0, 0, 0], 0, 0, 0, 0.5), "type_mask"),
        (
            d.MAVLink_set_position_target_global_int_message(
                0, *TARGET, 11, POSITION_ONLY, 470000000, 80000000, 10, 0, 0, 0, 0, 0, 0, 0, 0
            ),
            "coordinate_frame",
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_flown_is_refused_by_its_field(message, field):
    with pytest.raises(InvalidRequest) as refused:
        convert(message)
    assert refused.value.field == field


def test_what_is_left_out_is_said():
    both_headings = convert(local(mask=POSITION_ONLY & ~3072, yaw=1.0, rate=0.2))
    assert both_headings.setpoint == s.Position((0.0, 0.0, 0.0), yaw_ned_rad=1.0)
    assert both_headings.left_out == ("the yaw rate beside a yaw",)
    in_body = convert(local(frame=8, mask=0b110111000000, position=(1, 2, 3), velocity=(1, 0, 0)))
    assert in_body.setpoint == s.VelocityBody((1.0, 0.0, 0.0))
    assert in_body.left_out == ("the position, which PX4 ignores in frame 8",)
