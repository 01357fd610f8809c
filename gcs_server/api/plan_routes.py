"""Routes of plans: storing versions, checking, importing, exporting, patterns."""

from __future__ import annotations

import json
from typing import Annotated, Any

from fastapi import Body, Query, Request, Response
from msgspec import Raw

from gcs_server.api import plan_models as m
from gcs_server.api.documents import DocumentRoute, PatternBody
from gcs_server.api.offboard_mission_models import MissionToInsert, MissionWithInserted
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.refusals import MAX_BODY_BYTES
from gcs_server.api.responses import fields_of, json_bytes, json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import StationDep
from gcs_server.control.accepted import authorized_command
from gcs_server.errors import InvalidRequest
from gcs_server.flights.chosen import choose
from gcs_server.flights.plan_checks import (
    check_document,
    is_small_pattern,
    plan_context_of,
    take_off_position_of,
)
from gcs_server.plans.files import PlanVersion
from gcs_server.plans.work import SMALL_BYTES
from missions import documents
from missions.documents import PlanKind
from missions.formats.any_format import FormatName
from missions.values import Altitude, Reference

router = Routes(prefix="/plans", tags=["plans"], responses=RESPONSES, route_class=DocumentRoute)

MAX_MISSION_BYTES = MAX_BODY_BYTES - 4096
"""Maximum size of a mission after an insertion. The rest of MAX_BODY_BYTES is for the other fields of the
request that saves the mission."""
MAX_NOTES_LENGTH = 4000
"""Maximum length of the header with the notes of an export."""
NOTES_HEADER = "X-Plan-Notes"
FILE_BODY: dict[str, Any] = {
    "requestBody": {
        "required": True,
        "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
    }
}
"""OpenAPI description of a request whose body is the bytes of a file."""
MEDIA_TYPES: dict[FormatName, str] = {
    "json": "application/json",
    "plan": "application/json",
    "waypoints": "text/plain; charset=utf-8",
    "csv": "text/csv; charset=utf-8",
    "geojson": "application/geo+json",
    "kml": "application/vnd.google-earth.kml+xml",
    "kmz": "application/vnd.google-earth.kmz",
    "yaml": "application/yaml",
}


@router.get("", response_model=m.PlanList)
async def list_plans(station: StationDep) -> Response:
    """The newest version of each plan, without the documents."""
    return json_response({"plans": await station.flights.plans.all()})


@router.post("", response_model=m.KeptPlan, status_code=201)
async def create_plan(body: m.NewPlan, station: StationDep, principal: PrincipalDep) -> Response:
    """Stores a new plan as version 1."""
    with authorized_command(station, principal, "plans/create", None, {"name": body.name}):
        document = await body.plan.read(station.flights.plan_work, body.name)
        stored = await station.flights.plans.create(body.name, document, by=(principal.name, principal.key))
        return _plan_response(stored, document.text, 201)


@router.post("/check", response_model=m.PlanCheck)
async def check_plan(body: m.PlanToCheck, station: StationDep) -> Response:
    """Checks a plan: findings and estimates of its flight. Changes nothing.

    With `vehicle`, the vehicle's parameters and home are used. If the server does not know the parameters,
    it uses PX4's defaults (finding `parameters_unknown`). If it does not know the home, it uses the home of
    the plan (a sentence in `not_known`). An offboard mission is compiled for a start on the ground at home;
    `flight` contains its path and the duration of each step. If the vehicle is on the ground, the server
    compares a waypoint plan with the current flights of other vehicles, as it also does when the plan is
    started (warnings `separation`, `separation_unknown`).
    """
    vehicle = None if body.vehicle is None else station.fleet.get(body.vehicle)
    power = None if body.power is None else body.power.model_dump()
    check = await check_document(station.flights, body.plan.text, vehicle, power, compare_with_others=True)
    return json_bytes(check.body)


@router.post("/convert", response_model=m.ConvertedPlan)
async def convert_plan(body: m.PlanToConvert, station: StationDep) -> Response:
    """Converts a waypoint plan to an offboard mission, which flies it by setpoints. Saves nothing.

    With `vehicle`, the vehicle's parameters are used, and its home if the plan has no home.
    """
    vehicle = None if body.vehicle is None else station.fleet.get(body.vehicle)
    context = plan_context_of(station.flights, vehicle)
    arguments = {
        "plan": body.plan.text,
        "name": body.name,
        "parameters": context.parameters,
        "home": context.home,
    }
    answer = await station.flights.plan_work.run("convert", arguments, small=body.plan.small)
    return json_bytes(answer.body)


@router.post("/divide", response_model=m.DividedSurvey)
async def divide_survey(body: m.SurveyToDivide, station: StationDep) -> Response:
    """Divides a survey over several vehicles: a mission with a role for each of them. Saves nothing.

    The lines are flown once, in neighbouring parts that take equally long, the ways from and to the take-off
    positions included. The ways have layers of altitude where they come near to each other, and the vehicles
    wait for each other between take-off, ways, lines and landing.
    """
    vehicles = [station.fleet.get(each) for each in body.vehicles or []]
    context = plan_context_of(station.flights, vehicles[0] if vehicles else None)
    arguments = {
        **body.model_dump(include={"item", "count", "minimum_separation_m", "name"}),
        "plan": body.plan.text,
        "parameters": context.parameters,
        "starts": [take_off_position_of(each) for each in vehicles] if vehicles else None,
        "home": context.home,
        "vehicles": body.vehicles or [],
    }
    answer = await station.flights.plan_work.run("divide", arguments, small=False)
    return json_bytes(answer.body)


@router.post("/insert", response_model=MissionWithInserted)
async def insert_mission(body: MissionToInsert, station: StationDep) -> Response:
    """Inserts a mission for one vehicle into another mission. Saves nothing.

    The steps of the inserted mission become a new list of steps in `missions`, and a new `call` step at `at`
    calls this list. The lists and tables that these steps use are copied too. The inserted mission's speed
    limit and avoidance become fields of its steps; its other limits, its geofence and its obstacles apply to
    the whole mission.
    """
    added = await choose(station.flights.plans, body.source, "offboard_mission")
    arguments = {
        **body.model_dump(include={"at", "in_air", "positions"}),
        "plan": body.plan.text,
        "added": added.document.text,
        "name": added.reference.name,
        "max_bytes": MAX_MISSION_BYTES,
    }
    small = body.plan.small and added.document.small
    answer = await station.flights.plan_work.run("insert", arguments, small=small, field=added.field)
    return json_bytes(answer.body)


@router.post("/ground", response_model=m.GroundPlan)
async def follow_ground(body: m.PlanToFollowGround, station: StationDep) -> Response:
    """Resolves a plan's altitudes above the ground with the operator's elevation files. Saves nothing.

    PX4 flies to each item at a fixed altitude above sea level, and in straight lines between the items. With
    `tolerance_m`, waypoints are added where a line deviates by more than this from the planned height above
    the ground.
    """
    arguments = {"plan": body.plan.text, "tolerance_m": body.tolerance_m}
    answer = await station.flights.plan_work.run("follow_ground", arguments, small=False)
    return json_bytes(answer.body)


@router.get("/schema/{kind}", response_model=dict[str, Any])
async def plan_schema(kind: PlanKind) -> Response:
    """The JSON Schema of the documents of a kind."""
    return json_response(documents.schema(kind))


@router.post("/import", response_model=m.ImportedPlan, openapi_extra=FILE_BODY)
async def import_plan(
    request: Request,
    station: StationDep,
    filename: Annotated[
        str, Query(max_length=255, description="Name of the file; a CSV file is recognised by its extension.")
    ] = "",
    altitude_m: Annotated[
        float | None,
        Query(
            ge=-12_000,
            le=100_000,
            allow_inf_nan=False,
            description="Altitude of points without an altitude in the file [m]; default: a file with such "
            "points is refused (`field` of the error: `altitude_m`). Altitudes in the file are kept.",
        ),
    ] = None,
    altitude_reference: Annotated[
        Reference | None,
        Query(
            description="Reference of `altitude_m` (default: home), and of the altitudes in the file if the "
            "file does not state their reference. Without it and without `altitude_m`, such a file is "
            "refused (`field` of the error: `altitude_reference`)."
        ),
    ] = None,
) -> Response:
    """The plan in a file: .plan, .waypoints, CSV, GeoJSON, KML, KMZ, DJI waylines, this project's JSON, or
    YAML. Saves nothing.

    The body is the bytes of the file. What the file does not state is not guessed: a missing altitude or
    reference is asked for by an error (`field`), and `areas` lists areas whose use the user has to choose.
    """
    data = await _file_content(request)
    altitude = None
    if altitude_m is not None:
        altitude = Altitude(value_m=altitude_m, reference=altitude_reference or "home").model_dump()
    arguments = {"file": data, "filename": filename, "altitude": altitude, "reference": altitude_reference}
    small = len(data) <= SMALL_BYTES and not data.startswith(b"PK")  # PK: a ZIP archive (KMZ)
    answer = await station.flights.plan_work.run("import", arguments, small=small, field="body")
    return json_bytes(answer.body)


@router.post("/table", response_model=m.ImportedTableModel, openapi_extra=FILE_BODY)
async def import_table(
    request: Request,
    station: StationDep,
    filename: Annotated[
        str, Query(max_length=255, description="Name of the file; the name of the table is derived from it.")
    ] = "",
) -> Response:
    """The trajectory in a file, as CSV text for the `tables` of an offboard mission: CSV, or a NumPy array
    of shape (N, 4) or (N, 5) saved with `numpy.save` (.npy). Saves nothing.

    The body is the bytes of the file. Columns: `t_s`, `north_m`, `east_m`, `down_m`, and optionally
    `yaw_ned_rad`.
    """
    data = await _file_content(request)
    arguments = {"file": data, "filename": filename}
    small = len(data) <= SMALL_BYTES
    answer = await station.flights.plan_work.run("table", arguments, small=small, field="body")
    return json_bytes(answer.body)


async def _file_content(request: Request) -> bytes:
    data = await request.body()
    if not data:
        raise InvalidRequest("body", "The file is empty.", remedy="Send the file as the request's body.")
    return data


@router.post(
    "/export",
    response_class=Response,
    responses={
        200: {
            "description": "The file. `X-Plan-Notes` is a JSON list of sentences about content that the "
            "format cannot represent.",
            "content": {media_type.partition(";")[0]: {} for media_type in MEDIA_TYPES.values()},
        }
    },
)
async def export_plan(
    body: m.PlanToExport,
    station: StationDep,
    format: Annotated[
        FormatName,
        Query(
            description="`plan` is QGroundControl's format, `json` this project's. "
            "An offboard mission: `yaml` or `json`."
        ),
    ],
) -> Response:
    """The plan as a file. The header `X-Plan-Notes` is a JSON list of content that the format cannot
    represent."""
    arguments = {"plan": body.plan.text, "format": format}
    answer = await station.flights.plan_work.run("export", arguments, small=body.plan.small)
    notes = [note for note in answer.values["notes"] if len(note) < MAX_NOTES_LENGTH // 4][:4]
    return Response(
        answer.body,
        headers={
            "Content-Type": MEDIA_TYPES[format],
            "Content-Disposition": f'attachment; filename="plan.{format}"',
            NOTES_HEADER: json.dumps(notes),
        },
    )


@router.post("/pattern", response_model=m.PatternPlan)
async def make_pattern(
    pattern: Annotated[PatternBody, Body(description="`kind` and the fields of that pattern.")],
    station: StationDep,
    document: Annotated[
        PlanKind, Query(description="Items of a waypoint plan, or steps of an offboard mission.")
    ] = "waypoint_plan",
    vehicle: Annotated[
        str | None,
        Query(description="Its parameters are used for times and rounded corners; default: PX4's defaults."),
    ] = None,
    tolerance_m: Annotated[
        float | None,
        Query(
            gt=0,
            le=1000,
            allow_inf_nan=False,
            description="Resolves altitudes above the ground with the elevation files, and adds waypoints "
            "where a line deviates by more than this from the planned height above the ground [m]; default: "
            "altitudes are not resolved.",
        ),
    ] = None,
) -> Response:
    """Generates a pattern of a plan, or steps of a mission, from an area, a line or a point: survey,
    corridor, perimeter, orbit or structure scan. Saves nothing."""
    context = plan_context_of(station.flights, None if vehicle is None else station.fleet.get(vehicle))
    arguments = {
        "pattern": pattern.text,
        "kind": document,
        "parameters": context.parameters,
        "tolerance_m": tolerance_m,
    }
    task = "pattern" if tolerance_m is None else "pattern_on_ground"
    small = tolerance_m is None and pattern.small and is_small_pattern(pattern.text)
    answer = await station.flights.plan_work.run(task, arguments, small=small, field="body")
    return json_bytes(answer.body)


@router.get("/{plan}", response_model=m.KeptPlan)
async def get_plan(
    plan: str,
    station: StationDep,
    version: Annotated[int | None, Query(ge=1, description="Default: the newest.")] = None,
) -> Response:
    """A plan with its document."""
    return _plan_response(*await station.flights.plans.get(plan, version))


@router.get("/{plan}/versions", response_model=m.PlanVersions)
async def list_versions(plan: str, station: StationDep) -> Response:
    """The stored versions of a plan, newest first."""
    return json_response({"versions": await station.flights.plans.versions(plan)})


@router.put("/{plan}", response_model=m.KeptPlan)
async def save_plan(plan: str, body: m.ChangedPlan, station: StationDep, principal: PrincipalDep) -> Response:
    """Adds a version. Answers 409 `conflict` if `base_version` is not the newest version, with the time and
    the client of the newest version."""
    arguments: dict[str, object] = {"plan": plan, "name": body.name, "base_version": body.base_version}
    with authorized_command(station, principal, "plans/save", None, arguments):
        document = await body.plan.read(station.flights.plan_work, body.name)
        stored = await station.flights.plans.save(
            plan,
            body.name,
            document,
            base_version=body.base_version,
            by=(principal.name, principal.key),
        )
        return _plan_response(stored, document.text)


@router.delete("/{plan}", status_code=204)
async def delete_plan(
    plan: str,
    station: StationDep,
    principal: PrincipalDep,
    base_version: Annotated[
        int, Query(ge=1, description="Version that the caller has seen; 409 if it is not the newest.")
    ],
) -> Response:
    """Deletes a plan with all its versions."""
    arguments: dict[str, object] = {"plan": plan, "base_version": base_version}
    with authorized_command(station, principal, "plans/delete", None, arguments):
        await station.flights.plans.delete(
            plan, base_version=base_version, by=(principal.name, principal.key)
        )
    return Response(status_code=204)


def _plan_response(stored: PlanVersion, document: bytes, status: int = 200) -> Response:
    return json_response({**fields_of(stored), "plan": Raw(document)}, status)
