"""What is computed about plans: JSON values in, JSON values out, so that it runs in a thread or a process.

A plan or a file that cannot be used is an answer as well: `{"fault": {"place", "reason", "fix"}}`.
"""

from __future__ import annotations

import base64
import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

from missions import plan as plan_document
from missions.checks import Finding, Limits, check
from missions.errors import PlanError
from missions.estimates import estimate
from missions.formats import any_format
from missions.formats.results import ImportOptions
from missions.values import Altitude, HomePosition
from missions.vehicle import VehicleModel

Values = dict[str, Any]
"""As JSON."""


def run(task: str, arguments: Mapping[str, Any]) -> Values:
    """Runs one of `TASKS`; what is wrong with the plan or file is its answer."""
    try:
        return TASKS[task](arguments)
    except PlanError as error:
        return {"fault": {"place": error.place, "reason": error.reason, "fix": error.fix}}


def _check(arguments: Mapping[str, Any]) -> Values:
    """`plan` (JSON text), `parameters` (PX4's names), `home` (of the vehicle, null: not known)."""
    plan = plan_document.read(arguments["plan"])
    if arguments["home"] is not None:
        plan = plan.model_copy(update={"planned_home": HomePosition.model_validate(arguments["home"])})
    vehicle = VehicleModel.from_parameters(arguments["parameters"])
    findings = check(plan, Limits(vehicle=vehicle))
    return {
        "findings": [_finding(each) for each in findings],
        "estimates": dataclasses.asdict(estimate(plan, vehicle)),
    }


def _finding(finding: Finding) -> Values:
    return {
        "code": finding.code,
        "severity": finding.severity,
        "text": finding.message,
        "place": {"row": finding.row, "zone": finding.zone, "rally_point": finding.rally_point},
        "fix": finding.fix,
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
        "plan": plan_document.write(imported.plan).decode(),
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
    written = any_format.write(arguments["format"], plan_document.read(arguments["plan"]))
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


TASKS: dict[str, Callable[[Mapping[str, Any]], Values]] = {
    "check": _check,
    "import": _import,
    "export": _export,
    "pattern": _pattern,
}
