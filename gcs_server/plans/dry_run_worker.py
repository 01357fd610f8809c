"""`python -m gcs_server.plans.dry_run_worker`: one dry run, in a process with limits of its own.

It flies simulated vehicles and has no link: nothing that happens here reaches a real one.
"""

from __future__ import annotations

import json
import os
import resource
import signal

from gcs_server.operations.operations import Report
from gcs_server.operations.process import read_request, serve

NICENESS = 10
MEMORY_BYTES = 2_500_000_000
"""Of address space; NumPy and shapely alone reserve a fifth of it."""
COMPUTING_S = 1200
WITHIN_S = 3600
"""In all, on a busy machine."""


def main() -> None:
    """Reads the request of `missions.dry_run.task`, writes progress and its answer."""
    os.nice(NICENESS)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (COMPUTING_S, COMPUTING_S))
    signal.alarm(WITHIN_S)
    request = json.loads(read_request())

    def work(report: Report) -> dict[str, object]:
        from missions.dry_run import task

        return task.run(request, report)

    serve(work)


if __name__ == "__main__":
    main()
