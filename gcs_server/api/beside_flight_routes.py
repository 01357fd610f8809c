"""Two flights over each other."""

from __future__ import annotations

from typing import Annotated

from fastapi import Query, Response

from gcs_server.api.problems import RESPONSES
from gcs_server.api.reflect import model_of
from gcs_server.api.routes import Routes
from gcs_server.api.station import StationDep
from gcs_server.logbook.two_flights import Align, Totals, TwoFlights

router = Routes(prefix="/flights", tags=["flights"], responses=RESPONSES)

TotalsModel = model_of(Totals, "FlightTotals")
TwoFlightsModel = model_of(TwoFlights, first=TotalsModel, second=TotalsModel)


@router.get("/{f}/beside", response_model=TwoFlightsModel)
async def two_flights(
    f: str,
    station: StationDep,
    other: Annotated[str, Query(max_length=100, description="Id of the second flight, or of a file.")],
    align: Annotated[
        Align,
        Query(
            description="By what their times are brought together: arming, take-off, the best fit of their "
            "tracks in time, or `offset_s`."
        ),
    ] = "arming",
    offset_s: Annotated[
        float,
        Query(
            ge=-1e6,
            le=1e6,
            description="With `align=offset`: added to times of the second log, for those of the first [s].",
        ),
    ] = 0.0,
) -> Response:
    """A second flight over a flight: how far apart they were at the same times, and how duration, distance,
    height and energy differ. Of a flight with several files the main one is taken."""
    body = await station.logbook.beside((f, other), align, offset_s)
    return Response(body, media_type="application/json")
