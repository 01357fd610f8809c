"""The model of a vehicle: identified in a flight, kept for its dry runs, forgotten. Commands no vehicle."""

from __future__ import annotations

from typing import Annotated

import msgspec
from fastapi import Query, Response
from pydantic import Field

from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.reflect import model_of
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import StationDep, VehicleDep
from gcs_server.api.strict_body import ResponseBody, StrictBody, example
from gcs_server.api.what_if_models import IdentifiedValue
from gcs_server.control.accepted import authorized_command
from gcs_server.errors import InvalidRequest
from gcs_server.flights.vehicle_models import KeptModel
from gcs_server.logbook.joined_flights import Flight
from gcs_server.vehicle.vehicle import Vehicle
from missions.what_if.identified import VehicleModel

router = Routes(tags=["flights"], responses=RESPONSES)

Mass = Annotated[float, Field(ge=0.01, le=1000)]
KeptModelModel = model_of(KeptModel)
VehicleModelModel = model_of(VehicleModel, thrust_m_s2=IdentifiedValue, drag_per_s=IdentifiedValue)


class ModelToKeep(StrictBody):
    """The flight in which the model of a vehicle is identified."""

    model_config = example(flight="0123456789abcdef-0", mass_kg=1.8)

    flight: Annotated[str, Field(min_length=1, max_length=100)]
    """Id of a flight of this vehicle with its own log."""
    mass_kg: Mass | None = None
    """Take-off mass in that flight, if it is known [kg]."""


class VehicleModelView(ResponseBody):
    """The kept model of a vehicle."""

    model: KeptModelModel | None  # type: ignore[valid-type]
    """Null: none is kept; dry runs use the simulated quadrotor's body."""


@router.get("/flights/{f}/model", response_model=VehicleModelModel)
async def identify_model(
    f: str,
    station: StationDep,
    mass_kg: Annotated[
        float | None, Query(ge=0.01, le=1000, description="Known take-off mass; without it, only ratios.")
    ] = None,
) -> Response:
    """What a flight says of its aircraft: thrust and drag by mass with their standard errors, and what it
    does not say. It needs the vehicle's own log; nothing is kept."""
    flight = await station.logbook.flight(f)
    return Response(await station.logbook.identify(flight, mass_kg), media_type="application/json")


@router.get("/vehicles/{v}/model", response_model=VehicleModelView)
async def show_model(station: StationDep, vehicle: VehicleDep) -> Response:
    """The kept model of a vehicle, with which its dry runs fly."""
    return json_response({"model": station.flights.models.find(vehicle.identity)})


@router.put("/vehicles/{v}/model", response_model=VehicleModelView)
async def keep_model(v: str, body: ModelToKeep, station: StationDep, principal: PrincipalDep) -> Response:
    """Identifies the model of a vehicle in one of its flights, and keeps it: from now on its dry runs fly
    with it, and say so. A kept model is replaced. Nothing is sent to the vehicle."""
    with authorized_command(station, principal, "model/keep", None, {"vehicle": v, **body.model_dump()}):
        vehicle = station.fleet.get(v)
        flight = await station.logbook.flight(body.flight)
        _require_same_vehicle(flight, vehicle)
        found = msgspec.json.decode(await station.logbook.identify(flight, body.mass_kg), type=VehicleModel)
        main = next(iter(flight.files.values()))
        drag = found.drag_per_s if found.drag_known else None
        model = KeptModel(
            flight=flight.id,
            log=(flight.name or main.path.name)[:200],
            kept_unix_s=station.clock.unix_s(),
            kept_by=principal.name[:200],
            mass_kg=body.mass_kg,
            thrust_m_s2=found.thrust_m_s2.value,
            thrust_error_m_s2=found.thrust_m_s2.error,
            drag_per_s=None if drag is None else drag.value,
            drag_error_per_s=None if drag is None else drag.error,
            parameters=found.parameters,
            turns_known=found.turns_known,
        )
        await station.flights.models.keep(vehicle.identity, model)
    return json_response({"model": model})


@router.delete("/vehicles/{v}/model", status_code=204)
async def forget_model(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Forgets the kept model of a vehicle: its dry runs fly with the simulated quadrotor's body again."""
    with authorized_command(station, principal, "model/forget", None, {"vehicle": v}):
        await station.flights.models.keep(station.fleet.get(v).identity, None)
    return Response(status_code=204)


def _require_same_vehicle(flight: Flight, vehicle: Vehicle) -> None:
    """Raises InvalidRequest if the flight is surely of another vehicle."""
    logged, identity = flight.best, vehicle.identity
    uids = logged.uid, identity.uid
    if uids[0] is not None and uids[1] is not None and len(uids[0]) == len(uids[1]):
        is_other = uids[0].lower() != uids[1].lower()
    else:
        is_other = False
    # All simulators have the same uid.
    if is_other or logged.vehicle not in ("", str(identity.system_id)):
        raise InvalidRequest(
            "flight",
            "The flight is of another vehicle.",
            remedy="Take a flight of this vehicle, or connect the one that flew it.",
        )
