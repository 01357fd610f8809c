"""What if: a part of a flight is flown again in simulation. No vehicle is commanded."""

from __future__ import annotations

from fastapi import Response

from gcs_server.api import what_if_models as m
from gcs_server.api.problems import RESPONSES
from gcs_server.api.routes import Routes
from gcs_server.api.station import Station, StationDep
from gcs_server.errors import InvalidRequest

KINDS = ("waypoint_plan", "offboard_mission")

router = Routes(prefix="/flights", tags=["flights"], responses=RESPONSES)


@router.post("/{f}/rerun", response_model=m.RerunResult)
async def rerun_flight(f: str, body: m.RerunRequest, station: StationDep) -> Response:
    """Flies a part of a quadrotor's ULog again from its logged state: once as it was, which says how much to
    trust it, and once with a change. With the logged setpoints, what makes them (modes, missions, failsafes)
    is not flown again; the simulated PX4 (`flown_by`: `autopilot`) flies on in Mission, Hold, Return and Land
    and makes them itself, in Offboard an offboard mission of this server makes them."""
    change = body.model_dump(exclude={"from_s", "duration_s", "plan"})
    plan = await _plan(f, body, station) if body.flown_by == "autopilot" else None
    result = await station.logbook.rerun(f, body.from_s, body.from_s + body.duration_s, change, plan)
    return Response(result, media_type="application/json")


async def _plan(f: str, body: m.RerunRequest, station: Station) -> dict[str, str] | None:
    """`kind` and `text` (JSON) of the plan that was flown; None: not known."""
    plan_id, version = body.plan, None
    if plan_id is None:
        noted = await station.logbook.flown_plan(f, body.from_s)
        if noted is None or noted["kind"] not in KINDS:
            return None
        plan_id, version = noted["id"], noted["version"]
    head, text = await station.flights.plans.get(plan_id, version)
    if head.kind not in KINDS:
        raise InvalidRequest(
            "plan",
            f"{head.name} is no plan of a flight.",
            remedy="Give the id of a plan or offboard mission.",
        )
    return {"kind": head.kind, "text": text.decode()}
