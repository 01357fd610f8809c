"""Proofs of gains: proposed values flown many times in simulation. These routes send nothing to a vehicle."""

from __future__ import annotations

from typing import Annotated

from fastapi import Response
from pydantic import Field

from gcs_server.api.operation_routes import OperationModel, operation_view
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.reflect import model_of
from gcs_server.api.responses import json_bytes, json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import StationDep
from gcs_server.api.strict_body import StrictBody, example
from gcs_server.api.what_if_models import ParameterName, ParameterNumber
from gcs_server.control.accepted import authorized_command
from gcs_server.control.commands import API
from gcs_server.flights.proofs import simulated_values
from gcs_server.operations.operations import ReportProgress
from missions.what_if import proof_document as p

router = Routes(prefix="/proofs", tags=["flights"], responses=RESPONSES)

ConditionsModel = model_of(p.ProofConditions)
RunModel = model_of(p.ProofRun)
PairModel = model_of(p.ProofPair, conditions=ConditionsModel, present=RunModel, proposed=RunModel)
ProofModel = model_of(
    p.Proof,
    limits=model_of(p.Limits, "ProofLimits"),
    spread=model_of(p.ProofSpread),
    pairs=list[PairModel],
    id=Annotated[str, Field(description="Id of the proof.")],
    vehicle=Annotated[str, Field(description="Id of the vehicle.")],
)


class ProofRequest(StrictBody):
    """Values that are to be proved before they are written."""

    model_config = example(vehicle="1", parameters={"MC_ROLLRATE_P": 0.18, "MC_PITCHRATE_P": 0.18})

    vehicle: Annotated[str, Field(max_length=20)]
    """Id of the vehicle to which they would be written; its other parameters and its body are simulated."""
    parameters: Annotated[dict[ParameterName, ParameterNumber], Field(min_length=1, max_length=50)]
    """The proposed values: gains and limits of the controllers (MC_*, MPC_*)."""
    runs: Annotated[int, Field(ge=1, le=200)] = p.RUNS
    """Number of conditions; the page writes only what was proved in 100."""
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 0
    """Seed of conditions, gusts and noise: equal seeds give equal proofs."""


@router.post("", response_model=OperationModel, status_code=202)
async def start_proof(body: ProofRequest, station: StationDep, principal: PrincipalDep) -> Response:
    """Flies a manoeuvre in simulation in varied wind, mass, thrust and inertia, each time with the vehicle's
    present values and with the proposed ones; changes nothing and commands no vehicle.

    A proof is an operation with progress; `DELETE /operations/{id}` cancels it. After success, `GET
    /proofs/{p}` returns the result; `p` is `result.proof` of the operation.
    """
    arguments: dict[str, object] = body.model_dump()
    with authorized_command(station, principal, "proofs/start", None, arguments):
        flights = station.flights
        vehicle = flights.fleet.get(body.vehicle)
        proof_id = flights.proofs.next_id(principal.key)

        async def work(report: ReportProgress) -> dict[str, object]:
            values, assumed = await simulated_values(vehicle, flights.models, report)
            request = {
                "vehicle": body.vehicle, "parameters": values, "proposed": body.parameters, "runs": body.runs,
                "seed": body.seed, "assumed": assumed,
            }  # fmt: skip
            return await flights.proofs.run(proof_id, request, report, principal.key)

        operation = station.operations.start(
            "proof", work, text="The simulated flights start.", subject=proof_id,
            by=(principal.name, principal.key),
        )  # fmt: skip
        response = json_response(operation_view(operation), 202)
        response.headers["Location"] = f"{API}/operations/{operation.id}"
        return response


@router.get("/{p}", response_model=ProofModel)
async def show_proof(p: str, station: StationDep) -> Response:
    """The result of a proof: of each run whether it was stable with the present and with the proposed values,
    and which limits it exceeded; the last ten are kept until the server ends."""
    return json_bytes(station.flights.proofs.body(p))
