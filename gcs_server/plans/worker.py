"""`python -m gcs_server.plans.worker`: executes one task on a plan in a separate process with its own limits.
Files are untrusted and plans may be large; exceeding a limit ends only this process.
"""

from __future__ import annotations

import json

from gcs_server.operations.process import limit_process, read_request, serve

MEMORY_BYTES = 1_500_000_000
"""Limit of address space; NumPy and shapely alone reserve a third of it."""


def main() -> None:
    """Reads `{"task", "arguments"}`, and writes the task's result."""
    limit_process(memory_bytes=MEMORY_BYTES, cpu_time_s=20, timeout_s=60)
    request = json.loads(read_request())

    def work(_: object) -> dict[str, object]:
        from gcs_server.plans import tasks

        return tasks.run(request["task"], request["arguments"])

    serve(work)


if __name__ == "__main__":
    main()
