"""Checks before a vehicle flies its mission: the plan, and the separation from other vehicles. All ways in
use `checked_start`: a start, a resumption, the mode Mission, and arming in Mission.

If a vehicle on the ground starts at a later item, the flight from its position to that item is checked too.
"""

from __future__ import annotations

import asyncio
import functools
from collections.abc import AsyncGenerator, Collection, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import msgspec
from pydantic import TypeAdapter, ValidationError

from gcs_server.errors import PlanFindings, Refused, UnknownPlan
from gcs_server.flights.dry_run_paths import dry_run_path
from gcs_server.flights.plan_checks import ErrorGroup, check_document, findings_of, require_accepted
from gcs_server.flights.traffic import SEPARATION, compare_with_others
from gcs_server.flights.waypoint_flight import ClientStart, NamedDryRun
from gcs_server.storage.folder import StorageError
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.vehicle.samples import Mission
from gcs_server.vehicle.services.mission_on_vehicle import ItemsOnVehicle, plan_from_items
from gcs_server.vehicle.tickets import Ticket
from gcs_server.vehicle.vehicle import Vehicle
from missions import plan as plan_document
from missions.plan import Plan
from missions.traffic.conflict import FIX, Conflict
from missions.values import HomePosition, Obstacle, Obstacles
from missions.waypoints.resume import remaining_plan, resume_point

if TYPE_CHECKING:
    from gcs_server.flights.flights import Flights

PLAN_NOT_KNOWN = "plan_not_known"
"""Code in `despite` if the server does not know which plan is on the vehicle."""
MISSION_REJECTED = "mission_rejected"
"""Code in `despite` that accepts that PX4 rejected the mission after the upload."""
FLIGHT_FROM_HERE = "flight_from_here"
"""Code in `despite` that accepts errors of the flight from the vehicle's position to a later item and
onwards."""
LATER_ITEM = "starts_at_later_item"
"""Code in `despite` that accepts that PX4 begins at its current item, which is not the first."""
TRANSFERS = ("mission/upload", "mission/download")
POSITION_CODES = frozenset(
    {
        "fence_crossed",
        "fence_home_outside",
        "radius_exceeded",
        "altitude_fence",
        "altitude_below_home",
        "obstacle_hit",
        "terrain_hit",
    }
)
"""Codes of errors that depend on the position at which the flight begins."""


@dataclass(frozen=True, slots=True)
class WaypointStart:
    """How a client lets a vehicle fly its mission."""

    item: int | None = None
    """Index of the first item; None: the current item."""
    despite: Collection[str] = ()
    """Codes of the findings that the client accepts."""
    dry_run: str | None = None
    """The dry run with which the flight is compared; None: the plan."""
    mission_id: int | None = None
    """The mission to which `item` belongs; None: any."""


@asynccontextmanager
async def checked_start(
    flights: Flights, vehicle: Vehicle, request: WaypointStart, ticket: Ticket, client: str
) -> AsyncGenerator[None]:
    """Block in which a client's command lets a vehicle fly its mission, after all checks. If the plan on the
    vehicle changes in the block, the ticket is cancelled.

    Codes that a client accepted hold until the vehicle is disarmed, so that a flight can be resumed; those of
    the separation are accepted each time.

    Raises:
        PlanFindings, Refused: as `check_start`.
        Interrupted: the ticket was cancelled.
    """
    ticket.claim()
    checked, ids = vehicle.mission.items_on_vehicle, vehicle.mission.ids()
    if (problem := _transfer(flights, vehicle)) is not None:
        raise Refused(problem, remedy="Wait until it is done.")

    def changed() -> str | None:
        if vehicle.mission.items_on_vehicle is not checked or (ids and vehicle.mission.ids() != ids):
            return f"The plan on vehicle {vehicle.id} has changed since it was checked."
        return _transfer(flights, vehicle)

    ticket.add_condition(changed)
    waypoint_flights = flights.waypoint_flights
    accepted = frozenset(request.despite) | waypoint_flights.accepted_codes(vehicle, ids)
    path = await check_start(flights, vehicle, replace(request, despite=accepted))
    async with waypoint_flights.started_by_client(vehicle.id, ClientStart(client, path)):
        ticket.require()
        yield
        waypoint_flights.accept_codes(vehicle, ids, accepted - {SEPARATION})


def _transfer(flights: Flights, vehicle: Vehicle) -> str | None:
    """The upload or download that runs or is about to begin, as a sentence."""
    running = vehicle.mission.running_transfer
    if running is not None:
        return f"Vehicle {vehicle.id} is busy with {running}."
    for each in flights.operations.all():
        if each.state == "running" and each.vehicle == vehicle.id and each.kind in TRANSFERS:
            return f"Vehicle {vehicle.id} is busy with {each.kind}."
    return None


async def check_start(flights: Flights, vehicle: Vehicle, request: WaypointStart) -> NamedDryRun | None:
    """Refuses to start a plan that has errors or conflicts with other vehicles that the caller has not
    accepted.

    The error contains all findings. Until the end of the block `WaypointFlights.started_by_client`,
    the starts of other vehicles are compared with a flight that was not refused.

    Returns:
        Path and corridor of the dry run that the request names.

    Raises:
        PlanFindings: the server does not know the plan; or the plan, the flight from the vehicle's position,
            or the separation from other vehicles has errors that the caller has not accepted.
        Refused: the vehicle has no mission or another mission than `request` names, or cannot start at the
            item.
    """
    _require_mission(vehicle, request.mission_id)
    on_vehicle = vehicle.mission.items_on_vehicle
    same_ids = None if on_vehicle is None else is_still_on_vehicle(vehicle, on_vehicle)
    if on_vehicle is not None and not on_vehicle.items["mission"] and same_ids is not False:
        raise Refused(f"Vehicle {vehicle.id} has no mission.", remedy="Upload a plan first.")
    if on_vehicle is None or not same_ids:
        if PLAN_NOT_KNOWN not in request.despite:
            raise PlanFindings(
                f"The server does not know which plan is on vehicle {vehicle.id}, "
                "so the plan is not checked.",
                codes=(PLAN_NOT_KNOWN,),
                remedy="Download or upload it first, or name plan_not_known in `despite`.",
            )
        return await dry_run_path(flights, vehicle, request.dry_run)
    path = await dry_run_path(flights, vehicle, request.dry_run)
    plan, _ = await flights.plan_work.in_thread(functools.partial(plan_from_items, on_vehicle))
    plan = plan.model_copy(update={"obstacles": await _stored_obstacles(flights, on_vehicle)})
    groups = [_rejections(vehicle, on_vehicle), *await _errors(flights, vehicle, plan, request)]
    async with flights.waypoint_flights.comparison_lock:
        compared = await compare_with_others(flights, vehicle, plan, request.item, path)
        groups.append(_separation_errors(vehicle, compared.conflicts))
        require_accepted(groups, request.despite)
        if compared.path is not None:
            flights.waypoint_flights.set_start_path(vehicle.id, compared.path)
    return path


async def _errors(flights: Flights, vehicle: Vehicle, plan: Plan, request: WaypointStart) -> list[ErrorGroup]:
    """Errors of the plan, and of the flight from the vehicle's position for a start on the ground at a later
    item."""
    findings = await findings_of(await check_document(flights, await _text_of(plan), vehicle))
    errors = [(each.code, each.text) for each in findings if each.severity == "error"]
    groups = [
        ErrorGroup(
            f"The plan on vehicle {vehicle.id} has errors:",
            tuple(errors),
            "Correct the plan and upload it, or accept the findings by naming their codes in `despite`.",
        )
    ]
    landed = not vehicle.status.armed or vehicle.flight_state.landed_state == "on_ground"
    sample = vehicle.topic("mission")
    current = sample.value.current if sample is not None and isinstance(sample.value, Mission) else None
    item = request.item if request.item is not None else current
    if landed and item is not None and item > 0:
        if request.item is None:
            text = f"PX4's current item is item {item + 1}: the vehicle flies straight to it."
            fix = "Name the `item` at which to start, or name starts_at_later_item in `despite`."
            groups.append(ErrorGroup(f"Vehicle {vehicle.id}:", ((LATER_ITEM, text),), fix))
        later_errors = await _errors_from_here(flights, vehicle, plan, item)
        plan_errors = {text for _, text in errors}
        groups.append(
            ErrorGroup(
                f"The flight from here to item {item + 1} and onwards has errors:",
                tuple((FLIGHT_FROM_HERE, text) for text in later_errors if text not in plan_errors),
                "Start at another item or place, or name flight_from_here in `despite`.",
            )
        )
    return groups


def _rejections(vehicle: Vehicle, on_vehicle: ItemsOnVehicle) -> ErrorGroup:
    return ErrorGroup(
        f"Vehicle {vehicle.id} will not fly its mission:",
        tuple((MISSION_REJECTED, f"PX4 rejected it: {each}.") for each in on_vehicle.rejections),
        "Correct the plan and upload it, or name mission_rejected in `despite`.",
    )


def _separation_errors(vehicle: Vehicle, conflicts: Sequence[Conflict]) -> ErrorGroup:
    return ErrorGroup(
        f"Vehicle {vehicle.id} may come too near to another vehicle:",
        tuple((SEPARATION, each.text) for each in conflicts),
        f"{FIX} Or name separation in `despite`.",
    )


def is_still_on_vehicle(vehicle: Vehicle, on_vehicle: ItemsOnVehicle) -> bool | None:
    """Whether the vehicle still reports the mission ids of this transfer; None: the vehicle reports no
    ids."""
    ids = vehicle.mission.ids()
    if ids is None or not any((*ids.values(), *on_vehicle.ids.values())):
        return None
    return ids == on_vehicle.ids


def _require_mission(vehicle: Vehicle, mission_id: int | None) -> None:
    ids = vehicle.mission.ids()
    if mission_id is not None and (ids is None or ids["mission"] != mission_id):
        raise Refused(
            f"Vehicle {vehicle.id} has another mission than the one that the start was chosen for.",
            remedy="Read GET …/mission again, and choose the item to start at.",
        )


async def _errors_from_here(flights: Flights, vehicle: Vehicle, plan: Plan, item: int) -> list[str]:
    """Errors of the flight from the vehicle's position on the ground to an item and onwards. This position
    becomes the vehicle's home."""
    point = resume_point(plan, item)
    if isinstance(point, str):
        raise Refused(
            f"Vehicle {vehicle.id} cannot start at item {item + 1} on the ground. {point}",
            remedy="Start at an earlier item.",
        )
    position = VehicleEstimates(vehicle).global_position()
    if position is None:
        return []  # the vehicle refuses to arm without a position
    start = HomePosition(lat_deg=position.lat_deg, lon_deg=position.lon_deg, alt_amsl_m=position.alt_amsl_m)
    text = await _text_of(remaining_plan(plan, item, start))
    check = await check_document(flights, text, vehicle, home=start)
    errors = (each for each in await findings_of(check) if each.severity == "error")
    return [each.text for each in errors if each.code in POSITION_CODES]


async def _text_of(plan: Plan) -> bytes:
    return await asyncio.to_thread(plan_document.write, plan)


async def _stored_obstacles(flights: Flights, on_vehicle: ItemsOnVehicle) -> tuple[Obstacle, ...]:
    """The obstacles of the stored plan that is on the vehicle, because a vehicle stores no obstacles; empty
    if the plan is not stored on the server."""
    if on_vehicle.plan is None or on_vehicle.plan.id is None:
        return ()
    try:
        _, document = await flights.plans.get(on_vehicle.plan.id, on_vehicle.plan.version)
        obstacles = msgspec.json.decode(document, type=_StoredObstacles).obstacles
        return _obstacles.validate_json(bytes(obstacles))
    except (UnknownPlan, StorageError):
        return ()
    except (msgspec.DecodeError, ValidationError) as error:
        raise Refused(
            f"The obstacles of the plan {on_vehicle.plan.name!r} cannot be read, so they are not checked.",
            remedy="Correct and save the plan, and upload it again.",
        ) from error


class _StoredObstacles(msgspec.Struct):
    obstacles: msgspec.Raw = msgspec.Raw(b"[]")


_obstacles: TypeAdapter[tuple[Obstacle, ...]] = TypeAdapter(Obstacles)
