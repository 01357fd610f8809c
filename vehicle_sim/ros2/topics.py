"""The topics that each version of PX4 bridges to ROS 2 by default, with their types and measured rates.

The simulator names a topic without the version of its type. On the wire the version is part of the name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Final

from vehicle_sim.px4_version import Px4Version
from vehicle_sim.ros2.messages import MESSAGES, MessageType

MIN_PERIOD_US: Final = 10_000
"""Shortest period at which PX4's uXRCE-DDS client sends a topic [µs]."""
SHORTEST_US: Final = {
    "/fmu/out/arming_check_request": 200_000, "/fmu/out/battery_status": 1_000_000,
    "/fmu/out/estimator_status_flags": 200_000, "/fmu/out/failsafe_flags": 200_000,
    "/fmu/out/home_position": 200_000, "/fmu/out/position_setpoint_triplet": 200_000,
    "/fmu/out/vehicle_global_position": 20_000, "/fmu/out/vehicle_land_detected": 200_000,
    "/fmu/out/vehicle_local_position": 20_000, "/fmu/out/vehicle_status": 200_000,
}  # fmt: skip
"""Shortest period of each topic for which PX4 v1.17 has one of its own [µs]; those of at most a tick of the
autopilot, and of topics that a multicopter never publishes, are omitted."""


@dataclass(frozen=True, slots=True)
class Topic:
    """One topic of one version of PX4."""

    base: str
    """Name without version, such as "/fmu/out/battery_status"."""
    message: MessageType
    """The type's layout."""

    @property
    def name(self) -> str:
        """Name on the wire, such as "/fmu/out/battery_status_v1"; without namespace."""
        version = self.message.version
        return f"{self.base}_v{version}" if version else self.base

    @property
    def type(self) -> str:
        """Name of the type."""
        return self.message.name


@dataclass(frozen=True, slots=True)
class Output(Topic):
    """A topic that the vehicle publishes.

    `source` is the topic's name in the simulator (`topics/`). The name is empty if the topic is published on
    an event, or if a multicopter never publishes the topic.
    """

    source: str = ""
    every_us: int = 0
    """Period [µs]; 0: published at each change or event, -1: with each GPS sample."""
    shortest_us: int = 0
    """Shortest mean period of changes [µs]."""


@dataclass(frozen=True, slots=True)
class Input(Topic):
    """A topic that the vehicle subscribes to."""

    @property
    def depth(self) -> int:
        """Length of the DDS reader's queue: twice the length of the uORB topic's queue."""
        return 2 * self.message.constants.get("ORB_QUEUE_LENGTH", 1)


COMMAND_ACK: Final = "/fmu/out/vehicle_command_ack"
STATUS: Final = "/fmu/out/vehicle_status"
TIMESYNC: Final = "/fmu/out/timesync_status"
TRIPLET: Final = "/fmu/out/position_setpoint_triplet"
GIMBAL: Final = "/fmu/out/gimbal_device_attitude_status"
COMMAND: Final = "/fmu/in/vehicle_command"
EXECUTOR_COMMAND: Final = "/fmu/in/vehicle_command_mode_executor"
SERVICE_REQUEST: Final = "/fmu/vehicle_commandRequest"
SERVICE_REPLY: Final = "/fmu/vehicle_commandReply"
"""Topics of the service `/fmu/vehicle_command`; DDS has one for requests and one for replies."""

_Row = tuple[str, str, str, int]
_OUTPUTS: Final[tuple[_Row, ...]] = (
    ("register_ext_component_reply", "RegisterExtComponentReply", "", 0),
    ("arming_check_request", "ArmingCheckRequest", "", 0),
    ("mode_completed", "ModeCompleted", "", 0),
    ("battery_status", "BatteryStatus", "battery_status", MIN_PERIOD_US),
    ("collision_constraints", "CollisionConstraints", "", 0),
    ("estimator_status_flags", "EstimatorStatusFlags", "estimator_status_flags", 1_000_000),
    ("failsafe_flags", "FailsafeFlags", "failsafe_flags", 540_000),
    ("manual_control_setpoint", "ManualControlSetpoint", "manual_control_setpoint", 0),
    ("message_format_response", "MessageFormatResponse", "", 0),
    ("position_setpoint_triplet", "PositionSetpointTriplet", "", 50_000),
    ("sensor_combined", "SensorCombined", "sensor_combined", MIN_PERIOD_US),
    ("timesync_status", "TimesyncStatus", "", 1_000_000),
    ("transponder_report", "TransponderReport", "", 0),
    ("vehicle_land_detected", "VehicleLandDetected", "vehicle_land_detected", 1_000_000),
    ("vehicle_attitude", "VehicleAttitude", "vehicle_attitude", MIN_PERIOD_US),
    ("vehicle_control_mode", "VehicleControlMode", "vehicle_control_mode", 500_000),
    ("vehicle_command_ack", "VehicleCommandAck", "", 0),
    ("vehicle_global_position", "VehicleGlobalPosition", "vehicle_global_position", MIN_PERIOD_US),
    ("vehicle_gps_position", "SensorGps", "vehicle_gps_position", -1),
    ("vehicle_local_position", "VehicleLocalPosition", "vehicle_local_position", MIN_PERIOD_US),
    ("vehicle_odometry", "VehicleOdometry", "vehicle_odometry", MIN_PERIOD_US),
    ("vehicle_status", "VehicleStatus", "vehicle_status", 500_000),
    ("airspeed_validated", "AirspeedValidated", "", 0),
    ("vtol_vehicle_status", "VtolVehicleStatus", "", 0),
    ("home_position", "HomePosition", "home_position", 0),
    ("wind", "Wind", "", 0),
    ("gimbal_device_attitude_status", "GimbalDeviceAttitudeStatus", "", 50_000),
)
"""Topic, type, source and period, as in `Output`; a version of PX4 has those whose types it has."""

_INPUTS: Final = (
    ("register_ext_component_request", "RegisterExtComponentRequest"),
    ("unregister_ext_component", "UnregisterExtComponent"),
    ("config_overrides_request", "ConfigOverrides"),
    ("arming_check_reply", "ArmingCheckReply"),
    ("message_format_request", "MessageFormatRequest"),
    ("mode_completed", "ModeCompleted"),
    ("config_control_setpoints", "VehicleControlMode"),
    ("distance_sensor", "DistanceSensor"),
    ("manual_control_input", "ManualControlSetpoint"),
    ("offboard_control_mode", "OffboardControlMode"),
    ("onboard_computer_status", "OnboardComputerStatus"),
    ("obstacle_distance", "ObstacleDistance"),
    ("sensor_optical_flow", "SensorOpticalFlow"),
    ("goto_setpoint", "GotoSetpoint"),
    ("telemetry_status", "TelemetryStatus"),
    ("trajectory_setpoint", "TrajectorySetpoint"),
    ("vehicle_attitude_setpoint", "VehicleAttitudeSetpoint"),
    ("vehicle_mocap_odometry", "VehicleOdometry"),
    ("vehicle_rates_setpoint", "VehicleRatesSetpoint"),
    ("vehicle_visual_odometry", "VehicleOdometry"),
    ("vehicle_command", "VehicleCommand"),
    ("vehicle_command_mode_executor", "VehicleCommand"),
    ("vehicle_thrust_setpoint", "VehicleThrustSetpoint"),
    ("vehicle_torque_setpoint", "VehicleTorqueSetpoint"),
    ("actuator_motors", "ActuatorMotors"),
    ("actuator_servos", "ActuatorServos"),
    ("aux_global_position", "VehicleGlobalPosition"),
    ("fixed_wing_lateral_setpoint", "FixedWingLateralSetpoint"),
    ("fixed_wing_longitudinal_setpoint", "FixedWingLongitudinalSetpoint"),
    ("lateral_control_configuration", "LateralControlConfiguration"),
    ("longitudinal_control_configuration", "LongitudinalControlConfiguration"),
    ("landing_gear", "LandingGear"),
    ("rover_position_setpoint", "RoverPositionSetpoint"),
    ("rover_speed_setpoint", "RoverSpeedSetpoint"),
    ("rover_attitude_setpoint", "RoverAttitudeSetpoint"),
    ("rover_rate_setpoint", "RoverRateSetpoint"),
    ("rover_throttle_setpoint", "RoverThrottleSetpoint"),
    ("rover_steering_setpoint", "RoverSteeringSetpoint"),
)
"""Topic and type, as in `_OUTPUTS`."""
UNBRIDGED: Final = {"event": "Event", "vehicle_angular_velocity": "VehicleAngularVelocity"}
"""Topics without a bridge, for whose layout the simulator answers all the same."""


class Topics:
    """The topics of one version of PX4."""

    def __init__(self, messages: Mapping[str, MessageType], shortest_us: Mapping[str, int]) -> None:
        self.messages = messages
        """Types by name."""
        self.outputs = tuple(
            _output(base, messages[type_name], source, every_us, shortest_us.get(f"/fmu/out/{base}", 0))
            for base, type_name, source, every_us in _OUTPUTS
            if type_name in messages
        )
        self.inputs = tuple(
            Input(f"/fmu/in/{base}", messages[type_name])
            for base, type_name in _INPUTS
            if type_name in messages
        )
        self.output = {each.base: each for each in self.outputs}
        self.input = {each.base: each for each in self.inputs}
        """Topics by name without version."""
        topics = (*self.outputs, *self.inputs)
        self.hashes = {each.base.rpartition("/")[2]: each.message.hash for each in topics}
        """Hash of each topic's type, by the name of the topic inside PX4."""
        self.hashes |= {name: messages[type_name].hash for name, type_name in UNBRIDGED.items()}


def _output(base: str, message: MessageType, source: str, every_us: int, shortest_us: int) -> Output:
    every_us = max(every_us, shortest_us) if every_us > 0 else every_us
    return Output(f"/fmu/out/{base}", message, source, every_us, shortest_us)


@cache
def topics_of(px4: Px4Version) -> Topics:
    """The topics of a version of PX4."""
    return Topics(MESSAGES[px4.name], SHORTEST_US if px4.limits_topics else {})


def dds_name(name: str, namespace: str = "") -> str:
    """A topic's name in DDS, such as `rt/px4_1/fmu/out/…`; a service has `rq` (request) or `rr` (reply)."""
    prefix = {SERVICE_REQUEST: "rq", SERVICE_REPLY: "rr"}.get(name, "rt")
    return prefix + (f"/{namespace}" if namespace else "") + name
