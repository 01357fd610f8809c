"""The ROS 2 message types: recorded bytes decode to recorded fields; encoded bytes equal Cyclone DDS's."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from vehicle_sim.dds.types import idl_dataclass, idl_type
from vehicle_sim.ros2.messages import HEADER, MESSAGES, MalformedMessage

SAMPLES = Path(__file__).parents[2] / "data" / "px4_dds_samples.jsonl"


def _samples(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def _flat(values: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Recorded fields by the names of `MessageType.flat`."""
    for key, value in values.items():
        path_name = f"{name}.{key}" if name else key
        if isinstance(value, dict):
            yield from _flat(value, path_name)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            for n, each in enumerate(value):
                yield from _flat(each, f"{path_name}[{n}]")
        else:
            yield path_name, value


def _equal_or_both_nan(recorded: Any, ours: Any) -> bool:
    if isinstance(recorded, list):
        return len(recorded) == len(ours) and all(map(_equal_or_both_nan, recorded, ours))
    if recorded is None:
        return math.isnan(ours)
    if recorded in ("inf", "-inf") and isinstance(ours, float):
        return ours == float(recorded)
    if isinstance(recorded, float):
        return math.isclose(recorded, ours, rel_tol=2e-6, abs_tol=1e-12)
    return recorded == ours


def _check(sample: dict[str, Any]) -> None:
    message, data = MESSAGES[sample["type"]], bytes.fromhex(sample["cdr_hex"])
    values = message.decode(data)
    differ = {k: (v, values[k]) for k, v in _flat(sample["fields"]) if not _equal_or_both_nan(v, values[k])}
    assert not differ, (sample["topic"], differ)
    # PX4's padding contains old bytes of its buffer; our encoding and Cyclone's have zeros there.
    encoded = message.encode(values)
    assert len(encoded) <= len(data) < len(encoded) + 4
    cyclone = idl_dataclass(message).deserialize(data)
    assert encoded == cyclone.serialize(use_version_2=False)[: len(encoded)], sample["type"]


@pytest.mark.parametrize("sample", _samples(SAMPLES), ids=lambda sample: sample["type"])
def test_a_recorded_sample_decodes_and_encodes(sample):
    _check(sample)


def test_every_recorded_sample_decodes_and_encodes(shared):
    for sample in _samples(shared / "px4" / "dds" / "samples.jsonl"):
        _check(sample)


def test_layout_constants_and_hash_are_those_of_the_published_types(shared):
    published = json.loads((shared / "px4" / "dds" / "types.json").read_text())["types"]
    assert set(published) == set(MESSAGES) - {"PositionSetpoint", "VehicleAngularVelocity"}
    for name, facts in published.items():
        ours = MESSAGES[name]
        assert [[f.name, f.type, f.length or None] for f in ours.flat] == [f[:3] for f in facts["fields"]], (
            name
        )
        assert (ours.constants, ours.size, ours.hash) == (
            facts["constants"], facts["payload_bytes"], facts["message_hash"],
        ), name  # fmt: skip


@pytest.mark.parametrize(
    ("name", "answer"),
    [("ArmingCheckRequest", 2071694766), ("RegisterExtComponentRequest", 902686241),
     ("ActuatorMotors", 3401338181), ("ArmingCheckReply", 65702502)],
)  # fmt: skip
def test_the_hash_equals_px4s_answer(name, answer):
    assert MESSAGES[name].hash == answer


def test_dds_type_names_are_those_of_px4_msgs():
    assert idl_type(MESSAGES["VehicleStatus"]).__idl__.idl_transformed_typename == (
        "px4_msgs::msg::dds_::VehicleStatus_"
    )


@pytest.mark.parametrize("data", [b"", b"\x00", HEADER, HEADER + bytes(13), b"\x00\x00\x00\x00" + bytes(20)])
def test_bytes_that_are_not_a_message_are_refused(data):
    with pytest.raises(MalformedMessage, match="OffboardControlMode"):
        MESSAGES["OffboardControlMode"].decode(data)


def test_a_diverged_estimate_is_sent_as_infinite() -> None:
    message = MESSAGES["VehicleLocalPosition"]
    found = message.decode(message.encode({"x": 1e39, "vx": -1e300, "z": 1.0, "ref_lat": 1e300}))
    assert (found["x"], found["vx"], found["z"], found["ref_lat"]) == (math.inf, -math.inf, 1.0, 1e300)
