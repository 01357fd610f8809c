"""The known differences from the recordings: `explained.tsv`, a line a difference, each with its cause.

A line names its session, dialogue, message and field (or which message is missing or told besides), how
often, and the cause; what is behind the causes stands in docs/simulator.md. A line that is no difference any
more fails.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

from tests.contract.compare import Difference

Cell = tuple[str, str, str, str]
"""Session, dialogue, message, field."""


@dataclass(frozen=True, slots=True)
class Explained:
    """How often a difference occurs in its dialogue, and why."""

    times: int
    reason: str


def _read() -> dict[Cell, Explained]:
    path = Path(__file__).resolve().parent / "explained.tsv"
    with path.open(encoding="utf-8", newline="") as file:
        rows = csv.reader(file, delimiter="\t", quoting=csv.QUOTE_NONE)
        next(rows)
        return {
            (session, dialogue, message, field): Explained(int(times), why)
            for session, dialogue, message, field, times, why in rows
        }


EXPLAINED: dict[Cell, Explained] = _read()


def times_explained(cell: Cell) -> int:
    """How often a difference is known to occur; 0 for one that is not."""
    row = EXPLAINED.get(cell)
    return row.times if row is not None else 0


def cell_of(session: str, difference: Difference) -> Cell:
    """Where a difference stands in the table."""
    return session, difference.dialogue, difference.message, difference.field
