"""Reads and writes plans as KML and KMZ (OGC 12-007r2).

The size of a file is checked before parsing. Entities and document types are refused (defusedxml). Only one
document of a KMZ file is unpacked, up to the maximum file size. DJI's waylines (WPML) are KML whose altitudes
are in elements of their own. https://developer.dji.com/doc/cloud-api-tutorial/en/api-reference/dji-wpml/
"""

from __future__ import annotations

import io
import json
import math
import re
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal
from xml.etree.ElementTree import Element, ParseError, SubElement, tostring

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import XMLParser

from missions.bounded_json import MAX_DEPTH, MAX_FILE_BYTES, MAX_VALUES, decode
from missions.bounded_json import load as load_json
from missions.errors import PlanError
from missions.formats import features
from missions.formats.features import Coordinate, Feature
from missions.formats.geojson import open_ring
from missions.formats.results import Imported, ImportOptions, Written, count
from missions.plan import MAX_ITEMS, Plan
from missions.values import Reference

NAMESPACE = "http://www.opengis.net/kml/2.2"
_DATA_NAME = "offboard-gcs"
_REFERENCE: dict[str, Reference | Literal["none"]] = {
    "absolute": "amsl",
    "relativeToGround": "terrain",
    "clampToGround": "none",
    "clampToSeaFloor": "none",
}
_DJI_REFERENCE: dict[str, Reference] = {
    "relativeToStartPoint": "home",
    "EGM96": "amsl",
    "aboveGroundLevel": "terrain",
}
_DJI_HEIGHTS = ("executeHeight", "height", "ellipsoidHeight")
_DJI_WAYLINES = "waylines.wpml"
_ELLIPSOID = "the WGS84 ellipsoid, which is not a reference of PX4 (mean sea level is up to 100 m off)"
_NOT_UNDERSTOOD = (
    "LinearRing", "Model", "GroundOverlay", "PhotoOverlay", "ScreenOverlay", "NetworkLink", "Tour"
)  # fmt: skip
_OTHER_XML = {"gpx": "a GPX file", "svg": "an SVG picture", "html": "a web page"}
_COMMA = re.compile(r"\s*,\s*")
_FIRST_ELEMENT = re.compile(r"<([A-Za-z_][\w.:-]{0,40})")
MAX_ZIP_ENTRIES = 1000
_CHUNK_BYTES = 64 * 1024


def read(data: bytes, options: ImportOptions | None = None) -> Imported:
    """The plan of a KML or KMZ file, or of DJI waylines.

    `altitudeMode` sets the altitude reference: absolute is AMSL, relativeToGround is above terrain. Altitudes
    clamped to the ground are ignored; without an altitudeMode the reference is not known. A gx:Track becomes
    a path without its times.

    Raises:
        PlanError: The file is too large, not KML, or has entities; a value is wrong, a point has no altitude,
            the reference of the altitudes is not known, or the file contains nothing to import.
    """
    text = decode(_unpacked(data) if data[:2] == b"PK" else data)
    root = _parse(text)
    kind = _local_name(root)
    if kind != "kml":
        raise PlanError("the file", f"it is not KML, but {_described(kind)}", "Choose a KML file.")
    found = list(_features(root, _Dji()))
    is_dji = any("/wpmz/" in each.tag for each in root.iter())
    notes = ("DJI's speeds, turns and actions are not imported.",) if is_dji else ()
    above_ellipsoid = any(each.text == "WGS84" for each in _descendants(root, "executeHeightMode"))
    return features.to_plan(
        found, options or ImportOptions(), "The KML file", left_out=_left_out(root, len(found)), notes=notes,
        heights_above=_ELLIPSOID if above_ellipsoid else None,
    )  # fmt: skip


def _described(kind: str) -> str:
    return _OTHER_XML.get(kind.lower(), f"XML of the kind <{kind}>")


def _left_out(root: Element, found: int) -> tuple[str, ...]:
    """What the document contains and is not imported: `1 Model`."""
    numbers = Counter(
        _local_name(each)
        for parent in root.iter()
        if _local_name(parent) not in ("outerBoundaryIs", "innerBoundaryIs")
        for each in parent
    )
    parts = [count(numbers[name], name) for name in _NOT_UNDERSTOOD if numbers[name]]
    if numbers["Track"]:
        parts.append(f"the times of {count(numbers['Track'], 'gx:Track')}")
    if not found and numbers["Placemark"]:
        parts.append(f"{count(numbers['Placemark'], 'Placemark')} without point, line or area")
    return tuple(parts)


def _unpacked(data: bytes) -> bytes:
    if len(data) > MAX_FILE_BYTES:
        decode(data, "the KMZ file")  # raises PlanError: the file is too large
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            entries = archive.infolist()
            if len(entries) > MAX_ZIP_ENTRIES:
                raise PlanError(
                    "the KMZ file", f"more than {MAX_ZIP_ENTRIES} entries", "Choose another file."
                )
            documents = [entry for entry in entries if entry.filename.lower().endswith(".kml")]
            waylines = [entry for entry in entries if entry.filename.lower().endswith(_DJI_WAYLINES)]
            documents = waylines or documents
            if not documents:
                raise PlanError("the KMZ file", "it has no KML document", "Choose another file.")
            with archive.open(documents[0]) as file:
                chunks: list[bytes] = []
                while chunk := file.read(_CHUNK_BYTES):
                    chunks.append(chunk)
                    if len(chunks) * _CHUNK_BYTES > MAX_FILE_BYTES + _CHUNK_BYTES:
                        limit_mib = MAX_FILE_BYTES // 2**20
                        reason = f"its KML document is larger than {limit_mib} MiB"
                        raise PlanError("the KMZ file", reason, "Split the plan into smaller ones.")
                return b"".join(chunks)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, ValueError) as error:
        raise PlanError("the KMZ file", f"it cannot be unpacked ({error})", "Export it again.") from None


class _BoundedTreeBuilder:
    """Builds the element tree, up to a maximum depth and size."""

    def __init__(self) -> None:
        self.root: Element | None = None
        self._open: list[Element] = []
        self._text_parts: list[str] = []
        self._count = 0

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self._count += 1 + len(attributes)
        if len(self._open) >= MAX_DEPTH or self._count > MAX_VALUES:
            raise PlanError("the KML file", "too many elements, or nested too deeply", "Split it.")
        element = Element(tag, attributes) if not self._open else SubElement(self._open[-1], tag, attributes)
        self.root = self.root if self.root is not None else element
        self._open.append(element)
        self._text_parts.clear()

    def end(self, tag: str) -> None:
        element = self._open.pop()
        if len(element) == 0:
            element.text = "".join(self._text_parts)
        self._text_parts.clear()

    def data(self, text: str) -> None:
        self._text_parts.append(text)

    def close(self) -> Element:
        if self.root is None:
            raise ParseError("no element")
        return self.root


def _parse(text: str) -> Element:
    if text.count("<") + text.count("=") > 2 * MAX_VALUES:
        raise PlanError("the KML file", "it has too many elements", "Split it.")
    parser = XMLParser(target=_BoundedTreeBuilder(), forbid_dtd=True)
    try:
        parser.feed(text)
        return parser.close()
    except (ParseError, DefusedXmlException) as error:
        kind = first.group(1) if (first := _FIRST_ELEMENT.search(text)) else "kml"
        if kind.rpartition(":")[2].lower() in _OTHER_XML:
            reason = f"it is not KML, but {_described(kind.rpartition(':')[2])}"
            raise PlanError("the file", reason, "Choose a KML file.") from None
        if isinstance(error, DefusedXmlException):
            raise PlanError("the KML file", "it has entities or a document type", "Remove them.") from None
        line, column = getattr(error, "position", (1, 0))
        place = f"line {line}, column {column + 1}"
        raise PlanError(
            place, f"not valid XML ({str(error).partition(':')[0]})", "Export the file again."
        ) from None


def _local_name(element: Element) -> str:
    return element.tag.rpartition("}")[2]


def _descendants(element: Element, name: str) -> Iterator[Element]:
    return (each for each in element.iter() if _local_name(each) == name)


def _text(element: Element, name: str) -> str:
    return next(((each.text or "").strip() for each in element if _local_name(each) == name), "")


@dataclass(frozen=True, slots=True)
class _Dji:
    """What DJI's elements of a folder say about the altitudes of its placemarks."""

    mode: str = ""
    global_height: str = ""

    def inside(self, folder: Element) -> _Dji:
        """These values, where a folder does not state its own."""
        system = next((each for each in folder if _local_name(each) == "waylineCoordinateSysParam"), folder)
        mode = _text(folder, "executeHeightMode") or _text(system, "heightMode")
        return _Dji(mode or self.mode, _text(folder, "globalHeight") or self.global_height)

    def height_m(self, placemark: Element, name: str) -> float | None:
        """The altitude of a placemark; None: it has none of DJI's elements."""
        text = next((text for each in _DJI_HEIGHTS if (text := _text(placemark, each))), "")
        if _text(placemark, "useGlobalHeight") == "1" and not _text(placemark, "executeHeight"):
            text = self.global_height or text
        return _number(text, f"placemark {name!r}, its height") if text else None


def _features(element: Element, dji: _Dji) -> Iterator[Feature]:
    for child in element:
        if _local_name(child) == "Placemark":
            yield from _placemark(child, dji)
        else:
            yield from _features(child, dji.inside(child))


def _placemark(placemark: Element, dji: _Dji) -> Iterator[Feature]:
    name = _text(placemark, "name")[:100]
    properties = _properties(placemark)
    height_m = dji.height_m(placemark, name)
    has_geometry = False
    for feature in _geometries(placemark, properties, name):
        has_geometry = True
        if height_m is None:
            yield feature
        else:
            rings = tuple(tuple((lon, lat, height_m) for lon, lat, _ in ring) for ring in feature.rings)
            yield replace(feature, rings=rings, reference=_DJI_REFERENCE.get(dji.mode))
    if not has_geometry and properties:
        yield Feature("none", properties=properties, name=name)


def _geometries(parent: Element, properties: dict[str, Any], name: str) -> Iterator[Feature]:
    for geometry in parent:
        match _local_name(geometry):
            case "Point":
                ring = _coordinates(geometry, name)
                if len(ring) != 1:
                    raise PlanError(
                        f"placemark {name!r}", "its point must have one coordinate", "Correct the point."
                    )
                yield Feature("point", (ring,), properties, name, _reference(geometry))
            case "LineString":
                yield Feature("line", (_coordinates(geometry, name),), properties, name, _reference(geometry))
            case "Track":
                texts = [(each.text or "").strip() for each in geometry if _local_name(each) == "coord"]
                ring = tuple(_coordinate(",".join(text.split()), name) for text in texts)
                yield Feature("line", (ring,), properties, name, _reference(geometry))
            case "Polygon":
                yield _polygon(geometry, properties, name)
            case "MultiGeometry" | "MultiTrack":
                yield from _geometries(geometry, properties, name)
            case _:
                pass


def _polygon(geometry: Element, properties: dict[str, Any], name: str) -> Feature:
    outer = [_coordinates(each, name) for each in _descendants(geometry, "outerBoundaryIs")]
    # one innerBoundaryIs may contain several rings, although the standard allows one
    holes = [
        _coordinates(ring, name)
        for inner in _descendants(geometry, "innerBoundaryIs")
        for ring in _descendants(inner, "LinearRing")
    ]
    if len(outer) != 1:
        raise PlanError(
            f"placemark {name!r}", "its polygon must have one outer boundary", "Correct the polygon."
        )
    return Feature("area", tuple(open_ring(ring) for ring in (*outer, *holes)), properties, name)


def _reference(geometry: Element) -> Reference | Literal["none"] | None:
    return _REFERENCE.get(_text(geometry, "altitudeMode"))


def _properties(placemark: Element) -> dict[str, Any]:
    for data in _descendants(placemark, "Data"):
        if data.get("name") == _DATA_NAME:
            properties = load_json(_text(data, "value"))
            return properties if isinstance(properties, dict) else {}
    return {}


def _coordinates(geometry: Element, name: str) -> tuple[Coordinate, ...]:
    text = next(((each.text or "") for each in _descendants(geometry, "coordinates")), "")
    coordinates = _COMMA.sub(",", text).split()
    if len(coordinates) > MAX_ITEMS:
        raise PlanError(f"placemark {name!r}", f"more than {MAX_ITEMS} coordinates", "Simplify it.")
    return tuple(_coordinate(each, name) for each in coordinates)


def _number(text: str, place: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) <= 1e9:
        raise PlanError(place, f"{text[:40]!r} is not a possible number", "Correct it.")
    return value


def _coordinate(text: str, name: str) -> Coordinate:
    try:
        values = [float(value) for value in text.split(",")]
    except ValueError:
        values = []
    if not 2 <= len(values) <= 3 or not all(math.isfinite(value) and abs(value) <= 1e9 for value in values):
        reason = f"{text[:40]!r} is not longitude, latitude, altitude"
        raise PlanError(f"placemark {name!r}", reason, "Correct this coordinate.")
    return (values[0], values[1], values[2] if len(values) == 3 else None)


def write(plan: Plan) -> Written:
    """The plan as KML: a placemark for each item, fence zone, rally point and home."""
    root = Element("kml", {"xmlns": NAMESPACE})
    document = SubElement(root, "Document")
    for feature in features.features_of_plan(plan):
        placemark = SubElement(document, "Placemark")
        SubElement(placemark, "name").text = feature.name
        data = SubElement(SubElement(placemark, "ExtendedData"), "Data", {"name": _DATA_NAME})
        SubElement(data, "value").text = json.dumps(feature.properties, allow_nan=False)
        _write_geometry(placemark, feature)
    text = b'<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="utf-8")
    return features.result_with_notes(text + b"\n", plan, "A KML file")


def write_kmz(plan: Plan) -> Written:
    """The plan as a KMZ file, which is compressed KML."""
    result = write(plan)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo("doc.kml"), result.data, zipfile.ZIP_DEFLATED)
    return Written(out.getvalue(), result.notes)


def _write_geometry(placemark: Element, feature: Feature) -> None:
    if feature.geometry == "none":
        return
    if feature.geometry == "point":
        point = SubElement(placemark, "Point")
        if feature.reference is not None:
            SubElement(point, "altitudeMode").text = "absolute"
        SubElement(point, "coordinates").text = _to_text(feature.rings[0])
        return
    polygon = SubElement(placemark, "Polygon")
    ring = SubElement(SubElement(polygon, "outerBoundaryIs"), "LinearRing")
    SubElement(ring, "coordinates").text = _to_text((*feature.rings[0], feature.rings[0][0]))


def _to_text(ring: tuple[Coordinate, ...]) -> str:
    return " ".join(",".join(repr(value) for value in each if value is not None) for each in ring)
