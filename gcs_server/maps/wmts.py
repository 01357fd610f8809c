"""Reads the capabilities of a WMTS service (OGC 07-057r7): its layers of images in Web Mercator, each as the
address of its tiles, as a person would paste it.

A description is untrusted: it is read in a process with limits, without entities or document types.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from urllib.parse import quote, unquote
from xml.etree.ElementTree import Element, ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from gcs_server.errors import InvalidRequest
from gcs_server.maps.sources import address_of_tiles
from missions.errors import PlanError

MAX_LAYERS = 2000
MAX_TEXT = 100
MAX_ZOOM = 24
WORLD_M = 2 * math.pi * 6_378_137.0
"""Side of the world in Web Mercator [m]."""
PIXEL_M = 0.00028
"""Size of a pixel that the scales of WMTS assume [m]."""
TILE_SIDES_PX = ("256", "512")
CORNER_TOLERANCE_M = 1.0
IMAGES = ("image/png", "image/jpeg", "image/jpg", "image/png8", "image/webp")
_MERCATOR = re.compile(r"(?:^|\W)(?:3857|900913|3785|102100|102113)$")
_PLACEHOLDER = re.compile(r"\{([^{}]*)\}")
_HREF = "{http://www.w3.org/1999/xlink}href"
_FIRST_ELEMENT = re.compile(rb"<([A-Za-z_][\w.:-]{0,40})")
_OTHER = {
    "html": "a web page",
    "wms_capabilities": "the description of a WMS service, which has no tiles",
    "wmt_ms_capabilities": "the description of a WMS service, which has no tiles",
    "tilemapservice": "the description of a TMS service",
}
_FIX = "Paste the address of the WMTS service's capabilities, as other map programs take it."


@dataclass(frozen=True, slots=True)
class WmtsLayer:
    """A layer whose tiles the map can show."""

    name: str
    url: str
    """Address of its tiles, as `MapSource.url`."""
    min_zoom: int
    max_zoom: int


@dataclass(frozen=True, slots=True)
class WmtsService:
    """What the map can use of a service."""

    attribution: str
    """Who provides it; may be empty."""
    layers: tuple[WmtsLayer, ...]
    others: int
    """Number of layers that the map cannot show: not in Web Mercator, or no images."""


@dataclass(frozen=True, slots=True)
class _Zooms:
    """The zooms of a tile matrix set in Web Mercator: matrices whose names contain their zoom."""

    placeholder: str
    """The zoom in the name of a matrix: `EPSG:3857:{z}`."""
    first: int
    last: int


def read(content: bytes) -> WmtsService:
    """The layers of a service.

    Raises:
        PlanError: it is no description of a WMTS service, or no layer of it can be shown.
    """
    root = _parse(content)
    zooms = {
        _text(each, "identifier"): found
        for each in _children(_child(root, "contents"), "tilematrixset")
        if (found := _zooms(each)) is not None
    }
    kvp = _kvp_address(root)
    layers = list(_children(_child(root, "contents"), "layer"))[:MAX_LAYERS]
    usable = tuple(shown for each in layers if (shown := _layer(each, zooms, kvp)) is not None)
    if not usable:
        reason = (
            f"none of its {len(layers)} layers has images in Web Mercator (EPSG:3857), 256 or 512 pixels wide"
        )
        raise PlanError(
            "The WMTS service",
            reason if layers else "it has no layer",
            "Ask its provider for a layer in Web Mercator, or choose another service.",
            field="url",
        )
    provider = _text(_child(root, "serviceprovider"), "providername")
    title = _text(_child(root, "serviceidentification"), "title")
    return WmtsService(_shown(provider or title), usable, len(layers) - len(usable))


def _parse(content: bytes) -> Element:
    first = _FIRST_ELEMENT.search(content)
    kind = "" if first is None else first[1].decode().rpartition(":")[2].lower()
    if kind in _OTHER:
        raise _not_wmts(_OTHER[kind])
    try:
        root = fromstring(content, forbid_dtd=True)
    except DefusedXmlException:
        raise _not_wmts("XML with entities or a document type, which are not read") from None
    except (ParseError, LookupError, ValueError) as error:  # also of an unknown encoding
        raise _not_wmts(f"no valid XML ({str(error).partition(':')[0][:MAX_TEXT]})") from None
    if kind in ("exceptionreport", "serviceexceptionreport"):
        said = " ".join(" ".join(root.itertext()).split())
        raise PlanError("The WMTS service", f"it refuses: {_shown(said)}", _FIX, field="url")
    if _local_name(root) != "capabilities":
        raise _not_wmts(f"XML of the kind <{_local_name(root)[:MAX_TEXT]}>")
    return root


def _not_wmts(what: str) -> PlanError:
    return PlanError("The address", f"its answer is {what}, not the description of WMTS", _FIX, field="url")


def _zooms(matrix_set: Element) -> _Zooms | None:
    """The zooms of a tile matrix set; None: it is not the one of web maps."""
    if _MERCATOR.search(_text(matrix_set, "supportedcrs")) is None:
        return None
    names: dict[int, str] = {}
    for matrix in _children(matrix_set, "tilematrix"):
        zoom = _zoom_of(matrix)
        if zoom is not None:
            names[zoom] = _text(matrix, "identifier")
    first = min(names, default=0)
    placeholder = next((each for each in _placeholders(names.get(first, ""), first)), None)
    if placeholder is None:
        return None
    last = first  # zooms after a gap, or with another kind of name, are not used
    while last + 1 in names and names[last + 1] == _named(placeholder, last + 1):
        last += 1
    return _Zooms(placeholder, first, last)


def _zoom_of(matrix: Element) -> int | None:
    """The zoom whose tiles a matrix has; None: they are not those of web maps."""
    width_px, height_px = _text(matrix, "tilewidth"), _text(matrix, "tileheight")
    if width_px not in TILE_SIDES_PX or height_px != width_px:
        return None
    try:
        side_m = float(_text(matrix, "scaledenominator")) * PIXEL_M * int(width_px)
        west_m, north_m = map(float, _text(matrix, "topleftcorner").split())
        zoom = round(math.log2(WORLD_M / side_m))
    except (ValueError, ZeroDivisionError, OverflowError):
        return None
    corner_off_m = max(abs(west_m + WORLD_M / 2), abs(north_m - WORLD_M / 2))
    is_web = abs(side_m * 2.0**zoom / WORLD_M - 1) < 1e-4 and corner_off_m <= CORNER_TOLERANCE_M
    return zoom if is_web and 0 <= zoom <= MAX_ZOOM else None


def _placeholders(name: str, zoom: int) -> Iterator[str]:
    """How the names of the matrices of a set may go on, from the name of its first."""
    for digits, placeholder in ((f"{zoom:02d}", "{zz}"), (str(zoom), "{z}")):
        if name.endswith(digits):
            yield quote(name.removesuffix(digits), safe=":") + placeholder


def _named(placeholder: str, zoom: int) -> str:
    return unquote(placeholder.replace("{zz}", f"{zoom:02d}").replace("{z}", str(zoom)))


def _layer(layer: Element, all_zooms: dict[str, _Zooms], kvp: str | None) -> WmtsLayer | None:
    """A layer of images; None: the map cannot show it."""
    link = next(
        (each for each in _children(layer, "tilematrixsetlink") if _text(each, "tilematrixset") in all_zooms),
        None,
    )
    if link is None:
        return None
    zooms = all_zooms[_text(link, "tilematrixset")]
    limits = [_text(each, "tilematrix") for each in link.iter() if _local_name(each) == "tilematrixlimits"]
    known = [z for z in range(zooms.first, zooms.last + 1) if _named(zooms.placeholder, z) in limits]
    try:
        url = address_of_tiles(_address(layer, _text(link, "tilematrixset"), zooms.placeholder, kvp))
    except (InvalidRequest, LookupError):
        return None
    name = _shown(_text(layer, "title") or _text(layer, "identifier")) or "?"
    return WmtsLayer(name, url, min(known, default=zooms.first), max(known, default=zooms.last))


def _address(layer: Element, matrix_set: str, zoom: str, kvp: str | None) -> str:
    """The address of a layer's tiles, as the service writes it; LookupError: there is none of images."""
    styles = list(_children(layer, "style"))
    style = next((each for each in styles if each.get("isDefault") in ("true", "1")), (*styles, None)[0])
    values = {
        "style": _text(style, "identifier"),
        "tilematrixset": matrix_set,
        **{
            _text(each, "identifier").lower(): _text(each, "default")
            for each in _children(layer, "dimension")
        },
    }
    own = {"tilematrix": zoom, "tilerow": "{y}", "tilecol": "{x}"}
    quoted = {name: quote(value, safe=":,") for name, value in values.items()} | own
    for resource in _children(layer, "resourceurl"):
        if resource.get("resourceType") == "tile" and _is_image(resource.get("format", "")):
            return _PLACEHOLDER.sub(lambda m: quoted.get(m[1].lower(), m[0]), resource.get("template", ""))
    image = next(
        (text for each in _children(layer, "format") if _is_image(text := (each.text or "").strip())), ""
    )
    if kvp is None or not image:
        raise LookupError
    request = {
        "service": "WMTS", "request": "GetTile", "version": "1.0.0", "layer": _text(layer, "identifier"),
        "format": image, **values,
    }  # fmt: skip
    pairs = [f"{name.upper()}={quote(value, safe=':,/')}" for name, value in request.items()]
    pairs += [f"{name.upper()}={placeholder}" for name, placeholder in own.items()]
    separator = "" if kvp.endswith(("?", "&")) else "&" if "?" in kvp else "?"
    return f"{kvp}{separator}{'&'.join(pairs)}"


def _kvp_address(root: Element) -> str | None:
    """The address that answers GetTile with parameters; None: the service has none."""
    for operation in _children(_child(root, "operationsmetadata"), "operation"):
        if operation.get("name") == "GetTile":
            for get in (each for each in operation.iter() if _local_name(each) == "get"):
                encodings = [each.text for each in get.iter() if _local_name(each) == "value"]
                if "KVP" in encodings or not encodings:
                    return get.get(_HREF)
    return None


def _is_image(media_type: str) -> bool:
    return media_type.partition(";")[0].strip().lower() in IMAGES


def _shown(text: str) -> str:
    """A text of the service on one line, cut."""
    line = "".join(each for each in " ".join(text.split()) if each.isprintable())
    return line if len(line) <= MAX_TEXT else line[: MAX_TEXT - 1] + "…"


def _local_name(element: Element) -> str:
    """The name of an element without its namespace, in small letters."""
    return element.tag.rpartition("}")[2].lower()


def _children(element: Element | None, name: str) -> Iterator[Element]:
    return iter(()) if element is None else (each for each in element if _local_name(each) == name)


def _child(element: Element | None, name: str) -> Element | None:
    return next(_children(element, name), None)


def _text(element: Element | None, name: str) -> str:
    found = _child(element, name)
    return "" if found is None or found.text is None else found.text.strip()
