"""Computations on plans, with JSON values as input and output, so that they can run in a thread or a process.

The result for an unusable plan or file is `{"fault": {"place", "reason", "fix", "field"}}`.
"""

from __future__ import annotations

import base64
import dataclasses
import pickle
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from missions import documents
from missions import plan as plan_document
from missions.checks import CheckLimits, Finding, check
from missions.errors import PlanError
from missions.estimates import Estimate, estimate
from missions.formats import any_format
from missions.formats.results import ImportOptions
from missions.geodesy import LocalOrigin
from missions.offboard.document import OffboardMission
from missions.offboard.findings import MissionFinding
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
PLACE_FIELDS = ("row", "zone", "rally_point", "obstacle", "step")
"""Fields of the place of a finding. A finding of a waypoint plan has no `step`; a finding of an offboard
mission has only `obstacle` and `step`."""


def run(task: str, arguments: Mapping[str, Any]) -> Values:
    """Runs one of `TASKS`; a problem of the plan or file is part of the result."""
    try:
        return TASKS[task](arguments)
    except PlanError as error:
        fault = {"place": error.place, "reason": error.reason, "fix": error.fix, "field": error.field}
        return {"fault": fault}


def _check(arguments: Mapping[str, Any]) -> Values:
    """Checks a plan. Arguments: `plan` (JSON text); `parameters` and `unknown_parameters` of the vehicle;
    `home`, `origin` and `reported` of the vehicle, and `power`, each may be null; `operator` (as
    `OperatorArea`); `elevation`: paths of elevation files."""
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
        findings = (*findings, *ground_findings)
    return {
        "kind": "waypoint_plan",
        "findings": [_finding(each) for each in findings],
        "estimates": dataclasses.asdict(estimate(plan, vehicle, power)),
        "flight": None,
        "ground": list(ground.profile),
        "ground_not_known": list(ground.not_known),
    }


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
    """Compiles an offboard mission for a start on the ground at home, and checks it."""
    from missions.offboard import compiler, mission_checks, samples  # half a second to import
    from missions.offboard.positions import Start
    from missions.offboard.state import MissionVehicle

    home, origin = arguments["home"], arguments["origin"]
    start = Start()
    if home is not None:
        local_origin = LocalOrigin(**(home if origin is None else origin))
        home_ned_m = local_origin.to_ned(home["lat_deg"], home["lon_deg"], home["alt_amsl_m"])
        start = Start(position_ned_m=home_ned_m, origin=local_origin, home_alt_amsl_m=home["alt_amsl_m"])
    elif mission.home is not None:
        local_origin = LocalOrigin(mission.home.lat_deg, mission.home.lon_deg, mission.home.alt_amsl_m)
        start = Start(origin=local_origin, home_alt_amsl_m=mission.home.alt_amsl_m)
    vehicle = MissionVehicle.from_parameters(
        arguments["parameters"], limits, arguments["reported"], _area_of(arguments)
    )
    if mission.roles:
        return _check_roles(mission, vehicle, arguments["elevation"])
    timeline = compiler.compile_mission(mission, vehicle, start)
    start_ned_m = start.position_ned_m
    legs = samples.legs(timeline, start_ned_m)
    ground_findings, ground = _mission_ground(legs, start.origin, start_ned_m[2], arguments["elevation"])
    estimates = Estimate(
        timeline.length_m, timeline.duration_s, mission_checks.climb_m(timeline, start_ned_m[2]),
        timeline.photos, timeline.energy_wh, endless=False, known_altitudes=True,
    )  # fmt: skip
    return {
        "kind": "offboard_mission",
        "findings": [_finding(each) for each in (*timeline.findings, *ground_findings)],
        "estimates": dataclasses.asdict(estimates),
        "flight": {
            "steps": [dataclasses.asdict(each) for each in samples.step_times(timeline)],
            "legs": [dataclasses.asdict(each) for each in legs],
            "needs": list(timeline.needs),
            "start_ned_m": start_ned_m,
            "origin": None if start.origin is None else dataclasses.asdict(start.origin),
        },
        "ground": list(ground.profile),
        "ground_not_known": list(ground.not_known),
    }


def _mission_ground(
    legs: Sequence[Leg], origin: LocalOrigin | None, start_down_m: float, elevation: Sequence[str]
) -> tuple[list[MissionFinding], PlanGround]:
    if not elevation:
        return [], PlanGround()
    from gcs_server.plans import terrain_tasks

    return terrain_tasks.ground_of_mission(legs, origin, start_down_m, elevation)


def _check_roles(mission: OffboardMission, vehicle: MissionVehicle, elevation: Sequence[str]) -> Values:
    """Checks a mission of several vehicles. All vehicles have the parameters of `vehicle` and start on the
    ground at the start position of their role.
    """
    from missions.offboard import mission_checks, roles, samples

    starts = roles.planned_starts(mission)
    compiled = roles.compile_roles(mission, dict.fromkeys(mission.roles, vehicle), starts)
    timelines = compiled.timelines
    energy_wh = [each.energy_wh for each in timelines.values()]
    known_wh = [each for each in energy_wh if each is not None]
    climbs_m = [
        mission_checks.climb_m(each, starts[role].position_ned_m[2]) for role, each in timelines.items()
    ]
    estimates = Estimate(
        sum(each.length_m for each in timelines.values()), compiled.duration_s, max(climbs_m),
        sum(each.photos for each in timelines.values()),
        max(known_wh) if len(known_wh) == len(energy_wh) else None, endless=False, known_altitudes=True,
    )  # fmt: skip
    origin = next(iter(starts.values())).origin
    legs = [
        leg for role, each in timelines.items() for leg in samples.legs(each, starts[role].position_ned_m)
    ]
    ground_findings, ground = _mission_ground(legs, origin, 0.0, elevation)
    return {
        "kind": "offboard_mission",
        "findings": [_finding(each) for each in (*compiled.findings, *ground_findings)],
        "estimates": dataclasses.asdict(estimates),
        "flight": {
            "steps": [dataclasses.asdict(s) for each in timelines.values() for s in samples.step_times(each)],
            "legs": [dataclasses.asdict(each) for each in legs],
            "needs": list(dict.fromkeys(need for each in timelines.values() for need in each.needs)),
            "start_ned_m": (0.0, 0.0, 0.0),
            "origin": None if origin is None else dataclasses.asdict(origin),
        },
        "ground": list(ground.profile),
        "ground_not_known": list(ground.not_known),
    }


def _import(arguments: Mapping[str, Any]) -> Values:
    """Imports a file. Arguments: `file` (base64), `filename`, `altitude` (of points without an altitude; may
    be null), `reference` (of altitudes without a reference; may be null)."""
    altitude = arguments["altitude"]
    options = ImportOptions(
        None if altitude is None else Altitude.model_validate(altitude), arguments["reference"]
    )
    data = base64.b64decode(arguments["file"])
    format_name = any_format.recognise(data, arguments["filename"])
    imported = any_format.read(format_name, data, options)
    return {
        "format": format_name,
        "kind": documents.kind_of(imported.plan),
        "plan": documents.write(imported.plan).decode(),
        "areas": [
            {
                "name": area.name,
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


def _export(arguments: Mapping[str, Any]) -> Values:
    """Exports a plan. Arguments: `plan` (JSON text), `format`."""
    exported = any_format.write(arguments["format"], documents.read(arguments["plan"]))
    return {"file": base64.b64encode(exported.data).decode(), "notes": list(exported.notes)}


def _pattern(arguments: Mapping[str, Any]) -> Values:
    from gcs_server.plans import pattern_task

    return pattern_task.generate(arguments)


def _convert(arguments: Mapping[str, Any]) -> Values:
    """Converts a waypoint plan. Arguments: `plan` (JSON text), `name`, `parameters`, `home` (of the vehicle;
    null: the plan's home)."""
    from missions.offboard.from_plan import from_plan

    vehicle = VehicleModel.from_parameters(arguments["parameters"])
    plan = plan_document.read(arguments["plan"])
    if arguments["home"] is not None:
        plan = plan.model_copy(update={"planned_home": HomePosition.model_validate(arguments["home"])})
    converted = from_plan(plan, arguments["name"], vehicle)
    return {"plan": documents.write(converted.mission).decode(), "notes": list(converted.notes)}


def _insert(arguments: Mapping[str, Any]) -> Values:
    from gcs_server.plans import mission_tasks

    return mission_tasks.insert_mission(arguments)


def _table(arguments: Mapping[str, Any]) -> Values:
    from gcs_server.plans import mission_tasks

    return mission_tasks.import_table(arguments)


def _compile(arguments: Mapping[str, Any]) -> Values:
    """Compiles an offboard mission. Arguments: `plan` (JSON text), `parameters`, `reported`, `operator` (as
    `OperatorArea`), `start` (as `Start`, `origin` as a mapping or null), `elevation`: paths of elevation
    files.

    `timeline` in the result is the pickled timeline with its motion limits; only this server and its
    processes write and read it.
    """
    from missions.offboard.compiler import compile_mission

    mission = _mission_of(arguments["plan"])
    vehicle = _vehicle_of(arguments)
    start = _start_of(arguments["start"])
    timeline = compile_mission(mission, vehicle, start)
    ground_findings = _ground_findings(timeline, start, arguments["elevation"])
    return {
        "findings": [_short_finding(each) for each in (*timeline.findings, *ground_findings)],
        "timeline": _pickle((timeline, _motion_of(mission, vehicle))),
    }


def _compile_roles(arguments: Mapping[str, Any]) -> Values:
    """Compiles a mission of several vehicles. Arguments: `plan` (JSON text), `vehicles`: for each role the
    arguments of `compile`; `elevation`.

    `timelines` in the result is pickled: the timeline and the motion limits of each role.
    """
    from missions.offboard.roles import compile_roles

    mission = _mission_of(arguments["plan"])
    by_role: Mapping[str, Values] = arguments["vehicles"]
    vehicles = {role: _vehicle_of(each) for role, each in by_role.items()}
    starts = {role: _start_of(each["start"]) for role, each in by_role.items()}
    compiled = compile_roles(mission, vehicles, starts)
    findings = list(compiled.findings)
    for role, timeline in compiled.timelines.items():
        findings += _ground_findings(timeline, starts[role], arguments["elevation"])
    timelines = {
        role: (each, _motion_of(mission, vehicles[role])) for role, each in compiled.timelines.items()
    }
    return {"findings": [_short_finding(each) for each in findings], "timelines": _pickle(timelines)}


def _ground_findings(timeline: Timeline, start: Start, elevation: Sequence[str]) -> list[MissionFinding]:
    from missions.offboard import samples

    start_ned_m = start.position_ned_m
    return _mission_ground(samples.legs(timeline, start_ned_m), start.origin, start_ned_m[2], elevation)[0]


def _mission_of(text: str) -> OffboardMission:
    mission = documents.read(text)
    if not isinstance(mission, OffboardMission):
        raise PlanError("the plan", "it is a waypoint plan, which PX4 flies", "Send an offboard mission.")
    return mission


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


def _pickle(value: object) -> str:
    return base64.b64encode(pickle.dumps(value)).decode()


def _follow_ground(arguments: Mapping[str, Any]) -> Values:
    from gcs_server.plans import terrain_tasks

    return terrain_tasks.resolve_altitudes(arguments)


def _elevation_files(arguments: Mapping[str, Any]) -> Values:
    from gcs_server.plans import terrain_tasks

    return terrain_tasks.list_files(arguments)


WITH_ELEVATION = frozenset(
    {"check", "compile", "compile_roles", "elevation_files", "follow_ground", "pattern_on_ground"}
)
"""Tasks that take the paths of the operator's elevation files; they run in a process if there are elevation
files."""
TASKS: dict[str, Callable[[Mapping[str, Any]], Values]] = {
    "check": _check,
    "compile": _compile,
    "compile_roles": _compile_roles,
    "convert": _convert,
    "elevation_files": _elevation_files,
    "follow_ground": _follow_ground,
    "import": _import,
    "insert": _insert,
    "export": _export,
    "pattern": _pattern,
    "pattern_on_ground": _pattern,
    "table": _table,
}
