"""Channels with the schemas that Foxglove draws without a setting (docs.foxglove.dev, "Schemas")."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_server.logbook.exports.tracks import Track, tracks
from gcs_server.logbook.log import Log, Message, Times, Topic

Drawn = tuple[str, str, bytes, Times, Callable[[int, int], Sequence[bytes]]]
"""Topic, name and content of the schema, times, messages from one index to another."""
PREFIX = "foxglove."
LOG = f"{PREFIX}Log"
WORLD, BODY = "local_enu", "vehicle_flu"
LEVELS = (5, 5, 4, 4, 3, 2, 2, 1)
"""Level of foxglove.Log (fatal 5 to debug 1) by MAV_SEVERITY."""
_NUMBER = {"type": "number"}
_TIME = {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}


def _schema(title: str, **properties: Any) -> bytes:
    return json.dumps({"title": title, "type": "object", "properties": properties}).encode()


def _xyz(*names: str) -> dict[str, Any]:
    return {"type": "object", "properties": dict.fromkeys(names, _NUMBER)}


_TEXT = {"type": "string"}
_FIX = _schema(
    f"{PREFIX}LocationFix",
    timestamp=_TIME,
    frame_id=_TEXT,
    latitude=_NUMBER,
    longitude=_NUMBER,
    altitude={**_NUMBER, "description": "above mean sea level [m]"},
)
_LOG = _schema(
    LOG,
    timestamp=_TIME,
    level={"type": "integer"},
    message=_TEXT,
    name=_TEXT,
    severity={"type": "integer", "description": "MAV_SEVERITY"},
)
_TRANSFORM = _schema(
    f"{PREFIX}FrameTransform",
    timestamp=_TIME,
    parent_frame_id=_TEXT,
    child_frame_id=_TEXT,
    translation=_xyz("x", "y", "z"),
    rotation=_xyz("x", "y", "z", "w"),
)


def drawn_channels(log: Log, start_ns: int) -> Iterator[Drawn]:
    """The track of each vehicle, the pose of the log's own vehicle, and its messages."""
    found = tracks(log)
    for track in found:
        name = "/track" if len(found) == 1 else f"/track/{track.vehicle}"
        yield name, f"{PREFIX}LocationFix", _FIX, track.times_s, _fixes(track, start_ns)
    if (pose := _pose(log, start_ns)) is not None:
        yield pose
    if log.messages:
        times_s = np.array([each.t_s for each in log.messages])
        yield "/log", LOG, _LOG, times_s, _logs(log.messages, start_ns)


def _stamp(start_ns: int, t_s: float) -> dict[str, int]:
    seconds, nanoseconds = divmod(max(0, start_ns + round(t_s * 1e9)), 1_000_000_000)
    return {"sec": seconds, "nsec": nanoseconds}


def _fixes(track: Track, start_ns: int) -> Callable[[int, int], list[bytes]]:
    def messages(first: int, end: int) -> list[bytes]:
        part = slice(first, end)
        columns = (track.times_s, track.lat_deg, track.lon_deg, track.alt_amsl_m)
        return [
            json.dumps(
                {
                    "timestamp": _stamp(start_ns, t_s),
                    "frame_id": BODY,
                    "latitude": lat,
                    "longitude": lon,
                    "altitude": alt,
                }
            ).encode()
            for t_s, lat, lon, alt in zip(*(each[part].tolist() for each in columns), strict=True)
        ]

    return messages


def _logs(texts: Sequence[Message], start_ns: int) -> Callable[[int, int], list[bytes]]:
    def messages(first: int, end: int) -> list[bytes]:
        return [
            json.dumps(
                {
                    "timestamp": _stamp(start_ns, each.t_s),
                    "level": LEVELS[min(7, max(0, each.severity))],
                    "message": each.text,
                    "name": "",
                    "severity": each.severity,
                }
            ).encode()
            for each in texts[first:end]
        ]

    return messages


def _pose(log: Log, start_ns: int) -> Drawn | None:
    """The estimated pose at each sample of the position; None: the log has none of one vehicle alone."""
    position = _topic(log, "vehicle_local_position", ("x", "y", "z"))
    attitude = _topic(log, "vehicle_attitude", ("q[0]", "q[1]", "q[2]", "q[3]"))
    if position is None or attitude is None:
        return None

    def messages(first: int, end: int) -> list[bytes]:
        times_s = np.asarray(position.times_s[first:end])
        north, east, down = (np.nan_to_num(position.columns[axis][first:end].astype(float)) for axis in "xyz")
        at = np.clip(np.searchsorted(attitude.times_s, times_s, "right") - 1, 0, None)
        q = np.stack([attitude.columns[f"q[{i}]"][at].astype(float) for i in range(4)])
        rotations = _enu_flu(np.nan_to_num(q)).T.tolist()
        places = zip(east.tolist(), north.tolist(), (-down).tolist(), strict=True)
        return [
            json.dumps(
                {
                    "timestamp": _stamp(start_ns, t_s),
                    "parent_frame_id": WORLD,
                    "child_frame_id": BODY,
                    "translation": dict(zip("xyz", place, strict=True)),
                    "rotation": dict(zip("wxyz", rotation, strict=True)),
                }
            ).encode()
            for t_s, place, rotation in zip(times_s.tolist(), places, rotations, strict=True)
        ]

    return "/tf", f"{PREFIX}FrameTransform", _TRANSFORM, position.times_s, messages


def _topic(log: Log, name: str, fields: Sequence[str]) -> Topic | None:
    if log.kind == "tlog":
        return None
    named = [topic for topic in log.topics if topic.name == name]
    same = [topic for topic in named if all(each in topic.columns for each in fields)]
    return same[0] if len(same) == 1 else None


def _enu_flu(q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Quaternions (4, N) wxyz that take FRD to NED, as those that take FLU to ENU."""
    w, x, y, z = q
    half = np.sqrt(0.5)
    return half * np.stack((w + z, x + y, x - y, w - z))
