"""Streams of the additional lidars of a world: a second DISTANCE_SENSOR, and OBSTACLE_DISTANCE."""

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

    def begin(self, link: Link, now_us: int) -> None:
        """Streams OBSTACLE_DISTANCE if the world has such a lidar."""
        if self._context.view.simulation.world.lidars.around:
            link.set_interval(OBSTACLE_DISTANCE.id, round(1e6 / OBSTACLE_HZ[link.profile]), now_us)

    def send(self, link: Link) -> None:
        """Sends all distance sensors: downward, then forward."""
        for payload in (self._messages.distance_sensor(), self._messages.distance_forward()):
            if payload is not None:
                link.send_payload(DISTANCE_SENSOR, payload)
