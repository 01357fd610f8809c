"""All file formats of plans by name, and the detection of a file's format."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, get_args

from missions import plan as plan_document
from missions.bounded_json import UTF_16_MARKS, load
from missions.documents import MISSION_FORMAT, Document
from missions.errors import PlanError
from missions.formats import csv_table, geojson, kml, qgc_plan, waypoints
from missions.formats.results import Imported, ImportOptions, Written
from missions.offboard import reader as mission_reader
from missions.offboard import writer as mission_writer
from missions.offboard.document import OffboardMission
from missions.offboard.document import write as write_mission
from missions.plan import Plan

FormatName = Literal["json", "plan", "waypoints", "csv", "geojson", "kml", "kmz", "yaml"]
FORMATS: tuple[FormatName, ...] = get_args(FormatName)
"""`json` is this project's own format; each other name is the extension of its files."""
MISSION_FORMATS: tuple[FormatName, ...] = ("json", "yaml")
"""Formats of offboard missions; `yaml` is for offboard missions only."""

_READERS: dict[FormatName, Callable[[bytes, ImportOptions], Imported]] = {
    "json": lambda data, _: _read_json(data),
    "plan": lambda data, _: qgc_plan.read(data),
    "waypoints": lambda data, _: waypoints.read(data),
    "csv": csv_table.read,
    "geojson": geojson.read,
    "kml": kml.read,
    "kmz": kml.read,
    "yaml": lambda data, _: _read_yaml(data),
}
_WRITERS: dict[FormatName, Callable[[Plan], Written]] = {
    "json": lambda plan: Written(plan_document.write(plan)),
    "yaml": lambda _: _refuse_plan(),
    "plan": qgc_plan.write,
    "waypoints": waypoints.write,
    "csv": csv_table.write,
    "geojson": geojson.write,
    "kml": kml.write,
    "kmz": kml.write_kmz,
}
_RECOGNISED_BYTES = 4096
_GEOJSON_TYPES = ("Feature", "FeatureCollection", "GeometryCollection", "Point", "LineString", "Polygon")


def recognise(data: bytes, filename: str = "") -> FormatName:
    """Detects the format of a file from its content; YAML and CSV also from the file name.

    Raises:
        PlanError: the format is unknown.
    """
    start = _beginning(data)
    if start.startswith(b"PK"):
        return "kmz"
    if start.startswith(b"<"):
        return "kml"
    if start.startswith(b"QGC WPL") or filename.lower().endswith(".waypoints"):
        return "waypoints"
    if start.startswith(b"{"):
        return _json_format(data)
    if filename.lower().endswith((".yaml", ".yml")) or MISSION_FORMAT.encode() in data[:_RECOGNISED_BYTES]:
        return "yaml"
    if filename.lower().endswith((".csv", ".txt")):
        return "csv"
    raise PlanError(
        "the file",
        "its format is not supported",
        "Choose a .plan, .waypoints, .csv, .geojson, .kml, .kmz or .yaml file.",
    )


def _beginning(data: bytes) -> bytes:
    """The first bytes of a file in UTF-8, without byte order mark, blanks and lines of comments."""
    start = data[:_RECOGNISED_BYTES]
    if start.startswith(UTF_16_MARKS):
        start = start.decode("utf-16", errors="ignore").encode()
    start = start.lstrip(b"\xef\xbb\xbf \t\r\n")
    while start.startswith(b"#"):
        start = start.partition(b"\n")[2].lstrip()
    return start


def _json_format(data: bytes) -> FormatName:
    document = load(data)
    if document.get("format") in ("offboard-gcs-plan", MISSION_FORMAT):
        return "json"
    if document.get("fileType") == "Plan":
        return "plan"
    if str(document.get("type")) in _GEOJSON_TYPES or str(document.get("type")).startswith("Multi"):
        return "geojson"
    raise PlanError(
        "the file",
        "it is JSON, but neither a plan (of QGroundControl or of this program) nor GeoJSON",
        "Choose another file.",
    )


def read(name: FormatName, data: bytes, options: ImportOptions | None = None) -> Imported:
    """The plan of a file in this format.

    Raises:
        PlanError: the file cannot be read; the error names the part and the reason.
    """
    return _READERS[name](data, options or ImportOptions())


def write(name: FormatName, document: Document) -> Written:
    """The plan or mission as a file in this format.

    Raises:
        PlanError: the format cannot store the document.
    """
    if not isinstance(document, OffboardMission):
        return _WRITERS[name](document)
    if name not in MISSION_FORMATS:
        reason = f"{name} is for waypoint plans, and this is an offboard mission"
        raise PlanError("the format", reason, "Write it as yaml or json.")
    return Written(mission_writer.write_yaml(document) if name == "yaml" else write_mission(document))


def _read_json(data: bytes) -> Imported:
    value = load(data)
    is_mission = isinstance(value, dict) and value.get("format") == MISSION_FORMAT
    return Imported(mission_reader.read(data) if is_mission else plan_document.read(data))


def _read_yaml(data: bytes) -> Imported:
    comments = any(line.lstrip().startswith(b"#") for line in data.splitlines())
    notes = ("The file's comments are not kept in the plan.",) if comments else ()
    return Imported(mission_reader.read(data), notes=notes)


def _refuse_plan() -> Written:
    reason = "yaml is for offboard missions, and this is a waypoint plan"
    raise PlanError("the format", reason, "Write it as json, or convert it to an offboard mission first.")
