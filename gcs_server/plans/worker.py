"""`python -m gcs_server.plans.worker`: executes tasks on plans, each in a process of its own with its own
limits (`operations/fork_server.py`). Files are untrusted and plans may be large; exceeding a limit ends only
the process of that task.
"""

from __future__ import annotations

import gc
import importlib
import sys

from gcs_server.operations.fork_server import TaskLimits, serve_tasks

LIMITS = TaskLimits(memory_bytes=1_500_000_000, cpu_time_s=20, timeout_s=60)
"""Limits of one task; NumPy and shapely alone reserve a third of the memory."""
IMPORTED = (
    "missions.offboard.division",
    "missions.offboard.insertion",
    "missions.offboard.tables",
    "gcs_server.plans.pattern_task",
    "gcs_server.plans.traffic_task",
    "missions.offboard.compiler",
    "missions.offboard.from_plan",
    "missions.offboard.mission_checks",
    "missions.offboard.roles",
    "missions.offboard.samples",
)
"""Modules that take long to import. GDAL is not one of them: only a process that needs it loads it."""


def main() -> None:
    """Serves tasks until the server closes the socket whose number is the last argument."""
    from gcs_server.plans import tasks

    for name in IMPORTED:
        importlib.import_module(name)
    gc.freeze()  # the processes of tasks share these objects
    serve_tasks(int(sys.argv[-1]), tasks.answer_request, LIMITS)


if __name__ == "__main__":
    main()
