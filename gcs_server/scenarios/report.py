"""Reports of flown scenarios: text, JUnit XML, JSON, and the files of a report's folder.

Nothing in the files depends on the machine or the time of day: the same flights give the same bytes.
"""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.etree import ElementTree

from gcs_server.scenarios.checks import Broken
from gcs_server.scenarios.flown import VehicleFlight
from gcs_server.scenarios.page import page
from gcs_server.scenarios.results import FlightResult

COLUMNS = "t_s,north_m,east_m,down_m,speed_m_s,battery_share,setpoint_age_s"


def broken_text(broken: Broken, several: bool) -> str:
    """What did not hold: why, when and where."""
    name = f"{broken.vehicle}: " if several else ""
    when = "" if broken.t_s is None else f" (at {broken.t_s:.1f} s"
    if broken.position_ned_m is not None:
        n, e, d = broken.position_ned_m
        when += f", north {n:.1f}, east {e:.1f}, up {0.0 - d:.1f} m"
    return f"{name}{broken.why}{when}{')' if when else ''}"


def failures(result: FlightResult) -> list[str]:
    """One line for each check that did not hold in a flight."""
    several = len(result.vehicles) > 1
    return [
        f"{check.title}: {broken_text(broken, several)}" for check in result.checks for broken in check.broken
    ]


def by_scenario(results: Sequence[FlightResult]) -> Iterator[tuple[str, str, list[FlightResult]]]:
    """File, name and flights of each scenario, in the order of the results."""
    for (file, name), group in itertools.groupby(results, lambda each: (each.file, each.scenario)):
        yield file, name, list(group)


def text(results: Sequence[FlightResult]) -> str:
    """The report for a terminal: a line for each scenario, and what failed."""
    lines: list[str] = []
    for file, name, flights in by_scenario(results):
        failed = [each for each in flights if not each.passed]
        outcome = f"{len(failed)} of {len(flights)} failed" if failed else f"{len(flights)} passed"
        lines.append(f"{'FAILED' if failed else 'passed'}  {file}  {name}: {outcome}")
        for each in failed:
            lines.append(f"    {each.cell.text}")
            lines += [f"        {line}" for line in failures(each)]
    return "\n".join(lines)


def junit(results: Sequence[FlightResult]) -> bytes:
    """The report as JUnit XML; times are simulated."""
    root = ElementTree.Element("testsuites")
    for file, name, flights in by_scenario(results):
        failed = sum(not each.passed for each in flights)
        total_s = sum(each.duration_s for each in flights)
        counts = {"tests": len(flights), "failures": failed, "errors": 0, "skipped": 0}
        attributes = {"name": name, "time": f"{total_s:.1f}", **{k: str(n) for k, n in counts.items()}}
        suite = ElementTree.SubElement(root, "testsuite", attributes)
        for each in flights:
            case = ElementTree.SubElement(
                suite,
                "testcase",
                classname=name,
                name=each.cell.text,
                file=file,
                time=f"{each.duration_s:.1f}",
            )
            if not each.passed:
                lines = failures(each)
                failure = ElementTree.SubElement(case, "failure", message=_xml(lines[0]), type="check")
                failure.text = _xml("\n".join(lines))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"


def _xml(value: str) -> str:
    """Text without the characters that XML does not allow; a vehicle's or program's texts may have them."""
    return re.sub(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "\ufffd", value)


def document(results: Sequence[FlightResult]) -> dict[str, object]:
    """The report as JSON values."""
    return {
        "format": "offboard-gcs-scenario-results",
        "version": 1,
        "flights": [_flight(each) for each in results],
    }


def _flight(result: FlightResult) -> dict[str, object]:
    cell = result.cell
    return {
        "scenario": result.scenario,
        "file": result.file,
        "wind": cell.wind,
        "faults": cell.faults,
        "px4": cell.px4,
        "seed": cell.seed,
        "passed": result.passed,
        "duration_s": round(result.duration_s, 2),
        "checks": [
            {
                "check": check.title,
                "held": not check.broken,
                "broken": [
                    {
                        "vehicle": broken.vehicle,
                        "why": broken.why,
                        "t_s": broken.t_s,
                        "position_ned_m": broken.position_ned_m,
                    }
                    for broken in check.broken
                ],
            }
            for check in result.checks
        ],
        "track_sha256": result.track_sha256,
        "files": [name for name, _ in _files(result)],
    }


def write(results: Sequence[FlightResult], folder: Path) -> None:
    """Writes `junit.xml`, `results.json`, `report.html`, and track and recording of each failed flight.

    Raises:
        OSError: a file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for result in results:
        for name, data in _files(result):
            (folder / name).write_bytes(data)
    (folder / "junit.xml").write_bytes(junit(results))
    (folder / "results.json").write_bytes(json.dumps(document(results), indent=1).encode() + b"\n")
    (folder / "report.html").write_bytes(page(results, files).encode())


def files(result: FlightResult) -> list[str]:
    """Names of the files of a flight in the report's folder."""
    return [name for name, _ in _files(result)]


def _files(result: FlightResult) -> list[tuple[str, bytes]]:
    """Names and contents of the files of a failed flight."""
    if result.passed:
        return []
    path = Path(result.file)
    stem = re.sub(r"[^A-Za-z0-9.=_-]+", "_", f"{path.parent.name} {path.stem} {result.cell.text}").strip("_")
    several = len(result.vehicles) > 1
    found = [(f"{stem}{f'_{each.name}' if several else ''}.csv", _csv(each)) for each in result.vehicles]
    if result.recording is not None:
        found.append((f"{stem}.tlog", result.recording))
    return found


def _csv(flight: VehicleFlight) -> bytes:
    rows = zip(
        flight.t_s, flight.position_ned_m, flight.speed_m_s, flight.battery_share, flight.setpoint_age_s,
        strict=True,
    )  # fmt: skip
    lines = [
        f"{t:.2f},{n:.3f},{e:.3f},{d:.3f},{speed:.3f},{charge:.4f},{'' if age != age else f'{age:.3f}'}"
        for t, (n, e, d), speed, charge, age in rows
    ]
    return "\n".join([COLUMNS, *lines, ""]).encode()
