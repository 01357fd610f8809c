"""Writes a log as MCAP: each topic as JSON with its schema, and what Foxglove draws by itself: the track as
`foxglove.LocationFix`, the pose as `foxglove.FrameTransform` (ENU, FLU), messages as `foxglove.Log`."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from mcap.writer import CompressionType, Writer

from gcs_server.logbook.exports.foxglove import drawn_channels
from gcs_server.logbook.exports.json_messages import JsonTopic
from gcs_server.logbook.exports.sink import BadExport, Sink
from gcs_server.logbook.log import Log, Times, Topic

WINDOW_MESSAGES = 20_000
"""Messages that are in memory at once: those of a window of time, because readers expect its order."""
MIN_WINDOW_S = 1e-6
METADATA, PARAMETERS = "gcs.log", "gcs.parameters"


@dataclass(frozen=True, slots=True)
class Channel:
    """The messages of one topic of the file."""

    id: int
    times_s: Times
    messages: Callable[[int, int], Sequence[bytes]]
    """Messages from one index to another."""


def require_topics(log: Log, topics: Sequence[str]) -> None:
    """Raises BadExport if the log lacks one of the topics."""
    known = {topic.id for topic in log.topics}
    if (unknown := next((each for each in topics if each not in known), None)) is not None:
        raise BadExport("topic", f"The log has no topic {unknown[:120]!r}.")


def write_mcap(sink: Sink, log: Log, topics: Sequence[str], from_s: float | None, to_s: float | None) -> None:
    """Writes a log.

    Args:
        sink: the file.
        log: the log.
        topics: ids of the topics; empty: all.
        from_s: begin of the window [s since the log's start]; None: the log's.
        to_s: end of the window.
    """
    known = {topic.id: topic for topic in log.topics}
    chosen = [known[each] for each in dict.fromkeys(topics)] or log.topics
    writer = Writer(sink, compression=CompressionType.ZSTD)  # pyright: ignore[reportArgumentType] it only writes
    writer.start(profile="", library="offboard-gcs")
    _write_metadata(writer, log)
    start_ns = round((log.start_unix_s or 0.0) * 1e6) * 1000  # doubles of today have no nanoseconds
    channels = [_channel(writer, topic) for topic in chosen]
    if not topics:
        for name, schema, data, times_s, messages in drawn_channels(log, start_ns):
            number = writer.register_schema(name=schema, encoding="jsonschema", data=data)
            channel = writer.register_channel(topic=name, message_encoding="json", schema_id=number)
            channels.append(Channel(channel, times_s, messages))
    for first_s, end_s in _windows(channels, from_s, to_s):
        messages = [each for channel in channels for each in _messages(channel, first_s, end_s)]
        messages.sort(key=lambda each: each[0])
        for t_s, channel_id, data in messages:
            time_ns = max(0, start_ns + round(t_s * 1e9))
            writer.add_message(channel_id, log_time=time_ns, data=data, publish_time=time_ns)
    writer.finish()


def topic_name(topic: Topic) -> str:
    """Name in the file: `/vehicle_attitude`, `/sensor_baro/1`, `/ATTITUDE/1_1`."""
    return f"/{topic.name}" + ("" if topic.instance == "0" else f"/{topic.instance.replace('.', '_')}")


def _write_metadata(writer: Writer, log: Log) -> None:
    facts = {
        "kind": log.kind,
        "start_unix_s": "" if log.start_unix_s is None else f"{log.start_unix_s:.6f}",
        "firmware": log.firmware or "",
        "hardware": log.hardware or "",
    }
    writer.add_metadata(METADATA, facts)
    if log.parameters:
        writer.add_metadata(PARAMETERS, {name: repr(value) for name, value in log.parameters.items()})


def _channel(writer: Writer, topic: Topic) -> Channel:
    encoded = JsonTopic(topic)
    schema = writer.register_schema(name=topic.name, encoding="jsonschema", data=encoded.schema)
    types = {name: values.dtype.str for name, values in topic.columns.items()}
    channel = writer.register_channel(
        topic=topic_name(topic),
        message_encoding="json",
        schema_id=schema,
        metadata={"id": topic.id, "types": json.dumps(types), "units": json.dumps(topic.units)},
    )
    return Channel(channel, topic.times_s, encoded.messages)


def _count(channels: Sequence[Channel], from_s: float, to_s: float) -> int:
    return sum(
        int(np.searchsorted(each.times_s, to_s, "left") - np.searchsorted(each.times_s, from_s, "left"))
        for each in channels
    )


def _windows(
    channels: Sequence[Channel], from_s: float | None, to_s: float | None
) -> Iterator[tuple[float, float]]:
    """Windows with few enough messages, in order."""
    used = [each for each in channels if len(each.times_s)]
    if not used:
        return
    begin_s = min(float(each.times_s[0]) for each in used) if from_s is None else from_s
    end_s = max(float(each.times_s[-1]) for each in used) if to_s is None else to_s
    waiting = [(begin_s, float(np.nextafter(end_s, np.inf)))]
    while waiting:
        first_s, last_s = waiting.pop()
        if (count := _count(used, first_s, last_s)) == 0:
            continue
        middle_s = (first_s + last_s) / 2
        if count <= WINDOW_MESSAGES or last_s - first_s < MIN_WINDOW_S:
            yield first_s, last_s
        else:
            waiting += [(middle_s, last_s), (first_s, middle_s)]


def _messages(channel: Channel, from_s: float, to_s: float) -> Iterator[tuple[float, int, bytes]]:
    first, end = (int(np.searchsorted(channel.times_s, at_s, "left")) for at_s in (from_s, to_s))
    if first == end:
        return
    times_s = channel.times_s[first:end].tolist()
    for t_s, data in zip(times_s, channel.messages(first, end), strict=True):
        yield t_s, channel.id, data
