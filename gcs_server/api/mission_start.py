"""Checks before the mission on a vehicle starts: the plan, the separation from the flights of other vehicles,
and the flight from here if the vehicle starts on the ground at a later item."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from gcs_server.api.dry_run_paths import dry_run_path
from gcs_server.api.mission_models import StartRequest
from gcs_server.api.plan_checks import check_document
from gcs_server.api.plan_traffic import SEPARATION, compare_with_others
from gcs_server.api.station import Station
from gcs_server.errors import PlanFindings, Refused, UnknownPlan
from gcs_server.storage.folder import StorageError
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.streamer.waypoints.flight import DryRunPath
from gcs_server.vehicle.services.held_plan import plan_from_items
from gcs_server.vehicle.services.mission_held import ItemsOnVehicle
from gcs_server.vehicle.vehicle import Vehicle
from missions import plan as plan_document
from missions.errors import PlanError
from missions.plan import Plan
from missions.traffic.conflict import FIX, Conflict
from missions.values import HomePosition, Obstacle
from missions.waypoints.resume import remaining_plan, resume_point

NOT_KNOWN = "plan_not_known"
"""Code in `despite` if the server does not know which plan is on the vehicle."""
FROM_HERE = "flight_from_here"
"""Code in `despite` that accepts errors of the flight from the vehicle's position to a later item and
onwards."""
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


async def check_start(station: Station, vehicle: Vehicle, request: StartRequest) -> DryRunPath | None:
    """Refuses to start a plan with errors or conflicts with other vehicles that the caller has not accepted.

    All findings are in one answer. A start that is not refused counts as a flight for the starts of other
    vehicles, until `WaypointFlights.announced` ends.

    Returns:
        Path and corridor of the dry run that the request names.

    Raises:
        PlanFindings: the plan, its rest from here, or its separation from other vehicles has such findings,
            or the plan is not known.
        Refused: the vehicle has no mission, another one than `request` names, or cannot start at the item.
    """
    _require_mission(vehicle, request.mission_id)
    held = vehicle.mission.items_on_vehicle
    same_ids = None if held is None else still_held(vehicle, held)
    if held is not None and not held.items["mission"] and same_ids is not False:
        raise Refused(f"Vehicle {vehicle.id} has no mission.", remedy="Upload a plan first.")
    if held is None or not same_ids:
        if NOT_KNOWN not in request.despite:
            raise PlanFindings(
                f"The server does not know which plan is on vehicle {vehicle.id}, "
                "so the plan is not checked.",
                codes=(NOT_KNOWN,),
                remedy="Download or upload it first, or name plan_not_known in `despite`.",
            )
        return dry_run_path(station, vehicle, request.dry_run)
    path = dry_run_path(station, vehicle, request.dry_run)
    plan, _ = plan_from_items(held)
    plan = plan.model_copy(update={"obstacles": await _stored_obstacles(station, held)})
    found = await _errors(station, vehicle, plan, request)
    async with station.waypoint_flights.comparing:
        compared = await compare_with_others(station, vehicle, plan, request.item, path)
        found.append(_too_near(vehicle, compared.conflicts))
        _require_accepted(found, request.despite)
        if compared.path is not None:
            station.waypoint_flights.expect(vehicle.id, compared.path)
    return path


@dataclass(frozen=True, slots=True)
class _Errors:
    """Errors of one group: of the plan, of the flight from here, or of the separation."""

    about: str
    """Begin of the message, which the first error completes."""
    found: tuple[tuple[str, str], ...]
    """Codes and texts."""
    remedy: str

    def without(self, despite: Collection[str]) -> _Errors:
        """Those that the caller has not accepted."""
        return replace(self, found=tuple(each for each in self.found if each[0] not in despite))


def _require_accepted(groups: Sequence[_Errors], despite: Collection[str]) -> None:
    """Raises PlanFindings with all errors of all groups that the caller has not accepted."""
    remaining = [each for each in (errors.without(despite) for errors in groups) if each.found]
    if not remaining:
        return
    every = [each for errors in remaining for each in errors.found]
    raise PlanFindings(
        " ".join(f"{errors.about} {errors.found[0][1]}" for errors in remaining),
        codes=tuple(dict.fromkeys(code for code, _ in every)),
        reasons=tuple(text for _, text in every),
        remedy=" ".join(errors.remedy for errors in remaining),
    )


async def _errors(station: Station, vehicle: Vehicle, plan: Plan, request: StartRequest) -> list[_Errors]:
    """Errors of the plan, and for a start on the ground at a later item those of the flight from here."""
    findings = (await check_document(station, plan, vehicle))["findings"]
    errors = [(each["code"], each["text"]) for each in findings if each["severity"] == "error"]
    found = [
        _Errors(
            f"The plan on vehicle {vehicle.id} has errors:",
            tuple(errors),
            "Correct the plan and upload it, or accept the findings by naming their codes in `despite`.",
        )
    ]
    landed = not vehicle.status.armed or vehicle.flight_state.landed_state == "on_ground"
    if landed and request.item is not None and request.item > 0:
        rest = await _rest_errors(station, vehicle, plan, request.item)
        known = {text for _, text in errors}
        found.append(
            _Errors(
                f"The flight from here to item {request.item + 1} and onwards has errors:",
                tuple((FROM_HERE, text) for text in rest if text not in known),
                "Start at another item or place, or name flight_from_here in `despite`.",
            )
        )
    return found


def _too_near(vehicle: Vehicle, found: Sequence[Conflict]) -> _Errors:
    return _Errors(
        f"Vehicle {vehicle.id} may come too near to another vehicle:",
        tuple((SEPARATION, each.text) for each in found),
        f"{FIX} Or name separation in `despite`.",
    )


def still_held(vehicle: Vehicle, held: ItemsOnVehicle) -> bool | None:
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
    """Errors of the rest of the plan from the vehicle's position on the ground, which becomes its home."""
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
    check = await check_document(station, remaining_plan(plan, item, start), vehicle, home=start)
    return [each["text"] for each in check["findings"] if each["code"] in PLACE_CODES]


async def _stored_obstacles(station: Station, held: ItemsOnVehicle) -> tuple[Obstacle, ...]:
    """The obstacles of the stored plan that is on the vehicle; the vehicle itself stores no obstacles. Empty
    if the plan was not stored or is deleted."""
    if held.plan is None or held.plan.id is None:
        return ()
    try:
        _, document = await station.plans.get(held.plan.id, held.plan.version)
        return plan_document.read(document).obstacles
    except (UnknownPlan, StorageError, PlanError):
        return ()
