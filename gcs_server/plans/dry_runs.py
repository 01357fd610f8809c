"""Plans flown in simulation, each in a process of its own; the newest results are kept in memory."""

from __future__ import annotations

import json
import sys
from collections import OrderedDict
from collections.abc import Mapping
from typing import Any

from gcs_server.errors import Refused, UnknownDryRun
from gcs_server.operations.operations import Report
from gcs_server.operations.process import WorkerFailed, run_process

AT_ONCE = 2
"""Processes; they are nice, but a small computer has two cores."""
MOST_KEPT = 10
MAX_ANSWER_BYTES = 8 * 1024 * 1024
COMMAND = (sys.executable, "-m", "gcs_server.plans.dry_run_worker")


class DryRuns:
    """The dry runs of one server; a restart forgets them."""

    def __init__(self) -> None:
        self._count = 0
        self._running = 0
        self._kept: OrderedDict[str, dict[str, Any]] = OrderedDict()

    def next_id(self) -> str:
        """For one that is to begin.

        Raises:
            Refused: as many as possible run.
        """
        if self._running >= AT_ONCE:
            raise Refused(
                f"{AT_ONCE} dry runs are under way, and no more are begun.",
                remedy="Wait until one has ended, or cancel one (DELETE /operations/{id}).",
            )
        self._count += 1
        return str(self._count)

    async def run(
        self, dry_run_id: str, request: Mapping[str, Any], about: Mapping[str, Any], report: Report
    ) -> dict[str, object]:
        """Flies, and keeps the result; whoever cancels it ends the process.

        Args:
            dry_run_id: its name.
            request: as `missions.dry_run.task` takes it.
            about: kept beside the result.
            report: told how far it is.

        Returns:
            A summary.

        Raises:
            Refused: the plan cannot be flown, takes too long, or too many run.
        """
        if self._running >= AT_ONCE:
            raise Refused(f"{AT_ONCE} dry runs are under way.", remedy="Wait until one has ended.")
        self._running += 1
        try:
            found = await run_process(
                COMMAND, report, request=json.dumps(request).encode(), longest_line=MAX_ANSWER_BYTES
            )
        except WorkerFailed as error:
            raise Refused(
                f"The dry run has failed: {error}",
                remedy="Correct the plan where it is named; else fly less often, or a shorter plan.",
            ) from error
        finally:
            self._running -= 1
        self._kept[dry_run_id] = {"id": dry_run_id, **about, **found}
        while len(self._kept) > MOST_KEPT:
            self._kept.popitem(last=False)
        return {"dry_run": dry_run_id, **_summary(found)}

    def get(self, dry_run_id: str) -> dict[str, Any]:
        """The result of one.

        Raises:
            UnknownDryRun: there is none, it has not ended, or it was forgotten.
        """
        found = self._kept.get(dry_run_id)
        if found is None:
            raise UnknownDryRun(
                f"There is no result of a dry run {dry_run_id!r}.",
                remedy=f"Wait for its operation to succeed; the last {MOST_KEPT} results are kept.",
            )
        return found


def _summary(found: Mapping[str, Any]) -> dict[str, object]:
    nominal = found["nominal"]
    names = ("finished", "duration_s", "battery_end_share", "fence_distance_m", "obstacle_distance_m")
    errors = sum(each["severity"] == "error" for each in nominal["findings"])
    return {**{name: nominal[name] for name in names}, "errors": errors, "findings": len(nominal["findings"])}
