"""Dry runs: plans flown in simulation, each in a separate process. The newest results are kept in
memory."""

from __future__ import annotations

import json
import sys
from collections import OrderedDict
from collections.abc import Mapping
from typing import Any, cast

from gcs_server.errors import Refused, UnknownDryRun
from gcs_server.operations.operations import ReportProgress
from gcs_server.operations.process import WorkerFailed, run_process

MAX_RUNNING = 2
"""Maximum number of processes; they have low priority, but a small computer has only two cores."""
MAX_RESULTS = 10
MAX_RESULT_BYTES = 8 * 1024 * 1024
COMMAND = (sys.executable, "-m", "gcs_server.plans.dry_run_worker")


class DryRuns:
    """The dry runs of one server; they are lost in a restart."""

    def __init__(self) -> None:
        self._count = 0
        self._running = 0
        self._results: OrderedDict[str, dict[str, Any]] = OrderedDict()
        self._plans: dict[str, str] = {}
        """JSON text of the plan of each result."""

    def next_id(self) -> str:
        """Id of the next dry run.

        Raises:
            Refused: the limit of running dry runs is reached.
        """
        if self._running >= MAX_RUNNING:
            raise Refused(
                f"{MAX_RUNNING} dry runs are already running, which is the limit.",
                remedy="Wait until one has ended, or cancel one (DELETE /operations/{id}).",
            )
        self._count += 1
        return str(self._count)

    async def run(
        self, dry_run_id: str, request: Mapping[str, Any], details: Mapping[str, Any], report: ReportProgress
    ) -> dict[str, object]:
        """Runs a dry run and stores the result; cancelling this call ends the process.

        Args:
            dry_run_id: id of the dry run.
            request: input of `missions.dry_run.task`, and `elevation`: paths of elevation files.
            details: data to store with the result; the assumptions of the result are added to
                `details["assumed"]`.
            report: receives progress.

        Returns:
            A summary.

        Raises:
            Refused: the plan cannot be flown, the simulation takes too long, or too many dry runs are
                running.
        """
        if self._running >= MAX_RUNNING:
            raise Refused(f"{MAX_RUNNING} dry runs are already running.", remedy="Wait until one has ended.")
        self._running += 1
        try:
            result = await run_process(
                COMMAND, report, request=json.dumps(request).encode(), max_line_bytes=MAX_RESULT_BYTES
            )
        except WorkerFailed as error:
            raise Refused(
                f"The dry run has failed: {error}",
                remedy="Correct the plan if the error names it; otherwise use fewer flights or a shorter "
                "plan.",
            ) from error
        finally:
            self._running -= 1
        assumed = [*details["assumed"], *cast(list[str], result["assumed"])]
        self._results[dry_run_id] = {"id": dry_run_id, **details, **result, "assumed": assumed}
        self._plans[dry_run_id] = request["plan"]
        while len(self._results) > MAX_RESULTS:
            oldest, _ = self._results.popitem(last=False)
            del self._plans[oldest]
        return {"dry_run": dry_run_id, **_summary(result)}

    def plan(self, dry_run_id: str) -> str:
        """JSON text of the plan that was flown. Raises UnknownDryRun."""
        self.get(dry_run_id)
        return self._plans[dry_run_id]

    def get(self, dry_run_id: str) -> dict[str, Any]:
        """The result of a dry run.

        Raises:
            UnknownDryRun: there is no such dry run, it has not ended, or it was dropped.
        """
        result = self._results.get(dry_run_id)
        if result is None:
            raise UnknownDryRun(
                f"There is no result of a dry run {dry_run_id!r}.",
                remedy=f"Wait for its operation to succeed; the last {MAX_RESULTS} results are kept.",
            )
        return result


def _summary(result: Mapping[str, Any]) -> dict[str, object]:
    nominal = result["nominal"]
    names = ("finished", "duration_s", "battery_end_share", "fence_distance_m", "obstacle_distance_m")
    errors = sum(each["severity"] == "error" for each in nominal["findings"])
    return {**{name: nominal[name] for name in names}, "errors": errors, "findings": len(nominal["findings"])}
