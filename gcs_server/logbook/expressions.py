"""Derived values of a plot: a small language over fields in braces, such as
`norm({vehicle_local_position:0/vx}, {vehicle_local_position:0/vy})`.

Only numbers, fields, `+ - * / **`, comparisons and the functions below; nothing else of Python is reachable.
Fields of other topics are interpolated at the times of the first field.
"""

from __future__ import annotations

import ast
import operator
import re
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_server.logbook.columns import UnknownField
from gcs_server.logbook.log import Times

Values = NDArray[np.float64]
Read = Callable[[str], tuple[Times, Values, str | None]]

MAX_LENGTH = 500
MAX_FIELDS = 8
MAX_NODES = 100
_FIELD = re.compile(r"\{([^{}]{1,200})\}")


def _derivative(times_s: Times, values: Values) -> Values:
    if len(values) < 2:
        return np.full(len(values), np.nan)
    steps_s = np.diff(times_s)
    slopes = np.diff(values) / np.where(steps_s > 0, steps_s, np.nan)
    return np.concatenate((slopes[:1], slopes))


def _norm(*parts: Values) -> Values:
    return np.sqrt(sum((part * part for part in parts), np.float64(0.0)))  # pyright: ignore[reportCallIssue, reportArgumentType]


def _quaternion(angle: Callable[[Values, Values, Values, Values], Values]) -> Callable[..., Values]:
    def function(w: Values, x: Values, y: Values, z: Values) -> Values:
        return np.degrees(angle(w, x, y, z))

    return function


FUNCTIONS: dict[str, tuple[int, int, Callable[..., Values]]] = {
    "abs": (1, 1, np.abs),
    "sqrt": (1, 1, np.sqrt),
    "sin": (1, 1, np.sin),
    "cos": (1, 1, np.cos),
    "atan2": (2, 2, np.arctan2),
    "min": (2, 2, np.fmin),
    "max": (2, 2, np.fmax),
    "degrees": (1, 1, np.degrees),
    "radians": (1, 1, np.radians),
    "norm": (1, 4, _norm),
    "roll": (4, 4, _quaternion(lambda w, x, y, z: np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)))),
    "pitch": (4, 4, _quaternion(lambda w, x, y, z: np.arcsin(np.clip(2 * (w * y - z * x), -1, 1)))),
    "yaw": (4, 4, _quaternion(lambda w, x, y, z: np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))),
}
"""Number of arguments (least, most), and the function; roll, pitch and yaw [deg] of a quaternion w, x, y, z
that takes FRD to NED. `derivative(x)` needs the times too, and is not listed."""
UNITS = {"degrees": "°", "roll": "°", "pitch": "°", "yaw": "°"}
_OPERATORS: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}


def is_expression(text: str) -> bool:
    """Whether a text is an expression, not the name of a field."""
    return "{" in text


def used_fields(text: str) -> list[str]:
    """The fields that an expression names."""
    return _FIELD.findall(text)


def names_of(text: str) -> list[str]:
    """The fields of an expression, each once; the first is that whose times its values have.

    Raises:
        UnknownField: it is too long, or has too many fields or none.
    """
    if len(text) > MAX_LENGTH:
        raise UnknownField(f"an expression has at most {MAX_LENGTH} characters")
    names = list(dict.fromkeys(used_fields(text)))
    if not names or len(names) > MAX_FIELDS:
        raise UnknownField(f"an expression has 1 to {MAX_FIELDS} fields in braces")
    return names


def evaluate(text: str, read: Read) -> tuple[Times, Values, str | None]:
    """Times, values and unit of an expression.

    Args:
        text: the expression.
        read: reads a field.

    Raises:
        UnknownField: the expression is invalid, or a field is not known; the text says what is wrong.
    """
    names = names_of(text)
    source = _FIELD.sub(lambda match: f" field_{names.index(match[1])} ", text)
    if "{" in source:
        raise UnknownField(f"an expression has 1 to {MAX_FIELDS} fields in braces")
    try:
        tree = ast.parse(source.strip(), mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise UnknownField("the expression cannot be read") from None
    if sum(1 for _ in ast.walk(tree)) > MAX_NODES:
        raise UnknownField("the expression is too long")
    times_s, first, unit = read(names[0])
    fields = [first]
    for name in names[1:]:
        other_s, values, _ = read(name)
        same = len(other_s) == len(times_s) and np.array_equal(other_s, times_s)
        fields.append(values if same or not len(other_s) else np.interp(times_s, other_s, values))
    with np.errstate(all="ignore"):
        result = _Evaluator(times_s, fields).visit(tree.body)
    values = np.broadcast_to(np.asarray(result, np.float64), times_s.shape)
    return times_s, values, _unit(tree.body, unit)


def _unit(node: ast.expr, first: str | None) -> str | None:
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        name = node.func.id
        if name == "derivative":
            return None if first is None else f"{first}/s"
        return UNITS.get(name, first if name in ("norm", "abs", "min", "max") else None)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
        return first
    return None


class _Evaluator:
    def __init__(self, times_s: Times, fields: list[Values]) -> None:
        self._times_s = times_s
        self._fields = {f"field_{i}": values for i, values in enumerate(fields)}

    def visit(self, node: ast.expr) -> Any:
        if isinstance(node, ast.Constant) and type(node.value) in (int, float):
            return float(node.value)  # pyright: ignore[reportArgumentType] a number
        if isinstance(node, ast.Name) and node.id in self._fields:
            return self._fields[node.id]
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
            value = self.visit(node.operand)
            return -value if isinstance(node.op, ast.USub) else value
        if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
            return _OPERATORS[type(node.op)](
                np.asarray(self.visit(node.left)), np.asarray(self.visit(node.right))
            )
        if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in _OPERATORS:
            return _OPERATORS[type(node.ops[0])](
                np.asarray(self.visit(node.left)), np.asarray(self.visit(node.comparators[0]))
            )
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
            return self._call(node.func.id, [self.visit(argument) for argument in node.args])
        raise UnknownField("the expression has a part that is not allowed")

    def _call(self, name: str, arguments: list[Any]) -> Any:
        if name == "derivative" and len(arguments) == 1:
            return _derivative(self._times_s, np.broadcast_to(arguments[0], self._times_s.shape))
        if name not in FUNCTIONS:
            known = ", ".join(sorted([*FUNCTIONS, "derivative"]))
            raise UnknownField(f"there is no function {name!r}; there are {known}")
        least, most, function = FUNCTIONS[name]
        if not least <= len(arguments) <= most:
            raise UnknownField(f"{name} takes {least if least == most else f'{least} to {most}'} values")
        return function(*arguments)
