"""The overview of a log, as JSON: what it has, without the plotted values."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import msgspec
import numpy as np

from gcs_server.logbook.log import MAX_MESSAGES, Log, Topic
from gcs_server.logbook.logged_flights import flights_of


def overview(log: Log) -> dict[str, Any]:
    """The overview as plain values. Of too many messages, the most severe are kept."""
    kept = sorted(sorted(log.messages, key=lambda m: m.severity)[:MAX_MESSAGES], key=lambda m: m.t_s)
    return {
        "kind": log.kind,
        "start_unix_s": log.start_unix_s,
        "duration_s": log.duration_s,
        "firmware": log.firmware,
        "hardware": log.hardware,
        "vehicles": [asdict(vehicle) for vehicle in log.vehicles],
        "flights": flights_of(log),
        "topics": [_topic(topic) for topic in log.topics],
        "parameters": [{"name": name, "value": value} for name, value in sorted(log.parameters.items())],
        "parameter_changes": [
            {"t_s": t_s, "name": name, "value": value} for t_s, name, value in log.parameter_changes
        ],
        "messages": [asdict(message) for message in kept],
        "messages_left_out": len(log.messages) - len(kept),
        "dropouts": [{"t_s": t_s, "duration_s": duration_s} for t_s, duration_s in log.dropouts],
        "problems": log.problems,
    }


def encode(log: Log) -> bytes:
    """The overview as JSON."""
    return msgspec.json.encode(overview(log))


def _topic(topic: Topic) -> dict[str, Any]:
    samples = len(topic.times_s)
    begin_s, end_s = float(topic.times_s[0]), float(topic.times_s[-1])
    return {
        "id": topic.id,
        "name": topic.name,
        "instance": topic.instance,
        "samples": samples,
        "begin_s": begin_s,
        "end_s": end_s,
        "rate_hz": (samples - 1) / (end_s - begin_s) if end_s > begin_s else None,
        "fields": [
            {"name": name, "unit": topic.units.get(name), "type": np.dtype(values.dtype).name}
            for name, values in topic.columns.items()
        ],
    }
