"""Setpoints as PX4's ROS 2 messages, and the choice between ROS 2 and MAVLink."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import pytest

from gcs_server.ros2.external_mode import CONTROLLERS, Message
from gcs_server.ros2.message_types import MESSAGES
from gcs_server.ros2.topics import COMMAND
from gcs_server.streamer.frames import ResolvedSetpoint
from gcs_server.streamer.limits.limiter import apply_limits
from gcs_server.streamer.transport.ros2 import CONTROL_MODE, TOPIC_TYPES, Ros2Transport, encode, topics_of
from gcs_server.streamer.transport.vehicle_transport import NoSender, VehicleTransport
from gcs_server.streamer.values.limit_values import Bounds
from gcs_server.streamer.values.snapshot import Snapshot
from gcs_server.streamer.values.stream_request import ModeRequest, SetpointDue
from missions.fence import Circle, Region
from missions.geodesy import LocalOrigin
from missions.setpoints import (
    Acceleration,
    Actuators,
    Attitude,
    DirectSetpoint,
    Position,
    PositionGlobal,
    Rates,
    ThrustTorque,
    Trajectory,
    Velocity,
    VelocityBody,
)

NOW_US = 1_795_000_000_000_000
HALF_THRUST = (0.0, 0.0, -0.5)
"""Upwards, in FRD."""
LEVEL_ATTITUDE = (1.0, 0.0, 0.0, 0.0)
EXPECTED_MESSAGES: list[tuple[DirectSetpoint, str, dict[str, dict[str, Any]]]] = [
    (
        Position((1.0, 2.0, -3.0), 0.5),
        "position",
        {"trajectory_setpoint": {"position": (1.0, 2.0, -3.0), "yaw": 0.5}},
    ),
    (
        Velocity((1.0, None, None), yaw_rate_ned_rad_s=0.25),
        "velocity",
        {"trajectory_setpoint": {"velocity": (1.0, math.nan, math.nan), "yawspeed": 0.25, "yaw": math.nan}},
    ),
    (
        Acceleration((0.0, 0.5, 0.0)),
        "acceleration",
        {"trajectory_setpoint": {"acceleration": (0.0, 0.5, 0.0), "position": (math.nan,) * 3}},
    ),
    (
        Trajectory((1.0, 0.0, -3.0), (0.5, 0.0, 0.0)),
        "position",
        {"trajectory_setpoint": {"position": (1.0, 0.0, -3.0), "velocity": (0.5, 0.0, 0.0)}},
    ),
    (
        Attitude(LEVEL_ATTITUDE, 0.5, 0.25),
        "attitude",
        {
            "vehicle_attitude_setpoint": {
                "q_d": LEVEL_ATTITUDE, "thrust_body": HALF_THRUST, "yaw_sp_move_rate": 0.25,
            },
        },
    ),
    (
        Rates((0.5, 0.25, -0.5), 0.5),
        "body_rate",
        {"vehicle_rates_setpoint": {"roll": 0.5, "pitch": 0.25, "yaw": -0.5, "thrust_body": HALF_THRUST}},
    ),
    (
        ThrustTorque((0.0, 0.0, -0.5), (0.0, 0.25, 0.0)),
        "thrust_and_torque",
        {
            "vehicle_thrust_setpoint": {"xyz": HALF_THRUST},
            "vehicle_torque_setpoint": {"xyz": (0.0, 0.25, 0.0)},
        },
    ),
    (
        Actuators((0.5, None, 0.5, 0.25), (0.0,)),
        "direct_actuator",
        {
            "actuator_motors": {"control": (0.5, math.nan, 0.5, 0.25) + (math.nan,) * 8},
            "actuator_servos": {"control": (0.0,) + (math.nan,) * 7},
        },
    ),
]  # fmt: skip
"""For each setpoint: the flag of OffboardControlMode, and the fields of the other messages by topic."""


class Topics:
    """The topics of a vehicle; records the sent messages."""

    def __init__(self) -> None:
        self.sent: list[tuple[str, dict[str, Any]]] = []
        self.closed = False
        self.needed: set[str] = set()

    def send(self, messages: Sequence[Message], needed: Iterable[str] = ()) -> None:
        if self.closed:
            raise OSError("closed")
        self.needed = set(needed)
        for topic, data in messages:
            self.sent.append((topic.rsplit("/", 1)[1], MESSAGES[TOPIC_TYPES[topic]].decode(data)))


def _transport() -> Ros2Transport:
    return Ros2Transport((1, 1), (255, 191), lambda: NOW_US)


def _equal_or_both_nan(sent: Any, expected: Any) -> bool:
    if isinstance(expected, tuple):
        return len(sent) == len(expected) and all(map(_equal_or_both_nan, sent, expected))
    return sent == expected or (math.isnan(sent) and math.isnan(expected))


@pytest.mark.parametrize(
    ("setpoint", "flag", "expected"), EXPECTED_MESSAGES, ids=lambda each: getattr(each, "type", "")
)
def test_each_setpoint_type_is_sent_with_its_control_mode_and_topics(
    setpoint: DirectSetpoint, flag: str, expected: dict[str, dict[str, Any]]
) -> None:
    transport, topics = _transport(), Topics()
    transport.load(setpoint)
    assert transport.send(SetpointDue(0.0), topics)
    (mode_topic, mode), *messages = topics.sent
    assert mode_topic == "offboard_control_mode"
    assert [name for name, value in mode.items() if value is True] == [flag]
    assert [topic for topic, _ in messages] == list(expected)
    for topic, values in messages:
        assert values["timestamp"] == NOW_US
        for name, value in expected[topic].items():
            assert _equal_or_both_nan(values[name], value), (topic, name, values[name])


@pytest.mark.parametrize(
    ("setpoint", "flag", "expected"), EXPECTED_MESSAGES, ids=lambda each: getattr(each, "type", "")
)
def test_the_topics_of_a_setpoint_type_include_the_topics_of_its_messages(
    setpoint: DirectSetpoint, flag: str, expected: dict[str, Any]
) -> None:
    assert flag
    sent = {f"/fmu/in/{topic}" for topic in expected}
    assert set(topics_of(setpoint.type, in_offboard=True)) >= {COMMAND, CONTROL_MODE} | sent
    assert set(topics_of(setpoint.type, in_offboard=False)) >= {COMMAND, CONTROLLERS} | sent


def test_before_offboard_only_the_control_mode_is_sent() -> None:
    transport, topics = _transport(), Topics()
    transport.load(Position((1.0, 2.0, -3.0)))
    assert transport.send(SetpointDue(0.0, in_mode=False), topics)
    assert [topic for topic, _ in topics.sent] == ["offboard_control_mode"]
    assert topics.needed == {"/fmu/in/trajectory_setpoint"}


def test_a_mode_request_has_the_system_and_component_id_of_the_stream() -> None:
    transport, topics = _transport(), Topics()
    assert transport.send(ModeRequest("land", 2), topics)
    topic, command = topics.sent[0]
    assert topic == "vehicle_command"
    assert (command["command"], command["param2"], command["param3"]) == (176, 4.0, 6.0)
    assert (command["source_system"], command["source_component"]) == (255, 191)
    assert command["confirmation"] == 2


@pytest.mark.parametrize("setpoint", [VelocityBody((1.0, 0.0, 0.0)), PositionGlobal(47.0, 8.0, 500.0)])
def test_the_transport_refuses_setpoints_that_are_not_in_the_local_frame(setpoint: DirectSetpoint) -> None:
    with pytest.raises(ValueError, match=f"carries {setpoint.type}"):
        encode(setpoint)


class Mavlink(NoSender):
    """A MAVLink link; records the ids of the sent messages."""

    def __init__(self) -> None:
        self.ids: list[int] = []

    def send_payload(self, msg_id: int, payload: bytes, *, created_s: float | None = None) -> bool:
        self.ids.append(msg_id)
        return True


def test_a_stream_continues_over_mavlink_only_if_mavlink_has_a_message_for_the_setpoint() -> None:
    mavlink, topics = Mavlink(), Topics()
    ros2_link: list[Topics | None] = [topics]
    transport = VehicleTransport(mavlink, (1, 1), lambda: ros2_link[0], _transport())
    transport.load(Position((0.0, 0.0, -5.0)))
    assert transport.send(SetpointDue(0.0))
    ros2_link[0] = None
    assert transport.send(SetpointDue(0.02))
    assert (len(topics.sent), mavlink.ids) == (2, [84])
    ros2_link[0] = topics
    transport.load(Actuators((0.5,)))
    assert transport.send(SetpointDue(0.04))
    ros2_link[0] = None
    assert not transport.send(SetpointDue(0.06))
    assert mavlink.ids == [84]


def test_a_failed_transmission_is_reported_and_a_setpoint_without_any_message_is_refused() -> None:
    topics = Topics()
    transport = VehicleTransport(Mavlink(), (1, 1), lambda: topics, _transport())
    transport.load(Position((0.0, 0.0, -5.0)))
    topics.closed = True
    assert not transport.send(SetpointDue(0.0))
    with pytest.raises(ValueError, match="no MAVLink message carries actuators"):
        VehicleTransport(Mavlink(), (1, 1), lambda: None, _transport()).load(Actuators((0.5,)))


def _snapshot(yaw: float | None = math.pi / 2, origin: LocalOrigin | None = None) -> Snapshot:
    return Snapshot(0.0, "offboard", None, None, yaw, local_only=True, bounds=Bounds(origin=origin))


def test_a_velocity_along_the_heading_turns_with_the_vehicle() -> None:
    resolved = ResolvedSetpoint(VelocityBody((2.0, 0.0, -1.0), None, 0.1), 0.0, _snapshot(0.0), None)
    before_turn, after_turn = resolved.at(0.0, _snapshot(0.0)), resolved.at(1.0, _snapshot())
    assert isinstance(before_turn, Velocity)
    assert isinstance(after_turn, Velocity)
    assert before_turn.velocity_ned_m_s == pytest.approx((2.0, 0.0, -1.0))
    assert after_turn.velocity_ned_m_s == pytest.approx((0.0, 2.0, -1.0))
    assert after_turn.yaw_rate_ned_rad_s == 0.1
    assert resolved.at(2.0, _snapshot(None)) == after_turn


def test_a_global_position_is_sent_in_the_local_frame() -> None:
    origin = LocalOrigin.from_position(47.0, 8.0, 500.0, (0.0, 0.0, 0.0))
    snapshot = _snapshot(origin=origin)
    resolved = ResolvedSetpoint(PositionGlobal(47.0001, 8.0, 510.0), 0.0, snapshot, 0.5).at(0.0, snapshot)
    assert isinstance(resolved, Position)
    assert resolved.position_ned_m == pytest.approx((11.12, 0.0, -10.0), abs=0.02)
    assert resolved.yaw_ned_rad == 0.5
    with pytest.raises(ValueError, match="position_global needs a fresh estimate"):
        ResolvedSetpoint(PositionGlobal(47.0001, 8.0, 510.0), 0.0, _snapshot(), 0.5)


@pytest.mark.parametrize("setpoint", [ThrustTorque((0.0, 0.0, -0.5), (0.0, 0.0, 0.0)), Actuators((0.5,))])
def test_streams_of_thrust_or_motor_setpoints_stop_without_a_position_if_a_fence_is_set(
    setpoint: DirectSetpoint,
) -> None:
    fenced_bounds = Bounds(region=Region(circles=(Circle((0.0, 0.0), 50.0, "50 m"),)))
    assert apply_limits(setpoint, Bounds(), None).stop_reason is None
    assert "No valid position estimate" in (apply_limits(setpoint, fenced_bounds, None).stop_reason or "")
