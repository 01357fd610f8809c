"""Frozen dataclasses as bytes, for values that come from a process that reads foreign files.

The reader creates only the classes that the annotations of the expected class name, and checks the type of
each value, so that wrong bytes are an error and never code. Supported are scalars, literals, unions, tuples,
dictionaries, NumPy arrays of numbers, and dataclasses with their subclasses; a field that is not an argument
of its class (`init=False`) is left out.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import sys
import types
import typing
from collections.abc import Callable
from typing import Any, Literal, TypeVar, Union, get_args, get_origin

import msgspec
import numpy as np
from numpy.typing import NDArray

from missions.errors import PlanError

T = TypeVar("T")
Read = Callable[[Any], Any]
_ARRAY_KINDS = "biuf"


class WrongValue(ValueError):
    """The bytes are not a value of the expected type."""


def to_bytes(value: object) -> bytes:
    """A value of the supported types as bytes."""
    return msgspec.msgpack.encode(_plain(value))


def from_bytes(data: bytes, expected: type[T]) -> T:
    """Reads the output of `to_bytes`.

    Args:
        data: the bytes; bounded in size by the caller.
        expected: the type of the value, such as a dataclass or `tuple[A, B]`.

    Raises:
        WrongValue: the bytes are not such a value.
    """
    try:
        return _reader(expected)(msgspec.msgpack.decode(data))
    except WrongValue:
        raise
    except (msgspec.DecodeError, RecursionError, TypeError, ValueError, OverflowError, PlanError) as error:
        raise WrongValue(f"not a value of the expected type: {error}") from error


def _plain(value: Any) -> Any:
    if value is None or isinstance(value, bool | int | float | str | bytes):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        array = np.ascontiguousarray(value)
        return [array.dtype.str, list(array.shape), array.tobytes()]
    if isinstance(value, tuple | list):
        return [_plain(each) for each in value]
    if isinstance(value, dict):
        return [[_plain(key), _plain(each)] for key, each in value.items()]
    return [type(value).__name__, *(_plain(getattr(value, name)) for name in _names(type(value)))]


@functools.cache
def _names(value_type: type) -> tuple[str, ...]:
    if not dataclasses.is_dataclass(value_type):
        raise TypeError(f"{value_type.__name__} is not supported")
    return tuple(each.name for each in dataclasses.fields(value_type) if each.init)


def _require(condition: bool, expected: object) -> None:
    if not condition:
        raise WrongValue(f"not a value of type {expected}")


@functools.cache
def _reader(expected: Any) -> Read:
    """The function that reads a value of a type."""
    origin, arguments = get_origin(expected), get_args(expected)
    if dataclasses.is_dataclass(expected) and isinstance(expected, type):
        return _dataclass_reader(expected)
    if expected is float:
        return _read_float
    if expected in (bool, int, str, bytes, types.NoneType):
        return functools.partial(_read_exactly, expected)
    if origin is Literal:
        return functools.partial(_read_literal, arguments)
    if origin in (Union, types.UnionType):
        return functools.partial(_read_union, tuple(_reader(each) for each in arguments))
    if origin is tuple and arguments[-1] is Ellipsis:
        return functools.partial(_read_tuple, _Lazy(arguments[0]))
    if origin is tuple:
        return functools.partial(_read_row, tuple(_reader(each) for each in arguments))
    if origin is dict:
        return functools.partial(_read_dict, _reader(arguments[0]), _reader(arguments[1]))
    if origin in (np.ndarray, NDArray):  # before NumPy 2.5, and from it on
        return _read_array
    raise TypeError(f"{expected} is not supported")


class _Lazy:
    """The reader of a type, made when it is first used, because a type may contain itself."""

    def __init__(self, expected: Any) -> None:
        self._expected = expected

    def __call__(self, value: Any) -> Any:
        return _reader(self._expected)(value)


def _read_exactly(expected: type, value: Any) -> Any:
    _require(type(value) is expected, expected.__name__)
    return value


def _read_float(value: Any) -> float:
    _require(type(value) in (float, int), "float")
    return float(value)


def _read_literal(choices: tuple[Any, ...], value: Any) -> Any:
    _require(isinstance(value, str | int) and value in choices, choices)
    return value


def _read_union(readers: tuple[Read, ...], value: Any) -> Any:
    for reader in readers:
        try:
            return reader(value)
        except WrongValue:
            continue
    raise WrongValue("not a value of any type of the union")


def _read_tuple(reader: Read, value: Any) -> tuple[Any, ...]:
    _require(isinstance(value, list), "tuple")
    return tuple([reader(each) for each in value])


def _read_row(readers: tuple[Read, ...], value: Any) -> tuple[Any, ...]:
    _require(isinstance(value, list) and len(value) == len(readers), f"tuple of {len(readers)}")
    return tuple([reader(each) for reader, each in zip(readers, value, strict=True)])


def _read_dict(read_key: Read, read_value: Read, value: Any) -> dict[Any, Any]:
    _require(
        isinstance(value, list) and all(isinstance(each, list) and len(each) == 2 for each in value), "dict"
    )
    return {read_key(key): read_value(each) for key, each in value}


def _read_array(value: Any) -> NDArray[Any]:
    _require(isinstance(value, list) and len(value) == 3, "array")
    name, shape, data = value
    _require(isinstance(name, str) and isinstance(data, bytes) and len(name) <= 4, "array")
    dtype = np.dtype(name)
    _require(dtype.kind in _ARRAY_KINDS and isinstance(shape, list) and len(shape) <= 4, "array")
    _require(all(type(each) is int and each >= 0 for each in shape), "array")
    _require(math.prod(shape) * dtype.itemsize == len(data), "array")
    return np.frombuffer(data, dtype).reshape(shape).copy()


def _dataclass_reader(expected: type) -> Read:
    """Reads an object of a class or of one of its subclasses."""
    classes = {each.__name__: each for each in _with_subclasses(expected)}
    readers: dict[str, tuple[tuple[str, Read], ...]] = {}

    def read(value: Any) -> Any:
        _require(isinstance(value, list) and bool(value) and value[0] in classes, expected.__name__)
        name = value[0]
        if name not in readers:
            hints = typing.get_type_hints(classes[name])
            readers[name] = tuple((field, _Lazy(hints[field])) for field in _names(classes[name]))
        fields = readers[name]
        _require(len(value) == len(fields) + 1, name)
        return classes[name](
            **{field: reader(each) for (field, reader), each in zip(fields, value[1:], strict=True)}
        )

    return read


def _with_subclasses(base: type) -> list[type]:
    """The class and its subclasses. `@dataclass(slots=True)` leaves a second, unused class of the same
    name."""
    found = [base] if getattr(sys.modules[base.__module__], base.__name__, None) is base else []
    return found + [each for direct in base.__subclasses__() for each in _with_subclasses(direct)]
