"""Decides which ground the 3D view draws: that around a vehicle that a view follows, one for all views."""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable, Set

from gcs_server.errors import GcsError
from gcs_server.scene.ports import SceneFleet, SceneVehicle, value_of
from gcs_server.scene.terrain import ReadRelief, Terrain
from gcs_server.vehicle.samples import GlobalPosition, Home
from missions.frames import Vector3
from missions.geodesy import distance_m
from missions.terrain.relief import Relief

log = logging.getLogger(__name__)

MAX_AWAY_M = 1500.0
"""Distance of the vehicle from the middle of the ground from which ground around the vehicle is read [m]."""


class SceneGround:
    """Reads the ground around a vehicle, again when the vehicle is far away or an elevation file has changed.

    Args:
        files: returns a value that changes with the elevation files; empty: there are none.
        read: reads the ground around a position, in a process.
    """

    def __init__(self, files: Callable[[], Awaitable[tuple[object, ...]]], read: ReadRelief) -> None:
        self._files, self._read = files, read
        self._read_for: tuple[object, float, float] | None = None
        """The files and the position of the last reading."""
        self._relief: Relief | None = None
        self._terrain: tuple[Vector3 | None, Terrain | None] = (None, None)
        """The home for which the terrain was placed."""

    async def around(self, fleet: SceneFleet, followed: Set[str]) -> Terrain | None:
        """The ground to draw; None: it is not known. The same object until something has changed."""
        vehicles = fleet.all()
        vehicle = next((each for each in vehicles if each.id in followed), next(iter(vehicles), None))
        home_deg_m = None if vehicle is None else _home_of(vehicle)
        position = None if vehicle is None else _position_of(vehicle)
        files = await self._files()
        if not files or position is None:
            self._read_for = self._relief = None
        elif self._read_for is None or self._read_for[0] != files or self._is_far(position):
            self._read_for = (files, position[0], position[1])
            try:
                self._relief = await self._read(position[0], position[1])
            except GcsError as error:
                log.warning("the ground of the 3D view was not read: %s", error)
                self._relief = None
        placed = self._terrain[1]
        if self._relief is None:
            self._terrain = (None, None)
        elif placed is None or placed.relief is not self._relief or self._terrain[0] != home_deg_m:
            self._terrain = (home_deg_m, Terrain.at_home(self._relief, home_deg_m))
        return self._terrain[1]

    def _is_far(self, position: Vector3) -> bool:
        assert self._read_for is not None
        return distance_m(self._read_for[1], self._read_for[2], position[0], position[1]) > MAX_AWAY_M


def _home_of(vehicle: SceneVehicle) -> Vector3 | None:
    home = value_of(vehicle, "home", Home)
    return None if home is None else (home.lat_deg, home.lon_deg, home.alt_amsl_m)


def _position_of(vehicle: SceneVehicle) -> Vector3 | None:
    """Where the vehicle is; before it has reported that, its home."""
    sample = value_of(vehicle, "global_position", GlobalPosition)
    return _home_of(vehicle) if sample is None else (sample.lat_deg, sample.lon_deg, sample.alt_amsl_m)
