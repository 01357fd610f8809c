"""Compiled loops over all vehicles; the formulas are written for one vehicle.

A NumPy call takes a microsecond even for few vehicles, and a step would need hundreds of calls. Rules:

- A `@kernel` takes arrays of all vehicles and writes into arrays that the caller has allocated. It loops over
  the rows and allocates nothing per row. The rows are independent, so the result of one vehicle does not
  depend on other vehicles.
- A `@formula` takes and returns plain numbers or rows of one vehicle. Kernels and other formulas call
  formulas.
- The annotations of a kernel are its only types: `Column`, `Rows`, `Blocks`, `Flags`, `Integers`,
  `IntegerRows`, `float`, `int`, `bool`. A kernel is compiled when its module is imported, never in flight.
  Formulas must be defined above the kernel that calls them. Arrays are contiguous (C order).
- The compiler must not reorder sums (`fastmath` is off), and uses only instructions that all processors of an
  architecture have: the same seed gives the same flight everywhere. Division by zero gives infinity or NaN,
  as in NumPy. Comparisons are written so that NaN takes the same branch as in NumPy.
- Kernels draw no random numbers: NumPy draws them first (`noise.py`), in the same order for every fleet.
- Module constants are compiled in; values that change are arguments.

Compiled code is cached in a folder named after a hash of the sources of all kernels. A change in one file
recompiles all kernels, because the compiler does not detect changed formulas of other files. If processes
start together, one of them compiles a kernel and the others load the result. Without a writable folder
every process compiles all kernels.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import inspect
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

Column = NDArray[np.float64]
"""(N,) one number for each vehicle."""
Rows = NDArray[np.float64]
"""(N, m) one vector for each vehicle."""
Blocks = NDArray[np.float64]
"""(N, m, k) one matrix for each vehicle."""
Flags = NDArray[np.bool_]
"""(N,) one flag for each vehicle."""
Integers = NDArray[np.int64]
"""(N,) one integer for each vehicle."""
IntegerRows = NDArray[np.int64]
"""(N, m) m integers for each vehicle."""
F = TypeVar("F", bound=Callable[..., Any])

PACKAGE = Path(__file__).resolve().parent
UNUSED_AFTER_S = 7 * 86400.0
"""Compiled code of other versions of the sources is deleted if no process has loaded it for this long."""
_TYPES: dict[str, Any] = {
    "Column": numba.float64[::1],
    "Rows": numba.float64[:, ::1],
    "Blocks": numba.float64[:, :, ::1],
    "Flags": numba.boolean[::1],
    "Integers": numba.int64[::1],
    "IntegerRows": numba.int64[:, ::1],
    "float": numba.float64,
    "int": numba.int64,
    "bool": numba.boolean,
}


def _sources_digest() -> str:
    """Digest of all files that contain kernels or formulas."""
    digest = hashlib.sha256(f"{numba.__version__} {sys.version}".encode())
    for path in sorted(PACKAGE.rglob("*.py")):
        if path.name != "generated_dialect.py":
            source = path.read_bytes()
            if b"vehicle_sim.kernels" in source or path == Path(__file__):
                digest.update(source)
    return digest.hexdigest()[:16]


def _cache_folder() -> Path | None:
    """Folder of the compiled code; None: no folder is writable.

    The folder is in NUMBA_CACHE_DIR if set, otherwise next to the sources or in the user's cache.
    """
    user_cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    configured = os.environ.get("NUMBA_CACHE_DIR")
    folders = [Path(configured)] if configured else [PACKAGE / "__pycache__", user_cache / "offboard-gcs"]
    name = f"kernels-{_sources_digest()}"
    for folder in folders:
        try:
            if not (folder / name).exists():
                _remove_unused(folder)
                (folder / name).mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder / name):
                return folder / name
        except OSError:
            continue
    return None


def _remove_unused(folder: Path) -> None:
    for cached in folder.glob("kernels-*"):
        with contextlib.suppress(OSError):
            if time.clock_gettime(time.CLOCK_REALTIME) - (cached / "lock").stat().st_mtime > UNUSED_AFTER_S:
                shutil.rmtree(cached, ignore_errors=True)


_folder = _cache_folder()
_config = cast(Any, numba).config
if _folder is not None:
    _config.CACHE_DIR = str(_folder)
if not _config.CPU_NAME:
    _config.CPU_NAME, _config.CPU_FEATURES = "generic", ""


@contextlib.contextmanager
def _compile_lock() -> Generator[None]:
    """Lets one of the processes that start together compile a kernel; the others wait and load the result."""
    if _folder is None:
        yield
        return
    with (_folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _compiler(types: tuple[Any, ...] | None) -> Callable[[F], F]:
    compiler = numba.njit(types, cache=_folder is not None, error_model="numpy", fastmath=False)
    return cast(Callable[[F], F], compiler)


def kernel(function: F) -> F:
    """Compiles a loop over vehicles with the types of its annotations."""
    parameters = inspect.signature(function).parameters.values()
    with _compile_lock():
        return _compiler(tuple(_TYPES[each.annotation] for each in parameters))(function)


def formula(function: F) -> F:
    """Compiles the formulas of one vehicle for the types of its callers."""
    return _compiler(None)(function)
