"""Fixtures and settings for all tests."""

import gc
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from tools import build_sync_client

REPOSITORY = Path(__file__).resolve().parent.parent
SHARED = REPOSITORY.parent / "shared"

build_sync_client.build()  # before a test imports it: it may be older than the asynchronous client

for profile, derandomize in (("steady", True), ("search", False)):
    settings.register_profile(
        profile, deadline=None, derandomize=derandomize, suppress_health_check=[HealthCheck.too_slow]
    )
settings.load_profile("steady")
"""Hypothesis tries the same examples in each run; `--hypothesis-profile=search` tries new ones."""


REAL_PROCESSES = frozenset({"clients", "e2e", "hostile"})
"""Folders of tests that start servers, vehicles, browsers and third-party programs, in real time."""
REAL_TIME_MARKS = ("browser", "realtime")
"""Marks of tests in other folders that run in real time."""


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Disables garbage collection during imports, and exempts the imported modules from it later."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Repeats a failed test of real processes once; the summary has the failure's text.

    On a busy machine a process may stand still for longer than a timeout of PX4 or of a client.
    """
    for item in items:
        in_real_time = any(item.get_closest_marker(mark) for mark in REAL_TIME_MARKS)
        if in_real_time or item.nodeid.split("/")[1] in REAL_PROCESSES:
            item.add_marker(pytest.mark.flaky(reruns=1))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Prints why a test was repeated, so that its cause can be found although it passed later."""
    for report in terminalreporter.stats.get("rerun", []):
        terminalreporter.write_sep("=", f"repeated: {report.nodeid} ({report.when})")
        terminalreporter.write_line(report.longreprtext)
        for title, text in report.sections:
            terminalreporter.write_line(f"--- {title} ---\n{text}")


@pytest.fixture(scope="session")
def reference_data() -> Path:
    """The folder of reference data beside the checkout; tests that need it are skipped if it is missing."""
    if not (SHARED / "px4").is_dir():
        pytest.skip("the reference recordings (../shared) are not beside this checkout")
    return SHARED
