"""Switches obstacle avoidance of one vehicle's stream on and off, and requests a sufficient rate of the
messages of the vehicle's sensors."""

from __future__ import annotations

from gcs_server.clock import Clock
from gcs_server.errors import Refused
from gcs_server.mavlink import dialect as d
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.streamer.offboard.status import AvoidanceView
from gcs_server.streamer.schedule.scheduler import StreamState
from gcs_server.vehicle.samples import DistanceSensors, ObstacleDistance
from gcs_server.vehicle.vehicle import Vehicle
from missions.avoidance.avoider import FRESH_S
from missions.avoidance.scans import LEVEL_MAX_SINE, measures_level, recent_scans
from missions.avoidance.values import AvoidanceWay

SENSOR_TOPICS = {
    "distance_sensors": d.MAVLINK_MSG_ID_DISTANCE_SENSOR,
    "obstacle_distance": d.MAVLINK_MSG_ID_OBSTACLE_DISTANCE,
}
"""MAVLink message id of each telemetry topic with measurements of obstacles."""
RATE_HZ = 5.0
"""Requested rate of the sensors' messages [Hz]. PX4's default of one message every one or two seconds is too
slow for braking."""
MAX_MESSAGE_AGE_S = 0.5
"""Maximum age of the newest message; if it is older, a higher rate is requested [s]."""
REQUEST_PERIOD_S = 2.0
"""Minimum time between two requests of a higher rate [s]."""
SENSOR_PRESENT_S = 10.0
"""Time for which a sensor counts as present after a message [s]."""
SENSOR_TIMEOUT_S, CHECK_PERIOD_S = 3.0, 0.1


class AvoidanceControl:
    """Avoidance of one vehicle; off when the server starts.

    Args:
        clock: the server's clock.
        vehicle: the vehicle.
        estimates: the vehicle's estimates, with the measurements of its sensors.
    """

    def __init__(self, clock: Clock, vehicle: Vehicle, estimates: VehicleEstimates) -> None:
        self._clock = clock
        self._vehicle = vehicle
        self._estimates = estimates
        self._requested_s = float("-inf")
        self.way: AvoidanceWay | None = None
        """What avoidance tries first (over or around); None: avoidance is off."""
        self.mission_way: AvoidanceWay | None = None
        """What the mission's first step with avoidance tries first; None: avoidance is off in all
        steps. Reset at the end of the mission.
        """

    async def switch_on(self, way: AvoidanceWay) -> None:
        """Switches avoidance on, also for a running stream; returns once a sensor sends often enough.

        Raises:
            Refused: no sensor measures obstacles.
        """
        await self.wait_for_sensor()
        self.way = way

    async def wait_for_sensor(self) -> None:
        """Returns once a sensor sends often enough to avoid obstacles.

        Raises:
            Refused: no sensor measures obstacles.
        """
        until_s = self._clock.monotonic_s() + SENSOR_TIMEOUT_S
        self._vehicle.require_commandable()
        while self.has_sensor() and not self._has_recent_scan() and self._clock.monotonic_s() < until_s:
            self.request_rates()
            await self._clock.sleep(CHECK_PERIOD_S)
        self.require_sensor()

    def switch_off(self) -> None:
        """Switches avoidance off, even for the current mission; does not change the obstacle brake."""
        self.way = self.mission_way = None

    def require_sensor(self) -> None:
        """Checks that avoidance is possible.

        Raises:
            Refused: no sensor measures obstacles.
        """
        if not self._has_recent_scan():
            raise Refused(
                f"Vehicle {self._vehicle.id} cannot avoid obstacles: no obstacle sensor has sent data within "
                f"the last {FRESH_S:g} s.",
                remedy="Check the sensor (OBSTACLE_DISTANCE, or DISTANCE_SENSOR with a horizontal direction) "
                "and the link, or switch avoidance off.",
            )

    def request_rates(self) -> None:
        """Requests a higher rate of messages that arrive too rarely; called periodically while a stream
        runs."""
        now_s = self._clock.monotonic_s()
        if now_s - self._requested_s < REQUEST_PERIOD_S or not self.has_sensor():
            return
        for topic, msg_id in SENSOR_TOPICS.items():
            sample = self._vehicle.topic(topic)
            if sample is None or now_s - sample.received_monotonic_s < MAX_MESSAGE_AGE_S:
                continue
            self._requested_s = now_s
            identity = self._vehicle.identity
            self._vehicle.send(
                d.MAVLink_command_long_message(
                    identity.system_id, identity.component_id, d.MAV_CMD_SET_MESSAGE_INTERVAL, 0,
                    float(msg_id), 1e6 / RATE_HZ, 0.0, 0.0, 0.0, 0.0, 0.0,
                )
            )  # fmt: skip

    def has_sensor(self) -> bool:
        """Whether the vehicle has a sensor that measures obstacles, from its recent messages."""
        now_s = self._clock.monotonic_s()
        for topic in SENSOR_TOPICS:
            sample = self._vehicle.topic(topic)
            if sample is None or now_s - sample.received_monotonic_s > SENSOR_PRESENT_S:
                continue
            value = sample.value
            if isinstance(value, ObstacleDistance):
                return True
            if isinstance(value, DistanceSensors) and any(
                each.direction_frd[2] <= LEVEL_MAX_SINE for each in value.sensors
            ):
                return True
        return False

    def view(self, state: StreamState) -> AvoidanceView:
        """Avoidance as shown in the status."""
        current = state.avoiding
        text = "" if current is None else current.text
        if self.way is not None and state.phase == "idle":
            text = "On: acts once setpoints are streamed."
        elif self.way is None and self.mission_way is not None and current is None:
            text = "On in the mission's steps with avoidance."
        way = self.way or self.mission_way
        if way is not None and current is not None and current.way is not None:
            way = current.way
        return AvoidanceView(
            on=way is not None,
            way=way or "over",
            state=None if current is None else current.state,
            text=text,
            sensor=self.has_sensor(),
        )

    def _has_recent_scan(self) -> bool:
        scans = recent_scans(self._estimates.scans(), self._clock.monotonic_s(), FRESH_S)
        return any(measures_level(scan) for scan in scans)
