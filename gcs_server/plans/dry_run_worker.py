"""`python -m gcs_server.plans.dry_run_worker`: executes one dry run in a separate process with its own
limits. It flies simulated vehicles only and has no links to real vehicles.
"""

from __future__ import annotations

import json

from gcs_server.operations.operations import ReportProgress
from gcs_server.operations.process import limit_process, read_request, serve

MEMORY_BYTES = 2_500_000_000
"""Limit of address space; NumPy and shapely alone reserve a fifth of it."""


def main() -> None:
    """Reads the request of `missions.dry_run.task`, and writes progress and the result."""
    limit_process(memory_bytes=MEMORY_BYTES, cpu_time_s=1200, timeout_s=3600)
    request = json.loads(read_request())

    def work(report: ReportProgress) -> dict[str, object]:
        from missions.dry_run import task

        elevation = request["elevation"]
        if not elevation:
            return task.run(request, report)
        from gcs_server.plans import terrain_tasks

        return task.run(request, report, lambda positions: terrain_tasks.ground_around(positions, elevation))

    serve(work)


if __name__ == "__main__":
    main()
