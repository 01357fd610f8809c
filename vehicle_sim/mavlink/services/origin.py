"""Origin of the local frame: sent when it is first known, and set by SET_GPS_GLOBAL_ORIGIN."""

from __future__ import annotations

import math

from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import BY_NAME, Message
from vehicle_sim.mavlink.link import Link

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
