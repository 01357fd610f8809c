"""Reads and writes waypoint plans, which PX4 flies, and offboard missions, which are flown by setpoints."""

from __future__ import annotations

from typing import Any, Literal

from missions import plan as plan_document
from missions.bounded_json import decode, load
from missions.errors import PlanError
from missions.offboard import document as mission_document
from missions.offboard import reader as mission_reader
from missions.offboard.document import OffboardMission
from missions.offboard.steps import Branch, MissionStep, Repeat
from missions.plan import Plan

Document = Plan | OffboardMission
PlanKind = Literal["waypoint_plan", "offboard_mission"]
MISSION_FORMAT = "offboard-gcs-mission"
"""The `format` of an offboard mission; a document without `format` is a waypoint plan."""


def kind_of(document: Document) -> PlanKind:
    """The kind of a document."""
    return "offboard_mission" if isinstance(document, OffboardMission) else "waypoint_plan"


def read(data: str | bytes) -> Document:
    """A document of either kind from this project's JSON; `format` selects the kind.

    Raises:
        PlanError: The text is neither a waypoint plan nor an offboard mission; the error names the field and
            the fix.
    """
    text = decode(data)
    value = load(text)
    if not isinstance(value, dict):
        raise PlanError("the plan", "it is not a JSON object", "Send a plan or an offboard mission.")
    is_mission = value.get("format") == MISSION_FORMAT
    return mission_reader.read_json(text) if is_mission else plan_document.read(text)


def write(document: Document) -> bytes:
    """The document as this project's JSON in UTF-8; `read` returns an equal document."""
    if isinstance(document, OffboardMission):
        return mission_document.write(document)
    return plan_document.write(document)


def with_name(document: Document, name: str) -> Document:
    """A copy of the document with this name; a waypoint plan has no name and is returned unchanged."""
    if isinstance(document, OffboardMission) and document.name != name:
        return document.model_copy(update={"name": name})
    return document


def count_steps(document: Document) -> int:
    """Number of uploaded items of a waypoint plan, or of steps of an offboard mission (nested ones too)."""
    if isinstance(document, OffboardMission):
        return sum(
            _count_nested(steps) for steps in (*document.steps_by_role.values(), *document.missions.values())
        )
    return sum(1 for _ in document.simple_items())


def _count_nested(steps: tuple[MissionStep, ...]) -> int:
    total = len(steps)
    for step in steps:
        if isinstance(step, Repeat):
            total += _count_nested(step.steps)
        elif isinstance(step, Branch):
            total += _count_nested(step.then) + _count_nested(step.otherwise)
    return total


def schema(kind: PlanKind) -> dict[str, Any]:
    """The JSON Schema of one kind of document."""
    if kind == "offboard_mission":
        return mission_document.schema()
    return Plan.model_json_schema()
