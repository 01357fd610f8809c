"""Unit tests use no socket, process or browser: a test of this folder that opens one fails."""

import sys
from collections.abc import Iterator
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import pytest

OUTSIDE = frozenset(
    {"socket.bind", "socket.connect", "socket.sendto", "socket.sendmsg"}
    | {"subprocess.Popen", "os.fork", "os.forkpty", "os.posix_spawn", "os.system"}
)
"""Audit events of Python; the socket pair of an event loop raises none of them."""

HERE = Path(__file__).resolve().parent


class UnitTestRunning:
    """Whether a unit test is running; an audit hook cannot be removed."""

    on = False


def _refuse(event: str, _arguments: tuple[Any, ...]) -> None:
    if UnitTestRunning.on and event in OUTSIDE:
        raise AssertionError(f"a unit test may not do this ({event}): move it to tests/integration")


sys.addaudithook(_refuse)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Refuses sockets and processes during a unit test and its fixtures; also called for other tests."""
    if not item.path.is_relative_to(HERE):
        return (yield)
    start = BaseProcess.start

    def no_process(_process: BaseProcess) -> None:
        raise AssertionError("a unit test may not start a process: move it to tests/integration")

    BaseProcess.start, UnitTestRunning.on = no_process, True  # type: ignore[method-assign]
    try:
        return (yield)
    finally:
        BaseProcess.start, UnitTestRunning.on = start, False  # type: ignore[method-assign]
