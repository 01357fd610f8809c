"""Each setpoint type as a MAVLink message, decoded by pymavlink, which shares no code with the encoder."""

import math
import struct
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_server.mavlink.codec import encode_frame
from gcs_server.streamer.transport import mavlink
from missions.setpoints import (
    Acceleration,
    Actuators,
    Attitude,
    Position,
    PositionGlobal,
    Rates,
    Trajectory,
    Velocity,
    VelocityBody,
)
from vehicle_sim.mavlink import generated_dialect as pymavlink_dialect

number = st.floats(-1000, 1000, width=32)
angle = st.floats(-3.125, 3.125, width=32)
vector = st.tuples(number, number, number)
optional_number = st.none() | number
partial_vector = st.tuples(optional_number, optional_number, optional_number)
TARGET = (7, 1)


def encode_and_decode(setpoint):
    """Encodes a setpoint and decodes it with pymavlink."""
    msg_id, payload = mavlink.encode(setpoint, TARGET)
    raw = encode_frame(msg_id, mavlink.with_time(payload, 12.5), 3, 255, 190)
    (message,) = pymavlink_dialect.MAVLink(None).parse_buffer(raw)
    assert (message.target_system, message.target_component) == TARGET
    assert message.time_boot_ms == 12500
    return message


def without_ignored(values, bits, mask):
    """The values, with None for values that the mask ignores."""
    return tuple(None if mask & bit else value for value, bit in zip(values, bits, strict=True))


# Setpoint, message id, frame and type mask of PX4's documentation.
DOCUMENTED_MASKS = [
    (Position((1.0, 2.0, -3.0), yaw_ned_rad=0.5), 84, 1, 2552),
    (Position((1.0, 2.0, -3.0), yaw_rate_ned_rad_s=0.5), 84, 1, 1528),
    (Velocity((1.0, 2.0, -3.0), yaw_rate_ned_rad_s=0.5), 84, 1, 1479),
    (Velocity((1.0, 2.0, -3.0), yaw_ned_rad=0.5), 84, 1, 2503),
    (VelocityBody((1.0, 2.0, -3.0), yaw_rate_ned_rad_s=0.5), 84, 8, 1479),
    (Acceleration((1.0, 2.0, -3.0)), 84, 1, 3135),
    (Trajectory((1.0, 2.0, -3.0), (4.0, 5.0, 6.0), (7.0, 8.0, 9.0), yaw_ned_rad=0.5), 84, 1, 2048),
    (Trajectory((1.0, 2.0, None), (None, None, 6.0), yaw_ned_rad=0.5), 84, 1, 4 | 8 | 16 | 448 | 2048),
    (PositionGlobal(47.5, 8.5, alt_amsl_m=500.0, yaw_ned_rad=0.5), 86, 5, 2552),
    (Attitude((1.0, 0.0, 0.0, 0.0), 0.5), 82, None, 7),
    (Attitude((1.0, 0.0, 0.0, 0.0), 0.5, yaw_rate_ned_rad_s=0.2), 82, None, 3),
    (Rates((0.1, 0.2, 0.3), 0.5), 82, None, 128),
]


@pytest.mark.parametrize(("setpoint", "msg_id", "frame", "mask"), DOCUMENTED_MASKS)
def test_message_frame_and_mask_match_px4s_documentation(setpoint, msg_id, frame, mask):
    message = encode_and_decode(setpoint)
    assert message.get_msgId() == msg_id
    assert message.type_mask == mask
    assert getattr(message, "coordinate_frame", None) == frame


POSITION, VELOCITY, ACCELERATION = (1, 2, 4), (8, 16, 32), (64, 128, 256)


@given(partial_vector, partial_vector, partial_vector, optional_number, optional_number)
def test_empty_fields_are_ignored_and_other_fields_arrive(position, velocity, acceleration, yaw, rate):
    m = encode_and_decode(Trajectory(position, velocity, acceleration, yaw, rate))
    assert without_ignored((m.x, m.y, m.z), POSITION, m.type_mask) == position
    assert without_ignored((m.vx, m.vy, m.vz), VELOCITY, m.type_mask) == velocity
    assert without_ignored((m.afx, m.afy, m.afz), ACCELERATION, m.type_mask) == acceleration
    assert not m.type_mask & 512  # the force bit is never set
    (received_yaw, received_rate) = without_ignored((m.yaw, m.yaw_rate), (1024, 2048), m.type_mask)
    assert (received_yaw is None, received_rate is None) == (yaw is None, rate is None)
    if yaw is not None:
        assert -math.pi - 1e-6 <= received_yaw <= math.pi + 1e-6
        assert math.remainder(received_yaw - yaw, math.tau) == pytest.approx(0, abs=1e-4)
    if rate is not None:
        assert received_rate == rate


@given(vector, angle)
def test_a_body_velocity_never_has_an_ignore_bit_of_velocity(velocity, yaw):
    """PX4 ignores a message with one of these bits."""
    m = encode_and_decode(VelocityBody(velocity, yaw_ned_rad=yaw))
    assert m.type_mask & 0b111111111 == 0b111000111
    assert (m.vx, m.vy, m.vz) == velocity


@given(st.floats(-90, 90), st.floats(-180, 180), st.floats(-500, 9000, width=32))
def test_a_global_position_is_encoded_within_two_centimetres(lat, lon, alt):
    m = encode_and_decode(PositionGlobal(lat, lon, alt_amsl_m=alt, yaw_ned_rad=0.0))
    assert m.lat_int == pytest.approx(lat * 1e7, abs=0.51)
    assert m.lon_int == pytest.approx(lon * 1e7, abs=0.51)
    assert m.alt == alt


@given(st.tuples(angle, angle, angle, angle), optional_number, st.floats(0, 1, width=32))
def test_attitude_and_thrust_arrive(q, rate, thrust):
    m = encode_and_decode(Attitude(q, thrust, yaw_rate_ned_rad_s=rate))
    assert tuple(m.q) == q
    assert m.thrust == thrust
    assert m.type_mask & 128 == 0  # the attitude is used
    assert m.type_mask & 64 == 0  # the thrust is used
    assert without_ignored((m.body_yaw_rate,), (4,), m.type_mask) == (rate,)


@given(vector, st.floats(0, 1, width=32))
def test_body_rates_and_thrust_arrive_and_no_axis_is_ignored(rates, thrust):
    m = encode_and_decode(Rates(rates, thrust))
    assert (m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate) == rates
    assert m.type_mask & (1 | 2 | 4 | 64) == 0
    assert tuple(m.q) == (1.0, 0.0, 0.0, 0.0)


def test_only_the_time_changes_between_transmissions():
    _, payload = mavlink.encode(Position((1.0, 2.0, -3.0)), TARGET)
    early, late = mavlink.with_time(payload, 1.0), mavlink.with_time(payload, 5e6)
    assert early[4:] == late[4:] == payload[4:]
    assert struct.unpack("<I", late[:4])[0] == int(5e9) & 0xFFFFFFFF


def test_types_without_a_mavlink_message_have_no_encoder():
    assert {"thrust_torque", "actuators"}.isdisjoint(mavlink.MAVLINK_KINDS)
    with pytest.raises(KeyError):
        mavlink.encode(Actuators((0.5,)), TARGET)
    with pytest.raises(ValueError, match="above mean sea level"):
        mavlink.encode(replace(PositionGlobal(0.0, 0.0), alt_home_m=5.0), TARGET)


@pytest.mark.parametrize(("mode", "sub"), [("hold", 3), ("land", 6)])
def test_mode_commands_are_do_set_mode_with_a_confirmation_of_at_most_255(mode, sub):
    payload = mavlink.mode_command(mode, TARGET, 300)
    raw = encode_frame(mavlink.MSG_COMMAND_LONG, payload, 0, 255, 190)
    (m,) = pymavlink_dialect.MAVLink(None).parse_buffer(raw)
    assert (m.command, m.param1, m.param2, m.param3) == (176, 1, 4, sub)
    assert (m.target_system, m.target_component, m.confirmation) == (7, 1, 255)
