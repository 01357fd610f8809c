"""PX4's seven control levels, flown one after the other by the server over ROS 2, on simulated time.

PX4 publishes the active controllers at 2 Hz: after a change of the level, the position controller may
continue for up to half a second. So the comparison begins `SWITCHED_S` after the change. The expected motion
follows from the simulated aircraft (PX4's SIH): 1 kg, four motors of 5 N, and a drag of 1 N per m/s.
"""

from __future__ import annotations

import asyncio
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from gcs_server.ros2.message_types import MESSAGES
from gcs_server.streamer.transport.ros2 import TOPIC_TYPES
from gcs_server.vehicle.vehicle import Vehicle
from missions.frames import Vector3
from missions.setpoints import (
    Acceleration,
    Actuators,
    Attitude,
    Position,
    Rates,
    Setpoint,
    ThrustTorque,
    Velocity,
)
from tests.protocol.ros2_testbed import Ros2Testbed, newest_value, stream_request_for
from tests.protocol.simulated_testbed import both_versions, until
from vehicle_sim.px4_version import Px4Version

ALTITUDE_M = 20.0
HOVER_NED_M = (0.0, 0.0, -ALTITUDE_M)
SWITCHED_S = 0.8
GRAVITY_M_S2 = 9.80665
FULL_THRUST_M_S2 = 20.0
HOVER_THRUST = GRAVITY_M_S2 / FULL_THRUST_M_S2
DRAG_PER_S = 1.0
TRAJECTORY = {"TrajectorySetpoint"}


@dataclass(frozen=True, slots=True)
class Motion:
    """The estimated motion of the vehicle."""

    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    roll_rad: float
    pitch_rad: float
    yaw_ned_rad: float

    @classmethod
    def from_vehicle(cls, vehicle: Vehicle) -> Motion:
        local, attitude = newest_value(vehicle, "local_position"), newest_value(vehicle, "attitude")
        angles = attitude.roll_rad, attitude.pitch_rad, attitude.yaw_ned_rad
        return cls(local.position_ned_m, local.velocity_ned_m_s, *angles)


MotionError = Callable[[Motion, Motion], float]
"""Difference from the expected motion, of the motion at `SWITCHED_S` and at the end."""


@dataclass(frozen=True, slots=True)
class Level:
    """A control level: its setpoint, the messages that must be sent, and the expected motion."""

    flag: str
    """The only flag that is set in OffboardControlMode."""
    message_types: set[str]
    """Types of the setpoint messages."""
    setpoint: Setpoint
    duration_s: float
    """Time from `SWITCHED_S` to the comparison."""
    error: MotionError
    tolerance: float
    """In the unit of `error`."""


def acceleration_error(axis: int, acceleration_m_s2: float, time_s: float) -> MotionError:
    """Error of the velocity after a constant acceleration, against the drag [m/s]."""
    decay = math.exp(-DRAG_PER_S * time_s)

    def error(begin: Motion, end: Motion) -> float:
        expected = begin.velocity_ned_m_s[axis] * decay + acceleration_m_s2 / DRAG_PER_S * (1.0 - decay)
        return end.velocity_ned_m_s[axis] - expected

    return error


def lift_error(thrust: float, time_s: float) -> MotionError:
    """Error of the vertical velocity after a collective thrust of 0 to 1 [m/s]."""
    return acceleration_error(2, GRAVITY_M_S2 - thrust * FULL_THRUST_M_S2, time_s)


LEVELS = [
    Level(
        "position",
        TRAJECTORY,
        Position((4.0, 2.0, -ALTITUDE_M - 1.0), yaw_ned_rad=0.0),
        10.0,
        lambda _, end: math.dist(end.position_ned_m, (4.0, 2.0, -ALTITUDE_M - 1.0)),
        0.8,
    ),
    Level(
        "velocity",
        TRAJECTORY,
        Velocity((2.0, 0.0, 0.0), yaw_ned_rad=0.0),
        5.0,
        lambda _, end: math.dist(end.velocity_ned_m_s, (2.0, 0.0, 0.0)),
        0.5,
    ),
    Level(
        "acceleration",
        TRAJECTORY,
        Acceleration((0.0, 0.8, 0.0), yaw_ned_rad=0.0),
        2.0,
        acceleration_error(1, 0.8, 2.0),
        0.35,
    ),
    Level(
        "attitude",
        {"VehicleAttitudeSetpoint"},
        Attitude((math.cos(0.05), 0.0, -math.sin(0.05), 0.0), HOVER_THRUST),
        1.0,
        lambda _, end: math.dist((end.roll_rad, end.pitch_rad), (0.0, -0.1)),
        0.03,
    ),
    Level(
        "body_rate",
        {"VehicleRatesSetpoint"},
        Rates((0.0, 0.0, 0.5), HOVER_THRUST),
        1.5,
        lambda begin, end: end.yaw_ned_rad - begin.yaw_ned_rad - 0.5 * 1.5,
        0.15,
    ),
    Level(
        "thrust_and_torque",
        {"VehicleThrustSetpoint", "VehicleTorqueSetpoint"},
        ThrustTorque((0.0, 0.0, -0.8), (0.0, 0.0, 0.0)),
        0.6,
        lift_error(0.8, 0.6),
        0.3,
    ),
    Level(
        "direct_actuator",
        {"ActuatorMotors"},
        Actuators(motors=(0.9,) * 4),
        0.6,
        lift_error(0.9, 0.6),
        0.3,
    ),
]


@both_versions
@pytest.mark.story
def test_the_seven_control_levels_are_flown_in_one_flight(run_simulated: Any, px4: Px4Version) -> None:
    async def run() -> None:
        testbed = Ros2Testbed(px4=px4)
        vehicle = await testbed.take_off(alt_home_m=ALTITUDE_M)
        await vehicle.offboard.start(stream_request_for(Position(HOVER_NED_M, yaw_ned_rad=0.0)))
        for level in LEVELS:
            await hover(vehicle)
            await fly_level(testbed, vehicle, level)
        await hover(vehicle)
        await vehicle.command.land()
        await until(lambda: not vehicle.status.armed, 60)
        assert not vehicle.offboard.status().streaming
        await testbed.close()

    run_simulated(run)


async def hover(vehicle: Vehicle) -> None:
    """Flies back to the first position and waits until the vehicle hovers there."""
    await vehicle.offboard.setpoint(stream_request_for(Position(HOVER_NED_M, yaw_ned_rad=0.0)))

    def is_hovering() -> bool:
        motion = Motion.from_vehicle(vehicle)
        return (
            math.dist(motion.position_ned_m, HOVER_NED_M) < 0.5
            and math.hypot(*motion.velocity_ned_m_s) < 0.2
            and abs(motion.yaw_ned_rad) < 0.1
        )

    await until(is_hovering, 30)


async def fly_level(testbed: Ros2Testbed, vehicle: Vehicle, level: Level) -> None:
    """Flies a control level; checks the messages and the motion."""
    sent = testbed.topics[0].sent_messages
    sent_before = len(sent)
    await vehicle.offboard.setpoint(stream_request_for(level.setpoint))
    await asyncio.sleep(SWITCHED_S)
    begin = Motion.from_vehicle(vehicle)
    await asyncio.sleep(level.duration_s)
    error = level.error(begin, Motion.from_vehicle(vehicle))
    assert abs(error) < level.tolerance, (level.flag, error)
    status = vehicle.offboard.status()
    assert (status.state, vehicle.status.mode) == ("streaming", "offboard"), (level.flag, status.ended)
    assert (status.sends_failed, status.limited) == (0, ()), level.flag

    messages = [(TOPIC_TYPES[topic], data) for topic, data in sent[sent_before:]]
    counts = Counter(name for name, _ in messages)
    assert counts.keys() == {"OffboardControlMode", *level.message_types}, level.flag
    assert len(set(counts.values())) == 1, (level.flag, counts)
    for name, data in messages:
        if name == "OffboardControlMode":
            flags = MESSAGES[name].decode(data)
            assert {flag for flag, value in flags.items() if value is True} == {level.flag}
