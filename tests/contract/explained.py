"""The known differences from the recordings: each line of `explained.tsv` is one difference with its cause.

A line has the session, the dialogue, the message, the field (or the missing or additional message), the
number of occurrences, and the cause, which docs/simulator.md explains. The test fails for a line whose
difference no longer occurs.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

from tests.contract.compare import Difference

DifferenceKey = tuple[str, str, str, str]
"""Session, dialogue, message, field."""


@dataclass(frozen=True, slots=True)
class ExplainedDifference:
    """Number of occurrences of a difference in its dialogue, and the cause."""

    count: int
    cause: str


def _read_explained_differences() -> dict[DifferenceKey, ExplainedDifference]:
    path = Path(__file__).resolve().parent / "explained.tsv"
    with path.open(encoding="utf-8", newline="") as file:
        rows = csv.reader(file, delimiter="\t", quoting=csv.QUOTE_NONE)
        next(rows)
        return {
            (session, dialogue, message, field): ExplainedDifference(int(count), cause)
            for session, dialogue, message, field, count, cause in rows
        }


EXPLAINED_DIFFERENCES: dict[DifferenceKey, ExplainedDifference] = _read_explained_differences()


def explained_count(key: DifferenceKey) -> int:
    """Known number of occurrences of a difference; 0 for an unknown difference."""
    row = EXPLAINED_DIFFERENCES.get(key)
    return row.count if row is not None else 0


def key_of(session: str, difference: Difference) -> DifferenceKey:
    """The key of a difference in the table."""
    return session, difference.dialogue, difference.message, difference.field


def rows_of_1_17() -> dict[str, str]:
    """Cause of each dialogue of v1.17 that differs; those over ROS 2 begin with "ros2:"."""
    path = Path(__file__).resolve().parent / "explained_1_17.tsv"
    with path.open(encoding="utf-8", newline="") as file:
        return dict(csv.reader(file, delimiter="\t"))
