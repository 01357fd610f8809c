"""The topics that PX4 v1.16 bridges to ROS 2 by default, with their types and measured rates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from vehicle_sim.ros2.messages import MESSAGES, MessageType

MIN_PERIOD_US: Final = 10_000
"""Shortest period at which PX4's uXRCE-DDS client sends a topic [µs]."""


@dataclass(frozen=True, slots=True)
class Output:
    """A topic that the vehicle publishes.

    `source` is the topic's name in the simulator (`topics/`). The name is empty if the topic is published on
    an event, or if a multicopter never publishes the topic.
    """

    name: str
    type: str
    source: str = ""
    every_us: int = 0
    """Period [µs]; 0: published at each change or event, -1: with each GPS sample."""

    @property
    def message(self) -> MessageType:
        """The type's layout."""
        return MESSAGES[self.type]


@dataclass(frozen=True, slots=True)
class Input:
    """A topic that the vehicle subscribes to."""

    name: str
    type: str

    @property
    def message(self) -> MessageType:
        """The type's layout."""
        return MESSAGES[self.type]

    @property
    def depth(self) -> int:
        """Length of the DDS reader's queue: twice the length of the uORB topic's queue."""
        return 2 * self.message.constants.get("ORB_QUEUE_LENGTH", 1)


COMMAND_ACK: Final = "/fmu/out/vehicle_command_ack"
STATUS: Final = "/fmu/out/vehicle_status_v1"
TIMESYNC: Final = "/fmu/out/timesync_status"
TRIPLET: Final = "/fmu/out/position_setpoint_triplet"
COMMAND: Final = "/fmu/in/vehicle_command"
EXECUTOR_COMMAND: Final = "/fmu/in/vehicle_command_mode_executor"
SERVICE_REQUEST: Final = "/fmu/vehicle_commandRequest"
SERVICE_REPLY: Final = "/fmu/vehicle_commandReply"
"""Topics of the service `/fmu/vehicle_command`; DDS has one for requests and one for replies."""

OUTPUTS: Final = (
    Output("/fmu/out/register_ext_component_reply", "RegisterExtComponentReply"),
    Output("/fmu/out/arming_check_request", "ArmingCheckRequest"),
    Output("/fmu/out/mode_completed", "ModeCompleted"),
    Output("/fmu/out/battery_status", "BatteryStatus", "battery_status", MIN_PERIOD_US),
    Output("/fmu/out/collision_constraints", "CollisionConstraints"),
    Output("/fmu/out/estimator_status_flags", "EstimatorStatusFlags", "estimator_status_flags", 1_000_000),
    Output("/fmu/out/failsafe_flags", "FailsafeFlags", "failsafe_flags", 540_000),
    Output("/fmu/out/manual_control_setpoint", "ManualControlSetpoint", "manual_control_setpoint"),
    Output("/fmu/out/message_format_response", "MessageFormatResponse"),
    Output(TRIPLET, "PositionSetpointTriplet"),
    Output("/fmu/out/sensor_combined", "SensorCombined", "sensor_combined", MIN_PERIOD_US),
    Output(TIMESYNC, "TimesyncStatus"),
    Output("/fmu/out/vehicle_land_detected", "VehicleLandDetected", "vehicle_land_detected", 1_000_000),
    Output("/fmu/out/vehicle_attitude", "VehicleAttitude", "vehicle_attitude", MIN_PERIOD_US),
    Output("/fmu/out/vehicle_control_mode", "VehicleControlMode", "vehicle_control_mode", 500_000),
    Output(COMMAND_ACK, "VehicleCommandAck"),
    Output(
        "/fmu/out/vehicle_global_position", "VehicleGlobalPosition", "vehicle_global_position", MIN_PERIOD_US
    ),
    Output("/fmu/out/vehicle_gps_position", "SensorGps", "vehicle_gps_position", -1),
    Output(
        "/fmu/out/vehicle_local_position", "VehicleLocalPosition", "vehicle_local_position", MIN_PERIOD_US
    ),
    Output("/fmu/out/vehicle_odometry", "VehicleOdometry", "vehicle_odometry", MIN_PERIOD_US),
    Output(STATUS, "VehicleStatus", "vehicle_status", 500_000),
    Output("/fmu/out/airspeed_validated", "AirspeedValidated"),
    Output("/fmu/out/vtol_vehicle_status", "VtolVehicleStatus"),
    Output("/fmu/out/home_position", "HomePosition", "home_position"),
)

INPUTS: Final = (
    Input("/fmu/in/register_ext_component_request", "RegisterExtComponentRequest"),
    Input("/fmu/in/unregister_ext_component", "UnregisterExtComponent"),
    Input("/fmu/in/config_overrides_request", "ConfigOverrides"),
    Input("/fmu/in/arming_check_reply", "ArmingCheckReply"),
    Input("/fmu/in/message_format_request", "MessageFormatRequest"),
    Input("/fmu/in/mode_completed", "ModeCompleted"),
    Input("/fmu/in/config_control_setpoints", "VehicleControlMode"),
    Input("/fmu/in/distance_sensor", "DistanceSensor"),
    Input("/fmu/in/manual_control_input", "ManualControlSetpoint"),
    Input("/fmu/in/offboard_control_mode", "OffboardControlMode"),
    Input("/fmu/in/onboard_computer_status", "OnboardComputerStatus"),
    Input("/fmu/in/obstacle_distance", "ObstacleDistance"),
    Input("/fmu/in/sensor_optical_flow", "SensorOpticalFlow"),
    Input("/fmu/in/goto_setpoint", "GotoSetpoint"),
    Input("/fmu/in/telemetry_status", "TelemetryStatus"),
    Input("/fmu/in/trajectory_setpoint", "TrajectorySetpoint"),
    Input("/fmu/in/vehicle_attitude_setpoint", "VehicleAttitudeSetpoint"),
    Input("/fmu/in/vehicle_mocap_odometry", "VehicleOdometry"),
    Input("/fmu/in/vehicle_rates_setpoint", "VehicleRatesSetpoint"),
    Input("/fmu/in/vehicle_visual_odometry", "VehicleOdometry"),
    Input(COMMAND, "VehicleCommand"),
    Input(EXECUTOR_COMMAND, "VehicleCommand"),
    Input("/fmu/in/vehicle_thrust_setpoint", "VehicleThrustSetpoint"),
    Input("/fmu/in/vehicle_torque_setpoint", "VehicleTorqueSetpoint"),
    Input("/fmu/in/actuator_motors", "ActuatorMotors"),
    Input("/fmu/in/actuator_servos", "ActuatorServos"),
    Input("/fmu/in/aux_global_position", "VehicleGlobalPosition"),
)


def dds_name(name: str, namespace: str = "") -> str:
    """A topic's name in DDS, such as `rt/px4_1/fmu/out/…`; a service has `rq` (request) or `rr` (reply)."""
    prefix = {SERVICE_REQUEST: "rq", SERVICE_REPLY: "rr"}.get(name, "rt")
    return prefix + (f"/{namespace}" if namespace else "") + name
