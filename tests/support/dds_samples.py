"""Messages that a real PX4 published, one for each ROS 2 topic."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from gcs_server.ros2.message_types import MESSAGES, VERSIONS, convert

_FILE = Path(__file__).parents[1] / "data" / "px4_dds_samples.jsonl"


def base_name(topic: str) -> str:
    """A topic's name without the version of its message."""
    return re.sub(r"_v\d+$", "", topic)


def recorded_samples() -> dict[str, bytes]:
    """The CDR bytes of the last recorded message of each topic of v1.16, by PX4's name of the topic."""
    return {line["topic"]: bytes.fromhex(line["cdr_hex"]) for line in _lines()}


def server_samples() -> dict[str, bytes]:
    """The recorded messages in the layouts that the server uses inside, by topic without version."""
    samples: dict[str, bytes] = {}
    for line in _lines():
        source, target = VERSIONS["1.16"][line["type"]], MESSAGES[line["type"]]
        samples[base_name(line["topic"])] = convert(bytes.fromhex(line["cdr_hex"]), source, target)
    return samples


def _lines() -> list[dict[str, Any]]:
    return [json.loads(line) for line in _FILE.read_text().splitlines()]
