"""The server's own ROS 2 message types equal the types of PX4 v1.16."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from gcs_server.ros2.message_types import HEADER, MESSAGES, SHOWN, MalformedMessage
from tests.support.dds_samples import recorded_samples


def test_layouts_match_the_published_types(reference_data: Path) -> None:
    published = json.loads((reference_data / "px4" / "dds" / "types.json").read_text())["types"]
    for name, message in SHOWN.items():
        if name not in published:  # a type inside a published type
            assert name == "PositionSetpoint"
            continue
        fields = [
            (field, field_type, length or 0)
            for field, field_type, length, _offset in published[name]["fields"]
        ]
        assert [(field.name, field.type, field.length) for field in message.primitive_fields] == fields, name


def test_every_recorded_sample_decodes_to_its_fields(reference_data: Path) -> None:
    checked_types: set[str] = set()
    for line in (reference_data / "px4" / "dds" / "samples.jsonl").read_text().splitlines():
        sample = json.loads(line)
        message = SHOWN.get(sample["type"])
        if message is None:
            continue
        values = message.decode(bytes.fromhex(sample["cdr_hex"]))
        for name, expected in sample["fields"].items():
            if isinstance(expected, int | bool):
                assert values[name] == expected, (sample["topic"], name)
            elif isinstance(expected, float):
                assert math.isclose(values[name], expected, rel_tol=2e-6, abs_tol=1e-12)
        checked_types.add(sample["type"])
    assert len(checked_types) > 22


@pytest.mark.parametrize("topic", recorded_samples())
def test_a_decoded_message_is_encoded_with_the_same_fields_and_its_full_size(topic: str) -> None:
    types_with_other_names = {"vehicle_status_v1": "VehicleStatus", "vehicle_gps_position": "SensorGps"}
    name = topic.rsplit("/", 1)[1]
    message = MESSAGES.get(types_with_other_names.get(name, name.title().replace("_", "")))
    if message is None:
        return  # a topic that the server does not use
    values = message.decode(recorded_samples()[topic])
    assert message.decode(message.encode(values)).keys() == values.keys()
    assert len(message.encode(values)) == len(HEADER) + message.size


@pytest.mark.parametrize(
    ("data", "reason"),
    [(b"", "missing"), (b"\x00\x00\x00\x00" + bytes(200), "little-endian"), (HEADER + bytes(7), "11 bytes")],
)
def test_bytes_that_are_not_a_message_are_refused_with_the_reason(data: bytes, reason: str) -> None:
    with pytest.raises(MalformedMessage, match=reason):
        MESSAGES["VehicleStatus"].decode(data)
