"""The known differences from the recordings: each line of `explained.tsv` is one difference with its cause.

A line has session, dialogue, message and field (or the missing or additional message), the number of
occurrences, and the cause; docs/simulator.md explains the causes. A line without a difference fails the test.
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
    """How often a difference occurs in its dialogue, and its cause."""

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
    """Known number of occurrences of a difference; 0 for an unknown difference."""
    row = EXPLAINED.get(cell)
    return row.times if row is not None else 0


def cell_of(session: str, difference: Difference) -> Cell:
    """The key of a difference in the table."""
    return session, difference.dialogue, difference.message, difference.field
