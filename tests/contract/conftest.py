"""Recordings of a real PX4 for tests that compare whole recordings."""

import os
from pathlib import Path

import pytest


@pytest.fixture
def recorded(shared: Path) -> Path:
    """The folder of recordings, for tests that compare whole recordings: minutes of computing."""
    if os.environ.get("ALL_DIALOGUES") != "1":
        pytest.skip("make test-clients compares whole recordings (ALL_DIALOGUES=1)")
    return shared / "px4"
