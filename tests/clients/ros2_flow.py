"""The flow of the MATLAB example on plain Cyclone DDS: stream for 1 s, Offboard, arm, 20 s at 1 m, land.

Setpoints are in the field `position` of px4_msgs v1.16; the example uses `x`, `y` and `z` of older versions.

    gcs sim --ros2
    python tests/clients/ros2_flow.py
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
    TimesyncStatus,
    TrajectorySetpoint,
    VehicleCommand,
    VehicleOdometry,
    VehicleStatus,
    new_message,
)

VEHICLE_CMD_COMPONENT_ARM_DISARM, VEHICLE_CMD_DO_SET_MODE, VEHICLE_CMD_NAV_LAND = 400, 176, 21
STEP_S = 0.1


class Flow:
    """The example's helper functions, publishers and subscribers."""

    def __init__(self, node: Node, sleep: Callable[[float], None]) -> None:
        self.sleep = sleep
        self.control_mode = node.publisher(OffboardControlMode, "/fmu/in/offboard_control_mode")
        self.setpoint = node.publisher(TrajectorySetpoint, "/fmu/in/trajectory_setpoint")
        self.command = node.publisher(VehicleCommand, "/fmu/in/vehicle_command")
        self.status = node.subscription(VehicleStatus, "/fmu/out/vehicle_status_v1")
        self.time_sync = node.subscription(TimesyncStatus, "/fmu/out/timesync_status")
        self.odometry = node.subscription(VehicleOdometry, "/fmu/out/vehicle_odometry")

    def receive(self, subscription: Any, limit_s: float) -> None:
        """Wait for a message.

        Raises:
            TimeoutError: none was received in time.
        """
        for _ in range(round(limit_s / STEP_S)):
            if subscription.latest is not None:
                return
            self.sleep(STEP_S)
        raise TimeoutError(f"no message within {limit_s} s; does the vehicle run with --ros2?")

    def publish_offboard_control_mode(self, control_type: str) -> None:
        """Set the type of offboard control to be used."""
        self.control_mode.write(new_message(OffboardControlMode, timestamp=self.now, **{control_type: True}))

    def publish_trajectory_setpoint(self, xyz: list[float]) -> None:
        """NED; negative Z is higher altitude."""
        self.setpoint.write(new_message(TrajectorySetpoint, timestamp=self.now, position=xyz))

    def publish_vehicle_command(self, command: int, **params: float) -> None:
        """Sends a command to the autopilot of system 1."""
        self.command.write(
            new_message(
                VehicleCommand, timestamp=self.now, command=command, target_system=1, target_component=1,
                source_system=1, source_component=1, from_external=True, **params,
            )
        )  # fmt: skip

    @property
    def now(self) -> int:
        """The vehicle's time, from its newest message."""
        return self.time_sync.latest.timestamp

    def stream(self, seconds: float, xyz: list[float]) -> None:
        """Start or keep the flow of control messages."""
        for _ in range(round(seconds / STEP_S)):
            self.publish_offboard_control_mode("position")
            self.publish_trajectory_setpoint(xyz)
            self.sleep(STEP_S)

    def fly(self) -> None:
        """Switches to Offboard, arms, stays 20 s at 1 m, and lands."""
        for subscription in (self.status, self.odometry, self.time_sync):
            self.receive(subscription, 10.0)
        xyz = [0.0, 0.0, -1.0]
        self.stream(1.0, xyz)
        self.publish_vehicle_command(VEHICLE_CMD_DO_SET_MODE, param1=1.0, param2=6.0)
        self.publish_vehicle_command(VEHICLE_CMD_COMPONENT_ARM_DISARM, param1=1.0)
        self.stream(20.0, xyz)
        self.publish_vehicle_command(VEHICLE_CMD_NAV_LAND)


def main(domain: int = 0, namespace: str = "", sleep: Callable[[float], None] = time.sleep) -> None:
    """Run until the land command is sent."""
    Flow(Node(domain, namespace), sleep).fly()


if __name__ == "__main__":
    main(*(int(each) for each in sys.argv[1:2]))
