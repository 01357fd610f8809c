"""Sources of tiles: the usual ones, the operator's own, and which of them is used. There is one such list
for the map and one for the heights of the ground.

No source is chosen until an operator chooses one, and only the chosen source is asked for tiles.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Annotated
from urllib.parse import parse_qsl, urlsplit

from annotated_types import Ge, Le, MaxLen

from gcs_server.errors import GcsError, InvalidRequest, Refused
from gcs_server.storage.files import typed
from gcs_server.storage.records import Records, Unreadable

MAX_OWN_SOURCES = 50
MAX_ADDRESS_LENGTH = 1000
RECORD = "sources"
_PLACEHOLDER = re.compile(r"\{([^{}]*)\}")
_CANONICAL = {
    "z": "{z}", "x": "{x}", "y": "{y}", "-y": "{-y}", "q": "{q}", "quadkey": "{q}",
    "zoom": "{z}", "tilematrix": "{z}", "tilerow": "{y}", "tilecol": "{x}", "s": "a", "zz": "{zz}",
}  # fmt: skip
"""Placeholders by the names that other programs use for them. `{s}` is one of several equal servers; `{zz}`
is the zoom in two digits, as some WMTS services name it."""
_KVP = {"tilematrix": "{z}", "tilerow": "{y}", "tilecol": "{x}"}


class UnknownSource(GcsError):
    """There is no map source with this id."""

    code = "unknown_map_source"


@dataclass(frozen=True, slots=True)
class MapSource:
    """A source of tiles in the web's Mercator projection (EPSG:3857): images, 256 or 512 px wide, or those
    of a PMTiles archive."""

    id: str
    name: str
    url: Annotated[str, MaxLen(MAX_ADDRESS_LENGTH)]
    """Address of a tile with `{z}`, `{x}` and `{y}` (from the north), `{-y}` (from the south), or `{q}` (a
    quadkey); or of a PMTiles archive."""
    attribution: str
    """What the licence of the map asks to be shown."""
    max_zoom: Annotated[int, Ge(0), Le(24)]
    may_save: bool
    """Whether the terms of the source allow saving the tiles of a region for later."""
    min_zoom: Annotated[int, Ge(0), Le(24)] = 0

    @property
    def host(self) -> str:
        """The computer that learns which tiles are viewed."""
        return urlsplit(self.url).netloc.rpartition("@")[2]

    @property
    def is_archive(self) -> bool:
        """Whether the tiles are in one PMTiles archive."""
        return _is_archive(self.url)

    def tile_url(self, zoom: int, x: int, y: int) -> str:
        """Address of a tile, y counted from the north."""
        values = {
            "z": zoom,
            "zz": f"{zoom:02d}",
            "x": x,
            "y": y,
            "-y": (1 << zoom) - 1 - y,
            "q": _quadkey(zoom, x, y),
        }
        return _PLACEHOLDER.sub(lambda found: str(values[found[1]]), self.url)


def _is_archive(address: str) -> bool:
    return urlsplit(address).path.lower().endswith(".pmtiles") and "{" not in address


def _quadkey(zoom: int, x: int, y: int) -> str:
    return "".join(str((x >> bit & 1) | (y >> bit & 1) << 1) for bit in range(zoom - 1, -1, -1))


USUAL = (
    MapSource(
        "osm",
        "OpenStreetMap",
        "https://tile.openstreetmap.org/{z}/{x}/{y}.png",
        "© OpenStreetMap contributors",
        19,
        may_save=False,
    ),
    MapSource(
        "opentopomap",
        "OpenTopoMap",
        "https://tile.opentopomap.org/{z}/{x}/{y}.png",
        "© OpenStreetMap contributors, SRTM · © OpenTopoMap (CC-BY-SA)",
        17,
        may_save=False,
    ),
    MapSource(
        "esri_imagery",
        "Esri World Imagery",
        "https://server.arcgisonline.com/ArcGIS/rest/services/World_Imagery/MapServer/tile/{z}/{y}/{x}",
        "Esri, Maxar, Earthstar Geographics and the GIS user community",
        19,
        may_save=False,
    ),
)
"""Their terms allow viewing with attribution, and none of them allows saving a region."""
USUAL_ELEVATION = (
    MapSource(
        "terrain_tiles",
        "Terrain Tiles",
        "https://s3.amazonaws.com/elevation-tiles-prod/terrarium/{z}/{x}/{y}.png",
        "Terrain Tiles: Mapzen; SRTM, NED, GMTED and ETOPO1 (USGS, NOAA), ArcticDEM, EU-DEM and others",
        15,
        may_save=True,
    ),
)
"""Open data on Amazon's servers, in the Terrarium encoding."""


def check_address(address: str) -> None:
    """Raises InvalidRequest if this is not the address of something on a computer of the web."""
    try:
        parts = urlsplit(address)
        is_web = parts.scheme in ("http", "https") and bool(parts.hostname)
    except ValueError:  # brackets that are no IPv6 address
        is_web = False
    if not is_web:
        raise InvalidRequest("url", "The address must begin with http:// or https:// and name a computer.")
    if len(address) > MAX_ADDRESS_LENGTH or not address.isprintable() or " " in address:
        raise InvalidRequest("url", "The address has spaces or is too long.")


def address_of_tiles(address: str) -> str:
    """The address with this server's placeholders, from what other programs and services call them: an XYZ
    template, a WMTS template, the address of one WMTS tile with its parameters, or of a PMTiles archive.

    Raises:
        InvalidRequest: it is no address of tiles; says why.
    """
    check_address(address)
    parts = urlsplit(address)
    if _is_archive(address):
        return address
    keys = {key.lower(): value for key, value in parse_qsl(parts.query, keep_blank_values=True)}
    if keys.get("request", "").lower() == "getcapabilities":
        raise InvalidRequest(
            "url",
            "This is the description of a WMTS service, not the address of its tiles.",
            remedy="POST /map_sources/wmts_layers reads its layers and the addresses of their tiles.",
        )
    if keys.get("request", "").lower() == "gettile":
        address = address.replace(parts.query, "&".join(_kvp(pair) for pair in parts.query.split("&")))
    unknown = sorted({p for p in _PLACEHOLDER.findall(address) if p.lower() not in _CANONICAL})
    if unknown:
        raise InvalidRequest(
            "url",
            f"The address has {{{unknown[0]}}}, which has no value here.",
            remedy="Replace it with its value; {z}, {x}, {y} or {TileMatrix}, {TileCol}, {TileRow} stay.",
        )
    address = _PLACEHOLDER.sub(lambda found: _CANONICAL[found[1].lower()], address)
    has_rows = "{y}" in address or "{-y}" in address
    if "{q}" not in address and not (
        ("{z}" in address or "{zz}" in address) and "{x}" in address and has_rows
    ):
        raise InvalidRequest(
            "url",
            "The address names no tile: {z}, {x} and {y} are missing.",
            remedy="For example https://tiles.example.org/{z}/{x}/{y}.png, or a .pmtiles file's address.",
        )
    return address


def _kvp(pair: str) -> str:
    """A parameter of a WMTS request; the numbers of its tile become placeholders."""
    key, _, value = pair.partition("=")
    placeholder = _KVP.get(key.lower())
    if placeholder is None or "{" in value:
        return pair
    return f"{key}={re.sub('[0-9]+$', '', value)}{placeholder}"


@dataclass(frozen=True, slots=True)
class _Stored:
    chosen: str | None
    own: tuple[MapSource, ...]


class MapSources:
    """The sources, and the chosen one; stored by the server, for all browsers.

    Args:
        records: where they are stored.
        usual: the sources that always exist.
        what: what they are sources of, for texts.
    """

    def __init__(
        self, records: Records, usual: tuple[MapSource, ...] = USUAL, what: str = "map source"
    ) -> None:
        self._records = records
        self._usual = usual
        self.what = what
        self._stored = _Stored(None, ())
        self._problem: str | None = None

    def load(self) -> None:
        """Reads the stored sources; blocks. A file that cannot be read is kept, and nothing is chosen."""
        try:
            record = self._records.read_all().get(RECORD)
            if isinstance(record, Unreadable):
                raise ValueError(str(record))
            if record is not None:
                self._stored = typed(_Stored, record)
        except (OSError, ValueError) as error:
            path = self._records.folder / f"{RECORD}.json"
            self._problem = f"The {self.what}s in {path} cannot be read: {error}."

    def warnings(self) -> str | None:
        """Why the stored sources cannot be used."""
        return self._problem

    def all(self) -> tuple[MapSource, ...]:
        """The usual sources, then the operator's own."""
        return (*self._usual, *self._stored.own)

    def get(self, source_id: str) -> MapSource:
        """A source. Raises UnknownSource."""
        found = next((each for each in self.all() if each.id == source_id), None)
        if found is None:
            known = ", ".join(each.id for each in self.all())
            raise UnknownSource(f"There is no {self.what} {source_id!r}.", remedy=f"The sources are {known}.")
        return found

    @property
    def chosen(self) -> MapSource | None:
        """The source that is used; None: none."""
        return next((each for each in self.all() if each.id == self._stored.chosen), None)

    def is_own(self, source: MapSource) -> bool:
        """Whether an operator added this source."""
        return source in self._stored.own

    def choose(self, source_id: str | None) -> None:
        """Chooses a source, or none. Raises UnknownSource."""
        self._store(None if source_id is None else self.get(source_id).id, self._stored.own)

    def add(
        self, name: str, url: str, attribution: str, max_zoom: int, *, may_save: bool, min_zoom: int = 0
    ) -> MapSource:
        """Adds a source of the operator's own.

        Raises:
            InvalidRequest: the address is not usable, or the name is taken.
            Refused: there are too many.
        """
        if min_zoom > max_zoom:
            raise InvalidRequest("min_zoom", "The smallest zoom must not be above the largest.")
        if any(each.name == name for each in self.all()):
            raise InvalidRequest("name", f"There is a {self.what} {name!r} already.")
        if len(self._stored.own) >= MAX_OWN_SOURCES:
            raise Refused(f"There are {MAX_OWN_SOURCES} own {self.what}s.", remedy="Remove one first.")
        taken = {each.id for each in self.all()}
        source_id = next(each for n in range(1, MAX_OWN_SOURCES + 2) if (each := f"own{n}") not in taken)
        source = MapSource(source_id, name, address_of_tiles(url), attribution, max_zoom, may_save, min_zoom)
        self._store(self._stored.chosen, (*self._stored.own, source))
        return source

    def remove(self, source_id: str) -> None:
        """Removes one of the operator's own sources.

        Raises:
            UnknownSource: there is no such source.
            Refused: it is one of the usual sources.
        """
        source = self.get(source_id)
        if not self.is_own(source):
            raise Refused(f"{source.name} is one of the usual sources, which stay.", remedy="Choose another.")
        chosen = self._stored.chosen
        own = tuple(each for each in self._stored.own if each != source)
        self._store(None if chosen == source_id else chosen, own)

    def _store(self, chosen: str | None, own: tuple[MapSource, ...]) -> None:
        if self._problem is not None:
            raise Refused(self._problem, remedy="Mend or remove that file, and start the server again.")
        self._stored = _Stored(chosen, own)
        record: Mapping[str, object] = {"chosen": chosen, "own": [asdict(each) for each in own]}
        self._records.write(RECORD, record)

    def close(self) -> None:
        """Waits for pending writes."""
        self._records.close()
