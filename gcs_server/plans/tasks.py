"""Computations on plans, with plain values and bytes as input and output, so that they can run in a thread or
a process. The bytes of an answer are in most cases the response to the client, which the server passes on.
"""

from __future__ import annotations

import dataclasses
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import msgspec
from msgspec import Raw

from gcs_server.operations.process import WorkerFailed
from gcs_server.plans import typed_values
from missions import documents
from missions import plan as plan_document
from missions.checks import CheckLimits, Finding, check
from missions.errors import PlanError
from missions.estimates import Estimate, estimate
from missions.formats import any_format, mavlink_items
from missions.formats.results import ImportOptions
from missions.geodesy import LocalOrigin
from missions.offboard import reader as mission_reader
from missions.offboard.document import OffboardMission
from missions.offboard.findings import MissionFinding
from missions.offboard.names import valid_name
from missions.terrain.profile import PlanGround
from missions.values import Altitude, HomePosition
from missions.vehicle import PowerModel, VehicleModel

if TYPE_CHECKING:
    from missions.offboard.positions import Start
    from missions.offboard.samples import Leg
    from missions.offboard.state import MissionVehicle, OperatorArea
    from missions.offboard.timeline import Timeline
    from missions.trajectory.limits import MotionLimits

Values = dict[str, Any]
"""A JSON object."""
AnyFinding = TypeVar("AnyFinding", Finding, MissionFinding)
T = TypeVar("T")
PLACE_FIELDS = ("row", "zone", "rally_point", "obstacle", "step")
"""Fields of the place of a finding. A finding of a waypoint plan has no `step`; a finding of an offboard
mission has only `obstacle` and `step`."""


_HEAD = struct.Struct("!I")
MAX_PROBLEM_LENGTH = 1000


@dataclass(frozen=True, slots=True)
class Answer:
    """The result of a task."""

    values: Values
    """A few values that the server itself needs."""
    body: bytes = b""
    """A document, a response to the client, or values for `typed_values`."""
    fault: dict[str, str | None] | None = None
    """Why the plan or file cannot be used: `place`, `reason`, `fix`, `field`; None: it can."""


def run(task: str, arguments: Mapping[str, Any]) -> Answer:
    """Runs one of `TASKS`; a problem of the plan or file is part of the answer."""
    try:
        return TASKS[task](arguments)
    except PlanError as error:
        fault = {"place": error.place, "reason": error.reason, "fix": error.fix, "field": error.field}
        return Answer({}, fault=fault)


def answer_request(request: bytes) -> bytes:
    """Runs the task of a request (`task` and `arguments` as msgpack) in its process."""
    values = msgspec.msgpack.decode(request)
    try:
        answer, problem = run(values["task"], values["arguments"]), None
    except Exception as error:
        answer, problem = Answer({}), str(error) or type(error).__name__
    head = msgspec.msgpack.encode((answer.values, answer.fault, problem))
    return _HEAD.pack(len(head)) + head + answer.body


def answer_from_bytes(data: bytes) -> Answer:
    """Reads the output of `answer_request`.

    Raises:
        WorkerFailed: the task has failed.
        msgspec.DecodeError: the bytes are not an answer.
    """
    end = _HEAD.size + int.from_bytes(data[: _HEAD.size], "big")
    values, fault, problem = msgspec.msgpack.decode(data[_HEAD.size : end], type=_HeadType)
    if problem is not None:
        raise WorkerFailed(problem[:MAX_PROBLEM_LENGTH])
    return Answer(values, data[end:], fault)


_HeadType = tuple[Values, dict[str, str | None] | None, str | None]


def _response(values: Mapping[str, Any], **raw: bytes) -> Answer:
    """The answer whose body is a JSON object with these values, and others that are JSON already."""
    return Answer({}, msgspec.json.encode({**values, **{name: Raw(text) for name, text in raw.items()}}))


class DocumentHead(msgspec.Struct, frozen=True):
    """What the server itself needs of a document."""

    kind: documents.PlanKind
    steps: int
    """Number of items as uploaded, or of steps with nested steps."""
    name: str | None
    """Name of an offboard mission."""
    home: dict[str, float] | None
    """The planned home: `lat_deg`, `lon_deg`, `alt_amsl_m`."""
    takes_off: bool
    """Whether the first step of an offboard mission is a take-off."""
    separation_m: float | None
    roles: dict[str, tuple[float, float, float] | None]
    """Planned start of each role [m], from the home."""


def head_of(document: documents.Document) -> DocumentHead:
    """The head of a document."""
    kind, steps = documents.kind_of(document), documents.count_steps(document)
    home = document.home if isinstance(document, OffboardMission) else document.planned_home
    home_values = None if home is None else home.model_dump()
    if not isinstance(document, OffboardMission):
        return DocumentHead(kind, steps, None, home_values, False, None, {})
    takes_off = bool(document.steps) and document.steps[0].step == "take_off"
    roles = {name: role.start_ned_m for name, role in document.roles.items()}
    separation_m = document.separation_m
    return DocumentHead(kind, steps, document.name, home_values, takes_off, separation_m, roles)


@dataclass(frozen=True, slots=True)
class ReadDocument:
    """A document that has been read and found valid."""

    head: DocumentHead
    text: bytes
    """The document as this project writes it."""

    @classmethod
    def of(cls, document: documents.Document) -> ReadDocument:
        """Writes a document."""
        return cls(head_of(document), documents.write(document))

    @classmethod
    def from_answer(cls, answer: Answer) -> ReadDocument:
        """The result of the task `read`.

        Raises:
            msgspec.ValidationError: the values are not a head.
        """
        return cls(msgspec.convert(answer.values, DocumentHead), answer.body)


def _read(arguments: Mapping[str, Any]) -> Answer:
    """Reads a document. Arguments: `plan` (JSON text); `name` that the document gets (null: its own); `kind`
    that it must have (null: any). The body is the document as this project writes it."""
    reader = {"waypoint_plan": plan_document.read, "offboard_mission": _mission_of}.get(arguments["kind"])
    document = (reader or documents.read)(arguments["plan"])
    if arguments["name"] is not None:
        document = documents.with_name(document, arguments["name"])
    read = ReadDocument.of(document)
    return Answer(msgspec.to_builtins(read.head), read.text)


def _items(arguments: Mapping[str, Any]) -> Answer:
    """The MAVLink items of a waypoint plan. Argument: `plan` (JSON text). The body has the items of each part
    as msgpack; `rows` is the index in the plan's `items` of each mission item."""
    plan = plan_document.read(arguments["plan"])
    parts = {
        "mission": mavlink_items.mission_items(plan),
        "fence": mavlink_items.fence_items(plan),
        "rally": mavlink_items.rally_items(plan),
    }
    return Answer({"rows": [row for row, _ in plan.simple_items()]}, msgspec.msgpack.encode(parts))


def _check(arguments: Mapping[str, Any]) -> Answer:
    """Checks a plan. Arguments: `plan` (JSON text); `parameters` and `unknown_parameters` of the vehicle;
    `home`, `origin` and `reported` of the vehicle, and `power`, each may be null; `operator` (as
    `OperatorArea`); `traffic` (as `Traffic`, or null); `elevation`: paths of elevation files; `vehicle` (its
    id, or null) and `not_known` for the response."""
    values = _checked(arguments)
    not_known = (*arguments["not_known"], *values.pop("ground_not_known"))
    return _response({**values, "vehicle": arguments["vehicle"], "not_known": not_known})


def _checked(arguments: Mapping[str, Any]) -> Values:
    document = documents.read(arguments["plan"])
    power = None if arguments["power"] is None else PowerModel(**arguments["power"])
    limits = CheckLimits(power=power, unknown_parameters=tuple(arguments["unknown_parameters"]))
    if isinstance(document, OffboardMission):
        return _check_mission(document, arguments, limits)
    plan = document
    if arguments["home"] is not None:
        plan = plan.model_copy(update={"planned_home": HomePosition.model_validate(arguments["home"])})
    vehicle = VehicleModel.from_parameters(arguments["parameters"])
    findings = check(plan, dataclasses.replace(limits, vehicle=vehicle))
    ground = PlanGround()
    if arguments["elevation"]:
        from gcs_server.plans import terrain_tasks  # GDAL, 0.3 s to import

        ground_findings, ground = terrain_tasks.ground_of_plan(
            plan, arguments["elevation"], vehicle.return_alt_m
        )
        findings = (*(_on_ground(each, ground) for each in findings), *ground_findings)
    separation: list[Values] = []
    if arguments["traffic"] is not None:
        from gcs_server.plans import traffic_task

        traffic = typed_values.from_bytes(arguments["traffic"], traffic_task.Traffic)
        separation = traffic_task.separation_findings(document, traffic)
    return {
        "kind": "waypoint_plan",
        "findings": [*(_finding(each) for each in findings), *separation],
        "estimates": dataclasses.asdict(estimate(plan, vehicle, power)),
        "flight": None,
        "ground": list(ground.profile),
        "ground_not_known": list(ground.not_known),
    }


def _on_ground(finding: AnyFinding, ground: PlanGround) -> AnyFinding:
    """The finding as a warning if it is about an altitude below home where the ground is known: there the
    findings of the elevation data count."""
    place = finding.row if isinstance(finding, Finding) else finding.step
    if finding.code != "altitude_below_home" or place not in ground.known_places:
        return finding
    return dataclasses.replace(finding, is_error=False)


def _finding(finding: Finding | MissionFinding) -> Values:
    return {
        "code": finding.code,
        "severity": finding.severity,
        "text": finding.message,
        "place": {name: getattr(finding, name, None) for name in PLACE_FIELDS},
        "fix": finding.fix,
        "limit": finding.limit,
    }


def _check_mission(mission: OffboardMission, arguments: Mapping[str, Any], limits: CheckLimits) -> Values:
    """Compiles an offboard mission and checks it: for a start on the ground at home, or, if it has roles, at
    the start position of each role. All vehicles then have the same parameters."""
    from missions.offboard import compiler, mission_checks, roles, samples  # half a second to import
    from missions.offboard.state import MissionVehicle

    vehicle = MissionVehicle.from_parameters(
        arguments["parameters"], limits, arguments["reported"], _area_of(arguments)
    )
    start = _start_at_home(mission, arguments)
    timelines: list[Timeline]
    if mission.roles:
        by_role = roles.planned_starts(mission)
        compiled = roles.compile_roles(mission, dict.fromkeys(mission.roles, vehicle), by_role)
        timelines, starts = list(compiled.timelines.values()), [by_role[role] for role in compiled.timelines]
        start = dataclasses.replace(start, position_ned_m=(0.0, 0.0, 0.0), origin=starts[0].origin)
        findings, duration_s, closest = compiled.findings, compiled.duration_s, compiled.closest
    else:
        timelines, starts = [compiler.compile_mission(mission, vehicle, start)], [start]
        findings, duration_s, closest = timelines[0].findings, timelines[0].duration_s, ()
    flown = [(each, begin.position_ned_m) for each, begin in zip(timelines, starts, strict=True)]
    names = list(mission.roles) or [None]
    legs = [
        leg
        for (each, position_ned_m), role in zip(flown, names, strict=True)
        for leg in samples.legs(each, position_ned_m, role)
    ]
    ground_findings, ground = _mission_ground(
        legs, start.origin, start.position_ned_m[2], arguments["elevation"]
    )
    energies_wh = [each.energy_wh for each in timelines if each.energy_wh is not None]
    estimates = Estimate(
        sum(each.length_m for each in timelines),
        duration_s,
        max(mission_checks.climb_m(each, position_ned_m[2]) for each, position_ned_m in flown),
        sum(each.photos for each in timelines),
        max(energies_wh) if len(energies_wh) == len(timelines) else None,
        endless=False,
        known_altitudes=True,
    )
    return {
        "kind": "offboard_mission",
        "findings": [
            _finding(each) for each in (*(_on_ground(f, ground) for f in findings), *ground_findings)
        ],
        "estimates": dataclasses.asdict(estimates),
        "flight": {
            "steps": [dataclasses.asdict(step) for each in timelines for step in samples.step_times(each)],
            "legs": [dataclasses.asdict(each) for each in legs],
            "roles": [
                {"role": role, "time_s": each.duration_s, "length_m": each.length_m, "photos": each.photos}
                for role, each in zip(names, timelines, strict=True)
                if role is not None
            ],
            "closest": [dataclasses.asdict(each) for each in closest],
            "needs": list(dict.fromkeys(need for each in timelines for need in each.needs)),
            "start_ned_m": start.position_ned_m,
            "origin": None if start.origin is None else dataclasses.asdict(start.origin),
        },
        "ground": list(ground.profile),
        "ground_not_known": list(ground.not_known),
    }


def _start_at_home(mission: OffboardMission, arguments: Mapping[str, Any]) -> Start:
    """A start on the ground at the vehicle's home, or at the mission's home."""
    from missions.offboard.positions import Start

    home, origin = arguments["home"], arguments["origin"]
    if home is not None:
        local_origin = LocalOrigin(**(home if origin is None else origin))
        home_ned_m = local_origin.to_ned(home["lat_deg"], home["lon_deg"], home["alt_amsl_m"])
        return Start(position_ned_m=home_ned_m, origin=local_origin, home_alt_amsl_m=home["alt_amsl_m"])
    if mission.home is not None:
        local_origin = LocalOrigin(mission.home.lat_deg, mission.home.lon_deg, mission.home.alt_amsl_m)
        return Start(origin=local_origin, home_alt_amsl_m=mission.home.alt_amsl_m)
    return Start()


def _mission_ground(
    legs: Sequence[Leg], origin: LocalOrigin | None, start_down_m: float, elevation: Sequence[str]
) -> tuple[list[MissionFinding], PlanGround]:
    if not elevation:
        return [], PlanGround()
    from gcs_server.plans import terrain_tasks

    return terrain_tasks.ground_of_mission(legs, origin, start_down_m, elevation)


def _import(arguments: Mapping[str, Any]) -> Answer:
    """Imports a file. Arguments: `file` (bytes), `filename`, `altitude` (of points without an altitude; may
    be null), `reference` (of altitudes without a reference; may be null)."""
    altitude = arguments["altitude"]
    options = ImportOptions(
        None if altitude is None else Altitude.model_validate(altitude), arguments.get("reference")
    )
    data = arguments["file"]
    format_name = any_format.recognise(data, arguments["filename"])
    imported = any_format.read(format_name, data, options)
    values = {
        "format": format_name,
        "kind": documents.kind_of(imported.plan),
        "areas": [
            {
                "name": valid_name(area.name, ""),
                "outer": [point.model_dump() for point in area.outer],
                "holes": [[point.model_dump() for point in hole] for hole in area.holes],
                "likely_use": area.likely_use,
                "uses": [
                    {
                        "use": each.use,
                        "text": each.text,
                        "fence": [zone.model_dump(exclude={"original"}) for zone in each.fence],
                    }
                    for each in area.uses
                ],
            }
            for area in imported.areas
        ],
        "notes": list(imported.notes),
    }
    return _response(values, plan=documents.write(imported.plan))


def _export(arguments: Mapping[str, Any]) -> Answer:
    """Exports a plan. Arguments: `plan` (JSON text), `format`. The body is the file."""
    exported = any_format.write(arguments["format"], documents.read(arguments["plan"]))
    return Answer({"notes": list(exported.notes)}, exported.data)


def _pattern(arguments: Mapping[str, Any]) -> Answer:
    from gcs_server.plans import pattern_task

    return _document_response(pattern_task.generate(arguments))


def _document_response(values: Values) -> Answer:
    """The answer whose body contains `plan`, which is JSON already."""
    return _response(values, plan=values["plan"].encode())


def _convert(arguments: Mapping[str, Any]) -> Answer:
    """Converts a waypoint plan. Arguments: `plan` (JSON text), `name`, `parameters`, `home` of the vehicle,
    used if the plan has none; may be null."""
    from missions.offboard.from_plan import from_plan

    vehicle = VehicleModel.from_parameters(arguments["parameters"])
    plan = plan_document.read(arguments["plan"])
    if arguments["home"] is not None and plan.planned_home is None:
        plan = plan.model_copy(update={"planned_home": HomePosition.model_validate(arguments["home"])})
    converted = from_plan(plan, arguments["name"], vehicle)
    return _response({"notes": converted.notes}, plan=documents.write(converted.mission))


def _divide(arguments: Mapping[str, Any]) -> Answer:
    """Divides a survey over vehicles. Arguments: `plan` (JSON text), `item`, `name`, `minimum_separation_m`;
    `parameters` of the first vehicle; `starts`: place of each vehicle as a home, or null with `count` and
    `home` (used if the plan has none; may be null); `vehicles`: their ids, may be empty."""
    from missions.offboard import division

    plan = plan_document.read(arguments["plan"])
    minimum_m = arguments["minimum_separation_m"]
    if arguments["starts"] is not None:
        starts = [HomePosition.model_validate(each) for each in arguments["starts"]]
    else:
        home = plan.planned_home
        if home is None and arguments["home"] is not None:
            home = HomePosition.model_validate(arguments["home"])
        if home is None:
            fix = "Set the planned home of the plan, or choose vehicles."
            raise PlanError("the plan", "it has no home, so the take-off positions are unknown", fix)
        starts = division.planned_starts(home, arguments["count"], minimum_m)
    divided = division.divide(
        plan, arguments["item"], starts, arguments["name"], minimum_m=minimum_m,
        vehicle=VehicleModel.from_parameters(arguments["parameters"]),
    )  # fmt: skip
    vehicles = arguments["vehicles"]
    parts = [
        {
            "role": each.role,
            "vehicle": vehicles[each.vehicle] if vehicles else None,
            "lines": [[start.model_dump(), end.model_dump()] for start, end in each.lines],
            "layer_m": each.layer_m,
        }
        for each in divided.parts
    ]
    values = {"parts": parts, "notes": list(divided.notes)}
    return _response(values, plan=documents.write(divided.mission))


def _insert(arguments: Mapping[str, Any]) -> Answer:
    """Inserts the mission `added` into `plan`. Arguments: `plan` and `added` (JSON texts); `name` of the
    inserted mission (null: its own); `at`, `in_air`, `positions` (as for `insert`); `max_bytes`: maximum size
    of the result."""
    from missions.offboard.insertion import insert

    added = _mission_of(arguments["added"])
    if arguments["name"] is not None:
        added = added.model_copy(update={"name": arguments["name"]})
    try:
        mission = _mission_of(arguments["plan"])
    except PlanError as error:  # the error names its field of the request
        raise PlanError(error.place, error.reason, error.fix, field="plan") from None
    result = insert(
        mission, added, arguments["at"], in_air=arguments["in_air"], positions=arguments["positions"]
    )
    text = documents.write(result.mission)
    size, max_bytes = len(msgspec.json.format(text, indent=-1)), arguments["max_bytes"]
    if size > max_bytes:
        reason = f"with {added.name!r} it would have {size} bytes, and only {max_bytes} can be stored"
        raise PlanError("the mission", reason, "Give its trajectories (`tables`) fewer rows.")
    return _response({"called": result.called, "notes": list(result.notes)}, plan=text)


def _table(arguments: Mapping[str, Any]) -> Answer:
    """Imports a trajectory. Arguments: `file` (bytes), `filename`."""
    from missions.offboard import tables

    return _response(dataclasses.asdict(tables.import_file(arguments["file"], arguments["filename"])))


def _compile(arguments: Mapping[str, Any]) -> Answer:
    """Compiles an offboard mission. Arguments: `plan` (JSON text); `vehicles`: pairs of a role (null: the
    mission of one vehicle) and the vehicle's `parameters`, `reported`, `operator` (as `OperatorArea`) and
    `start` (as `Start`, `origin` as a mapping or null); `elevation`: paths of elevation files.

    The body has the `CompiledMission` of each role, in the mission's order. It has none if the roles are not
    those of the mission, whose `head` has them.
    """
    from missions.offboard import compiler, roles

    mission = _mission_of(arguments["plan"])
    by_role: dict[str | None, Values] = dict(arguments["vehicles"])
    vehicles = {role: _vehicle_of(each) for role, each in by_role.items()}
    starts = {role: _start_of(each["start"]) for role, each in by_role.items()}
    timelines: dict[str | None, Timeline] = {}
    findings: list[MissionFinding] = []
    if None in by_role:
        timelines = {None: compiler.compile_mission(mission, vehicles[None], starts[None])}
        findings = list(timelines[None].findings)
    elif set(by_role) == set(mission.roles):
        compiled = roles.compile_roles(mission, _named(vehicles), _named(starts))
        timelines.update(compiled.timelines)
        findings = list(compiled.findings)
    for role, timeline in timelines.items():
        ground_findings, ground = _timeline_ground(timeline, starts[role], arguments["elevation"])
        findings = [*(_on_ground(each, ground) for each in findings), *ground_findings]
    results = {role: (each, _motion_of(mission, vehicles[role])) for role, each in timelines.items()}
    values = {
        "head": msgspec.to_builtins(head_of(mission)),
        "findings": [_short_finding(each) for each in findings],
    }
    return Answer(values, typed_values.to_bytes(results))


def _named(by_role: Mapping[str | None, T]) -> dict[str, T]:
    return {role: each for role, each in by_role.items() if role is not None}


def _timeline_ground(
    timeline: Timeline, start: Start, elevation: Sequence[str]
) -> tuple[list[MissionFinding], PlanGround]:
    from missions.offboard import samples

    start_ned_m = start.position_ned_m
    return _mission_ground(samples.legs(timeline, start_ned_m), start.origin, start_ned_m[2], elevation)


def _mission_of(text: bytes) -> OffboardMission:
    return mission_reader.read_json(text)


def _vehicle_of(arguments: Mapping[str, Any]) -> MissionVehicle:
    from missions.offboard.state import MissionVehicle

    return MissionVehicle.from_parameters(
        arguments["parameters"], reported=arguments["reported"], operator=_area_of(arguments)
    )


def _area_of(arguments: Mapping[str, Any]) -> OperatorArea:
    from missions.offboard.state import OperatorArea

    return OperatorArea.from_json(arguments["operator"])


def _start_of(start: Values) -> Start:
    from missions.offboard.positions import Start

    north, east, down = start["position_ned_m"]
    return Start(
        (north, east, down),
        start["yaw_ned_rad"],
        None if start["origin"] is None else LocalOrigin(**start["origin"]),
        start["home_alt_amsl_m"],
        start["in_air"],
    )


def _motion_of(mission: OffboardMission, vehicle: MissionVehicle) -> MotionLimits:
    """Motion limits for pauses and for the approach to the path, at the mission's speed."""
    motion = vehicle.motion_within(mission.limits)
    cruise_m_s = min(vehicle.limits.vehicle.cruise_m_s, mission.limits.speed_m_s or motion.speed_m_s)
    return dataclasses.replace(motion, speed_m_s=min(cruise_m_s, motion.speed_m_s))


def _short_finding(finding: MissionFinding) -> Values:
    return {
        "code": finding.code, "severity": finding.severity, "text": finding.message, "step": finding.step
    }  # fmt: skip


def _follow_ground(arguments: Mapping[str, Any]) -> Answer:
    from gcs_server.plans import terrain_tasks

    return _document_response(terrain_tasks.resolve_altitudes(arguments))


def _elevation_files(arguments: Mapping[str, Any]) -> Answer:
    from gcs_server.plans import terrain_tasks

    return Answer(terrain_tasks.list_files(arguments))


def _known_ground(arguments: Mapping[str, Any]) -> Answer:
    from gcs_server.plans import terrain_tasks

    ground = terrain_tasks.known_ground(arguments)
    return Answer({}) if ground is None else Answer(ground.fields, ground.amsl_m)


def _ground_from_tiles(arguments: Mapping[str, Any]) -> Answer:
    from gcs_server.plans import terrain_tasks

    terrain_tasks.ground_from_tiles(arguments)
    return Answer({})


def _ground_tile(arguments: Mapping[str, Any]) -> Answer:
    from gcs_server.plans import terrain_tasks

    return Answer({}, terrain_tasks.ground_tile(arguments))


def _relief(arguments: Mapping[str, Any]) -> Answer:
    from gcs_server.plans import terrain_tasks

    return Answer({}, terrain_tasks.relief(arguments))


def _wmts_layers(arguments: Mapping[str, Any]) -> Answer:
    """The layers of a WMTS service. Argument: `description` (bytes). The body is the response."""
    from gcs_server.maps import wmts

    return _response(dataclasses.asdict(wmts.read(arguments["description"])))


WITH_ELEVATION = frozenset(
    {
        "check", "compile", "elevation_files", "follow_ground", "ground_tile", "known_ground",
        "pattern_on_ground", "relief",
    }
)  # fmt: skip
"""Tasks that take the paths of the operator's elevation files; they run in a process if there are elevation
files."""
TASKS: dict[str, Callable[[Mapping[str, Any]], Answer]] = {
    "check": _check,
    "compile": _compile,
    "convert": _convert,
    "divide": _divide,
    "elevation_files": _elevation_files,
    "follow_ground": _follow_ground,
    "ground_from_tiles": _ground_from_tiles,
    "ground_tile": _ground_tile,
    "import": _import,
    "items": _items,
    "insert": _insert,
    "known_ground": _known_ground,
    "export": _export,
    "pattern": _pattern,
    "pattern_on_ground": _pattern,
    "read": _read,
    "relief": _relief,
    "table": _table,
    "wmts_layers": _wmts_layers,
}
