"""Runs the tests of this folder on simulated time."""

from collections.abc import Callable, Coroutine
from typing import Any

import pytest

from gcs_server.scenarios.simulated_time import run_on_simulated_time


@pytest.fixture
def run_simulated() -> Callable[[Callable[[], Coroutine[Any, Any, Any]]], Any]:
    """Runs a coroutine function on simulated time."""
    return run_on_simulated_time
