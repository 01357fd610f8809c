"""The ROS 2 message types decode recorded bytes to recorded fields, and encode the same bytes as Cyclone
DDS."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.support.dds_recordings import dds_folder
from vehicle_sim.dds.types import idl_dataclass, idl_type
from vehicle_sim.ros2.messages import HEADER, MESSAGES, MalformedMessage

SAMPLES = Path(__file__).parents[2] / "data" / "px4_dds_samples.jsonl"


def _read_samples(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def _flat_fields(values: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """(name, value) of each recorded field, with the names of `MessageType.flat`."""
    for key, value in values.items():
        path_name = f"{prefix}.{key}" if prefix else key
        if isinstance(value, dict):
            yield from _flat_fields(value, path_name)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            for index, element in enumerate(value):
                yield from _flat_fields(element, f"{path_name}[{index}]")
        else:
            yield path_name, value


def _equals_recorded(recorded: Any, simulated: Any) -> bool:
    """Whether the values are equal in single precision; JSON has null for NaN, and infinity as text."""
    if isinstance(recorded, list):
        return len(recorded) == len(simulated) and all(map(_equals_recorded, recorded, simulated))
    if recorded is None:
        return math.isnan(simulated)
    if recorded in ("inf", "-inf") and isinstance(simulated, float):
        return simulated == float(recorded)
    if isinstance(recorded, float):
        return math.isclose(recorded, simulated, rel_tol=2e-6, abs_tol=1e-12)
    return recorded == simulated


def _check_sample(sample: dict[str, Any], px4: str) -> None:
    message, data = MESSAGES[px4][sample["type"]], bytes.fromhex(sample["cdr_hex"])
    values = message.decode(data)
    differences = {
        k: (v, values[k]) for k, v in _flat_fields(sample["fields"]) if not _equals_recorded(v, values[k])
    }
    assert not differences, (sample["topic"], differences)
    # PX4's padding contains old bytes of its buffer; both encodings end with zeros.
    encoded = message.encode(values)
    assert len(encoded) <= len(data) < len(encoded) + 4
    cyclone = idl_dataclass(message).deserialize(data)
    assert encoded == cyclone.serialize(use_version_2=False)[: len(encoded)], sample["type"]


@pytest.mark.parametrize("sample", _read_samples(SAMPLES), ids=lambda sample: sample["type"])
def test_a_recorded_sample_decodes_and_encodes(sample):
    _check_sample(sample, "1.16")


@pytest.mark.parametrize("px4", sorted(MESSAGES))
def test_every_recorded_sample_decodes_and_encodes(px4):
    samples = _read_samples(dds_folder(px4) / "samples.jsonl")
    own_layout = [each for each in samples if each.get("layout", f"v{px4}") == f"v{px4}"]
    assert len(own_layout) > 90
    for sample in own_layout:
        _check_sample(sample, px4)


@pytest.mark.parametrize("px4", sorted(MESSAGES))
def test_layout_constants_and_hash_match_the_published_types(px4):
    published_types = json.loads((dds_folder(px4) / "types.json").read_text())["types"]
    assert set(MESSAGES[px4]) - set(published_types) <= {"PositionSetpoint", "VehicleAngularVelocity"}
    for name, published in published_types.items():
        if name == "PositionSetpoint":
            continue  # a nested type, whose constants the simulator does not need
        simulated = MESSAGES[px4][name]
        assert [[f.name, f.type, f.length or None] for f in simulated.flat] == [
            f[:3] for f in published["fields"]
        ], name
        assert (simulated.constants, simulated.size, simulated.hash) == (
            published["constants"], published["payload_bytes"], published["message_hash"],
        ), name  # fmt: skip


@pytest.mark.parametrize(
    ("px4", "name", "expected"),
    [("1.16", "ArmingCheckRequest", 2071694766), ("1.16", "RegisterExtComponentRequest", 902686241),
     ("1.16", "ActuatorMotors", 3401338181), ("1.16", "ArmingCheckReply", 65702502),
     ("1.17", "ArmingCheckRequest", 1848233421), ("1.17", "FailsafeFlags", 1776302583),
     ("1.17", "ActuatorMotors", 3401338181), ("1.17", "ArmingCheckReply", 2083851748)],
)  # fmt: skip
def test_the_message_hash_equals_the_hash_that_px4_sends(px4, name, expected):
    assert MESSAGES[px4][name].hash == expected


def test_types_that_did_not_change_are_the_same_in_both_versions():
    old, new = MESSAGES["1.16"], MESSAGES["1.17"]
    changed = {name for name in old if new[name] is not old[name]}
    assert changed == {
        "AirspeedValidated", "ArmingCheckReply", "ArmingCheckRequest", "BatteryStatus",
        "EstimatorStatusFlags", "Event", "FailsafeFlags", "HomePosition", "SensorGps",
        "VehicleAttitudeSetpoint", "VehicleCommand", "VehicleLocalPosition", "VehicleStatus",
    }  # fmt: skip
    assert len(new.keys() - old.keys()) == 14


def test_dds_type_names_match_px4_msgs():
    assert idl_type(MESSAGES["1.17"]["VehicleStatus"]).__idl__.idl_transformed_typename == (
        "px4_msgs::msg::dds_::VehicleStatus_"
    )


@pytest.mark.parametrize("data", [b"", b"\x00", HEADER, HEADER + bytes(13), b"\x00\x00\x00\x00" + bytes(20)])
def test_bytes_that_are_not_a_message_are_refused(data):
    with pytest.raises(MalformedMessage, match="OffboardControlMode"):
        MESSAGES["1.16"]["OffboardControlMode"].decode(data)


def test_a_diverged_estimate_is_sent_as_infinite() -> None:
    message = MESSAGES["1.16"]["VehicleLocalPosition"]
    fields = message.decode(message.encode({"x": 1e39, "vx": -1e300, "z": 1.0, "ref_lat": 1e300}))
    assert (fields["x"], fields["vx"], fields["z"], fields["ref_lat"]) == (math.inf, -math.inf, 1.0, 1e300)
