"""Findings of simulated flights: how many of each fault are found, how many healthy flights are silent."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

from gcs_server.logbook.findings.table import findings
from gcs_server.logbook.ulog import read_ulog
from tests.support.finding_flights import CASES, fly

EACH = 10
"""Flights of each case; all together about two hundred."""
SEED = 7


def table(each: int = EACH) -> Iterator[str]:
    """A row for each fault: the flights, those in which it was found, and what else was found."""
    yield "| fault | expected | found | also found (in flights) |"
    yield "|---|---|---|---|"
    flights = hits = healthy = alarms = 0
    for case in CASES:
        with tempfile.TemporaryDirectory() as folder:
            logs = [read_ulog(path) for path in fly(case, Path(folder), each, SEED)]
        kinds = [{one["kind"] for one in findings(log)["findings"]} for log in logs]
        others = sorted(set().union(*kinds) - case.expected)
        also = ", ".join(f"{kind} ({sum(kind in one for one in kinds)})" for kind in others)
        found = sum(bool(case.expected & one) for one in kinds)
        wanted = ", ".join(sorted(case.expected)) or "nothing"
        if case.expected:
            flights, hits = flights + each, hits + found
            yield f"| {case.name} | {wanted} | {found} of {each} | {also or '–'} |"
        else:
            healthy, alarms = healthy + each, alarms + sum(bool(one) for one in kinds)
            yield f"| {case.name} | {wanted} | – | {also or '–'} |"
    yield f"| **all** | | **{hits} of {flights}** | **{alarms} of {healthy} healthy flights** |"
