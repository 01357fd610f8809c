"""Unit tests use no socket, process or browser: a test of this folder that opens one fails."""

import sys
from collections.abc import Iterator
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import pytest

FORBIDDEN_EVENTS = frozenset(
    {"socket.bind", "socket.connect", "socket.sendto", "socket.sendmsg"}
    | {"subprocess.Popen", "os.fork", "os.forkpty", "os.posix_spawn", "os.system"}
)
"""Audit events of Python that fail a unit test; the socket pair of an event loop raises none of them."""

UNIT_TESTS = Path(__file__).resolve().parent


class AuditState:
    """Whether a unit test is running. The audit hook reads it, because Python cannot remove the hook."""

    unit_test_running = False


def _refuse_event(event: str, _arguments: tuple[Any, ...]) -> None:
    if AuditState.unit_test_running and event in FORBIDDEN_EVENTS:
        raise AssertionError(f"a unit test may not do this ({event}): move it to tests/integration")


sys.addaudithook(_refuse_event)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Refuses sockets and processes during a unit test and its fixtures; also called for other tests."""
    if not item.path.is_relative_to(UNIT_TESTS):
        return (yield)
    real_start = BaseProcess.start

    def refuse_start(_process: BaseProcess) -> None:
        raise AssertionError("a unit test may not start a process: move it to tests/integration")

    BaseProcess.start, AuditState.unit_test_running = refuse_start, True  # type: ignore[method-assign]
    try:
        return (yield)
    finally:
        BaseProcess.start, AuditState.unit_test_running = real_start, False  # type: ignore[method-assign]
