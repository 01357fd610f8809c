"""Plan files of QGroundControl among the test data."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[1] / "data" / "plans"


def plan_file(name: str) -> bytes:
    """The content of a file, by its name without suffix."""
    return (FOLDER / f"{name}.plan").read_bytes()


def same_json(first: bytes, second: bytes) -> bool:
    """Whether values and order of keys are equal; 1 and 1.0 are different."""
    return json.dumps(json.loads(first)) == json.dumps(json.loads(second))


def plan_file_with(name: str, path: list[str | int], value: Any) -> bytes:
    """A file with another value at a path of keys and indexes."""
    document = json.loads(plan_file(name))
    part = document
    for key in path[:-1]:
        part = part[key]
    part[path[-1]] = value
    return json.dumps(document).encode()
