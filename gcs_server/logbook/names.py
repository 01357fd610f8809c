"""Names of log files."""

from __future__ import annotations

ULOG = ".ulg"
SUFFIXES = (ULOG, ".tlog", ".tlog.gz")


def suffix_of(name: str) -> str | None:
    """The end of a log's name that says its kind; None: not the name of a log."""
    return next((suffix for suffix in SUFFIXES if name.lower().endswith(suffix)), None)
