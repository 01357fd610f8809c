"""`python -m gcs_server.logbook.worker`: reads logs, each in a process of its own with its own limits
(`operations/fork_server.py`). Logs are untrusted; exceeding a limit ends only the process of that log."""

from __future__ import annotations

import gc
import importlib
import sys

from gcs_server.operations.fork_server import TaskLimits, serve_tasks

LIMITS = TaskLimits(memory_bytes=1_500_000_000, cpu_time_s=120, timeout_s=300)
"""Limits of one task: a ULog of 100 MB needs 3 s of processor time."""
IMPORTED = (
    "columns",
    "exports.export",
    "findings.table",
    "loops",
    "mcap_log",
    "overview",
    "series",
    "spectra",
    "tlog",
    "two_flights",
    "ulog",
)
"""Modules of this package that take long to import."""


def main() -> None:
    """Serves tasks until the server closes the socket whose number is the last argument."""
    from gcs_server.logbook import tasks

    for name in IMPORTED:
        importlib.import_module(f"gcs_server.logbook.{name}")
    gc.freeze()  # the processes of tasks share these objects
    serve_tasks(int(sys.argv[-1]), tasks.answer_request, LIMITS)


if __name__ == "__main__":
    main()
