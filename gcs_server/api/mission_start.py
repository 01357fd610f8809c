"""What is checked before the mission on a vehicle starts: its plan, and for a start on the ground at a later
item, the flight from there."""

from __future__ import annotations

from gcs_server.api.mission_models import StartRequest
from gcs_server.api.plan_checks import check_document
from gcs_server.api.station import Station
from gcs_server.errors import PlanFindings, Refused, UnknownPlan
from gcs_server.storage.folder import StorageError
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.vehicle.services.held_plan import plan_of
from gcs_server.vehicle.services.mission_held import Held
from gcs_server.vehicle.vehicle import Vehicle
from missions import plan as plan_document
from missions.errors import PlanError
from missions.plan import Plan
from missions.values import HomePosition, Obstacle
from missions.waypoints.resume import rest_of, resume_point

NOT_KNOWN = "plan_not_known"
"""Code in `despite` if the server does not know which plan is on the vehicle."""
FROM_HERE = "flight_from_here"
"""Code in `despite` that accepts errors of the flight from the vehicle's place to a later item, and on."""
PLACE_CODES = frozenset(
    {
        "fence_crossed",
        "fence_home_outside",
        "radius_exceeded",
        "altitude_fence",
        "obstacle_hit",
        "terrain_hit",
    }
)
"""Errors that depend on where the vehicle takes off."""


async def check_start(station: Station, vehicle: Vehicle, request: StartRequest) -> None:
    """Refuses a plan with error findings that the caller has not accepted.

    Raises:
        PlanFindings: the plan, or its rest from here, has such findings, or the plan is not known.
        Refused: the vehicle has no mission, another one than `request` names, or cannot start at the item.
    """
    _require_mission(vehicle, request.mission_id)
    held = vehicle.mission.held
    same = None if held is None else still_held(vehicle, held)
    if held is not None and not held.items["mission"] and same is not False:
        raise Refused(f"Vehicle {vehicle.id} has no mission.", remedy="Upload a plan first.")
    if held is None or not same:
        if NOT_KNOWN not in request.despite:
            raise PlanFindings(
                f"The server does not know which plan is on vehicle {vehicle.id}, "
                "so the plan is not checked.",
                codes=(NOT_KNOWN,),
                remedy="Download or upload it first, or name plan_not_known in `despite`.",
            )
        return
    plan, _ = plan_of(held)
    plan = plan.model_copy(update={"obstacles": await _stored_obstacles(station, held)})
    findings = (await check_document(station, plan, vehicle))["findings"]
    errors = [each for each in findings if each["severity"] == "error"]
    unaccepted = [each for each in errors if each["code"] not in request.despite]
    if unaccepted:
        raise PlanFindings(
            f"The plan on vehicle {vehicle.id} has errors: {unaccepted[0]['text']}",
            codes=tuple(dict.fromkeys(each["code"] for each in unaccepted)),
            reasons=tuple(each["text"] for each in unaccepted),
            remedy="Correct the plan and upload it, or accept the findings by naming their codes in "
            "`despite`.",
        )
    landed = not vehicle.status.armed or vehicle.flight_state.landed_state == "on_ground"
    if landed and request.item is not None and request.item > 0:
        rest = await _rest_errors(station, vehicle, plan, request.item)
        known = {each["text"] for each in errors}
        _require_rest(request, tuple(text for text in rest if text not in known))


def still_held(vehicle: Vehicle, held: Held) -> bool | None:
    """Whether the vehicle still reports the ids of this transfer; None: it reports no ids."""
    ids = vehicle.mission.ids()
    if ids is None or not any((*ids.values(), *held.ids.values())):
        return None
    return ids == held.ids


def _require_mission(vehicle: Vehicle, mission_id: int | None) -> None:
    ids = vehicle.mission.ids()
    if mission_id is not None and (ids is None or ids["mission"] != mission_id):
        raise Refused(
            f"Vehicle {vehicle.id} has another mission than the one that the start was chosen for.",
            remedy="Read GET …/mission again, and choose the item to start at.",
        )


async def _rest_errors(station: Station, vehicle: Vehicle, plan: Plan, item: int) -> list[str]:
    """Errors of the rest of the plan from the vehicle's place on the ground, which becomes its home."""
    found = resume_point(plan, item)
    if isinstance(found, str):
        raise Refused(
            f"Vehicle {vehicle.id} cannot start at item {item + 1} on the ground. {found}",
            remedy="Start at an earlier item.",
        )
    here = VehicleEstimates(vehicle).global_position()
    if here is None:
        return []  # the vehicle refuses to arm without a position
    start = HomePosition(lat_deg=here.lat_deg, lon_deg=here.lon_deg, alt_amsl_m=here.alt_amsl_m)
    check = await check_document(station, rest_of(plan, item, start), vehicle, home=start)
    return [each["text"] for each in check["findings"] if each["code"] in PLACE_CODES]


def _require_rest(request: StartRequest, errors: tuple[str, ...]) -> None:
    if errors and FROM_HERE not in request.despite:
        raise PlanFindings(
            f"The flight from here to item {(request.item or 0) + 1} and on has errors: {errors[0]}",
            codes=(FROM_HERE,),
            reasons=errors,
            remedy="Start at another item or place, or name flight_from_here in `despite`.",
        )


async def _stored_obstacles(station: Station, held: Held) -> tuple[Obstacle, ...]:
    """The obstacles of the stored plan that is on the vehicle, which does not hold them; none if the plan was
    not stored or is deleted."""
    if held.plan is None or held.plan.id is None:
        return ()
    try:
        _, document = await station.plans.get(held.plan.id, held.plan.version)
        return plan_document.read(document).obstacles
    except (UnknownPlan, StorageError, PlanError):
        return ()
