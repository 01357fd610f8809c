"""Routes of map sources: choosing one, adding own ones, their tiles, and saving a region for the field."""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from typing import Annotated

from fastapi import Path, Response
from pydantic import Field

from gcs_server.api.map_routes import MAX_ZOOM, REVALIDATE
from gcs_server.api.operation_routes import OperationModel, operation_view
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES, Problem
from gcs_server.api.responses import json_bytes, json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import Station, StationDep
from gcs_server.api.strict_body import Latitude, Longitude, ResponseBody, StrictBody, example
from gcs_server.control.accepted import authorized_command
from gcs_server.errors import Refused
from gcs_server.maps.regions import USUAL_TILE_BYTES, Region, region_path, save
from gcs_server.maps.sources import MapSource, MapSources, check_address
from gcs_server.maps.tiles import Tiles, content_type
from gcs_server.mavlink.dialect import MAV_SEVERITY_DEBUG
from gcs_server.operations.operations import ReportProgress
from gcs_server.storage.maps import VECTOR_TYPE

router = Routes(tags=["station"], responses=RESPONSES)

Zoom = Annotated[int, Field(ge=0, le=MAX_ZOOM)]
ShortText = Annotated[str, Field(min_length=1, max_length=100)]


class MapSourceView(ResponseBody):
    """A source of map tiles, or of heights."""

    id: str
    """Id for the other calls."""
    name: str
    """Name in the page."""
    url: str
    """Address of a tile, with placeholders."""
    host: str
    """The computer that is asked for tiles, and thereby learns which area is viewed."""
    attribution: str
    """Attribution that its licence requires."""
    min_zoom: int
    """Smallest zoom with tiles."""
    max_zoom: int
    """Largest zoom with tiles."""
    may_save: bool
    """Whether its terms allow saving a region."""
    own: bool
    """Whether an operator added it."""
    kept_bytes: int
    """Size of its tiles on the server's disk."""
    problem: str | None
    """Why it last failed; null: it answered since, or was not asked."""


class MapSourceList(ResponseBody):
    """The sources of map tiles, or of heights."""

    chosen: str | None
    """The source that is used; null: none, and nothing is asked for."""
    sources: list[MapSourceView]
    """The usual sources, then the operator's own."""


class ChosenSource(StrictBody):
    """Which source is used."""

    model_config = example(source="osm")

    source: str | None
    """Id of a source; null: none."""


class NewMapSource(StrictBody):
    """A source of the operator's own."""

    model_config = example(name="Field", url="http://192.168.1.20/tiles/{z}/{x}/{y}.png", may_save=True)

    name: ShortText
    """Name in the page."""
    url: Annotated[str, Field(min_length=1, max_length=1000)]
    """Address of a tile: an XYZ or WMTS template, or a WMTS tile with its parameters; or of a PMTiles
    archive."""
    attribution: Annotated[str, Field(max_length=300)] = ""
    """Attribution that its licence requires."""
    min_zoom: Zoom = 0
    """Smallest zoom with tiles."""
    max_zoom: Zoom = 19
    """Largest zoom with tiles."""
    may_save: bool = False
    """Whether its terms allow saving a region."""


class WmtsAddress(StrictBody):
    """The address of a WMTS service."""

    model_config = example(url="https://maps.example.org/wmts/1.0.0/WMTSCapabilities.xml")

    url: Annotated[str, Field(min_length=1, max_length=1000)]
    """Address of its capabilities."""


class WmtsLayerView(ResponseBody):
    """A layer of a WMTS service that the map can show."""

    name: str
    """Its title."""
    url: str
    """Address of its tiles, for `POST /map_sources`."""
    min_zoom: int
    """Smallest zoom with tiles."""
    max_zoom: int
    """Largest zoom with tiles."""


class WmtsLayers(ResponseBody):
    """The layers of a WMTS service."""

    attribution: str
    """Who provides the service; may be empty."""
    layers: list[WmtsLayerView]
    """Layers of images in Web Mercator, in the service's order."""
    others: int
    """Number of its other layers."""


class RegionRequest(StrictBody):
    """A region of a source."""

    model_config = example(
        source="own1", name="Test field", bounds_deg=[8.54, 47.39, 8.56, 47.41], min_zoom=10, max_zoom=17
    )

    source: str
    """Id of the source."""
    name: ShortText
    """Name of the map file."""
    bounds_deg: tuple[Longitude, Latitude, Longitude, Latitude]
    """West, south, east, north."""
    min_zoom: Zoom
    """Smallest zoom."""
    max_zoom: Zoom
    """Largest zoom."""

    def region(self) -> Region:
        """The area and zooms."""
        return Region(self.bounds_deg, self.min_zoom, self.max_zoom)


class RegionSize(ResponseBody):
    """What saving a region takes."""

    tiles: int
    """Number of tiles."""
    estimated_bytes: float
    """Size of the file, from the mean of the kept tiles, or else from a usual tile."""


@router.get("/map_sources", response_model=MapSourceList)
async def list_map_sources(station: StationDep) -> Response:
    """The sources of map tiles. Nothing is asked of any of them before one is chosen."""
    return await source_list(station.map_sources, station.map_tiles)


@router.put("/map_sources/chosen", response_model=MapSourceList)
async def choose_map_source(body: ChosenSource, station: StationDep, principal: PrincipalDep) -> Response:
    """Chooses the source that the map shows in all browsers, or none."""
    with authorized_command(station, principal, "maps/choose", None, {"source": body.source}):
        station.map_sources.choose(body.source)
        announce(station, f"{principal.name} chose another map.")
    return await list_map_sources(station)


@router.post("/map_sources", status_code=201, response_model=MapSourceView)
async def add_map_source(body: NewMapSource, station: StationDep, principal: PrincipalDep) -> Response:
    """Adds a source; it is not chosen, and not asked for anything."""
    with authorized_command(station, principal, "maps/add_source", None, body.model_dump()):
        source = station.map_sources.add(
            body.name,
            body.url,
            body.attribution,
            body.max_zoom,
            may_save=body.may_save,
            min_zoom=body.min_zoom,
        )
    return json_response(await source_view(station.map_sources, station.map_tiles, source), 201)


@router.post(
    "/map_sources/wmts_layers",
    response_model=WmtsLayers,
    responses={502: {"model": Problem, "description": "The service does not answer, or not as WMTS."}},
)
async def read_wmts_layers(body: WmtsAddress, station: StationDep, principal: PrincipalDep) -> Response:
    """Asks a WMTS service once for its layers, so that the address of one can be added as a source."""
    with authorized_command(station, principal, "maps/read_service", None, body.model_dump()):
        check_address(body.url)
        description = await station.map_tiles.description(body.url)
        answer = await station.flights.plan_work.run(
            "wmts_layers", {"description": description}, small=False, field="url"
        )
    return json_bytes(answer.body)


@router.delete("/map_sources/{s}", status_code=204)
async def remove_map_source(s: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Removes one of the operator's own sources and its kept tiles."""
    with authorized_command(station, principal, "maps/remove_source", None, {"source": s}):
        source = station.map_sources.get(s)
        station.map_sources.remove(s)
        await station.map_tiles.forget(source)
        announce(station, f"{principal.name} removed the map source {source.name}.")
    return Response(status_code=204)


@router.get(
    "/map_sources/{s}/{zoom}/{x}/{y}",
    response_class=Response,
    responses={
        200: {"content": {"image/png": {}}},
        204: {"description": "The source has no such tile."},
    },
)
async def source_tile(
    s: str,
    zoom: Annotated[int, Path(ge=0, le=MAX_ZOOM)],
    x: Annotated[int, Path(ge=0, lt=1 << MAX_ZOOM)],
    y: Annotated[int, Path(ge=0, lt=1 << MAX_ZOOM)],
    station: StationDep,
) -> Response:
    """A tile of the chosen source, y counted from the north; the server asks the source for a tile that it
    has not kept, and shows an old one while the source does not answer."""
    source = station.map_sources.get(s)
    if source != station.map_sources.chosen:
        raise Refused(f"The map source {source.name} is not chosen.", remedy="PUT /map_sources/chosen")
    if not source.min_zoom <= zoom <= source.max_zoom or max(x, y) >= 1 << zoom:
        return Response(status_code=204, headers=REVALIDATE)
    tile = await station.map_tiles.tile(source, zoom, x, y)
    if not tile:
        return Response(status_code=204, headers=REVALIDATE)
    return Response(
        tile, media_type=content_type(tile) or VECTOR_TYPE, headers={"Cache-Control": "max-age=86400"}
    )


@router.post("/map_regions/size", response_model=RegionSize)
async def region_size(body: RegionRequest, station: StationDep) -> Response:
    """The number of tiles and the size of a region, before it is saved."""
    source = station.map_sources.get(body.source)
    region = body.region()
    region.check(source)
    tile_bytes = await station.map_tiles.mean_tile_bytes(source) or USUAL_TILE_BYTES
    return json_response({"tiles": region.count(), "estimated_bytes": region.count() * tile_bytes})


@router.post(
    "/map_regions",
    status_code=202,
    response_model=OperationModel,
    responses={202: {"model": OperationModel, "description": "The region is being saved."}},
)
async def save_region(body: RegionRequest, station: StationDep, principal: PrincipalDep) -> Response:
    """Saves a region as a map file: an operation, which can be followed and cancelled. Its result is the
    `file` in the maps folder and the number of `tiles`."""
    with authorized_command(station, principal, "maps/save_region", None, body.model_dump()):
        source, region = station.map_sources.get(body.source), body.region()
        region.check(source)
        if source.is_archive and (await station.map_tiles.archive_info(source)).is_vector:
            raise Refused(
                f"{source.name} has vector tiles, of which no region can be saved.",
                remedy="Copy the PMTiles file into the maps folder.",
            )
        path = await asyncio.to_thread(region_path, station.maps, body.name)

        async def work(report: ReportProgress) -> dict[str, object]:
            count = await save(station.map_tiles, source, region, path, report)
            announce(station, f"The map {path.name} was saved.")
            return {"file": path.name, "tiles": count}

        operation = station.operations.start(
            "maps/save",
            work,
            text=f"Saving {region.count():,} tiles of {source.name}.",
            subject=body.name,
            by=(principal.name, principal.key),
        )
    return json_response(operation_view(operation), 202)


def announce(station: Station, text: str) -> None:
    """Tells all clients that the map shows something else."""
    now_s = station.clock.unix_s()
    station.fleet.events.add("maps_changed", now_s, text, severity=MAV_SEVERITY_DEBUG, stored=False)


async def source_list(sources: MapSources, tiles: Tiles) -> Response:
    """All sources, and which is chosen."""
    chosen = sources.chosen
    views = [await source_view(sources, tiles, each) for each in sources.all()]
    return json_response({"chosen": None if chosen is None else chosen.id, "sources": views})


async def source_view(sources: MapSources, tiles: Tiles, source: MapSource) -> dict[str, object]:
    """One source."""
    return {
        **asdict(source),
        "host": source.host,
        "own": sources.is_own(source),
        "kept_bytes": await tiles.kept_bytes(source),
        "problem": tiles.failure(source),
    }
