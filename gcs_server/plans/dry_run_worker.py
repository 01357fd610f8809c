"""`python -m gcs_server.plans.dry_run_worker`: executes one dry run in a separate process with its own
limits. It flies simulated vehicles only and has no links to real vehicles.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

import msgspec

from gcs_server.operations.operations import ReportProgress
from gcs_server.operations.process import Result, limit_process, read_request, serve

MEMORY_BYTES = 2_500_000_000
"""Limit of address space; NumPy and shapely alone reserve a fifth of it."""


def main() -> None:
    """Reads the request of `missions.dry_run.task` with `id` and `details`; writes progress and result."""
    limit_process(memory_bytes=MEMORY_BYTES, cpu_time_s=1200, timeout_s=3600)
    request = msgspec.json.decode(read_request())
    serve(lambda report: fly(request, report))


def fly(request: Mapping[str, Any], report: ReportProgress) -> Result:
    """Flies the plan; returns a summary, and the response to clients as JSON."""
    from missions.dry_run import task

    elevation, details = request["elevation"], request["details"]
    find_ground = None
    if elevation:
        from gcs_server.plans import terrain_tasks

        find_ground = functools.partial(terrain_tasks.ground_around, paths=elevation)
    result = task.run(request, report, find_ground)
    assumed = [*details["assumed"], *result["assumed"]]
    response = {"id": request["id"], **details, **result, "assumed": assumed}
    return _summary(result), msgspec.json.encode(response)


def _summary(result: Mapping[str, Any]) -> dict[str, object]:
    nominal = result["nominal"]
    names = ("finished", "duration_s", "battery_end_share", "fence_distance_m", "obstacle_distance_m")
    errors = sum(each["severity"] == "error" for each in nominal["findings"])
    return {**{name: nominal[name] for name in names}, "errors": errors, "findings": len(nominal["findings"])}


if __name__ == "__main__":
    main()
