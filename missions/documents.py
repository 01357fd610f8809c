"""Reads and writes both kinds of plan: waypoint plans, flown by PX4, and offboard missions, flown by
setpoints."""

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
Kind = Literal["waypoint_plan", "offboard_mission"]
MISSION_FORMAT = "offboard-gcs-mission"
"""The `format` of an offboard mission; without one a document is a waypoint plan."""


def kind_of(document: Document) -> Kind:
    """Which of the two it is."""
    return "offboard_mission" if isinstance(document, OffboardMission) else "waypoint_plan"


def read(data: str | bytes) -> Document:
    """A document of either kind from our own JSON, as its `format` says.

    Raises:
        PlanError: It is neither; says where and what to do.
    """
    text = decode(data)
    value = load(text)
    if not isinstance(value, dict):
        raise PlanError("the plan", "it is not a JSON object", "Send a plan or an offboard mission.")
    is_mission = value.get("format") == MISSION_FORMAT
    return mission_reader.read_json(text) if is_mission else plan_document.read(text)


def write(document: Document) -> bytes:
    """The document as our own JSON, UTF-8; `read` gives the same."""
    if isinstance(document, OffboardMission):
        return mission_document.write(document)
    return plan_document.write(document)


def named(document: Document, name: str) -> Document:
    """The document under this name; only missions have one of their own."""
    if isinstance(document, OffboardMission) and document.name != name:
        return document.model_copy(update={"name": name})
    return document


def count(document: Document) -> int:
    """Items of a waypoint plan as they are uploaded, or steps of a mission, nested ones included."""
    if isinstance(document, OffboardMission):
        return sum(_steps(steps) for steps in (*document.flown.values(), *document.missions.values()))
    return sum(1 for _ in document.simple_items())


def _steps(steps: tuple[MissionStep, ...]) -> int:
    found = len(steps)
    for step in steps:
        if isinstance(step, Repeat):
            found += _steps(step.steps)
        elif isinstance(step, Branch):
            found += _steps(step.then) + _steps(step.otherwise)
    return found


def schema(kind: Kind) -> dict[str, Any]:
    """The JSON Schema of the documents of a kind."""
    if kind == "offboard_mission":
        return mission_document.schema()
    return Plan.model_json_schema()
