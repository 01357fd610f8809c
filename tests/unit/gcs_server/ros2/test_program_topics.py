"""Messages of ROS 2 programs become the MAVLink messages that mean the same."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_server.guard.setpoints import convert
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import FrameParser, decode, encode_frame, encode_payload
from gcs_server.ros2 import program_topics as topics
from gcs_server.ros2.program_topics import ProgramTopics, command_message, setpoint_message
from missions import setpoints as s

NAN3 = (math.nan,) * 3
numbers = st.floats(-500.0, 500.0, width=32)
axes = st.tuples(*[st.one_of(st.just(math.nan), numbers)] * 3)


def trajectory(position=NAN3, velocity=NAN3, acceleration=NAN3, yaw=math.nan, yawspeed=math.nan):
    return {
        "position": position, "velocity": velocity, "acceleration": acceleration, "yaw": yaw,
        "yawspeed": yawspeed,
    }  # fmt: skip


def command(**fields):
    zeros = {f"param{n}": 0.0 for n in range(1, 8)}
    ids = {"target_system": 1, "target_component": 1, "source_system": 7, "source_component": 3}
    return {**zeros, **ids, "command": 176, "confirmation": 0, **fields}


def frames(data):
    return [decode(each) for each in FrameParser().feed(data, 0.0)]


@given(axes, axes, axes)
def test_axes_without_a_number_are_ignored_and_the_others_stay(position, velocity, acceleration):
    message = setpoint_message(topics.TRAJECTORY, trajectory(position, velocity, acceleration, yaw=0.5))
    for n, (name, value) in enumerate(
        zip(
            ["x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz"],
            (*position, *velocity, *acceleration),
            strict=True,
        )
    ):
        assert bool(message.type_mask >> n & 1) == math.isnan(value)
        assert math.isnan(value) or getattr(message, name) == value
    assert (message.type_mask & 1024, message.yaw, message.type_mask & 2048) == (0, 0.5, 2048)


def test_each_setpoint_is_the_kind_that_px4_flies():
    flown = convert(setpoint_message(topics.TRAJECTORY, trajectory(velocity=(1.0, 2.0, math.nan))))
    assert flown.setpoint == s.Velocity((1.0, 2.0, None))
    attitude = {"q_d": (1.0, 0.0, 0.0, 0.0), "thrust_body": (0.0, 0.0, -0.6), "yaw_sp_move_rate": 0.1}
    flown = convert(setpoint_message(topics.ATTITUDE, attitude))
    assert flown.setpoint == s.Attitude((1.0, 0.0, 0.0, 0.0), 0.6, 0.1)
    flown = convert(setpoint_message(topics.ATTITUDE, {**attitude, "yaw_sp_move_rate": math.nan}))
    assert flown.setpoint == s.Attitude((1.0, 0.0, 0.0, 0.0), 0.6, None)
    rates = {"roll": 0.1, "pitch": 0.2, "yaw": 0.3, "thrust_body": (0.1, 0.0, -0.5)}
    flown = convert(setpoint_message(topics.RATES, rates))
    assert flown.setpoint == s.Rates((0.1, 0.2, 0.3), 0.5)
    assert "thrust_body" in flown.left_out[0], "PX4 flies only its part along the body's axis"


@given(st.floats(-90.0, 90.0), st.floats(-180.0, 180.0))
def test_a_place_is_not_rounded_to_float32(lat_deg, lon_deg):
    message = command_message(command(command=192, param5=lat_deg, param6=lon_deg, param7=480.0))
    if message.get_type() == "COMMAND_INT":
        assert (message.x / 1e7, message.y / 1e7) == pytest.approx((lat_deg, lon_deg), abs=1e-7)
        assert message.z == 480.0
    else:
        assert (message.param5, message.param6, message.param7) == (lat_deg, lon_deg, 480.0)


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e12, -3e38])
def test_any_number_of_a_command_can_be_sent(value):
    message = command_message(command(param5=value, param6=1.1))
    encode_payload(message)


def test_a_setpoint_counts_with_its_mode_and_is_passed_again_with_each_mode_without_a_new_one():
    program = ProgramTopics(1)
    here = trajectory((1.0, 2.0, -3.0))
    assert program.take(topics.TRAJECTORY, here, 0.0) == b"", "PX4 is not told yet what it is for"
    mode = dict.fromkeys(topics.SETPOINT_OF_FLAG, False) | {"position": True}
    assert program.take(topics.CONTROL_MODE, mode, 0.1) == b""
    assert program.due(0.11, lambda: None) == b"", "its setpoint may be on its way"
    (sent,) = frames(program.due(0.2, lambda: None))
    assert (sent.x, sent.y, sent.z) == (1.0, 2.0, -3.0)
    assert program.due(0.3, lambda: None) == b"", "one for each"
    assert frames(program.take(topics.TRAJECTORY, here, 0.4))
    assert program.take(topics.TRAJECTORY, here, 2.0) == b"", "PX4 has left Offboard by then"
    program.take(topics.CONTROL_MODE, {**mode, "position": False, "attitude": True}, 2.1)
    assert program.take(topics.TRAJECTORY, here, 2.2) == b"", "another setpoint is flown"


def test_without_a_setpoint_the_place_is_kept_where_the_vehicle_was_first():
    program, mode = ProgramTopics(1), dict.fromkeys(topics.SETPOINT_OF_FLAG, False) | {"velocity": True}

    def at(x, valid=True):
        return lambda: {"x": x, "y": 2.0, "z": -3.0, "xy_valid": valid, "z_valid": True}

    sent = []
    for now_s, position in ((0.0, at(0.0, False)), (1.0, at(1.0)), (2.0, at(9.0))):
        program.take(topics.CONTROL_MODE, mode, now_s)
        sent += frames(program.due(now_s + 0.1, position))
    assert [(each.x, each.y, each.z) for each in sent] == [(1.0, 2.0, -3.0)] * 2
    assert sent[0].type_mask & 0b111 == 0


def test_an_answer_is_for_the_program_that_sent_the_command():
    program = ProgramTopics(1)
    (sent,) = FrameParser().feed(program.take(topics.COMMAND, command(), 0.0), 0.0)
    assert (sent.system_id, sent.component_id) == (7, 3)
    ack = d.MAVLink_command_ack_message(176, 1, 0, 0, 1, topics.COMPONENT)
    (frame,) = FrameParser().feed(encode_frame(77, encode_payload(ack), 0, 1, 1), 0.0)
    answer = program.answer(frame)
    assert answer is not None
    assert (answer["command"], answer["result"]) == (176, 1)
    assert (answer["target_system"], answer["target_component"]) == (7, 3)
    (text,) = FrameParser().feed(encode_frame(253, b"\4GCS", 0, 1, 1), 0.0)
    assert program.answer(text) is None
