"""Generates a pattern: its items or steps, its path and its figures.

Shapely takes 0.2 s to import, so this module is imported when the first pattern is generated.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from missions import documents
from missions import plan as plan_document
from missions.estimates import estimate
from missions.items import PlacedItem
from missions.offboard.document import OffboardMission
from missions.offboard.from_pattern import steps_from_pattern
from missions.patterns import document
from missions.patterns.current import pattern_item
from missions.plan import Plan
from missions.route import is_flown_to
from missions.vehicle import VehicleModel

Values = dict[str, Any]


def generate(arguments: Mapping[str, Any]) -> Values:
    """Generates a pattern. Arguments: `pattern` (JSON text); `kind` of the document; `parameters` of the
    vehicle; `tolerance_m`: largest deviation from the height above the ground; null: altitudes above the
    ground are not resolved. `elevation`: paths of elevation files, needed with `tolerance_m`."""
    pattern = document.read(arguments["pattern"])
    items_and_figures = document.make(pattern)
    row = pattern_item(pattern, items_and_figures.items)
    plan, notes = _with_resolved_altitudes(Plan(items=(row,)), arguments)
    vehicle = VehicleModel.from_parameters(arguments["parameters"])
    flight = estimate(plan, vehicle)
    figures = {
        each.name: getattr(items_and_figures, each.name)
        for each in dataclasses.fields(items_and_figures)
        if each.name not in ("items", "lines")
    }
    content = documents.write(plan)
    if arguments["kind"] == "offboard_mission":
        items = [item for _, item in plan.simple_items()]
        mission = OffboardMission(
            name=pattern.kind.capitalize(), steps=steps_from_pattern(pattern, items, vehicle)
        )
        content = documents.write(mission)
    return {
        "plan": content.decode(),
        "lines": [[start.model_dump(), end.model_dump()] for start, end in items_and_figures.lines],
        "path": _path(plan),
        "figures": {**figures, "length_m": flight.length_m, "time_s": flight.time_s},
        "notes": list(notes),
    }


def _path(plan: Plan) -> list[Values]:
    """The positions that the vehicle flies to, in order."""
    items = [item for _, item in plan.simple_items() if isinstance(item, PlacedItem) and is_flown_to(item)]
    return [
        {"lat_deg": item.lat_deg, "lon_deg": item.lon_deg, "altitude": item.altitude.model_dump()}
        for item in items
    ]


def _with_resolved_altitudes(plan: Plan, arguments: Mapping[str, Any]) -> tuple[Plan, Sequence[str]]:
    """The plan with altitudes above ground resolved to AMSL, and sentences about missing elevation data."""
    if arguments["tolerance_m"] is None:
        return plan, ()
    from gcs_server.plans import terrain_tasks

    resolved = terrain_tasks.resolve_altitudes({**arguments, "plan": plan_document.write(plan).decode()})
    unknown = resolved["unknown"]
    missing = (
        (f"{unknown} altitudes above the ground are not resolved: no elevation file covers them.",)
        if unknown
        else ()
    )
    return plan_document.read(resolved["plan"]), (*missing, *resolved["notes"])
