"""`python -m gcs_server.flights.proof_worker`: proves gains in simulation (`missions.what_if.proof`), in a
process of its own with its own limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import msgspec

from gcs_server.operations.operations import ReportProgress
from gcs_server.operations.process import Result, limit_process, read_request, serve


def main() -> None:
    """Reads `id`, `vehicle`, `parameters` (of the vehicle), `proposed`, `runs`, `seed`, `assumed`; writes
    progress and result."""
    limit_process(memory_bytes=2_000_000_000, cpu_time_s=300, timeout_s=900)
    request = msgspec.json.decode(read_request())
    serve(lambda report: prove(request, report))


def prove(request: Mapping[str, Any], report: ReportProgress) -> Result:
    """Flies the proof; returns a summary, and the response to clients as JSON."""
    from missions.what_if import proof

    found = proof.prove(
        request["parameters"], request["proposed"], runs=request["runs"], seed=request["seed"],
        assumed=request["assumed"], report=report,
    )  # fmt: skip
    response = {"id": request["id"], "vehicle": request["vehicle"], **asdict(found)}
    summary: dict[str, object] = {"passed": found.passed, "stable": found.stable, "runs": found.runs}
    return summary, msgspec.json.encode(response)


if __name__ == "__main__":
    main()
