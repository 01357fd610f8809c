"""The offboard node of PX4's ROS 2 guide on plain Cyclone DDS: arm, climb to 5 m in Offboard, land.

Topics, types and fields are those of the node; `px4_dds.Node` and a loop at 10 Hz replace rclpy.

    gcs sim --ros2
    python tests/clients/ros2_offboard_node.py
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.clients.px4_dds import (
    Node,
    OffboardControlMode,
    TrajectorySetpoint,
    VehicleCommand,
    VehicleLocalPosition,
    VehicleStatus,
    new_message,
)

VEHICLE_CMD_COMPONENT_ARM_DISARM, VEHICLE_CMD_DO_SET_MODE, VEHICLE_CMD_NAV_LAND = 400, 176, 21
NAVIGATION_STATE_OFFBOARD = 14
POSITION_TOPICS = {
    "1.16": "/fmu/out/vehicle_local_position",
    "1.17": "/fmu/out/vehicle_local_position_v1",
}
"""Name of the position by version of PX4; the message is the same."""


class OffboardControl:
    """Node for controlling a vehicle in offboard mode."""

    def __init__(self, node: Node, position_topic: str) -> None:
        self.offboard_control_mode_publisher = node.publisher(
            OffboardControlMode, "/fmu/in/offboard_control_mode"
        )
        self.trajectory_setpoint_publisher = node.publisher(TrajectorySetpoint, "/fmu/in/trajectory_setpoint")
        self.vehicle_command_publisher = node.publisher(VehicleCommand, "/fmu/in/vehicle_command")
        self.vehicle_local_position_subscriber = node.subscription(VehicleLocalPosition, position_topic)
        # PX4 appends the version of the message, from v1.16 on.
        self.vehicle_status_subscriber = node.subscription(VehicleStatus, "/fmu/out/vehicle_status_v1")
        self.offboard_setpoint_counter = 0
        self.takeoff_height = -5.0
        self.done = False

    def arm(self) -> None:
        """Send an arm command to the vehicle."""
        self.publish_vehicle_command(VEHICLE_CMD_COMPONENT_ARM_DISARM, param1=1.0)
        print("Arm command sent")

    def engage_offboard_mode(self) -> None:
        """Switch to offboard mode."""
        self.publish_vehicle_command(VEHICLE_CMD_DO_SET_MODE, param1=1.0, param2=6.0)
        print("Switching to offboard mode")

    def land(self) -> None:
        """Switch to land mode."""
        self.publish_vehicle_command(VEHICLE_CMD_NAV_LAND)
        print("Switching to land mode")

    def publish_offboard_control_heartbeat_signal(self) -> None:
        """Publish the offboard control mode."""
        self.offboard_control_mode_publisher.write(
            new_message(OffboardControlMode, position=True, timestamp=time.time_ns() // 1000)
        )

    def publish_position_setpoint(self, x: float, y: float, z: float) -> None:
        """Publish the trajectory setpoint."""
        self.trajectory_setpoint_publisher.write(
            new_message(TrajectorySetpoint, position=[x, y, z], yaw=1.57079, timestamp=time.time_ns() // 1000)
        )

    def publish_vehicle_command(self, command: int, **params: Any) -> None:
        """Publish a vehicle command."""
        self.vehicle_command_publisher.write(
            new_message(
                VehicleCommand, command=command, target_system=1, target_component=1, source_system=1,
                source_component=1, from_external=True, timestamp=time.time_ns() // 1000, **params,
            )
        )  # fmt: skip

    def timer_callback(self) -> None:
        """Callback function for the timer."""
        self.publish_offboard_control_heartbeat_signal()
        if self.offboard_setpoint_counter == 10:
            self.engage_offboard_mode()
            self.arm()
        local_position = self.vehicle_local_position_subscriber.latest
        status = self.vehicle_status_subscriber.latest
        if local_position is not None and status is not None:
            offboard = status.nav_state == NAVIGATION_STATE_OFFBOARD
            if local_position.z > self.takeoff_height and offboard:
                self.publish_position_setpoint(0.0, 0.0, self.takeoff_height)
            elif local_position.z <= self.takeoff_height:
                self.land()
                self.done = True
        if self.offboard_setpoint_counter < 11:
            self.offboard_setpoint_counter += 1


def main(
    domain: int = 0,
    namespace: str = "",
    sleep: Callable[[float], None] = time.sleep,
    position_topic: str = POSITION_TOPICS["1.17"],
) -> None:
    """Run until the land command is sent."""
    offboard_control = OffboardControl(Node(domain, namespace), position_topic)
    while not offboard_control.done:
        offboard_control.timer_callback()
        sleep(0.1)


if __name__ == "__main__":
    main(*(int(each) for each in sys.argv[1:2]))
