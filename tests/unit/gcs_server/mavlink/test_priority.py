"""Priority and lifetime of each message on a link."""

import math

import pytest

from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import FrameParser, encode_frame, encode_payload
from gcs_server.mavlink.priority import SETPOINT_LIFETIME_S, Priority, classify, classify_forwarded
from gcs_server.vehicle.services.transaction import RESEND_S

ARM_DISARM, TERMINATE, SET_MODE, RETURN, LAND = 400, 185, 176, 20, 21
SET_MESSAGE_INTERVAL, REQUEST_MESSAGE, SET_CAMERA_MODE = 511, 512, 530
FORCE = 21196
"""Parameter 2 of ARM_DISARM."""


def command_long(command, p1=0.0, p2=0.0, *, system=1, confirmation=0):
    return d.MAVLink_command_long_message(system, 1, command, confirmation, p1, p2, 0, 0, 0, 0, 0)


def classify_message(message):
    """Classifies a message; the zeros that MAVLink 2 cuts off must not change the priority."""
    payload = encode_payload(message)
    of_full_payload, of_truncated_payload = (
        classify(message.get_msgId(), payload),
        classify(message.get_msgId(), payload.rstrip(b"\0")),
    )
    assert of_full_payload.priority == of_truncated_payload.priority
    return of_full_payload


@pytest.mark.parametrize(
    ("message", "priority"),
    [
        (command_long(ARM_DISARM, 0, FORCE), Priority.STOP),
        (command_long(TERMINATE, 1), Priority.STOP),
        (d.MAVLink_command_int_message(1, 1, 0, ARM_DISARM, 0, 0, 0, FORCE, 0, 0, 0, 0, 0), Priority.STOP),
        (command_long(ARM_DISARM, 1, FORCE), Priority.COMMAND),  # arms, with force
        (command_long(ARM_DISARM, 0, 0), Priority.MODE),
        (command_long(SET_MODE, 1, 4), Priority.MODE),
        (command_long(RETURN), Priority.MODE),
        (command_long(LAND), Priority.MODE),
        (d.MAVLink_set_mode_message(1, 1, 0), Priority.MODE),
        (command_long(ARM_DISARM, 1), Priority.COMMAND),
        (command_long(ARM_DISARM, math.nan, FORCE), Priority.COMMAND),
        (command_long(REQUEST_MESSAGE, 30), Priority.COMMAND),
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
    position = d.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0)
    attitude = d.MAVLink_set_attitude_target_message(0, 1, 1, 0, [1, 0, 0, 0], 0, 0, 0, 0)
    attitude_of_vehicle_2 = d.MAVLink_set_attitude_target_message(0, 2, 1, 0, [1, 0, 0, 0], 0, 0, 0, 0)
    assert (
        classify_message(position).key
        == classify_message(attitude).key
        != classify_message(attitude_of_vehicle_2).key
    )
    assert classify_message(position).lifetime_s == SETPOINT_LIFETIME_S == 0.1


def test_a_repeated_command_replaces_only_itself_and_flight_commands_share_the_group_of_their_vehicle():
    assert (
        classify_message(command_long(SET_CAMERA_MODE, 1)).key
        == classify_message(command_long(SET_CAMERA_MODE, 1, confirmation=3)).key
    )
    assert (
        classify_message(command_long(SET_MESSAGE_INTERVAL, 30)).key
        != classify_message(command_long(SET_MESSAGE_INTERVAL, 31)).key
    )
    assert classify_message(command_long(REQUEST_MESSAGE)).flight is None
    hold, arm, stop = (
        command_long(SET_MODE, 1, 4),
        command_long(ARM_DISARM, 1),
        command_long(ARM_DISARM, 0, FORCE),
    )
    assert classify_message(hold).flight == classify_message(arm).flight == classify_message(stop).flight
    assert classify_message(arm).flight != classify_message(command_long(ARM_DISARM, 1, system=2)).flight


def test_commands_expire_before_their_repetition():
    assert classify_message(command_long(SET_MODE)).lifetime_s <= RESEND_S
    assert classify_message(command_long(ARM_DISARM, 1)).lifetime_s <= RESEND_S


def test_forwarded_commands_keep_their_order_except_stop_motors():
    def classify_forwarded_message(message, system=254):
        raw = encode_frame(message.get_msgId(), encode_payload(message), 0, system, 190)
        (frame,) = FrameParser().feed(raw, 0.0)
        return classify_forwarded(frame)

    assert classify_forwarded_message(command_long(ARM_DISARM, 0, FORCE)).priority is Priority.STOP
    arm, disarm = (
        classify_forwarded_message(command_long(ARM_DISARM, 1)),
        classify_forwarded_message(command_long(ARM_DISARM, 0)),
    )
    assert arm.priority is disarm.priority is Priority.COMMAND
    assert arm.key is arm.flight is disarm.flight is None
    stop = command_long(ARM_DISARM, 0, FORCE)
    assert classify_forwarded_message(stop, 254).key != classify_forwarded_message(stop, 253).key
