"""Routes of a vehicle's gimbals; the default for `component` and `device` is the first gimbal."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Query, Response

from gcs_server.api import models, responses
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import json_response
from gcs_server.api.station import StationDep, VehicleDep
from gcs_server.api.vehicle_routes import run_command

router = APIRouter(prefix="/vehicles/{v}/gimbal", tags=["gimbal"], responses=RESPONSES)


Component = Annotated[
    int | None,
    Query(
        ge=1,
        le=255,
        description="MAVLink component id of the gimbal manager; default: the first gimbal manager.",
    ),
]
Device = Annotated[
    int | None,
    Query(ge=1, le=255, description="Gimbal device id, if the gimbal manager has several gimbals."),
]
GimbalSelector = tuple[int | None, int | None]


def gimbal_selector(component: Component = None, device: Device = None) -> GimbalSelector:
    """The gimbal selected by a request."""
    return component, device


GimbalSelectorDep = Annotated[GimbalSelector, Depends(gimbal_selector)]


def _journal_arguments(selector: GimbalSelector, **arguments: object) -> dict[str, object]:
    """The arguments of a command for the journal."""
    parts = zip(("component", "device"), selector, strict=True)
    return arguments | {name: value for name, value in parts if value is not None}


@router.get("", response_model=responses.GimbalView)
async def show(vehicle: VehicleDep, station: StationDep, selector: GimbalSelectorDep) -> Response:
    """State and limits of the gimbal, and the component that controls it."""
    service = vehicle.gimbals.service_for(*selector)
    gimbal = service.reading()
    return json_response(
        {
            "vehicle": vehicle.id,
            "available": gimbal is not None,
            "in_control": gimbal is not None and gimbal.primary_control == station.mavlink_ids,
            "roi": service.roi,
            "gimbal": gimbal,
        }
    )


@router.post("/take", response_model=responses.CommandDone)
async def take(v: str, station: StationDep, principal: PrincipalDep, selector: GimbalSelectorDep) -> Response:
    """Takes primary control of the gimbal."""
    return await run_command(
        station,
        principal,
        "gimbal/take",
        v,
        _journal_arguments(selector),
        lambda vehicle: vehicle.gimbals.service_for(*selector).take_control(),
    )


@router.post("/release", response_model=responses.CommandDone)
async def release(
    v: str, station: StationDep, principal: PrincipalDep, selector: GimbalSelectorDep
) -> Response:
    """Releases gimbal control if this server has it."""
    return await run_command(
        station,
        principal,
        "gimbal/release",
        v,
        _journal_arguments(selector),
        lambda vehicle: vehicle.gimbals.service_for(*selector).release_control(),
    )


@router.post("/angles", response_model=responses.GimbalPointed)
async def angles(
    v: str,
    body: models.GimbalAngles,
    station: StationDep,
    principal: PrincipalDep,
    selector: GimbalSelectorDep,
) -> Response:
    """Points the camera. Answers once the gimbal has reached the angles or stopped; `limited` is the angle at
    which a limit stopped the gimbal.

    Without `wait`, answers once the vehicle has acknowledged.
    """
    return await run_command(
        station,
        principal,
        "gimbal/angles",
        v,
        _journal_arguments(selector, **body.model_dump(exclude_none=True)),
        lambda vehicle: vehicle.gimbals.service_for(*selector).set_angles(
            body.pitch_deg, body.yaw_deg, roll_deg=body.roll_deg, yaw_lock=body.yaw_lock, wait=body.wait
        ),
        result_as="limited",
    )


@router.post("/rates", response_model=responses.CommandDone)
async def rates(
    v: str,
    body: models.GimbalRates,
    station: StationDep,
    principal: PrincipalDep,
    selector: GimbalSelectorDep,
) -> Response:
    """Turns the camera at constant rates; zero stops both axes."""
    return await run_command(
        station,
        principal,
        "gimbal/rates",
        v,
        _journal_arguments(selector, **body.model_dump()),
        lambda vehicle: vehicle.gimbals.service_for(*selector).set_rates(
            body.pitch_rate_deg_s, body.yaw_rate_deg_s, yaw_lock=body.yaw_lock
        ),
    )


@router.post("/roi", response_model=responses.CommandDone)
async def roi(
    v: str, body: models.GimbalRoi, station: StationDep, principal: PrincipalDep, selector: GimbalSelectorDep
) -> Response:
    """Keeps the camera pointed at a location (ROI)."""
    return await run_command(
        station,
        principal,
        "gimbal/roi",
        v,
        _journal_arguments(selector, **body.model_dump()),
        lambda vehicle: vehicle.gimbals.service_for(*selector).set_roi(
            body.lat_deg, body.lon_deg, body.alt_amsl_m
        ),
    )


@router.post("/roi/clear", response_model=responses.CommandDone)
async def clear_roi(
    v: str, station: StationDep, principal: PrincipalDep, selector: GimbalSelectorDep
) -> Response:
    """Clears the location (ROI) at which the camera is pointed."""
    return await run_command(
        station,
        principal,
        "gimbal/roi/clear",
        v,
        _journal_arguments(selector),
        lambda vehicle: vehicle.gimbals.service_for(*selector).clear_roi(),
    )
