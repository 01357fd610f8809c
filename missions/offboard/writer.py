"""Writes an offboard mission as readable YAML, without fields that have their default value."""

from __future__ import annotations

from typing import Any

import yaml

from missions.offboard.document import Actions, OffboardMission
from missions.offboard.reader import is_text
from missions.values import Model

FIRST = ("format", "version", "step", "shape", "inclusion")
"""Fields that are always written first, because they name the kind of an object."""


def write_yaml(mission: OffboardMission) -> bytes:
    """The mission as YAML in UTF-8; `reader.read` returns an equal mission."""
    text = yaml.dump(
        _to_yaml_values(mission),
        Dumper=_Dumper,
        sort_keys=False,
        allow_unicode=True,
        default_flow_style=None,
        width=120,
    )
    return text.encode()


def _to_yaml_values(value: Any) -> Any:
    """Converts a value to mappings, lists, strings and numbers; whole numbers become int."""
    if isinstance(value, Model):
        fields = type(value).model_fields
        return {
            name: _to_yaml_values(each)
            for name, each in sorted(value, key=lambda pair: pair[0] not in FIRST)
            if each is not None
            and (
                name in (*FIRST, "actions")
                or isinstance(value, Actions)  # all actions are always written
                or each != fields[name].get_default(call_default_factory=True)
            )
        }
    if isinstance(value, dict):
        return {name: _to_yaml_values(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_to_yaml_values(each) for each in value]
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        return int(value)
    return value


class _Dumper(yaml.SafeDumper):
    """Writes YAML without anchors, and quotes strings that could be read as a number or keyword."""

    def ignore_aliases(self, data: Any) -> bool:
        """Always true, because the reader refuses anchors."""
        return True


def _text_node(dumper: _Dumper, text: str) -> yaml.ScalarNode:
    lines = text.split("\n")
    needs_escapes = not all(line.isprintable() and line == line.strip() for line in lines)
    style = '"'
    if not needs_escapes and len(lines) > 1:
        style = "|"
    elif not needs_escapes and is_text(text):
        style = None
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _text_node)
