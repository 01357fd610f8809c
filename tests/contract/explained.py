"""The known differences from the recordings: `explained.tsv`, a line a cell, each with its reason.

The reasons stand, with what is behind them, in docs/simulator.md.
"""

from __future__ import annotations

import csv
from pathlib import Path

from tests.contract.compare import Difference

Cell = tuple[str, str, str, str]
"""Session, dialogue, message, field."""

LASTING = frozenset(
    {
        "the recorded vehicle held other values",
        "the recorded vehicle lay tipped over after an actuator test",
        "how long the barometer is calibrated is not recorded",
        "the recording is thinned, so not all that was sent is known",
    }
)
"""Reasons whose rows may not go without being taken out of the table; the others are work that goes on."""


def _read() -> dict[Cell, str]:
    path = Path(__file__).resolve().parent / "explained.tsv"
    with path.open(encoding="utf-8", newline="") as file:
        rows = csv.reader(file, delimiter="\t", quoting=csv.QUOTE_NONE)
        next(rows)
        return {(session, dialogue, message, field): why for session, dialogue, message, field, why in rows}


EXPLAINED: dict[Cell, str] = _read()


def cell_of(session: str, difference: Difference) -> Cell:
    """Where a difference stands in the table."""
    return session, difference.dialogue, difference.message, difference.field
