"""The outputs in a vehicle's actuators metadata, and what keeps a gimbal from working. Pure."""

from __future__ import annotations

import json
import lzma
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_server.vehicle import metadata_files
from gcs_server.vehicle.actuator_document import MAX_OUTPUTS, parse
from gcs_server.vehicle.metadata_files import ACTUATORS
from gcs_server.vehicle.param_table import Param
from gcs_server.vehicle.services.gimbal_setup import findings, state_in


def document(*groups: Any) -> bytes:
    return json.dumps({"version": 1, "outputs_v1": list(groups)}).encode()


def group(parameters: list[Any], channels: list[Any], label: str = "CAN") -> dict[str, Any]:
    subgroup = {"per-channel-parameters": parameters, "channels": channels}
    return {"label": label, "subgroups": [subgroup]}


FUNCTION = {"name": "UAVCAN_SV_FUNC${i}", "function": "function"}


@pytest.mark.parametrize("folder", ["", "v1.17"])
def test_the_outputs_of_a_real_px4_are_read_with_their_names(reference_data: Path, folder: str) -> None:
    packed = (reference_data / "px4" / folder / "actuators.json.xz").read_bytes()
    encoded = metadata_files.encode_document(ACTUATORS, packed, 0)
    outputs = metadata_files.decode_document(ACTUATORS, encoded)
    assert [output.name for output in outputs.values()] == [f"MAIN {n}" for n in range(1, 17)]
    seventh = outputs["PWM_MAIN_FUNC7"]
    assert (seventh.label, seventh.reverse_param, seventh.reverse_bit) == (
        "SIM Channel 7",
        "PWM_MAIN_REV",
        6,
    )


def test_other_outputs_have_the_names_of_the_metadata_and_invalid_ones_are_omitted() -> None:
    outputs = parse(
        document(
            group([FUNCTION], [{"label": "Servo 1", "param-index": 1}]),
            group([{"name": "bad name", "function": "function"}], [{"param-index": 1}]),
            group([{"name": "NO_FUNCTION"}], [{"param-index": 1}]),
            "no group",
        )
    )
    assert {name: output.name for name, output in outputs.items()} == {"UAVCAN_SV_FUNC1": "CAN Servo 1"}
    assert "Left out 2 outputs" in str(outputs.omission_text)
    channels = [{"param-index": n} for n in range(150)]
    many = parse(
        document(group([FUNCTION], channels), group([{**FUNCTION, "name": "PWM_AUX_FUNC${i}"}], channels))
    )
    assert len(many) == MAX_OUTPUTS
    for content in (b"{}", b"[]", b'{"version": 2}', b"\xff", lzma.compress(b"{}")):
        with pytest.raises(ValueError):  # noqa: PT011 (msgspec words them)
            parse(content)


@given(
    st.recursive(
        st.none() | st.integers() | st.text(),
        lambda inner: (
            st.lists(inner)
            | st.dictionaries(
                st.sampled_from(
                    ["label", "subgroups", "channels", "per-channel-parameters", "name", "param-index"]
                ),
                inner,
            )
        ),
    )
)
def test_any_document_is_read_or_refused(value: Any) -> None:
    outputs = parse(document(value))
    assert len(outputs) <= MAX_OUTPUTS


def test_the_state_in_the_consoles_words_and_the_findings_of_parameters() -> None:
    assert state_in("WARN  [gimbal] not running\npxh> ") == "not_running"
    assert state_in("INFO  [gimbal] Input: Test\nINFO  [gimbal] Output: AUX\n") == "input_none"
    assert state_in("INFO  [gimbal] Input: Mavlink (Gimbal V2)\n") == "input_mavlink"

    def codes(mode_in: int, mode_out: int, prearm: int, *, runs: bool = False) -> list[str]:
        values = {
            name: Param(name, value, True)
            for name, value in (
                ("MNT_MODE_IN", mode_in),
                ("MNT_MODE_OUT", mode_out),
                ("COM_PREARM_MODE", prearm),
            )
        }
        return [finding.code for finding in findings(values, (), "input_mavlink" if runs else "unknown")]

    assert codes(-1, 2, 0) == ["input_none"]
    assert codes(4, 2, 0) == ["not_started"]
    assert codes(0, 2, 0, runs=True) == []
    assert codes(1, 0, 2) == ["input_none", "no_outputs"]
    assert codes(4, 0, 1, runs=True) == ["no_outputs", "prearm_off"]
    assert findings({}, (), "unknown") == ()
