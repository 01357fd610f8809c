"""The recordings of a real PX4, for tests that compare whole ones."""

import os
from pathlib import Path

import pytest


@pytest.fixture
def recorded(shared: Path) -> Path:
    """The recordings, for a test that compares whole ones: minutes of computing."""
    if os.environ.get("ALL_DIALOGUES") != "1":
        pytest.skip("whole recordings are compared by make test-clients (ALL_DIALOGUES=1)")
    return shared / "px4"
