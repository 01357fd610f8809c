"""Messages that a real PX4 published, one for each ROS 2 topic."""

from __future__ import annotations

import json
from pathlib import Path

_FILE = Path(__file__).parents[1] / "data" / "px4_dds_samples.jsonl"


def recorded_samples() -> dict[str, bytes]:
    """The CDR bytes of the last recorded message of each topic."""
    lines = map(json.loads, _FILE.read_text().splitlines())
    return {line["topic"]: bytes.fromhex(line["cdr_hex"]) for line in lines}
