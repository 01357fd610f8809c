"""Routes of a vehicle's own mission: show, upload, download, compare, clear, start, resume."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any

from fastapi import Body, Query, Response
from msgspec import Raw

from gcs_server.api import mission_models as m
from gcs_server.api import responses
from gcs_server.api.authorized import progress_reporter
from gcs_server.api.command_routes import run_command, run_flight_command
from gcs_server.api.documents import DocumentRoute
from gcs_server.api.offboard_mission_models import FlownMissionView
from gcs_server.api.operation_routes import OperationModel, operation_view
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import Station, StationDep, VehicleDep
from gcs_server.control.accepted import authorized_command
from gcs_server.control.commands import API, BY_NAME
from gcs_server.errors import Refused
from gcs_server.flights.upload import (
    chosen_items,
    flies_mission,
    require_accepted,
    require_unchanged,
    upload_check,
)
from gcs_server.flights.waypoint_start import WaypointStart, checked_start, is_still_on_vehicle
from gcs_server.operations.operations import Operation, ReportProgress
from gcs_server.vehicle.services.mission_compare import differences
from gcs_server.vehicle.services.mission_dialogue import PARTS
from gcs_server.vehicle.services.mission_on_vehicle import ItemsOnVehicle, plan_from_items
from gcs_server.vehicle.tickets import Ticket
from gcs_server.vehicle.vehicle import Vehicle
from missions import plan as plan_document

router = Routes(
    prefix="/vehicles/{v}/mission", tags=["mission"], responses=RESPONSES, route_class=DocumentRoute
)

CONFIRM_DESCRIPTION = (
    "Required while the vehicle is in Mission mode: `vehicle {id} loses the mission that it flies`."
)


@router.get("", response_model=m.MissionView)
async def show_mission(vehicle: VehicleDep, station: StationDep) -> Response:
    """Progress of the vehicle's mission, the plan on the vehicle, and its newest flight.

    If the server knows the plan, it reads the parameters for `if_link_lost` in the background, and sends
    nothing else.
    """
    resume_offer = await station.flights.waypoint_flights.resume_offer(vehicle.id)
    on_vehicle, plan_state, flights = (
        vehicle.mission.items_on_vehicle,
        vehicle.mission.plan_on_vehicle(),
        station.flights.waypoint_flights,
    )
    sample = vehicle.topic("mission")
    return json_response(
        {
            "vehicle": vehicle.id,
            "mission": sample.value if sample is not None else None,
            "holds": {
                "state": plan_state,
                "plan": None if on_vehicle is None else on_vehicle.plan,
                "known_unix_s": None if on_vehicle is None else on_vehicle.at_unix_s,
            },
            "transfer": vehicle.mission.running_transfer,
            "flight": flights.status(vehicle.id),
            "resume": None if isinstance(resume_offer, str) else resume_offer,
            "no_resume": resume_offer if isinstance(resume_offer, str) else None,
            "if_link_lost": flights.if_link_lost(vehicle.id) if plan_state == "plan" else None,
        }
    )


@router.get("/flown", response_model=FlownMissionView)
async def show_flown(vehicle: VehicleDep, station: StationDep) -> Response:
    """The newest flight of a plan in Mission mode, running or ended, compared with its plan.

    `samples` are the flown positions, and the nearest points of the planned path.
    """
    return json_response({"vehicle": vehicle.id, "flown": station.flights.waypoint_flights.flown(vehicle.id)})


@router.post(
    "/upload",
    response_model=OperationModel,
    status_code=202,
    responses={200: {"model": OperationModel, "description": "With `wait`: done."}},
)
async def upload(v: str, body: m.UploadRequest, station: StationDep, principal: PrincipalDep) -> Response:
    """Replaces mission, geofence and rally points with those of a plan, and reads them back for verification.

    The upload is an operation with progress; `DELETE /operations/{id}` cancels it. Its `result` contains the
    number of items, and `not_kept`: the item parameters that the vehicle did not store. Parts that the plan
    does not have are cleared. The upload does not start the mission. However, a vehicle in Mission mode flies
    to the first item of a changed mission at once. The upload is then refused (409 `plan_findings`, code
    `flies_new_plan_at_once`, with the place), unless `despite` names the code; with `hold_first` the vehicle
    is first put into Hold, and the result has `held_first`. An identical mission keeps its current item.
    """
    arguments = body.model_dump(exclude={"plan", "wait"}, exclude_none=True, exclude_defaults=True)
    with authorized_command(station, principal, "mission/upload", v, arguments):
        vehicle = station.fleet.get(v)
        reference, items = await chosen_items(station.flights, body.source)
        check = await upload_check(station.flights, vehicle, items, body.despite)
        _require_no_transfer(station, vehicle)
        held = body.hold_first and flies_mission(vehicle)
        if held:
            with authorized_command(station, principal, "hold", v, {}) as accepted:
                await vehicle.command.hold(by=principal.name, ticket=accepted.ticket)
        require_accepted(check)

        async def work(report: ReportProgress) -> dict[str, object]:
            uploaded = await vehicle.mission.upload(
                items, reference, progress=report, before_mission=lambda: require_unchanged(check)
            )
            not_kept = [each.text() for each in uploaded.not_kept]
            counts = {part: len(items[part]) for part in PARTS}
            held_first: dict[str, object] = {"held_first": True} if held else {}
            return {"items": counts, "not_kept": not_kept[:20], **held_first}

        subject = f"{reference.id}@{reference.version}" if reference.id is not None else None
        operation = _begin_transfer(
            station, vehicle, "mission/upload", work, subject, (principal.name, principal.key)
        )
        return await _operation_response(station, operation, body.wait)


@router.post(
    "/download",
    response_model=OperationModel,
    status_code=202,
    responses={200: {"model": OperationModel, "description": "With `wait`: done."}},
)
async def download(
    vehicle: VehicleDep,
    station: StationDep,
    principal: PrincipalDep,
    body: Annotated[m.DownloadRequest | None, Body()] = None,
) -> Response:
    """Reads mission, geofence and rally points from the vehicle; `GET …/mission/plan` returns them."""

    async def work(report: ReportProgress) -> dict[str, object]:
        on_vehicle = await vehicle.mission.download(progress=report)
        return {"items": {part: len(on_vehicle.items[part]) for part in PARTS}}

    operation = _begin_transfer(
        station, vehicle, "mission/download", work, None, (principal.name, principal.key)
    )
    return await _operation_response(station, operation, body is not None and body.wait)


@router.get("/plan", response_model=m.DownloadedPlan)
async def downloaded_plan(vehicle: VehicleDep, station: StationDep) -> Response:
    """The plan that was last downloaded from the vehicle, or uploaded and verified."""
    on_vehicle = _downloaded_items(vehicle)

    def read() -> tuple[bytes, list[str]]:
        plan, notes = plan_from_items(on_vehicle)
        return plan_document.write(plan), notes

    text, notes = await station.flights.plan_work.in_thread(read)
    return json_response(
        {
            "vehicle": vehicle.id,
            "plan": Raw(text),
            "plan_name": on_vehicle.plan,
            "read_unix_s": on_vehicle.at_unix_s,
            "still_held": is_still_on_vehicle(vehicle, on_vehicle),
            "notes": notes,
        }
    )


@router.post("/compare", response_model=m.MissionComparison)
async def compare(vehicle: VehicleDep, body: m.WhichPlan, station: StationDep) -> Response:
    """Differences between a plan and the items of the last download from the vehicle.

    If a stored plan is equal and the vehicle still has these items, the server regards that plan as the plan
    on the vehicle.
    """
    reference, items = await chosen_items(station.flights, body.source)
    on_vehicle = _downloaded_items(vehicle)
    all_differences = await station.flights.plan_work.in_thread(
        lambda: [each for part in PARTS for each in differences(part, items[part], on_vehicle.items[part])]
    )
    equal = not any(each.essential for each in all_differences)
    same_ids = is_still_on_vehicle(vehicle, on_vehicle)
    if equal and same_ids and reference.id is not None:
        await vehicle.mission.set_items_on_vehicle(replace(on_vehicle, plan=reference))
    return json_response(
        {
            "vehicle": vehicle.id,
            "equal": equal,
            "differences": all_differences,
            "read_unix_s": on_vehicle.at_unix_s,
            "still_held": same_ids,
        }
    )


@router.delete("", response_model=responses.CommandDone)
async def clear(
    v: str,
    station: StationDep,
    principal: PrincipalDep,
    confirm: Annotated[str | None, Query(max_length=100, description=CONFIRM_DESCRIPTION)] = None,
) -> Response:
    """Clears mission, geofence and rally points on the vehicle."""

    async def work(vehicle: Vehicle) -> None:
        if flies_mission(vehicle):
            BY_NAME["mission/clear"].require_confirmation(confirm or "", vehicle=vehicle.id)
        await vehicle.mission.clear()

    return await run_command(station, principal, "mission/clear", v, {}, work)


@router.post("/start", response_model=responses.CommandDone)
async def start(
    v: str,
    station: StationDep,
    principal: PrincipalDep,
    body: Annotated[m.StartRequest | None, Body()] = None,
) -> Response:
    """Starts the vehicle's mission at the given or the current item; arms the vehicle if needed.

    Answers once the vehicle is armed in Mission. Answers 409 `plan_findings` if the plan has error findings
    or is unknown, unless `despite` lists their codes; the response contains all findings. Before a start on
    the ground at a later item, the server also checks the flight from the vehicle's position to that item.

    The server compares the predicted flight with the other vehicles of this server that hover, fly an
    offboard mission, or fly a waypoint plan that the server knows. If two vehicles may come nearer than the
    sum of 5 m, a margin of about 2 m and their braking distances, the code is `separation`, and the text
    names both vehicles, place, time and distance. The server does not compare vehicles flown by hand or by
    other commands, or vehicles of other stations.

    To resume an interrupted flight, start at the item of `resume` of `GET …/mission`. Hold pauses the
    mission. The server monitors the flight of a plan that it knows (topic `waypoint_flight`), and never
    intervenes.
    """
    request = body or m.StartRequest()
    arguments = request.model_dump(exclude_none=True)
    choice = WaypointStart(**request.model_dump())

    async def work(vehicle: Vehicle, ticket: Ticket) -> None:
        vehicle.require_commandable()
        async with checked_start(station.flights, vehicle, choice, ticket, principal.name):
            if request.item is not None:
                await vehicle.mission.set_current(request.item)
            progress = progress_reporter(vehicle, principal, "mission/start")
            await vehicle.command.start_mission(by=principal.name, progress=progress, ticket=ticket)

    return await run_flight_command(station, principal, "mission/start", v, arguments, work)


@router.post("/resume", response_model=responses.CommandDone)
async def resume(
    v: str,
    station: StationDep,
    principal: PrincipalDep,
    body: Annotated[m.ResumeRequest | None, Body()] = None,
) -> Response:
    """Lets a flying vehicle continue its mission at its current item or at `item`, from Hold or while it
    flies the mission, after the checks of `mission/start`. Unlike `mission/start` it never arms. What was
    accepted when this flight started need not be accepted again, except `separation`."""
    request = body or m.ResumeRequest()
    choice = WaypointStart(**request.model_dump())

    async def work(vehicle: Vehicle, ticket: Ticket) -> None:
        vehicle.require_commandable()
        if not vehicle.flight_state.armed or vehicle.flight_state.landed_state == "on_ground":
            raise Refused(
                f"Vehicle {vehicle.id} is not flying.",
                remedy="Start the mission at the item where it should continue (`resume` of GET …/mission).",
            )
        progress = progress_reporter(vehicle, principal, "mission/resume")
        async with checked_start(station.flights, vehicle, choice, ticket, principal.name):
            if request.item is not None:
                await vehicle.mission.set_current(request.item)
            await vehicle.command.set_mode("mission", by=principal.name, progress=progress, ticket=ticket)

    arguments = request.model_dump(exclude_none=True, exclude_defaults=True)
    return await run_flight_command(station, principal, "mission/resume", v, arguments, work)


# --- helpers ------------------------------------------------------------------------------------------


def _begin_transfer(
    station: Station, vehicle: Vehicle, kind: str, work: Any, subject: str | None, by: tuple[str, str]
) -> Operation:
    """Starts a transfer; refused if another transfer of the vehicle is running."""
    _require_no_transfer(station, vehicle)
    activity = "Uploading to" if kind == "mission/upload" else "Downloading from"
    text = f"{activity} vehicle {vehicle.id}."
    return station.operations.start(
        kind, work, text=text, vehicle=vehicle.id, subject=subject, by=by, needs_vehicle=True
    )


def _require_no_transfer(station: Station, vehicle: Vehicle) -> None:
    vehicle.require("mission_transfer")
    if vehicle.mission.running_transfer is not None or any(
        each.state == "running" and each.vehicle == vehicle.id and each.kind.startswith("mission/")
        for each in station.operations.all()
    ):
        raise Refused(
            f"Vehicle {vehicle.id} already has a mission transfer; only one can run at a time.",
            remedy="Wait until it is done, or cancel it (DELETE /operations/{id}).",
        )


async def _operation_response(station: Station, operation: Operation, wait: bool) -> Response:
    if wait:
        ended_operation = await station.operations.wait(operation.id)
        if ended_operation.state == "cancelled":
            raise Refused(f"{operation.text.rstrip('.')} was cancelled.")
        return json_response(operation_view(ended_operation))
    response = json_response(operation_view(operation), 202)
    response.headers["Location"] = f"{API}/operations/{operation.id}"
    return response


def _downloaded_items(vehicle: Vehicle) -> ItemsOnVehicle:
    on_vehicle = vehicle.mission.items_on_vehicle
    if on_vehicle is None:
        raise Refused(
            f"The plan on vehicle {vehicle.id} has not been downloaded.",
            remedy="Download it first (POST …/mission/download).",
        )
    return on_vehicle
