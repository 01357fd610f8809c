"""Samples of a topic as JSON messages, and their JSON schema: `q[0]` to `q[3]` become a list `q`,
`esc[0].rpm` an object in a list."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_server.logbook.log import Topic

_PART = re.compile(r"\[(\d+)\]|\.?([^.\[\]]+)")
_TYPES = {"f": "number", "i": "integer", "u": "integer", "b": "boolean", "S": "string"}
Tree = dict[str | int, Any]
"""Names of columns by the parts of their names."""


def _parts(name: str) -> list[str | int]:
    found = list(_PART.finditer(name))
    if "".join(match[0] for match in found) != name or not found:
        return [name]
    return [int(match[1]) if match[1] is not None else match[2] for match in found]


def _tree(names: Sequence[str]) -> Tree:
    """The names as a tree; flat if a name is both a value and a group."""
    root: Tree = {}
    for name in names:
        *groups, last = _parts(name)
        at = root
        for part in groups:
            at = at.setdefault(part, {})
            if not isinstance(at, dict):
                return {each: each for each in names}
        if last in at:
            return {each: each for each in names}
        at[last] = name
    return root


def _is_list(tree: Tree) -> bool:
    return list(tree) == list(range(len(tree)))


class JsonTopic:
    """Writes the samples of one topic.

    Args:
        topic: the topic.
    """

    def __init__(self, topic: Topic) -> None:
        self._topic = topic
        self._order: list[str] = []
        tree = _tree(list(topic.columns))
        self._template = self._object(tree)
        self.schema = json.dumps({**self._schema(tree), "title": topic.name}).encode()

    def messages(self, first: int, end: int) -> list[bytes]:
        """The samples from one index to another."""
        columns = [json_texts(np.asarray(self._topic.columns[name][first:end])) for name in self._order]
        return [(self._template % row).encode() for row in zip(*columns, strict=True)]

    def _object(self, node: Any) -> str:
        """A template with a place for each value, in the order of `_order`."""
        if not isinstance(node, dict):
            self._order.append(node)
            return "%s"
        tree: Tree = node
        if _is_list(tree):
            return "[" + ",".join(self._object(each) for each in tree.values()) + "]"
        pairs = (
            f"{json.dumps(str(key)).replace('%', '%%')}:{self._object(each)}" for key, each in tree.items()
        )
        return "{" + ",".join(pairs) + "}"

    def _schema(self, node: Any) -> dict[str, Any]:
        if not isinstance(node, dict):
            kind = _TYPES.get(self._topic.columns[node].dtype.kind, "string")
            unit = self._topic.units.get(node)
            return {"type": kind} if unit is None else {"type": kind, "description": f"[{unit}]"}
        tree: Tree = node
        if _is_list(tree):
            return {"type": "array", "items": self._schema(tree[0])}
        return {"type": "object", "properties": {str(key): self._schema(each) for key, each in tree.items()}}


def json_texts(values: NDArray[Any]) -> list[str]:
    """Values as JSON, which are read as the same values again; what is no number is null."""
    plain = values.tolist()
    if values.dtype.kind == "f":
        text = "%.9g" if values.dtype.itemsize <= 4 else "%r"
        finite = np.isfinite(values)
        if finite.all():
            return [text % each for each in plain]
        return [text % each if ok else "null" for each, ok in zip(plain, finite.tolist(), strict=True)]
    if values.dtype.kind == "b":
        return ["true" if each else "false" for each in plain]
    if values.dtype.kind in "iu":
        return [str(each) for each in plain]
    return [json.dumps(each.decode("latin-1") if isinstance(each, bytes) else str(each)) for each in plain]
