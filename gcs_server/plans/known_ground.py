"""The ground around each vehicle, from the operator's elevation files, for the floor of its targets.

A setpoint must be checked at once, so the ground is read in advance: around the vehicle every few seconds if
it has moved, and around the target of a go-to before the command. A process reads the files.
"""

from __future__ import annotations

import asyncio
import logging
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np

from gcs_server.clock import Clock
from gcs_server.errors import GcsError
from gcs_server.plans.tasks import Answer
from gcs_server.plans.work import PlanWork, elevation_files
from gcs_server.vehicle.fleet import Fleet
from gcs_server.vehicle.samples import GlobalPosition
from gcs_server.vehicle.vehicle import Vehicle
from missions.geodesy import distance_m
from missions.terrain.ground import Ground
from missions.terrain.relief import Relief, offsets_m

log = logging.getLogger(__name__)

PERIOD_S = 5.0
HALF_SIDE_M = 3000.0
"""Half of the side of an area that is read at once [m]."""
VEHICLE_MARGIN_M, TARGET_MARGIN_M = 1500.0, 100.0
"""Minimum distance of a vehicle, and of a target, from the edge of a known area [m]. Setpoints may be 1 km
away from the vehicle."""
MAX_AREAS = 2
"""Areas of one vehicle: around itself, and around its last distant target."""
TIMEOUT_S = 4.0
"""Maximum wait of a command for the ground around its target [s]."""

Files = tuple[tuple[str, int, int], ...]
"""Path, time of change and size of each elevation file."""


@dataclass(frozen=True, slots=True, eq=False)
class _Area:
    lat_deg: float
    lon_deg: float
    files: Files
    ground: Ground | None
    """None: no file covers the area."""


class KnownGround:
    """Reads the ground around vehicles and targets.

    Args:
        clock: the server's clock.
        fleet: the vehicles.
        work: runs the process that reads the files.
    """

    def __init__(self, clock: Clock, fleet: Fleet, work: PlanWork) -> None:
        self._clock = clock
        self._fleet = fleet
        self._work = work
        self._areas: WeakKeyDictionary[Vehicle, tuple[_Area, ...]] = WeakKeyDictionary()

    async def watch(self) -> None:
        """Keeps the ground around all vehicles known."""
        while True:
            for vehicle in self._fleet.all():
                sample = vehicle.topic("global_position")
                if sample is None or not isinstance(sample.value, GlobalPosition):
                    continue
                try:
                    await self._read(vehicle, sample.value.lat_deg, sample.value.lon_deg, VEHICLE_MARGIN_M)
                except GcsError as error:
                    log.warning("the ground around vehicle %s was not read: %s", vehicle.id, error)
            await self._clock.sleep(PERIOD_S)

    async def read_around(self, vehicle: Vehicle, lat_deg: float, lon_deg: float) -> None:
        """Reads the ground around a target, unless it is known; gives up after `TIMEOUT_S`, and if the files
        cannot be read. Then the ground there counts as level at home."""
        with suppress(GcsError, TimeoutError):
            async with asyncio.timeout(TIMEOUT_S):
                await self._read(vehicle, lat_deg, lon_deg, TARGET_MARGIN_M)

    async def _read(self, vehicle: Vehicle, lat_deg: float, lon_deg: float, margin_m: float) -> None:
        folder = self._work.elevation_folder
        files = await asyncio.to_thread(files_in, folder) if folder.is_dir() else ()
        known = self._areas.get(vehicle, ())
        areas = tuple(area for area in known if area.files == files)
        reach_m = HALF_SIDE_M - margin_m
        if files and all(distance_m(lat_deg, lon_deg, a.lat_deg, a.lon_deg) > reach_m for a in areas):
            arguments = {"lat_deg": lat_deg, "lon_deg": lon_deg, "half_side_m": HALF_SIDE_M}
            answer = await self._work.run("known_ground", arguments, small=False)
            area = _Area(lat_deg, lon_deg, files, _ground_of(answer))
            areas = (area, *areas)[:MAX_AREAS]
        if areas == known:
            return
        self._areas[vehicle] = areas
        vehicle.command.floor.grounds = tuple(area.ground for area in areas if area.ground is not None)


async def relief_around(work: PlanWork, lat_deg: float, lon_deg: float) -> Relief | None:
    """The relief around a position; None: no elevation file covers it. Raises as `PlanWork.run`."""
    answer = await work.run("relief", {"lat_deg": lat_deg, "lon_deg": lon_deg}, small=False)
    if not answer.body:
        return None
    count = len(offsets_m())
    return Relief(lat_deg, lon_deg, np.frombuffer(answer.body, np.float32).reshape(count, count))


async def files_of(work: PlanWork) -> Files:
    """The elevation files of the server."""
    return await asyncio.to_thread(files_in, work.elevation_folder)


def files_in(folder: Path) -> Files:
    """The elevation files in a folder; blocks."""
    files: list[tuple[str, int, int]] = []
    for path in elevation_files(folder):
        with suppress(OSError):
            state = Path(path).stat()
            files.append((path, state.st_mtime_ns, state.st_size))
    return tuple(files)


def _ground_of(answer: Answer) -> Ground | None:
    """The ground in the answer of the task `known_ground`; None: no file covers the area."""
    if not answer.body:
        return None
    fields = answer.values
    cells = np.frombuffer(answer.body, dtype=np.float32).reshape(fields["rows"], fields["columns"])
    edges = (fields["north_deg"], fields["west_deg"], fields["step_lat_deg"], fields["step_lon_deg"])
    return Ground(*edges, cells)
