"""The gimbal of a vehicle."""

from __future__ import annotations

from fastapi import APIRouter, Response

from gcs_server.api import models, responses
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import answer
from gcs_server.api.station import StationDep, VehicleDep
from gcs_server.api.vehicle_routes import carry_out
from gcs_server.vehicle.samples import Gimbal

router = APIRouter(prefix="/vehicles/{v}/gimbal", tags=["gimbal"], responses=RESPONSES)


@router.get("", response_model=responses.GimbalView)
async def show(vehicle: VehicleDep, station: StationDep) -> Response:
    """State and limits of the gimbal, and who controls it."""
    sample = vehicle.topic("gimbal")
    gimbal = sample.value if sample is not None and isinstance(sample.value, Gimbal) else None
    return answer(
        {
            "vehicle": vehicle.id,
            "available": gimbal is not None,
            "in_control": gimbal is not None and gimbal.primary_control == station.own_ids,
            "roi": vehicle.gimbal.roi,
            "gimbal": gimbal,
        }
    )


@router.post("/take", response_model=responses.CommandDone)
async def take(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Takes primary control of the gimbal."""
    return await carry_out(station, principal, "gimbal/take", v, {}, lambda x: x.gimbal.take_control())


@router.post("/release", response_model=responses.CommandDone)
async def release(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Releases gimbal control if this server has it."""
    return await carry_out(station, principal, "gimbal/release", v, {}, lambda x: x.gimbal.release_control())


@router.post("/angles", response_model=responses.GimbalPointed)
async def angles(v: str, body: models.GimbalAngles, station: StationDep, principal: PrincipalDep) -> Response:
    """Points the camera; answers once it points there or has stopped: `limited` says where a limit stopped
    it.

    Without `wait` it answers once the vehicle has acknowledged.
    """
    return await carry_out(
        station,
        principal,
        "gimbal/angles",
        v,
        body.model_dump(exclude_none=True),
        lambda x: x.gimbal.set_angles(
            body.pitch_deg, body.yaw_deg, roll_deg=body.roll_deg, yaw_lock=body.yaw_lock, wait=body.wait
        ),
        result_as="limited",
    )


@router.post("/rates", response_model=responses.CommandDone)
async def rates(v: str, body: models.GimbalRates, station: StationDep, principal: PrincipalDep) -> Response:
    """Turns the camera at constant rates; zero stops both axes."""
    return await carry_out(
        station,
        principal,
        "gimbal/rates",
        v,
        body.model_dump(),
        lambda x: x.gimbal.set_rates(body.pitch_rate_deg_s, body.yaw_rate_deg_s, yaw_lock=body.yaw_lock),
    )


@router.post("/roi", response_model=responses.CommandDone)
async def roi(v: str, body: models.GimbalRoi, station: StationDep, principal: PrincipalDep) -> Response:
    """Keeps the camera pointed at a location (ROI)."""
    return await carry_out(
        station,
        principal,
        "gimbal/roi",
        v,
        body.model_dump(),
        lambda x: x.gimbal.set_roi(body.lat_deg, body.lon_deg, body.alt_amsl_m),
    )


@router.post("/roi/clear", response_model=responses.CommandDone)
async def clear_roi(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Clears the location that the camera looks at."""
    return await carry_out(station, principal, "gimbal/roi/clear", v, {}, lambda x: x.gimbal.clear_roi())
