"""How a ROS 2 message lies in its bytes (CDR), from the definition that a recording has with it (`ros2msg`).

PX4's messages have neither texts of variable length nor sequences, so each has one layout, and NumPy reads
all samples of a topic at once. Types without a fixed layout have none here.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

HEADER_BYTES = 4
LITTLE_ENDIAN, BIG_ENDIAN = b"\x00\x01", b"\x00\x00"
"""Begin of a message's header, by its byte order; other encodings are not read."""
MAX_DEFINITION_BYTES = 200_000
MAX_FIELDS = 4000
"""Single values of a message."""
MAX_DEPTH = 8
_TYPES = {
    "bool": "?", "byte": "u1", "char": "u1", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8",
}  # fmt: skip
_FIELD = re.compile(r"^([A-Za-z]\w*(?:/\w+)*)(?:\[(\d{1,5})\])?\s+([A-Za-z]\w*)\s*(=?)")
_SEPARATOR = re.compile(r"^={10,}\s*$", re.MULTILINE)


class NoLayout(ValueError):
    """A type has no fixed layout, or its definition cannot be read; the text says why."""


@dataclass(frozen=True, slots=True)
class Layout:
    """The places of a message's single values after its header."""

    names: tuple[str, ...]
    """As pyulog names them: `q[0]`, `esc[1].esc_rpm`."""
    formats: tuple[str, ...]
    """NumPy's types without a byte order."""
    offsets: tuple[int, ...]
    size: int

    def dtype(self, order: str) -> np.dtype[np.void]:
        """The type of a sample, `<` little or `>` big endian."""
        formats = [f"{order}{each}" for each in self.formats]
        return np.dtype(
            {
                "names": list(self.names),
                "formats": formats,
                "offsets": list(self.offsets),
                "itemsize": self.size,
            }
        )


def layout_of(definition: str) -> Layout:
    """The layout of a type.

    Args:
        definition: its fields; after lines of `=`, `MSG: package/Type` and the fields of each type in it.

    Raises:
        NoLayout: it has none.
    """
    if len(definition) > MAX_DEFINITION_BYTES:
        raise NoLayout("its definition is too long")
    main, *others = _SEPARATOR.split(definition)
    nested: dict[str, str] = {}
    for each in others:
        head, _, body = each.strip().partition("\n")
        if head.startswith("MSG:"):
            nested[head.removeprefix("MSG:").strip().split("/")[-1]] = body
    builder = _Builder(nested)
    builder.add(main, "", 0)
    if not builder.names:
        raise NoLayout("it has no fields")
    return Layout(tuple(builder.names), tuple(builder.formats), tuple(builder.offsets), builder.end)


class _Builder:
    def __init__(self, nested: dict[str, str]) -> None:
        self._nested = nested
        self.names: list[str] = []
        self.formats: list[str] = []
        self.offsets: list[int] = []
        self.end = 0

    def add(self, definition: str, prefix: str, depth: int) -> None:
        if depth > MAX_DEPTH:
            raise NoLayout("its types are nested too deep")
        for line in definition.splitlines():
            text = line.split("#", 1)[0].strip()
            if not text:
                continue
            match = _FIELD.match(text)
            if match is None:
                raise NoLayout(f"the field {text[:60]!r} has no fixed size")
            kind, length, name, is_constant = match.groups()
            if is_constant:
                continue
            names = [name] if length is None else [f"{name}[{i}]" for i in range(int(length))]
            for each in names:
                self._add_value(kind, f"{prefix}{each}", depth)

    def _add_value(self, kind: str, name: str, depth: int) -> None:
        if len(self.names) >= MAX_FIELDS:
            raise NoLayout(f"it has more than {MAX_FIELDS} values")
        code = _TYPES.get(kind)
        if code is None:
            body = self._nested.get(kind.split("/")[-1])
            if body is None:
                raise NoLayout(f"the type {kind[:60]!r} is not defined or has no fixed size")
            self.add(body, f"{name}.", depth + 1)
            return
        size = np.dtype(code).itemsize
        self.end = -(-self.end // size) * size
        self.names.append(name)
        self.formats.append(code)
        self.offsets.append(self.end)
        self.end += size
