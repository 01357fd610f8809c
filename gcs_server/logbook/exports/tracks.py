"""The flown path of each vehicle of a log, and its files: GeoJSON and KML. Altitudes are above mean sea level
(AMSL), as the vehicle estimates them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from gcs_server.logbook.exports.sink import Sink
from gcs_server.logbook.log import Log, Times
from gcs_server.logbook.logged_flights import own_topics

Values = NDArray[np.float64]

_SOURCES = (
    ("vehicle_global_position", ("lat", "lon", "alt"), 1.0, 1.0),
    ("GLOBAL_POSITION_INT", ("lat", "lon", "alt"), 1e-7, 1e-3),
    ("vehicle_gps_position", ("latitude_deg", "longitude_deg", "altitude_msl_m"), 1.0, 1.0),
    ("vehicle_gps_position", ("lat", "lon", "alt"), 1e-7, 1e-3),
    ("sensor_gps", ("latitude_deg", "longitude_deg", "altitude_msl_m"), 1.0, 1.0),
    ("GPS_RAW_INT", ("lat", "lon", "alt"), 1e-7, 1e-3),
)
"""Topic, its fields, and the units of its degrees and metres; the first that a log has: the estimates, then
what a GPS receiver says."""
ALTITUDE = "metres above mean sea level (AMSL), by the vehicle's estimate"
_PIECE = 5000


@dataclass(frozen=True, slots=True)
class Track:
    """The path of one vehicle."""

    vehicle: str
    """MAVLink system id; empty: not known."""
    topic: str
    """The topic that it is from."""
    times_s: Times
    lat_deg: Values
    lon_deg: Values
    alt_amsl_m: Values


def tracks(log: Log, from_s: float | None = None, to_s: float | None = None) -> list[Track]:
    """The paths of the vehicles that have at least two positions in a window of time."""
    found = [_track(log, vehicle.id) for vehicle in log.vehicles] or [_track(log, "")]
    parts = [_window(track, from_s, to_s) for track in found if track is not None]
    return [part for part in parts if len(part.times_s) > 1]


def _track(log: Log, vehicle: str) -> Track | None:
    topics = own_topics(log, vehicle)
    for name, fields, degrees, metres in _SOURCES:
        for topic in topics:
            columns = [topic.columns.get(field) for field in fields]
            if topic.name != name or any(each is None for each in columns):
                continue
            lat, lon, alt = (np.asarray(each).astype(np.float64) for each in columns)
            lat, lon, alt = lat * degrees, lon * degrees, alt * metres
            known = np.isfinite(lat) & np.isfinite(lon) & np.isfinite(alt)
            known &= (np.abs(lat) <= 90) & (np.abs(lon) <= 180) & (np.abs(alt) < 1e5)
            known &= (lat != 0) | (lon != 0)
            if np.any(known):
                return Track(
                    vehicle, topic.id, np.asarray(topic.times_s)[known], lat[known], lon[known], alt[known]
                )
    return None


def _window(track: Track, from_s: float | None, to_s: float | None) -> Track:
    first = 0 if from_s is None else int(np.searchsorted(track.times_s, from_s, "left"))
    end = None if to_s is None else int(np.searchsorted(track.times_s, to_s, "right"))
    part = slice(first, end)
    return Track(
        track.vehicle,
        track.topic,
        track.times_s[part],
        track.lat_deg[part],
        track.lon_deg[part],
        track.alt_amsl_m[part],
    )


def write_geojson(sink: Sink, log: Log, found: Sequence[Track]) -> None:
    """Writes tracks as a FeatureCollection of lines, with `t_s` and (if the start is known) `coordTimes` of
    each position."""
    sink.write('{"type": "FeatureCollection", "features": [')
    for n, track in enumerate(found):
        properties = {"vehicle": track.vehicle, "topic": track.topic, "altitude": ALTITUDE}
        sink.write(f'{", " if n else ""}{{"type": "Feature", "properties": {json.dumps(properties)[:-1]}')
        _list(sink, ', "t_s": [', (f"{t_s:.3f}" for t_s in track.times_s.tolist()))
        if log.start_unix_s is not None:
            _list(sink, ', "coordTimes": [', (f'"{when}"' for when in _times(track, log.start_unix_s)))
        points = (f"[{point}]" for point in _points(track, ", "))
        _list(sink, '}, "geometry": {"type": "LineString", "coordinates": [', points)
        sink.write("}}")
    sink.write("]}\n")


def write_kml(sink: Sink, log: Log, name: str, found: Sequence[Track]) -> None:
    """Writes tracks as lines in absolute altitude, if the start is known also as a `gx:Track` with times."""
    sink.write(
        '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2" '
        f'xmlns:gx="http://www.google.com/kml/ext/2.2"><Document><name>{escape(name)}</name>\n'
        f"<description>Altitudes: {escape(ALTITUDE)}.</description>\n"
    )
    for track in found:
        title = escape(f"Vehicle {track.vehicle}" if track.vehicle else "Vehicle")
        sink.write(f"<Placemark><name>{title}, flown path</name><LineString>")
        _list(sink, "<altitudeMode>absolute</altitudeMode><coordinates>", _points(track, ","), " ", "")
        sink.write("</coordinates></LineString></Placemark>\n")
        if log.start_unix_s is not None:
            sink.write(f"<Placemark><name>{title}, with times</name><gx:Track>")
            whens = (f"<when>{when}</when>" for when in _times(track, log.start_unix_s))
            _list(sink, "<altitudeMode>absolute</altitudeMode>", whens, "\n", "")
            coords = (f"<gx:coord>{point}</gx:coord>" for point in _points(track, " "))
            _list(sink, "", coords, "\n", "")
            sink.write("</gx:Track></Placemark>\n")
    sink.write("</Document></kml>\n")


def _list(sink: Sink, begin: str, texts: Iterator[str], between: str = ", ", end: str = "]") -> None:
    """Writes texts, some thousand at once."""
    sink.write(begin)
    part: list[str] = []
    is_first = True
    for text in texts:
        part.append(text)
        if len(part) == _PIECE:
            sink.write(("" if is_first else between) + between.join(part))
            part, is_first = [], False
    if part:
        sink.write(("" if is_first else between) + between.join(part))
    sink.write(end)


def _points(track: Track, between: str) -> Iterator[str]:
    columns = (track.lon_deg.tolist(), track.lat_deg.tolist(), track.alt_amsl_m.tolist())
    return (f"{lon:.8f}{between}{lat:.8f}{between}{alt:.3f}" for lon, lat, alt in zip(*columns, strict=True))


def _times(track: Track, start_unix_s: float) -> Iterator[str]:
    for t_s in track.times_s.tolist():
        when = datetime.fromtimestamp(start_unix_s + t_s, UTC)
        yield when.isoformat(timespec="milliseconds").replace("+00:00", "Z")
