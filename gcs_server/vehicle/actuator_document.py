"""Reads the metadata document of a vehicle's actuators: its outputs, and the parameters that set them.

Format: MAVLink's actuators metadata schema, version 1. An output that does not conform is omitted, and the
reason is recorded.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated

import msgspec

from gcs_server.vehicle.metadata_limits import Document, OmittedEntries, cut

MAX_OUTPUTS = 200
"""Maximum number of outputs; PX4's simulation has 16, a large board with CAN fewer than 60."""
MAX_LABEL_LENGTH = 40
_parameter_name = re.compile(r"[A-Z][A-Z0-9_]{0,15}")
_pwm_function = re.compile(r"PWM_([A-Z]+)_FUNC(\d+)")

_Index = Annotated[int, msgspec.Meta(ge=0, le=1000)]


@dataclass(frozen=True, slots=True)
class Output:
    """One output of a vehicle."""

    name: str
    """As printed on boards: MAIN 7, AUX 1; of other drivers the labels of the metadata."""
    label: str
    """Group and channel in the vehicle's metadata."""
    function_param: str
    """Parameter of the output's function."""
    reverse_param: str | None = None
    """Parameter whose bit `reverse_bit` reverses the output; null: it has none."""
    reverse_bit: int = 0


class _Parameter(msgspec.Struct, rename="kebab"):
    name: str
    function: str = ""
    index_offset: Annotated[int, msgspec.Meta(ge=-1000, le=1000)] = 0
    show_as: str = ""


class _Channel(msgspec.Struct, rename="kebab"):
    param_index: _Index
    label: str = ""


class _Subgroup(msgspec.Struct, rename="kebab"):
    per_channel_parameters: Annotated[list[_Parameter], msgspec.Meta(max_length=50)] = []
    channels: Annotated[list[_Channel], msgspec.Meta(max_length=MAX_OUTPUTS)] = []


class _Group(msgspec.Struct):
    label: str = ""
    subgroups: Annotated[list[msgspec.Raw], msgspec.Meta(max_length=50)] = []


class _Document(msgspec.Struct):
    version: int
    outputs_v1: Annotated[list[msgspec.Raw], msgspec.Meta(max_length=50)] = []


def parse(content: bytes) -> Document[str, Output]:
    """Reads the metadata document; returns the outputs by the parameter of their function.

    Raises:
        ValueError: the content is not an actuators document, or its version is not supported.
    """
    document = msgspec.json.decode(content, type=_Document)  # msgspec's errors are ValueErrors
    if document.version != 1:
        raise ValueError(f"actuators document version {document.version} is not supported, only version 1")
    omitted = OmittedEntries("output", "outputs")
    outputs: dict[str, Output] = {}
    for raw_group in document.outputs_v1:
        try:
            group = msgspec.json.decode(raw_group, type=_Group)
            for raw in group.subgroups:
                for output in _outputs(group.label, msgspec.json.decode(raw, type=_Subgroup)):
                    if len(outputs) >= MAX_OUTPUTS:
                        raise ValueError(f"more than {MAX_OUTPUTS}")
                    outputs[output.function_param] = output
        except (ValueError, RecursionError) as error:
            omitted.add("a group", error)
    return Document(outputs, omitted.text())


def _outputs(group_label: str, subgroup: _Subgroup) -> Iterable[Output]:
    function = next((p for p in subgroup.per_channel_parameters if p.function == "function"), None)
    if function is None:
        return
    reverse = next(
        (p for p in subgroup.per_channel_parameters if p.show_as == "bitset" and p.name.endswith("_REV")),
        None,
    )
    for channel in subgroup.channels:
        function_param = _name(function, channel)
        if _parameter_name.fullmatch(function_param) is None:
            raise ValueError(f"{cut(function_param, MAX_LABEL_LENGTH)!r} is not a parameter")
        bit = 0 if reverse is None else channel.param_index + reverse.index_offset
        can_reverse = reverse is not None and _parameter_name.fullmatch(reverse.name) and 0 <= bit < 32
        label = cut(f"{group_label} {channel.label}".strip(), MAX_LABEL_LENGTH)
        yield Output(
            name=output_name(function_param) or label,
            label=label,
            function_param=function_param,
            reverse_param=reverse.name if reverse is not None and can_reverse else None,
            reverse_bit=bit if can_reverse else 0,
        )


def _name(parameter: _Parameter, channel: _Channel) -> str:
    return parameter.name.replace("${i}", str(channel.param_index + parameter.index_offset))


def output_name(function_param: str) -> str | None:
    """Name of a PWM output as printed on boards; None: the parameter is not that of a PWM output.

    >>> output_name("PWM_MAIN_FUNC7")
    'MAIN 7'
    """
    match = _pwm_function.fullmatch(function_param)
    return None if match is None else f"{match[1]} {match[2]}"
