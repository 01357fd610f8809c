"""Writes the blocking client (`blocking*.py` of `gcs_server/client`) from the asynchronous client.

Each public class gets a blocking counterpart whose methods have the same names, arguments and docstrings.
A blocking method runs the asynchronous method on an event loop in another thread. `make types` runs this
tool; a test checks that the generated files are up to date.

    python -m tools.build_sync_client
"""

from __future__ import annotations

import ast
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

CLIENT = Path(__file__).resolve().parent.parent / "gcs_server" / "client"
MODULES = (
    "aio", "control", "dry_runs", "gimbal", "group", "mission", "mission_modes", "offboard",
    "offboard_mission", "operations", "plans", "vehicle",
)  # fmt: skip
MAIN = "blocking"
FILES = {
    "blocking_work": ("DryRuns", "MissionModes", "Operations", "Plans"),
    "blocking_parts": (
        "Control", "Gimbal", "Group", "Mission", "Offboard", "LiveOffboard", "OffboardMission",
    ),
    MAIN: ("Gcs", "Vehicle"),
}  # fmt: skip
"""The generated modules, each with its classes."""
CLASSES = tuple(name for names in FILES.values() for name in names)
ROOT = "Gcs"
"""The class that programs instantiate; it owns the thread of the event loop."""
SETPOINT_CLASSES = ("Offboard", "LiveOffboard")
"""Classes that inherit the methods for each setpoint type; these methods call `send`."""
EXCLUDED_METHODS = ("socket",)
"""Methods that return a WebSocket, which belongs to the event loop."""

HEADER = '''"""The same client for programs without an event loop: `with SyncGcs() as gcs`.

Each call runs the asynchronous call in an event loop on a separate thread, and waits for its result.
Made by tools/build_sync_client.py from the asynchronous client: change that, then run `make types`.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from anyio.from_thread import BlockingPortal

from gcs_server.client import (
    aio, control, dry_runs, gimbal, group, mission, mission_modes, offboard, offboard_mission, operations,
    plans, vehicle
)
from gcs_server.client.control import OnControlLost
from gcs_server.client.dry_runs import RUN_TIMEOUT_S
from gcs_server.client.group import Setpoints
from gcs_server.client.mission import TRANSFER_TIMEOUT_S
from gcs_server.client.offboard import Response, SetpointCalls
from gcs_server.client.plans import Plan
from gcs_server.client.portal import LoopThread, iterate
from gcs_server.client.setpoints import Body, ExpiryAction, PathPoints
'''


@dataclass(frozen=True)
class AsyncClass:
    """An asynchronous class and its module."""

    module: str
    node: ast.ClassDef

    def blocking_source(self) -> str:
        """The source of the blocking class."""
        bases = {ROOT: "(LoopThread)"} | dict.fromkeys(SETPOINT_CLASSES, "(SetpointCalls[Response])")
        head = f"class Sync{self.node.name}{bases.get(self.node.name, '')}:\n"
        body = [_doc(self.node), _init(self), *(_method(m) for m in _public(self.node))]
        return head + "\n\n".join(part for part in body if part)


def build(file: str) -> str:
    """The source of one module of `FILES`, formatted by ruff."""
    classes = {found.node.name: found for module in MODULES for found in _classes(module)}
    others = "".join(
        f"from gcs_server.client.{other} import {', '.join(f'Sync{name}' for name in names)}\n"
        for other, names in FILES.items()
        if file == MAIN and other != MAIN
    )
    source = "\n\n\n".join([HEADER + others, *(classes[name].blocking_source() for name in FILES[file])])
    ruff = [sys.executable, "-m", "ruff"]
    for step in (["check", "--fix", "--quiet", "--select", "F401,I"], ["format", "--quiet"]):
        command = [*ruff, *step, "--stdin-filename", str(path(file)), "-"]
        source = subprocess.run(command, input=source, capture_output=True, text=True, check=True).stdout
    return source


def path(file: str) -> Path:
    """Path of a module of `FILES`."""
    return CLIENT / f"{file}.py"


def _classes(module: str) -> list[AsyncClass]:
    tree = ast.parse((CLIENT / f"{module}.py").read_text("utf-8"))
    return [AsyncClass(module, n) for n in tree.body if isinstance(n, ast.ClassDef) and n.name in CLASSES]


def _public(node: ast.ClassDef) -> list[ast.FunctionDef | ast.AsyncFunctionDef]:
    methods = [m for m in node.body if isinstance(m, ast.FunctionDef | ast.AsyncFunctionDef)]
    return [m for m in methods if not m.name.startswith("_") and m.name not in EXCLUDED_METHODS]


def _doc(node: ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) -> str:
    indent = "    " if isinstance(node, ast.ClassDef) else "        "
    text = ast.get_docstring(node) or ""
    lines = "\n".join(f"{indent}{line}".rstrip() for line in text.splitlines()).strip()
    end = f"\n{indent}" if "\n" in lines else ""
    return f'{indent}"""{lines}{end}"""'


def _init(cls: AsyncClass) -> str:
    init = next(m for m in cls.node.body if isinstance(m, ast.FunctionDef) and m.name == "__init__")
    attributes = "\n".join(f"        {line}" for line in _attributes(init))
    if cls.node.name == ROOT:
        return (
            f"    def __init__({ast.unparse(init.args)}) -> None:\n"
            f"        self._inner = aio.{ROOT}({_passed(init.args)})\n"
            f"        super().__init__(self._inner.__aexit__)\n{attributes}"
        )
    return (
        f"    def __init__(self, inner: {cls.module}.{cls.node.name}, portal: BlockingPortal) -> None:\n"
        f"        self._inner = inner\n        self._portal = portal\n{attributes}"
    )


def _attributes(init: ast.FunctionDef) -> list[str]:
    """Assignments of the public attributes; an object of a class in `CLASSES` becomes a blocking object."""
    found: list[str] = []
    for node in init.body:
        if not isinstance(node, ast.Assign | ast.AnnAssign):
            continue
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        names = [
            leaf.attr
            for target in targets
            for leaf in (target.elts if isinstance(target, ast.Tuple) else [target])
            if isinstance(leaf, ast.Attribute) and not leaf.attr.startswith("_")
        ]
        part = _called(node.value)
        for name in names:
            inner = f"self._inner.{name}"
            value = f"Sync{part}({inner}, self._portal)" if part in CLASSES else inner
            found.append(f"self.{name} = {value}")
    return found


def _called(node: ast.expr | None) -> str:
    return node.func.id if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) else ""


def _method(method: ast.FunctionDef | ast.AsyncFunctionDef) -> str:
    """The source of one method, which returns a plain value, an awaited value, a context manager or an
    iterator."""
    decorators = [d.id for d in method.decorator_list if isinstance(d, ast.Name)]
    assert method.returns is not None, method.name
    returned = ast.unparse(method.returns)
    call = f"self._inner.{method.name}({_passed(method.args)})"
    before, result = "", _sync_type(returned)
    if "asynccontextmanager" in decorators:
        before, result = "    @contextmanager\n", f"Generator[{_sync_type(_argument(returned))}]"
        body = f"with self._portal.wrap_async_context_manager({call}) as found:\n"
        body += f"            yield {_wrapped('found', _argument(returned))}"
    elif returned.startswith("AsyncGenerator["):
        result = f"Generator[{_argument(returned)}]"
        body = f"return iterate(self._portal, {call})"
    elif isinstance(method, ast.AsyncFunctionDef):
        value = _wrapped(f"self._portal.call(lambda: {call})", returned)
        body = value if returned == "None" else f"return {value}"
    else:
        body = f"return {_wrapped(call, returned)}"
    head = f"{before}    def {method.name}({ast.unparse(method.args)}) -> {result}:\n"
    return f"{head}{_doc(method)}\n        {body}"


def _argument(generic: str) -> str:
    return generic.partition("[")[2].removesuffix("]")


def _sync_type(name: str) -> str:
    if name.startswith("list["):
        return f"list[{_sync_type(_argument(name))}]"
    return f"Sync{name}" if name in CLASSES else name


def _wrapped(value: str, kind: str) -> str:
    if kind.startswith("list[") and _argument(kind) in CLASSES:
        return f"[Sync{_argument(kind)}(found, self._portal) for found in {value}]"
    return f"Sync{kind}({value}, self._portal)" if kind in CLASSES else value


def _passed(arguments: ast.arguments) -> str:
    """The arguments of a call that passes on all parameters."""
    parts = [argument.arg for argument in arguments.args if argument.arg != "self"]
    parts += [f"*{arguments.vararg.arg}"] if arguments.vararg else []
    parts += [f"{argument.arg}={argument.arg}" for argument in arguments.kwonlyargs]
    parts += [f"**{arguments.kwarg.arg}"] if arguments.kwarg else []
    return ", ".join(parts)


if __name__ == "__main__":
    for file in FILES:
        path(file).write_text(build(file), "utf-8")
