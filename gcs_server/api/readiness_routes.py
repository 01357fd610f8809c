"""Routes of readiness: for each flight mode, why a vehicle cannot arm or fly in it; and the modes to choose
from."""

from __future__ import annotations

from dataclasses import asdict

from fastapi import Response
from pydantic import Field, create_model

from gcs_server.api.problems import RESPONSES
from gcs_server.api.reflect import model_of
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import VehicleDep
from gcs_server.vehicle.mode_choices import ModeChoice, ModesOffered, mode_choices
from gcs_server.vehicle.readiness import Cause, ModeReadiness, Offer, Readiness
from gcs_server.vehicle.vehicle import Vehicle

router = Routes(prefix="/vehicles", tags=["vehicles"], responses=RESPONSES)

CauseModel = model_of(Cause, "ReadinessCause")
ModeModel = model_of(ModeReadiness, arming=tuple[CauseModel, ...], running=tuple[CauseModel, ...])
ReadinessModel = model_of(
    Readiness,
    modes=tuple[ModeModel, ...],
    findings=tuple[CauseModel, ...],
    offers=tuple[model_of(Offer, "ReadinessOffer"), ...],
)
ReadinessView = create_model(
    "VehicleReadiness",
    __base__=ReadinessModel,
    __doc__="For each flight mode, why the vehicle cannot arm or fly in it; from the vehicle's last report.",
    vehicle=(str, Field(description="The vehicle's id.")),
)

ChoiceModel = model_of(ModeChoice)
ModesView = create_model(
    "VehicleModes",
    __base__=model_of(ModesOffered, modes=tuple[ChoiceModel, ...]),
    __doc__="The flight modes that the vehicle offers, in its own order.",
    vehicle=(str, Field(description="The vehicle's id.")),
)


def _view(vehicle: Vehicle) -> dict[str, object]:
    return {"vehicle": vehicle.id, **asdict(vehicle.health.readiness)}


@router.get("/{v}/readiness", response_model=ReadinessView)
async def readiness(vehicle: VehicleDep) -> Response:
    """The vehicle's last report, for all modes; the telemetry topic `readiness` has every change."""
    return json_response(_view(vehicle))


@router.post("/{v}/readiness/check", response_model=ReadinessView)
async def check(vehicle: VehicleDep) -> Response:
    """Requests the vehicle to run its checks now, and returns the result. The texts of the checks are read
    from the vehicle's files, once per firmware, and arrive a little later.
    """
    await vehicle.health.check()
    vehicle.in_background("metadata of its events", vehicle.health.read_definitions(vehicle.metadata))
    return json_response(_view(vehicle))


@router.get("/{v}/modes", response_model=ModesView)
async def modes(vehicle: VehicleDep) -> Response:
    """The flight modes that the vehicle offers, with the reasons why one cannot be entered now. The vehicle
    is asked for its list (AVAILABLE_MODES) unless the server has it."""
    announced = await vehicle.mode_list.read()
    offered = mode_choices(announced, vehicle.mode_names, vehicle.health.readiness)
    return json_response({"vehicle": vehicle.id, **asdict(offered)})
