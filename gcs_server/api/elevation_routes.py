"""Route of the operator's elevation files."""

from __future__ import annotations

from fastapi import Response

from gcs_server.api import plan_models as m
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import StationDep

router = Routes(prefix="/elevation", tags=["plans"], responses=RESPONSES)


@router.get("", response_model=m.ElevationFiles)
async def list_elevation_files(station: StationDep) -> Response:
    """The elevation files in the data folder, from the finest grid to the coarsest, and the files that cannot
    be read."""
    files = await station.flights.plan_work.run("elevation_files", {}, small=False)
    return json_response({"folder": str(station.flights.plan_work.elevation_folder), **files.values})
