"""The layouts of PX4's messages by version: equal to the published ones, and never mixed up."""

from __future__ import annotations

import json
import math
import struct
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_server.ros2.formats import USED
from gcs_server.ros2.message_types import (
    CODES,
    HEADER,
    LAYOUTS,
    MESSAGES,
    VERSIONS,
    MalformedMessage,
    MessageType,
    convert,
    versions_of,
)
from tests.support.dds_samples import recorded_samples

FOLDERS = {"1.16": Path("px4/dds"), "1.17": Path("px4/v1.17/dds")}
"""Recordings of a real PX4 by version."""
PUBLISHED_HASHES = {
    ("1.15", "VehicleStatus"): 0xA492864E, ("1.15", "FailsafeFlags"): 0xD9BC4415,
    ("1.15", "BatteryStatus"): 0xE2FC0296, ("1.15", "VehicleLocalPosition"): 0x2BE8BCB6,
    ("1.15", "VehicleGlobalPosition"): 0xFE346068, ("1.15", "PositionSetpointTriplet"): 0xC8515211,
    ("1.18", "VehicleStatus"): 0x53EE3679, ("1.18", "FailsafeFlags"): 0xBC6BF28C,
    ("1.18", "SensorGps"): 0x2C0D832A, ("1.18", "PositionSetpointTriplet"): 0x30C28670,
    ("main", "FailsafeFlags"): 0x73E41F31, ("main", "HomePosition"): 0x7C107F8D,
}  # fmt: skip
"""FNV-1a of the definitions that px4_msgs publishes for versions without a recording."""


@pytest.mark.parametrize("version", FOLDERS)
def test_layouts_and_hashes_equal_those_that_the_vehicle_confirmed(
    version: str, reference_data: Path
) -> None:
    published = json.loads((reference_data / FOLDERS[version] / "types.json").read_text())["types"]
    compared = VERSIONS[version].keys() & published.keys()
    for name in compared:
        message, offset = VERSIONS[version][name], 0
        fields: list[tuple[Any, ...]] = []
        for field in message.primitive_fields:
            size = CODES[field.type][1]
            offset += -offset % size
            fields.append((field.name, field.type, field.length or None, offset))
            offset += size * (field.length or 1)
        assert fields == [tuple(each) for each in published[name]["fields"]], name
        assert (message.hash, message.size) == (
            published[name]["message_hash"],
            published[name]["payload_bytes"],
        )
    assert {use.type for use in USED.values()} <= compared


@pytest.mark.parametrize(("version", "name"), PUBLISHED_HASHES)
def test_the_hash_of_a_version_without_recording_is_that_of_its_published_definition(
    version: str, name: str
) -> None:
    assert VERSIONS[version][name].hash == PUBLISHED_HASHES[version, name]


def test_hashes_name_their_versions() -> None:
    assert versions_of(MESSAGES["TrajectorySetpoint"]) == "v1.15, v1.16, v1.17, v1.18, main"
    assert versions_of(VERSIONS["1.16"]["FailsafeFlags"]) == "v1.16"
    assert "RegisterExtComponentRequest" not in VERSIONS["1.18"], "its meaning is not known"


@pytest.mark.parametrize("version", FOLDERS)
def test_every_recorded_sample_decodes_to_its_fields(version: str, reference_data: Path) -> None:
    checked_types: set[str] = set()
    for line in (reference_data / FOLDERS[version] / "samples.jsonl").read_text().splitlines():
        sample = json.loads(line)
        message = VERSIONS[sample.get("layout", version).removeprefix("v")].get(sample["type"])
        if message is None:
            continue
        values = message.decode(bytes.fromhex(sample["cdr_hex"]))
        inside = MESSAGES[message.name].decode(
            convert(bytes.fromhex(sample["cdr_hex"]), message, MESSAGES[message.name])
        )
        for name, expected in sample["fields"].items():
            if isinstance(expected, int | bool):
                assert values[name] == expected, (sample["topic"], name)
            elif isinstance(expected, float):
                assert math.isclose(values[name], expected, rel_tol=2e-6, abs_tol=1e-12)
            else:
                continue
            assert inside.get(name, values[name]) == values[name], (sample["topic"], name)
        checked_types.add(sample["type"])
    assert len(checked_types) > 22


def test_a_failsafe_of_v1_17_that_a_v1_16_reader_misread_is_read_right() -> None:
    """In the layout of v1.16 this message said: geofence breached."""
    sent = {"manual_control_signal_lost": True, "gcs_connection_lost": True, "fd_motor_failure": True}
    data = VERSIONS["1.17"]["FailsafeFlags"].encode(sent)
    with pytest.raises(MalformedMessage, match="95 bytes instead of the 90"):
        VERSIONS["1.16"]["FailsafeFlags"].decode(data)
    values = MESSAGES["FailsafeFlags"].decode(data)
    assert {name for name, value in values.items() if value} == sent.keys()


def test_a_field_that_a_version_lacks_has_the_value_for_which_the_version_stands() -> None:
    def inside(version: str, name: str) -> dict[str, Any]:
        message = VERSIONS[version][name]
        return MESSAGES[name].decode(convert(message.encode({}), message, MESSAGES[name]))

    assert inside("1.16", "ArmingCheckRequest")["valid_registrations_mask"] == 0xFFFFFFFF
    assert inside("1.15", "VehicleGlobalPosition")["lat_lon_valid"], "v1.15 publishes only a valid position"
    assert inside("1.15", "VehicleGlobalPosition")["alt_valid"]
    assert not inside("1.15", "FailsafeFlags")["navigator_failure"]
    assert inside("1.18", "FailsafeFlags").keys() == MESSAGES["FailsafeFlags"].defaults.keys() | {
        field.name for field in MESSAGES["FailsafeFlags"].primitive_fields
    }


@pytest.mark.parametrize("topic", recorded_samples())
def test_a_decoded_message_is_encoded_with_the_same_fields_and_its_full_size(topic: str) -> None:
    types_with_other_names = {"vehicle_status_v1": "VehicleStatus", "vehicle_gps_position": "SensorGps"}
    name = topic.rsplit("/", 1)[1]
    message = VERSIONS["1.16"].get(types_with_other_names.get(name, name.title().replace("_", "")))
    if message is None:
        return  # a topic that the server does not know
    values = message.decode(recorded_samples()[topic])
    assert message.decode(message.encode(values)).keys() == values.keys()
    assert len(message.encode(values)) == len(HEADER) + message.size


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "missing"),
        (b"\x00\x00\x00\x00" + bytes(200), "little-endian"),
        (HEADER + bytes(7), "11 bytes"),
        (HEADER + bytes(84), "88 bytes"),
    ],
)
def test_bytes_of_another_length_are_not_a_message_and_the_reason_says_so(data: bytes, reason: str) -> None:
    with pytest.raises(MalformedMessage, match=reason):
        MESSAGES["VehicleStatus"].decode(data)


@st.composite
def messages(draw: st.DrawFn) -> tuple[MessageType, dict[str, Any]]:
    """A layout and values for its fields, with the extremes of each type."""
    message = LAYOUTS[draw(st.sampled_from(sorted(LAYOUTS)))]
    seed = draw(st.binary(min_size=8, max_size=8))
    values: dict[str, Any] = {}
    for number, field in enumerate(message.primitive_fields):
        code, size = CODES[field.type]
        raw = bytes(seed[(number + n) % 8] for n in range(size)) if code != "?" else bytes([seed[0] & 1])
        value = struct.unpack(f"<{code}", raw)[0]
        values[field.name] = (value,) * field.length if field.length else value
    return message, values


@given(messages(), st.sampled_from(sorted(VERSIONS)), st.booleans())
def test_a_message_of_one_version_is_never_read_as_another(
    drawn: tuple[MessageType, dict[str, Any]], version: str, padded: bool
) -> None:
    """In the layout that its hash names, each field has its value; another hash names another layout."""
    message, values = drawn
    data = message.encode(values)
    data += bytes(-(len(data) - len(HEADER)) % 4) if padded else b""
    inside = MESSAGES[message.name].decode(convert(data, message, MESSAGES[message.name]))
    for name, value in inside.items():
        sent = values.get(
            name, message.defaults.get(name, 0 * value if not isinstance(value, tuple) else None)
        )
        assert sent is None or _same(value, sent), name
    other = VERSIONS[version].get(message.name)
    if other is None or other.hash == message.hash:
        return
    if abs(other.size - message.size) >= 4:
        with pytest.raises(MalformedMessage):
            other.decode(data)
    else:
        other_values = other.decode(data) if len(data) in _lengths(other) else {}
        assert other_values.keys() != values.keys()


def _lengths(message: MessageType) -> tuple[int, int]:
    return len(HEADER) + message.size, len(HEADER) + message.size + -message.size % 4


def _same(value: Any, sent: Any) -> bool:
    if isinstance(value, tuple):
        return len(value) == len(sent) and all(map(_same, value, sent))
    return value == sent or (value != value and sent != sent)
