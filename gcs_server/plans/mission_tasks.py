"""Edits of offboard missions: a mission inserted into another one, a trajectory from a file.

The compiler's modules take half a second to import, so this module is imported at the first edit.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from typing import Any

from missions import documents
from missions.errors import PlanError
from missions.offboard import tables
from missions.offboard.document import OffboardMission
from missions.offboard.insertion import insert
from missions.offboard.reader import read_json

Values = dict[str, Any]


def insert_mission(arguments: Mapping[str, Any]) -> Values:
    """Inserts the mission `added` into `plan`. Arguments: `plan` and `added` (JSON texts); `name` of the
    inserted mission; `at`, `in_air`, `positions` (as for `insert`); `max_bytes`: maximum size of the
    result."""
    mission = _read_plan(arguments["plan"])
    inserted = read_json(arguments["added"]).model_copy(update={"name": arguments["name"]})
    result = insert(
        mission, inserted, arguments["at"], in_air=arguments["in_air"], positions=arguments["positions"]
    )
    text = documents.write(result.mission).decode()
    _check_size(text, inserted.name, arguments["max_bytes"])
    return {"plan": text, "called": result.called, "notes": list(result.notes)}


def _read_plan(text: bytes) -> OffboardMission:
    """The mission to change; an error names its field of the request."""
    try:
        return read_json(text)
    except PlanError as error:
        raise PlanError(error.place, error.reason, error.fix, field="plan") from None


def _check_size(text: str, name: str, max_bytes: int) -> None:
    size = len(json.dumps(json.loads(text), ensure_ascii=False, separators=(",", ":")).encode())
    if size > max_bytes:
        reason = f"with {name!r} it would have {size} bytes, and only {max_bytes} can be stored"
        raise PlanError("the mission", reason, "Give its trajectories (`tables`) fewer rows.")


def import_table(arguments: Mapping[str, Any]) -> Values:
    """Imports a trajectory. Arguments: `file` (bytes), `filename`."""
    return dataclasses.asdict(tables.import_file(arguments["file"], arguments["filename"]))
