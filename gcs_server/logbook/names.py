"""Names of log files."""

from __future__ import annotations

ULOG, MCAP = ".ulg", ".mcap"
SUFFIXES = (ULOG, ".tlog", ".tlog.gz", MCAP)
KINDS = {ULOG: "ulog", MCAP: "mcap"}
"""Kind of a log by its suffix; all others are telemetry logs."""


def suffix_of(name: str) -> str | None:
    """The end of a log's name that says its kind; None: not the name of a log."""
    return next((suffix for suffix in SUFFIXES if name.lower().endswith(suffix)), None)


def kind_of(name: str) -> str:
    """Kind of the log that a file of this name is: `ulog`, `tlog`, `mcap`."""
    return KINDS.get(suffix_of(name) or "", "tlog")
