"""Routes of the ground: the elevation files, the sources of heights, and saving the ground of a region."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import Path, Response
from pydantic import Field

from gcs_server.api import plan_models as m
from gcs_server.api.map_routes import MAX_ZOOM, REVALIDATE
from gcs_server.api.map_source_routes import (
    ChosenSource,
    MapSourceList,
    MapSourceView,
    NewMapSource,
    RegionSize,
    ShortText,
    Zoom,
    announce,
    source_list,
    source_view,
)
from gcs_server.api.operation_routes import OperationModel, operation_view
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import Station, StationDep
from gcs_server.api.strict_body import Latitude, Longitude, StrictBody, example
from gcs_server.control.accepted import authorized_command
from gcs_server.errors import Refused
from gcs_server.maps.regions import Region, region_path
from gcs_server.maps.sources import MapSource
from gcs_server.operations.operations import ReportProgress
from gcs_server.plans import ground_regions

router = Routes(prefix="/elevation", tags=["plans"], responses=RESPONSES)


class GroundRegion(StrictBody):
    """A region whose ground is saved."""

    model_config = example(
        source="terrain_tiles", name="Test field", bounds_deg=[8.54, 47.39, 8.56, 47.41], zoom=13
    )

    source: str
    """Id of the source of heights, which must be chosen."""
    name: ShortText
    """Name of the elevation file."""
    bounds_deg: tuple[Longitude, Latitude, Longitude, Latitude]
    """West, south, east, north."""
    zoom: Annotated[Zoom, Field(ge=8)]
    """Zoom of the tiles: at 13, heights are 13 m apart in central Europe; one more halves that."""

    def region(self) -> Region:
        """The area and the zoom."""
        return Region(self.bounds_deg, self.zoom, self.zoom)


@router.get("", response_model=m.ElevationFiles)
async def list_elevation_files(station: StationDep) -> Response:
    """The elevation files in the data folder, in the order in which they are used, and the files that cannot
    be read."""
    version, files = await station.ground_tiles.listing()
    url = None if version is None else f"/api/v1/elevation/tiles/{version}"
    folder = str(station.flights.plan_work.elevation_folder)
    return json_response({"folder": folder, "tiles_url": url, **files})


@router.get(
    "/tiles/{version}/{zoom}/{x}/{y}",
    response_class=Response,
    responses={
        200: {"content": {"image/png": {}}},
        204: {"description": "The ground there is not known, or the zoom is not within 8 to 14."},
    },
)
async def ground_tile(
    version: Annotated[str, Path(max_length=64)],
    zoom: Annotated[int, Path(ge=0, le=MAX_ZOOM)],
    x: Annotated[int, Path(ge=0, lt=1 << MAX_ZOOM)],
    y: Annotated[int, Path(ge=0, lt=1 << MAX_ZOOM)],
    station: StationDep,
) -> Response:
    """The known ground as a tile of heights (Terrarium, 512 px), y counted from the north, made of the
    elevation files. Unknown heights beside known ones are as low as the lowest known one of the tile."""
    current = await station.ground_tiles.version()
    tile = b"" if current is None else await station.ground_tiles.tile(current, zoom, x, y)
    headers = {"Cache-Control": "max-age=86400"} if version == current else REVALIDATE
    if not tile:
        return Response(status_code=204, headers=headers)
    return Response(tile, media_type="image/png", headers=headers)


@router.get("/sources", response_model=MapSourceList)
async def list_elevation_sources(station: StationDep) -> Response:
    """The sources of heights (tiles in the Terrarium encoding). Nothing is asked of any of them before one
    is chosen and a region is saved."""
    return await source_list(station.elevation_sources, station.elevation_tiles)


@router.put("/sources/chosen", response_model=MapSourceList)
async def choose_elevation_source(
    body: ChosenSource, station: StationDep, principal: PrincipalDep
) -> Response:
    """Chooses the source from which the ground of a region can be saved, or none."""
    with authorized_command(station, principal, "elevation/choose", None, {"source": body.source}):
        station.elevation_sources.choose(body.source)
        announce(station, f"{principal.name} chose another source of heights.")
    return await list_elevation_sources(station)


@router.post("/sources", status_code=201, response_model=MapSourceView)
async def add_elevation_source(body: NewMapSource, station: StationDep, principal: PrincipalDep) -> Response:
    """Adds a source of heights; it is not chosen, and not asked for anything."""
    sources = station.elevation_sources
    with authorized_command(station, principal, "elevation/add_source", None, body.model_dump()):
        source = sources.add(
            body.name,
            body.url,
            body.attribution,
            body.max_zoom,
            may_save=body.may_save,
            min_zoom=body.min_zoom,
        )
    return json_response(await source_view(sources, station.elevation_tiles, source), 201)


@router.delete("/sources/{s}", status_code=204)
async def remove_elevation_source(s: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Removes one of the operator's own sources and its kept tiles. Saved regions stay."""
    with authorized_command(station, principal, "elevation/remove_source", None, {"source": s}):
        source = station.elevation_sources.get(s)
        station.elevation_sources.remove(s)
        await station.elevation_tiles.forget(source)
        announce(station, f"{principal.name} removed the source {source.name}.")
    return Response(status_code=204)


@router.post("/regions/size", response_model=RegionSize)
async def ground_region_size(body: GroundRegion, station: StationDep) -> Response:
    """The number of tiles of a region and the size of its file, before it is saved."""
    source = _chosen(station, body.source)
    region = body.region()
    ground_regions.check(region, source)
    tile_bytes = await station.elevation_tiles.mean_tile_bytes(source) or ground_regions.USUAL_TILE_BYTES
    return json_response({"tiles": region.count(), "estimated_bytes": region.count() * tile_bytes})


@router.post(
    "/regions",
    status_code=202,
    response_model=OperationModel,
    responses={202: {"model": OperationModel, "description": "The ground is being saved."}},
)
async def save_ground_region(body: GroundRegion, station: StationDep, principal: PrincipalDep) -> Response:
    """Saves the ground of a region as an elevation file: an operation, which can be followed and cancelled.
    Its result is the file's name and the number of its tiles."""
    with authorized_command(station, principal, "elevation/save_region", None, body.model_dump()):
        source = _chosen(station, body.source)
        region = body.region()
        ground_regions.check(region, source)
        work_on_plans = station.flights.plan_work
        path = await asyncio.to_thread(region_path, work_on_plans.elevation_folder, body.name, ".tif")

        async def work(report: ReportProgress) -> dict[str, object]:
            tiles = station.elevation_tiles
            count = await ground_regions.save(work_on_plans, tiles, source, region, path, report)
            announce(station, f"The ground {path.name} was saved.")
            return {"file": path.name, "tiles": count}

        operation = station.operations.start(
            "elevation/save",
            work,
            text=f"Saving {region.count():,} tiles of {source.name}.",
            subject=body.name,
            by=(principal.name, principal.key),
        )
    return json_response(operation_view(operation), 202)


def _chosen(station: Station, source_id: str) -> MapSource:
    """The source with this id. Raises UnknownSource, and Refused if it is not chosen."""
    source = station.elevation_sources.get(source_id)
    if source != station.elevation_sources.chosen:
        raise Refused(
            f"The elevation source {source.name} is not chosen.", remedy="PUT /elevation/sources/chosen"
        )
    return source
