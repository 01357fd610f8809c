"""The lowest altitudes for the targets of one vehicle, from its home and the known ground around it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from gcs_server.vehicle.samples import Home
from gcs_server.vehicle.services.port import VehiclePort
from missions.floor import LANDING_HEIGHT_M, Floor
from missions.terrain.ground import Ground

LANDING_HEIGHT_PARAMETER = "MPC_LAND_ALT3"
MAX_LANDING_HEIGHT_M = 10.0


class VehicleFloor:
    """The floor of one vehicle. `grounds` is the known ground around the vehicle and its targets; the server
    reads it from the elevation files."""

    def __init__(self, vehicle: VehiclePort, parameter: Callable[[str], float | None]) -> None:
        """
        Args:
            vehicle: the vehicle.
            parameter: the newest known value of a parameter; None: unknown.
        """
        self._vehicle = vehicle
        self._parameter = parameter
        self.grounds: Sequence[Ground] = ()

    def now(self) -> Floor:
        """The lowest altitudes now."""
        sample = self._vehicle.topic("home")
        home = sample.value if sample is not None and isinstance(sample.value, Home) else None
        landing_height_m = self._parameter(LANDING_HEIGHT_PARAMETER)
        if landing_height_m is None or not 0.0 <= landing_height_m <= MAX_LANDING_HEIGHT_M:
            landing_height_m = LANDING_HEIGHT_M
        position = None if home is None else (home.lat_deg, home.lon_deg, home.alt_amsl_m)
        return Floor(position, self.grounds, landing_height_m)
