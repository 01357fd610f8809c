"""Computations on plans, with JSON values as input and output, so that they can run in a thread or a process.

An unusable plan or file is reported as an answer: `{"fault": {"place", "reason", "fix"}}`.
"""

from __future__ import annotations

import base64
import dataclasses
import pickle
from collections.abc import Callable, Mapping
from typing import Any

from missions import documents
from missions import plan as plan_document
from missions.checks import Finding, Limits, check
from missions.errors import PlanError
from missions.estimates import Estimate, estimate
from missions.formats import any_format
from missions.formats.results import ImportOptions
from missions.geodesy import LocalOrigin
from missions.offboard.document import OffboardMission
from missions.values import Altitude, HomePosition
from missions.vehicle import PowerModel, VehicleModel

Values = dict[str, Any]
"""As JSON."""


def run(task: str, arguments: Mapping[str, Any]) -> Values:
    """Runs one of `TASKS`; a problem of the plan or file is part of the answer."""
    try:
        return TASKS[task](arguments)
    except PlanError as error:
        return {"fault": {"place": error.place, "reason": error.reason, "fix": error.fix}}


def _check(arguments: Mapping[str, Any]) -> Values:
    """`plan` (JSON text); `parameters`; `home`, `origin`, `reported` of the vehicle and `power`, or null."""
    document = documents.read(arguments["plan"])
    power = None if arguments["power"] is None else PowerModel(**arguments["power"])
    if isinstance(document, OffboardMission):
        return _check_mission(document, arguments, power)
    plan = document
    if arguments["home"] is not None:
        plan = plan.model_copy(update={"planned_home": HomePosition.model_validate(arguments["home"])})
    vehicle = VehicleModel.from_parameters(arguments["parameters"])
    findings = check(plan, Limits(vehicle=vehicle, power=power))
    return {
        "kind": "waypoint_plan",
        "findings": [_finding(each) for each in findings],
        "estimates": dataclasses.asdict(estimate(plan, vehicle, power)),
        "flight": None,
    }


def _finding(finding: Finding) -> Values:
    return {
        "code": finding.code,
        "severity": finding.severity,
        "text": finding.message,
        "place": {
            "row": finding.row, "zone": finding.zone, "rally_point": finding.rally_point, "step": None
        },
        "fix": finding.fix,
    }  # fmt: skip


def _check_mission(
    mission: OffboardMission, arguments: Mapping[str, Any], power: PowerModel | None
) -> Values:
    """Checks an offboard mission, compiled for a start on the ground at home."""
    from missions.offboard import compiler, mission_checks, samples  # half a second to import
    from missions.offboard.places import Start
    from missions.offboard.state import MissionVehicle

    home, origin = arguments["home"], arguments["origin"]
    start = Start()
    if home is not None:
        frame = LocalOrigin(**(home if origin is None else origin))
        here = frame.to_ned(home["lat_deg"], home["lon_deg"], home["alt_amsl_m"])
        start = Start(position_ned_m=here, origin=frame, home_alt_amsl_m=home["alt_amsl_m"])
    elif mission.home is not None:
        frame = LocalOrigin(mission.home.lat_deg, mission.home.lon_deg, mission.home.alt_amsl_m)
        start = Start(origin=frame, home_alt_amsl_m=mission.home.alt_amsl_m)
    vehicle = MissionVehicle.from_parameters(
        arguments["parameters"], Limits(power=power), arguments["reported"]
    )
    timeline = compiler.compile_mission(mission, vehicle, start)
    here = start.position_ned_m
    estimates = Estimate(
        timeline.length_m, timeline.duration_s, mission_checks.climb_m(timeline, here[2]), timeline.photos,
        timeline.energy_wh, endless=False, known_altitudes=True,
    )  # fmt: skip
    return {
        "kind": "offboard_mission",
        "findings": [
            {
                "code": each.code,
                "severity": each.severity,
                "text": each.message,
                "place": {"row": None, "zone": None, "rally_point": None, "step": each.step},
                "fix": each.fix,
            }
            for each in timeline.findings
        ],
        "estimates": dataclasses.asdict(estimates),
        "flight": {
            "steps": [dataclasses.asdict(each) for each in samples.step_times(timeline)],
            "legs": [dataclasses.asdict(each) for each in samples.legs(timeline, here)],
            "needs": list(timeline.needs),
            "start_ned_m": here,
            "origin": None if start.origin is None else dataclasses.asdict(start.origin),
        },
    }


def _import(arguments: Mapping[str, Any]) -> Values:
    """`file` (base64), `filename`, `altitude` (of points without one, or null)."""
    altitude = arguments["altitude"]
    options = ImportOptions(None if altitude is None else Altitude.model_validate(altitude))
    data = base64.b64decode(arguments["file"])
    found = any_format.recognise(data, arguments["filename"])
    imported = any_format.read(found, data, options)
    return {
        "format": found,
        "kind": documents.kind_of(imported.plan),
        "plan": documents.write(imported.plan).decode(),
        "areas": [
            {
                "name": area.name,
                "outer": [point.model_dump() for point in area.outer],
                "holes": [[point.model_dump() for point in hole] for hole in area.holes],
            }
            for area in imported.areas
        ],
        "notes": list(imported.notes),
    }


def _export(arguments: Mapping[str, Any]) -> Values:
    """`plan` (JSON text), `format`."""
    written = any_format.write(arguments["format"], documents.read(arguments["plan"]))
    return {"file": base64.b64encode(written.data).decode(), "notes": list(written.notes)}


def _pattern(arguments: Mapping[str, Any]) -> Values:
    """`pattern` (JSON text)."""
    from missions.patterns import document  # shapely takes 0.2 s to import, and only patterns need it

    found = document.make(document.read(arguments["pattern"]))
    plan = plan_document.Plan(items=found.items)
    figures = {
        each.name: getattr(found, each.name)
        for each in dataclasses.fields(found)
        if each.name not in ("items", "lines")
    }
    return {
        "plan": plan_document.write(plan).decode(),
        "lines": [[start.model_dump(), end.model_dump()] for start, end in found.lines],
        "figures": figures,
    }


def _convert(arguments: Mapping[str, Any]) -> Values:
    """`plan` (JSON text), `name`, `parameters`, `home` (of the vehicle, null: the plan's own)."""
    from missions.offboard.from_plan import from_plan

    vehicle = VehicleModel.from_parameters(arguments["parameters"])
    plan = plan_document.read(arguments["plan"])
    if arguments["home"] is not None:
        plan = plan.model_copy(update={"planned_home": HomePosition.model_validate(arguments["home"])})
    made = from_plan(plan, arguments["name"], vehicle)
    return {"plan": documents.write(made.mission).decode(), "notes": list(made.notes)}


def _compile(arguments: Mapping[str, Any]) -> Values:
    """`plan` (JSON text), `parameters`, `reported`, `start` (as `Start`, `origin` as a mapping or null).

    `timeline` is pickled: it goes from a process of this server's to this server.
    """
    from missions.offboard.compiler import compile_mission
    from missions.offboard.places import Start
    from missions.offboard.state import MissionVehicle

    mission = documents.read(arguments["plan"])
    if not isinstance(mission, OffboardMission):
        raise PlanError("the plan", "it is a waypoint plan, which PX4 flies", "Send an offboard mission.")
    start: Values = arguments["start"]
    north, east, down = start["position_ned_m"]
    where = Start(
        (north, east, down),
        start["yaw_ned_rad"],
        None if start["origin"] is None else LocalOrigin(**start["origin"]),
        start["home_alt_amsl_m"],
        start["in_air"],
    )
    vehicle = MissionVehicle.from_parameters(arguments["parameters"], reported=arguments["reported"])
    timeline = compile_mission(mission, vehicle, where)
    motion = vehicle.within(mission.limits)
    cruise_m_s = min(vehicle.limits.vehicle.cruise_m_s, mission.limits.speed_m_s or motion.speed_m_s)
    motion = dataclasses.replace(motion, speed_m_s=min(cruise_m_s, motion.speed_m_s))
    return {
        "findings": [
            {"code": each.code, "severity": each.severity, "text": each.message, "step": each.step}
            for each in timeline.findings
        ],
        "flown": base64.b64encode(pickle.dumps((timeline, motion))).decode(),
    }


TASKS: dict[str, Callable[[Mapping[str, Any]], Values]] = {
    "check": _check,
    "compile": _compile,
    "convert": _convert,
    "import": _import,
    "export": _export,
    "pattern": _pattern,
}
