"""Routes of a vehicle's cameras."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Response

from gcs_server.api import responses
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.station import StationDep
from gcs_server.api.vehicle_routes import run_command

router = APIRouter(prefix="/vehicles/{v}/camera", tags=["camera"], responses=RESPONSES)


Component = Annotated[
    int | None,
    Query(
        ge=1,
        le=255,
        description="MAVLink component id of the camera; default: the lowest that is connected.",
    ),
]


@router.post("/picture", response_model=responses.CommandDone)
async def picture(
    v: str, station: StationDep, principal: PrincipalDep, component: Component = None
) -> Response:
    """Takes one photo; answers once the camera has acknowledged it."""
    return await run_command(
        station,
        principal,
        "camera/picture",
        v,
        {} if component is None else {"component": component},
        lambda vehicle: vehicle.camera.take_picture(component),
    )
