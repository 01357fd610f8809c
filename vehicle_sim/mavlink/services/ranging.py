"""DISTANCE_SENSOR of the downward and the forward lidar, and OBSTACLE_DISTANCE of a scanning lidar."""

from __future__ import annotations

from typing import Final

from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import BY_NAME
from vehicle_sim.mavlink.link import Link
from vehicle_sim.mavlink.messages.sensors import SensorMessages

DISTANCE_SENSOR, OBSTACLE_DISTANCE = BY_NAME["DISTANCE_SENSOR"], BY_NAME["OBSTACLE_DISTANCE"]
OBSTACLE_HZ: Final = {"gcs": 1.0, "api": 10.0}


class RangingService:
    """Sends the distance sensor messages of one vehicle."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._messages = SensorMessages(context.autopilot)

    def start_streams(self, link: Link, now_us: int) -> None:
        """Starts OBSTACLE_DISTANCE if the world has a lidar that measures in all horizontal directions."""
        if self._context.view.simulation.world.lidars.around:
            link.set_interval(OBSTACLE_DISTANCE.id, round(1e6 / OBSTACLE_HZ[link.profile]), now_us)

    def send(self, link: Link) -> None:
        """Sends DISTANCE_SENSOR of the downward lidar, then of the forward lidar."""
        for payload in (self._messages.distance_sensor(), self._messages.distance_forward()):
            if payload is not None:
                link.send_payload(DISTANCE_SENSOR, payload)
