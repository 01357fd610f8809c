"""`python -m gcs_server.plans.worker`: one task about a plan, in a process with limits of its own.

Files are foreign and plans may be large: what takes too much memory or time ends this process only.
"""

from __future__ import annotations

import json
import os
import resource
import signal

from gcs_server.operations.process import read_request, serve

NICENESS = 10
MEMORY_BYTES = 1_500_000_000
"""Of address space; NumPy and shapely alone reserve a third of it."""
COMPUTING_S = 20
WITHIN_S = 60
"""In all, on a busy machine."""


def main() -> None:
    """Reads `{"task", "arguments"}`, writes its answer."""
    os.nice(NICENESS)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (COMPUTING_S, COMPUTING_S))
    signal.alarm(WITHIN_S)
    request = json.loads(read_request())

    def work(_: object) -> dict[str, object]:
        from gcs_server.plans import tasks

        return tasks.run(request["task"], request["arguments"])

    serve(work)


if __name__ == "__main__":
    main()
