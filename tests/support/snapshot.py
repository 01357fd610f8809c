"""A copy of a whole simulated flight, so that many tests can continue the same flight.

`copy.deepcopy` shares functions together with the objects in their closures, and copies arrays that share
memory into arrays that do not. This module copies both correctly. Objects that belong to a module (tables and
layouts) stay shared.
"""

from __future__ import annotations

import copy
import struct
import sys
import types
from typing import Any, TypeVar
from unittest.mock import patch

import numpy as np

from vehicle_sim.mavlink.dialect import Message

T = TypeVar("T")
Memo = dict[int, Any]


def snapshot(original: T) -> T:
    """A copy that is independent of the original: a change of one does not affect the other."""
    memo: Memo = {}
    for name, module in list(sys.modules.items()):
        if name.split(".")[0] == "vehicle_sim":
            for value in list(vars(module).values()):
                elements = (
                    value.values() if isinstance(value, dict) else value if isinstance(value, tuple) else ()
                )
                memo |= {id(shared): shared for shared in (value, *elements)}
    with patch.dict(copy._deepcopy_dispatch, COPIERS):
        return copy.deepcopy(original, memo)


def _copy_function(function: types.FunctionType, memo: Memo) -> types.FunctionType:
    if not function.__closure__ and not function.__defaults__ and not function.__kwdefaults__:
        return function
    cells = [memo.setdefault(id(cell), types.CellType()) for cell in function.__closure__ or ()]
    code, global_names = function.__code__, function.__globals__
    copied = types.FunctionType(code, global_names, function.__name__, None, tuple(cells) or None)
    memo[id(function)] = copied  # before its cells: one of them may contain the function itself
    for old, new in zip(function.__closure__ or (), cells, strict=True):
        if id(new) not in memo:  # two functions may share a cell
            memo[id(new)] = new
            new.cell_contents = copy.deepcopy(old.cell_contents, memo)
    copied.__defaults__ = copy.deepcopy(function.__defaults__, memo)
    copied.__kwdefaults__ = copy.deepcopy(function.__kwdefaults__, memo)
    copied.__dict__.update(function.__dict__)
    return copied


def _copy_builtin(function: types.BuiltinMethodType, memo: Memo) -> Any:
    owner = function.__self__
    if owner is None or isinstance(owner, types.ModuleType | type):
        return function
    return getattr(copy.deepcopy(owner, memo), function.__name__)


def _copy_array(array: np.ndarray, memo: Memo) -> np.ndarray:
    base = array.base
    if not isinstance(base, np.ndarray):
        copied = array.copy(order="K")
    else:
        memory = copy.deepcopy(base, memo)
        offset = array.__array_interface__["data"][0] - base.__array_interface__["data"][0]
        copied = np.ndarray(array.shape, array.dtype, _bytes_of(memory), offset, array.strides)
    copied.flags.writeable = array.flags.writeable
    memo[id(array)] = copied
    return copied


def _bytes_of(memory: np.ndarray) -> np.ndarray:
    assert memory.flags.c_contiguous, "the base of a view must be laid out row by row"
    return memory.reshape(-1).view(np.uint8)


def _copy_memory_view(view: memoryview, memo: Memo) -> memoryview:
    copied = memo[id(view)] = memoryview(copy.deepcopy(view.obj, memo)).cast("B").cast(view.format)
    return copied


def _keep_unchanged(value: T, _memo: Memo) -> T:
    return value


COPIERS: dict[type, Any] = {
    types.FunctionType: _copy_function,
    types.BuiltinMethodType: _copy_builtin,
    np.ndarray: _copy_array,
    memoryview: _copy_memory_view,
    struct.Struct: _keep_unchanged,
    Message: _keep_unchanged,
}
"""For each type that `copy.deepcopy` copies wrongly, its copier; received messages never change."""
