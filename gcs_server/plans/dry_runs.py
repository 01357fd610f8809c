"""Dry runs: plans flown in simulation, each in a separate process. The newest results are kept in memory, as
the JSON that the process wrote.
"""

from __future__ import annotations

import asyncio
import sys
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypedDict

import msgspec

from gcs_server.errors import ClientHasTooMany, Refused, UnknownDryRun
from gcs_server.operations.operations import ReportProgress
from gcs_server.operations.process import WorkerFailed, run_process
from missions.frames import Quaternion, Vector3

MAX_RUNNING = 2
"""Maximum number of processes; they have low priority, but a small computer has only two cores."""
MAX_RESULTS = 10
MAX_RESULT_BYTES = 32 * 1024 * 1024
MAX_TOTAL_BYTES = 24 * 1024 * 1024
"""Maximum size of all results; the newest result is always kept."""
COMMAND = (sys.executable, "-m", "gcs_server.plans.dry_run_worker")


class _Values(TypedDict):
    """Values at the points of a corridor."""

    p5: list[float]
    p95: list[float]
    greatest: list[float]


class _Corridor(TypedDict):
    position_ned_m: list[Vector3]
    horizontal_m: _Values
    vertical_m: _Values


class _WithCorridor(TypedDict):
    corridor: _Corridor | None


class _MonteCarloOfRoles(TypedDict):
    roles: dict[str, _WithCorridor]


class _Path(TypedDict):
    t_s: list[float]
    position_ned_m: list[Vector3]
    q_ned_frd: list[Quaternion]
    gimbal_rad: list[tuple[float, float]]


class _Step(TypedDict):
    place: str
    title: str
    row: int | None
    start_s: float
    end_s: float


class _Flight(TypedDict):
    finished: bool
    duration_s: float | None
    origin: dict[str, float]
    steps: list[_Step]
    path: _Path | None


class _Group(TypedDict):
    roles: dict[str, _Flight]
    monte_carlo: _MonteCarloOfRoles | None


class DryRunResult(TypedDict):
    """What the server itself uses of a result: for the comparison with a flight, and for the 3D view."""

    id: str
    kind: str
    nominal: _Flight
    monte_carlo: _WithCorridor | None
    group: _Group | None


@dataclass(frozen=True, slots=True)
class _Stored:
    body: bytes
    """The result as JSON, as in the API."""
    plan: bytes


class DryRuns:
    """The dry runs of one server; they are lost in a restart."""

    def __init__(self) -> None:
        self._count = 0
        self._running: list[str] = []
        """Keys of the clients whose dry runs are running."""
        self._stored: OrderedDict[str, _Stored] = OrderedDict()

    def next_id(self, client_key: str) -> str:
        """Id of the next dry run of a client.

        Raises:
            ClientHasTooMany: a dry run of this client is running; the other process is for other clients.
            Refused: the limit of running dry runs is reached.
        """
        self._require_room(client_key)
        self._count += 1
        return str(self._count)

    async def run(
        self,
        dry_run_id: str,
        plan: bytes,
        request: Mapping[str, Any],
        details: Mapping[str, Any],
        report: ReportProgress,
        client_key: str,
    ) -> dict[str, object]:
        """Runs a dry run and stores the result; cancelling this call ends the process.

        Args:
            dry_run_id: id of the dry run.
            plan: the plan as JSON.
            request: the rest of the input of `missions.dry_run.task`, and `elevation`: paths of elevation
            files.
            details: data to store with the result; the assumptions of the result are added to
                `details["assumed"]`.
            report: receives progress.
            client_key: identifies the client.

        Returns:
            A summary.

        Raises:
            ClientHasTooMany: a dry run of this client is running.
            Refused: the plan cannot be flown, the simulation takes too long, or too many dry runs are
                running.
        """
        self._require_room(client_key)
        self._running.append(client_key)
        line = msgspec.json.encode({**request, "plan": plan.decode(), "id": dry_run_id, "details": details})
        try:
            summary, body = await run_process(COMMAND, report, request=line, max_body_bytes=MAX_RESULT_BYTES)
        except WorkerFailed as error:
            raise Refused(
                f"The dry run has failed: {error}",
                remedy="Correct the plan if the error names it; otherwise use fewer flights or a shorter "
                "plan.",
            ) from error
        finally:
            self._running.remove(client_key)
        self._store(dry_run_id, body, plan)
        return {"dry_run": dry_run_id, **summary}

    def plan(self, dry_run_id: str) -> bytes:
        """The plan that was flown, as JSON. Raises UnknownDryRun."""
        return self._get(dry_run_id).plan

    def body(self, dry_run_id: str) -> bytes:
        """The result of a dry run as JSON.

        Raises:
            UnknownDryRun: there is no such dry run, it has not ended, or it was dropped.
        """
        return self._get(dry_run_id).body

    async def result(self, dry_run_id: str) -> DryRunResult:
        """The result of a dry run, read in a thread; raises the same errors as `body`."""
        return await asyncio.to_thread(read_result, self.body(dry_run_id))

    def _get(self, dry_run_id: str) -> _Stored:
        stored = self._stored.get(dry_run_id)
        if stored is None:
            raise UnknownDryRun(
                f"There is no result of a dry run {dry_run_id!r}.",
                remedy=f"Wait for its operation to succeed; the last {MAX_RESULTS} results are kept, "
                "fewer of large results.",
            )
        return stored

    def _require_room(self, client_key: str) -> None:
        remedy = "Wait until one has ended, or cancel one (DELETE /operations/{id})."
        if client_key in self._running:
            raise ClientHasTooMany("A dry run of this client is already running.", remedy=remedy)
        if len(self._running) >= MAX_RUNNING:
            raise Refused(f"{MAX_RUNNING} dry runs are already running, which is the limit.", remedy=remedy)

    def _store(self, dry_run_id: str, body: bytes, plan: bytes) -> None:
        self._stored[dry_run_id] = _Stored(body, plan)
        while len(self._stored) > MAX_RESULTS or (
            len(self._stored) > 1
            and sum(len(each.body) + len(each.plan) for each in self._stored.values()) > MAX_TOTAL_BYTES
        ):
            self._stored.popitem(last=False)


def read_result(body: bytes) -> DryRunResult:
    """Reads a result that was stored as JSON."""
    return msgspec.json.decode(body, type=DryRunResult)
