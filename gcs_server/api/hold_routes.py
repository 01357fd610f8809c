"""Hold for several vehicles in one request."""

from __future__ import annotations

import asyncio

from fastapi import Response
from pydantic import BaseModel, ConfigDict, Field

from gcs_server.api.authorized import progress_reporter
from gcs_server.api.group_models import VehicleId
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES, Problem, problem_of
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import StationDep
from gcs_server.api.strict_body import StrictBody, example
from gcs_server.control.accepted import authorized_command
from gcs_server.errors import GcsError

MAX_VEHICLES = 1000

router = Routes(tags=["commands"], responses=RESPONSES)


class HoldRequest(StrictBody):
    """The vehicles to switch to Hold."""

    model_config = example(vehicles=["1", "2"])

    vehicles: tuple[VehicleId, ...] | None = Field(default=None, max_length=MAX_VEHICLES)
    """Ids of the vehicles; default: all armed vehicles."""


class HoldResult(BaseModel):
    """One vehicle's result."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    vehicle: str = Field(description="The vehicle's id.")
    held: bool = Field(description="Whether the vehicle has reported Hold.")
    problem: Problem | None = Field(description="Why the vehicle has not switched to Hold; null if it has.")


class HoldResults(BaseModel):
    """The result for each vehicle."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    results: list[HoldResult] = Field(description="The results, in the order of the request.")


@router.post("/hold", response_model=HoldResults)
async def hold_several(body: HoldRequest, station: StationDep, principal: PrincipalDep) -> Response:
    """Switches several vehicles to Hold, even if another client has control; ends their setpoint streams.

    The command is sent to all vehicles at the same time, also to those whose connection is lost, and a
    failure of one does not affect the others.
    Answers once each vehicle has reported Hold or failed.
    """

    async def hold(vehicle_id: str) -> dict[str, object]:
        problem: dict[str, object] | None = None
        try:
            with authorized_command(station, principal, "hold", vehicle_id, {}) as accepted:
                vehicle = station.fleet.get(vehicle_id)
                progress = progress_reporter(vehicle, principal, "hold")
                await vehicle.command.hold(
                    by=principal.name, progress=progress, on_lost_link=True, ticket=accepted.ticket
                )
        except GcsError as error:
            problem = problem_of(error)
        return {"vehicle": vehicle_id, "held": problem is None, "problem": problem}

    armed = (vehicle.id for vehicle in station.fleet.all() if vehicle.flight_state.armed)
    vehicle_ids = dict.fromkeys(armed if body.vehicles is None else body.vehicles)
    results = await asyncio.gather(*map(hold, vehicle_ids), return_exceptions=True)
    for result in results:
        if isinstance(result, BaseException):  # an error of one vehicle does not stop the others
            raise result
    return json_response({"results": results})
