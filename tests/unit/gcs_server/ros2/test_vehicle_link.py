"""One vehicle of a ROS 2 link: commands and their acknowledgements, and messages that cannot be used."""

from __future__ import annotations

import math
from typing import Any

import pytest

from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import FrameParser, decode, encode_frame, encode_payload
from gcs_server.ros2.message_types import MESSAGES, VERSIONS
from gcs_server.ros2.vehicle_link import VehicleLink
from tests.support.dds_samples import recorded_samples
from tests.support.px4_formats import formats_of_version

STATUS, ACK = "/fmu/out/vehicle_status", "/fmu/out/vehicle_command_ack"
FAILSAFE_FLAGS = "/fmu/out/failsafe_flags"
TYPES = VERSIONS["1.16"]
STATUS_BYTES = recorded_samples()["/fmu/out/vehicle_status_v1"]
UNIX_US = 1_795_000_000_000_000
ARM_DISARM, SET_MODE, REQUEST_MESSAGE = 400, 176, 512
"""Commands of MAVLink, the same in VehicleCommand."""


class VehicleLinkSetup:
    """A vehicle link; `sent` has the topic and the fields of each VehicleCommand that it sends."""

    def __init__(self) -> None:
        self.sent: list[tuple[str, dict[str, Any]]] = []
        self.link = VehicleLink("px4_1", self, 255)
        self.link.formats = formats_of_version("1.16")
        self.receive((STATUS, STATUS_BYTES))

    def send(self, topic: str, data: bytes) -> None:
        self.sent.append((topic, MESSAGES["VehicleCommand"].decode(data)))

    def receive(self, *samples: tuple[str, bytes], now_s: float = 0.0) -> list[Any]:
        frames = FrameParser().feed(self.link.to_frames(samples, now_s), now_s)
        return [decode(frame) for frame in frames]

    def command(self, message: d.MAVLink_message, sender: tuple[int, int] = (255, 190)) -> None:
        self.link.send(encode_frame(message.get_msgId(), encode_payload(message), 0, *sender), UNIX_US)

    def acknowledge(self, **values: int) -> list[Any]:
        return self.receive((ACK, MESSAGES["VehicleCommandAck"].encode(values)))


@pytest.fixture
def setup() -> VehicleLinkSetup:
    return VehicleLinkSetup()


def _command_long(command: int, *params: float) -> d.MAVLink_message:
    return d.MAVLink_command_long_message(1, 1, command, 0, *(params + (0.0,) * (7 - len(params))))


def test_a_command_keeps_its_parameters_and_addresses(setup: VehicleLinkSetup) -> None:
    setup.command(_command_long(ARM_DISARM, 1.0, 21196.0))
    topic, sent = setup.sent[0]
    assert topic == "/fmu/in/vehicle_command"
    assert (sent["command"], sent["param1"], sent["param2"]) == (ARM_DISARM, 1.0, 21196.0)
    assert (sent["target_system"], sent["target_component"]) == (1, 1)
    assert (sent["source_system"], sent["source_component"]) == (255, 192)
    assert sent["from_external"]
    assert sent["timestamp"] == UNIX_US


def test_a_position_of_a_command_int_is_sent_in_degrees(setup: VehicleLinkSetup) -> None:
    setup.command(
        d.MAVLink_command_int_message(1, 1, 0, 192, 0, 0, -1, 1, 0, math.nan, 473977420, 85455940, 500.0)
    )
    sent = setup.sent[0][1]
    assert (sent["param5"], sent["param6"], sent["param7"]) == pytest.approx((47.397742, 8.545594, 500.0))
    assert math.isnan(sent["param4"])


def test_the_acknowledgement_of_a_ros_2_command_has_the_servers_mavlink_address(
    setup: VehicleLinkSetup,
) -> None:
    (ack,) = setup.acknowledge(command=ARM_DISARM, result=1, target_system=255, target_component=192)
    assert (ack.command, ack.result, ack.target_system, ack.target_component) == (ARM_DISARM, 1, 255, 190)
    assert (ack.get_srcSystem(), ack.get_srcComponent()) == (1, 1)


def test_the_acknowledgement_of_the_servers_mavlink_command_is_not_repeated(setup: VehicleLinkSetup) -> None:
    assert setup.acknowledge(command=ARM_DISARM, result=0, target_system=255, target_component=190) == []


def test_acknowledgements_to_other_stations_are_received_and_acknowledgements_to_mode_executors_are_not(
    setup: VehicleLinkSetup,
) -> None:
    (ack,) = setup.acknowledge(command=SET_MODE, result=0, target_system=254, target_component=190)
    assert (ack.target_system, ack.target_component) == (254, 190)
    assert setup.acknowledge(command=SET_MODE, result=0, target_system=1, target_component=1001) == []


def test_a_refusal_is_explained_by_the_flags_of_the_requested_mode(setup: VehicleLinkSetup) -> None:
    flags = TYPES["FailsafeFlags"].decode(recorded_samples()[FAILSAFE_FLAGS])
    flags |= {"auto_mission_missing": True, "mode_req_mission": 1 << 3, "offboard_control_signal_lost": True}
    setup.receive((FAILSAFE_FLAGS, TYPES["FailsafeFlags"].encode(flags)))
    setup.command(_command_long(SET_MODE, 1.0, 4.0, 4.0))
    text, ack = setup.acknowledge(command=SET_MODE, result=1, target_system=255, target_component=192)
    assert text.text == "no mission on the vehicle"
    assert ack.result == 1
    setup.command(_command_long(ARM_DISARM, 0.0))
    (ack,) = setup.acknowledge(command=ARM_DISARM, result=1, target_system=255, target_component=192)
    assert ack.get_type() == "COMMAND_ACK"


def test_a_heartbeat_and_a_request_for_a_message_are_not_sent(setup: VehicleLinkSetup) -> None:
    setup.command(d.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    setup.command(_command_long(REQUEST_MESSAGE, 148.0))
    assert not setup.sent


def test_a_request_for_home_returns_the_newest_received_home(setup: VehicleLinkSetup) -> None:
    setup.receive(("/fmu/out/home_position", recorded_samples()["/fmu/out/home_position"]))
    setup.command(_command_long(REQUEST_MESSAGE, 242.0))
    assert [message.get_type() for message in setup.receive()] == ["HOME_POSITION"]
    assert setup.receive() == []


def test_a_command_that_ros_2_does_not_carry_is_refused(setup: VehicleLinkSetup) -> None:
    with pytest.raises(OSError, match="PX4 has no ROS 2 message for MAVLink message 21"):
        setup.command(d.MAVLink_param_request_list_message(1, 1))


def test_a_malformed_sample_is_reported_for_a_minute_and_other_samples_are_used(
    setup: VehicleLinkSetup,
) -> None:
    status = STATUS_BYTES
    messages = setup.receive((STATUS, status[:20]), (STATUS, b""), (STATUS, status), now_s=5.0)
    assert messages[0].get_type() == "HEARTBEAT"
    problems = setup.link.problems(6.0)
    assert "/px4_1/fmu/out/vehicle_status_v1" in problems[0]
    assert "Check which programs publish this topic" in problems[-1]
    assert setup.link.problems(70.0) == []


def test_frames_have_consecutive_sequence_numbers(setup: VehicleLinkSetup) -> None:
    frames = FrameParser().feed(setup.link.to_frames([(STATUS, STATUS_BYTES)] * 2, 0.0), 0.0)
    numbers = [frame.seq for frame in frames]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
