"""What if: a part of a flight is flown again in simulation. No vehicle is commanded."""

from __future__ import annotations

from fastapi import Response

from gcs_server.api import what_if_models as m
from gcs_server.api.problems import RESPONSES
from gcs_server.api.routes import Routes
from gcs_server.api.station import StationDep

router = Routes(prefix="/flights", tags=["flights"], responses=RESPONSES)


@router.post("/{f}/rerun", response_model=m.RerunResult)
async def rerun_flight(f: str, body: m.RerunRequest, station: StationDep) -> Response:
    """Flies a part of a quadrotor's ULog again, from its logged state with its logged setpoints: once as it
    was, which says how much to trust it, and once with other parameters, wind, moved setpoints or a failed
    motor. What makes
    the setpoints (modes, missions, failsafes) is not flown again."""
    change = body.model_dump(include={"parameters", "wind_ned_m_s", "motor_health", "moved_ned_m"})
    result = await station.logbook.rerun(f, body.from_s, body.from_s + body.duration_s, change)
    return Response(result, media_type="application/json")
