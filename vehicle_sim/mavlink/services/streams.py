"""What the vehicle sends besides telemetry: clock offsets, distances, and the origin of its local frame."""

from __future__ import annotations

import math
from typing import Final

from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import BY_NAME, Message
from vehicle_sim.mavlink.link import Link
from vehicle_sim.mavlink.messages.sensors import SensorMessages


class TimeService:
    """Sends TIMESYNC and PING requests, and replies to received requests."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self.handlers = {"TIMESYNC": self.timesync, "PING": self.ping}

    def timesync(self, link: Link, message: Message) -> None:
        """Replies to a request (tc1 = 0) with the vehicle's time [ns]."""
        if message.tc1 == 0:
            link.send(
                "TIMESYNC", tc1=self._context.view.time_boot_us() * 1000, ts1=message.ts1,
                target_system=message.system_id, target_component=message.component_id,
            )  # fmt: skip

    def ping(self, link: Link, message: Message) -> None:
        """Replies to a ping request."""
        if message.target_system == 0 and message.target_component == 0:
            link.send(
                "PING", time_usec=message.time_usec, seq=message.seq, target_system=message.system_id,
                target_component=message.component_id,
            )  # fmt: skip

    def send_timesync(self, link: Link) -> None:
        """Sends a TIMESYNC request."""
        link.send("TIMESYNC", ts1=self._context.view.time_boot_us() * 1000)

    def send_ping(self, link: Link) -> None:
        """Sends a ping request."""
        link.send("PING", time_usec=self._context.view.time_boot_us(), seq=link.ping_sequence)
        link.ping_sequence += 1


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


CHECK_EVERY_S = 1.0
MIN_ALT_AMSL_M, MAX_ALT_AMSL_M = -12_000.0, 100_000.0


class OriginService:
    """Sets the origin; always replies with the current origin, as MAVLink requires.

    A new origin changes the vehicle's local position, but not its global position. An armed vehicle keeps its
    origin, because setpoints are relative to the origin.
    """

    def __init__(self, context: Context) -> None:
        self._context = context
        self._sent_to_client = False
        self.handlers = {"SET_GPS_GLOBAL_ORIGIN": self.set_gps_global_origin}
        context.call_later(CHECK_EVERY_S, self._send_when_known)

    def set_gps_global_origin(self, link: Link, m: Message) -> None:
        """Handles SET_GPS_GLOBAL_ORIGIN (1e-7 degrees and millimetres)."""
        if m.target_system != self._context.system_id:
            return
        lat_deg, lon_deg, alt_amsl_m = m.latitude * 1e-7, m.longitude * 1e-7, m.altitude * 1e-3
        is_valid = (
            abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0 and MIN_ALT_AMSL_M < alt_amsl_m < MAX_ALT_AMSL_M
        )
        if is_valid and not self._context.autopilot.commander.armed:
            self._set_origin(lat_deg, lon_deg, alt_amsl_m)
        self._sent_to_client = math.isfinite(self._context.view.origin[0])
        self._context.call_soon(lambda: self._send(link))

    def _set_origin(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> None:
        view, home = self._context.view, self._context.autopilot.commander.home
        view.simulation.set_origin(view.row, lat_deg, lon_deg, alt_amsl_m)
        home.on_origin_change()

    def _send_when_known(self) -> None:
        if self._sent_to_client:
            return
        if not math.isfinite(self._context.view.origin[0]):
            self._context.call_later(CHECK_EVERY_S, self._send_when_known)
            return
        for link in self._context.links:
            self._send(link)

    def _send(self, link: Link) -> None:
        layout_and_payload = self._context.telemetry.payload(BY_NAME["GPS_GLOBAL_ORIGIN"].id)
        if layout_and_payload is not None:
            link.send_payload(*layout_and_payload)
