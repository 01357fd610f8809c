"""Priority and lifetime of each message on a link."""

import math

import pytest

from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import FrameParser, encode_frame, encode_payload
from gcs_server.mavlink.priority import SETPOINT_LIFETIME_S, Priority, classify, classify_forwarded
from gcs_server.vehicle.services.transaction import RESEND_S


def command_long(command, p1=0.0, p2=0.0, *, system=1, confirmation=0):
    return d.MAVLink_command_long_message(system, 1, command, confirmation, p1, p2, 0, 0, 0, 0, 0)


def classify_message(message):
    """Classifies a message; the zeros that MAVLink 2 cuts off must not change the priority."""
    payload = encode_payload(message)
    of_payload, of_truncated = (
        classify(message.get_msgId(), payload),
        classify(message.get_msgId(), payload.rstrip(b"\0")),
    )
    assert of_payload.priority == of_truncated.priority
    return of_payload


@pytest.mark.parametrize(
    ("message", "priority"),
    [
        (command_long(400, 0, 21196), Priority.STOP),
        (command_long(185, 1), Priority.STOP),
        (d.MAVLink_command_int_message(1, 1, 0, 400, 0, 0, 0, 21196, 0, 0, 0, 0, 0), Priority.STOP),
        (command_long(400, 1, 21196), Priority.COMMAND),  # arms, with force
        (command_long(400, 0, 0), Priority.MODE),
        (command_long(176, 1, 4), Priority.MODE),
        (command_long(20), Priority.MODE),
        (command_long(21), Priority.MODE),
        (d.MAVLink_set_mode_message(1, 1, 0), Priority.MODE),
        (command_long(400, 1), Priority.COMMAND),
        (command_long(400, math.nan, 21196), Priority.COMMAND),
        (command_long(512, 30), Priority.COMMAND),
        (d.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), Priority.COMMAND),
        (
            d.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0),
            Priority.SETPOINT,
        ),
        (d.MAVLink_set_attitude_target_message(0, 1, 1, 0, [1, 0, 0, 0], 0, 0, 0, 0), Priority.SETPOINT),
        (d.MAVLink_param_request_list_message(1, 1), Priority.OTHER),
        (d.MAVLink_file_transfer_protocol_message(0, 1, 1, [0] * 251), Priority.OTHER),
    ],
)
def test_each_message_has_its_priority(message, priority):
    assert classify_message(message).priority is priority


def test_a_setpoint_replaces_only_setpoints_of_its_vehicle():
    local = d.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0)
    attitude = d.MAVLink_set_attitude_target_message(0, 1, 1, 0, [1, 0, 0, 0], 0, 0, 0, 0)
    other = d.MAVLink_set_attitude_target_message(0, 2, 1, 0, [1, 0, 0, 0], 0, 0, 0, 0)
    assert classify_message(local).key == classify_message(attitude).key != classify_message(other).key
    assert classify_message(local).lifetime_s == SETPOINT_LIFETIME_S == 0.1


def test_a_repeated_command_replaces_only_itself():
    assert (
        classify_message(command_long(530, 1)).key
        == classify_message(command_long(530, 1, confirmation=3)).key
    )
    assert classify_message(command_long(511, 30)).key != classify_message(command_long(511, 31)).key
    assert classify_message(command_long(512)).flight is None
    hold, arm, stop = command_long(176, 1, 4), command_long(400, 1), command_long(400, 0, 21196)
    assert classify_message(hold).flight == classify_message(arm).flight == classify_message(stop).flight
    assert classify_message(arm).flight != classify_message(command_long(400, 1, system=2)).flight


def test_commands_expire_before_their_repetition():
    assert classify_message(command_long(176)).lifetime_s <= RESEND_S
    assert classify_message(command_long(400, 1)).lifetime_s <= RESEND_S


def test_forwarded_commands_keep_their_order_except_stop_motors():
    def forwarded(message, system=254):
        raw = encode_frame(message.get_msgId(), encode_payload(message), 0, system, 190)
        (frame,) = FrameParser().feed(raw, 0.0)
        return classify_forwarded(frame)

    assert forwarded(command_long(400, 0, 21196)).priority is Priority.STOP
    arm, disarm = forwarded(command_long(400, 1)), forwarded(command_long(400, 0))
    assert arm.priority is disarm.priority is Priority.COMMAND
    assert arm.key is arm.flight is disarm.flight is None
    stop = command_long(400, 0, 21196)
    assert forwarded(stop, 254).key != forwarded(stop, 253).key
