"""Where on the globe the local frame lies: told once it is known, and set by SET_GPS_GLOBAL_ORIGIN."""

from __future__ import annotations

import math

from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import BY_NAME, Message
from vehicle_sim.mavlink.link import Link

LOOK_EVERY_S = 1.0
LOWEST_M, HIGHEST_M = -12_000.0, 100_000.0


class OriginService:
    """Takes the origin and tells the one in force, changed or not, as MAVLink asks for.

    The vehicle stays where it is on the globe: its local position moves. Once armed the origin stays, since
    whatever is flown to was counted from it.
    """

    def __init__(self, context: Context) -> None:
        self._context = context
        self._asked = False
        self.handlers = {"SET_GPS_GLOBAL_ORIGIN": self.set}
        context.after(LOOK_EVERY_S, self._look)

    def set(self, link: Link, m: Message) -> None:
        """Degrees and metres from 1e-7 degrees and millimetres."""
        if m.target_system != self._context.system_id:
            return
        lat_deg, lon_deg, alt_amsl_m = m.latitude * 1e-7, m.longitude * 1e-7, m.altitude * 1e-3
        possible = abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0 and LOWEST_M < alt_amsl_m < HIGHEST_M
        if possible and not self._context.autopilot.commander.armed:
            self._move(lat_deg, lon_deg, alt_amsl_m)
        self._asked = True
        self._context.later(lambda: self._tell(link))

    def _move(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> None:
        view, keeper = self._context.view, self._context.autopilot.commander.home
        view.simulation.set_origin(view.row, lat_deg, lon_deg, alt_amsl_m)
        keeper.origin_moved()

    def _look(self) -> None:
        if self._asked:
            return
        if not math.isfinite(self._context.view.origin[0]):
            self._context.after(LOOK_EVERY_S, self._look)
            return
        for link in self._context.links:
            self._tell(link)

    def _tell(self, link: Link) -> None:
        built = self._context.telemetry.payload(BY_NAME["GPS_GLOBAL_ORIGIN"].id)
        if built is not None:
            link.send_payload(*built)
