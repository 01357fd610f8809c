"""Tuning: how the loops of a logged flight respond."""

from __future__ import annotations

from typing import Annotated

from fastapi import Query, Response

from gcs_server.api.problems import RESPONSES
from gcs_server.api.reflect import model_of
from gcs_server.api.routes import Routes
from gcs_server.api.station import StationDep
from gcs_server.logbook.autotune import Autotune, TunedAxis
from gcs_server.logbook.loops import FrequencyResponse, LoopResponse, Loops, StepResponse

router = Routes(prefix="/flights", tags=["flights"], responses=RESPONSES)

StepModel = model_of(StepResponse)
FrequencyModel = model_of(FrequencyResponse)
LoopModel = model_of(LoopResponse, step=StepModel | None, frequency=FrequencyModel | None)
AutotuneModel = model_of(Autotune, axes=list[model_of(TunedAxis)])
LoopsModel = model_of(Loops, "FlightLoops", loops=list[LoopModel], autotune=AutotuneModel | None)


@router.get("/{f}/loops", response_model=LoopsModel)
async def flight_loops(
    f: str,
    station: StationDep,
    from_s: Annotated[
        float | None, Query(ge=-1e7, le=1e7, description="Begin of the window [s since the log's start].")
    ] = None,
    to_s: Annotated[float | None, Query(ge=-1e7, le=1e7, description="End of the window.")] = None,
) -> Response:
    """How the rate and attitude loops of a vehicle's own log follow their setpoints: step response (rise,
    overshoot, settling) and frequency response (gain, phase, coherence, bandwidth) of each axis; and where
    the log does not say enough, why. `autotune` has the gains that PX4's autotune found in the flight, as
    parameters; they may be proved (`POST /proofs`)."""
    return Response(await station.logbook.loops(f, from_s, to_s), media_type="application/json")
