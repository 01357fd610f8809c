"""Saves the heights of a region, from tiles of a source, as an elevation file: then the profile, the checks,
terrain following and the floor of targets know the ground there, as from a file that the operator has
copied."""

from __future__ import annotations

import asyncio
from pathlib import Path

from gcs_server.errors import InvalidRequest, Refused
from gcs_server.maps import regions
from gcs_server.maps.regions import Region
from gcs_server.maps.sources import MapSource
from gcs_server.maps.tiles import Tiles
from gcs_server.operations.operations import ReportProgress
from gcs_server.plans.work import PlanWork
from gcs_server.storage.maps import MapError

MAX_TILES = 400
"""Twenty by twenty tiles: 33 km by 33 km at zoom 14 in central Europe."""
USUAL_TILE_BYTES = 80_000.0


def check(region: Region, source: MapSource) -> None:
    """Raises InvalidRequest or Refused if the heights of this region cannot be saved."""
    region.check(source)
    if region.count() > MAX_TILES:
        raise Refused(
            f"The region has {region.count():,} tiles; the ground of at most {MAX_TILES} is saved at a time.",
            remedy="Choose a smaller area, or less detail.",
        )


async def save(
    work: PlanWork, tiles: Tiles, source: MapSource, region: Region, path: Path, report: ReportProgress
) -> int:
    """Saves a region; a process with limits reads the tiles. Returns the number of tiles.

    Raises:
        MapSourceFailed: the source stopped answering.
        MapError: the tiles show no heights, or the file cannot be written. Nothing is left of it.
    """

    async def write(part: Path) -> None:
        made = path.with_name(f".{path.name}.made")
        report(f"Writing {path.name}.", None)
        arguments = {"tiles": str(part), "file": str(made), "attribution": source.attribution}
        try:
            await work.run("ground_from_tiles", arguments, small=False, field="name")
            await asyncio.to_thread(made.rename, path)
        except InvalidRequest as error:
            raise MapError(f"Not saved: {error.message}", remedy=error.remedy) from error
        finally:
            made.unlink(missing_ok=True)

    return await regions.save(tiles, source, region, path, report, write)
