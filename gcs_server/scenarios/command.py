"""The command `gcs test`."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gcs_server.errors import GcsError

if TYPE_CHECKING:
    from gcs_server.scenarios.results import FlightResult

EXIT_FAILED = 1
EXIT_INTERRUPTED = 130


class ScenarioError(GcsError):
    """A scenario cannot be read or flown."""

    code = "scenario"


def add_flags(parser: argparse.ArgumentParser) -> None:
    """The flags of `gcs test`."""
    parser.add_argument(
        "paths", nargs="*", type=Path, metavar="PATH", help="scenario files, or folders of them"
    )
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="TEXT",
        help="fly only flights whose name contains this text ('wind=west'); may be given several times",
    )
    parser.add_argument(
        "--jobs", type=int, metavar="N", help="processes that fly (default: one for each core)"
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FOLDER",
        help="write report.html, junit.xml, results.json, and track and recording of each failed flight",
    )
    parser.add_argument("--list", action="store_true", help="print the names of the flights, and fly none")
    parser.add_argument(
        "--schema", action="store_true", help="print the JSON Schema of a scenario, for an editor"
    )


def run(options: argparse.Namespace) -> int:
    """Flies the scenarios; 0: all that must hold held, 1: something did not.

    Raises:
        GcsError: a scenario cannot be read or flown, or the report cannot be written.
    """
    # Imported here, because the simulator takes a second, and the other commands do not need it.
    from gcs_server.scenarios.run import fly_all, select
    from gcs_server.scenarios.scenario import find, load, schema
    from vehicle_sim.yaml_fields import FileProblem

    if options.schema:
        print(json.dumps(schema(), indent=2))
        return 0
    try:
        selected = select([load(each) for each in find(options.paths or [Path()])], options.only)
    except FileProblem as problem:
        raise ScenarioError(str(problem)) from None
    if not selected:
        raise ScenarioError("No flight has such a name.", remedy="See the names with --list.")
    if options.list:
        for each in selected:
            print("\n".join(f"{each.scenario.document.name} [{cell.text}]" for cell in each.cells))
        return 0
    jobs = options.jobs or len(os.sched_getaffinity(0))
    try:
        results = fly_all(selected, jobs, _print)
    except KeyboardInterrupt:
        print("Interrupted.", file=sys.stderr)
        return EXIT_INTERRUPTED
    return _report(results, options.out)


def _print(results: Sequence[FlightResult]) -> None:
    from gcs_server.scenarios import report

    print(report.text(results), flush=True)


def _report(results: Sequence[FlightResult], folder: Path | None) -> int:
    from gcs_server.scenarios import report

    failed = sum(not each.passed for each in results)
    if folder is not None:
        try:
            report.write(results, folder)
        except OSError as error:
            raise ScenarioError(f"The report cannot be written to {folder}: {error.strerror}.") from None
    where = "" if folder is None else f" Report: {folder / 'report.html'}"
    print(f"{len(results)} flights: {len(results) - failed} passed, {failed} failed.{where}")
    sys.stdout.flush()
    return EXIT_FAILED if failed else 0
