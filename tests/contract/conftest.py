"""The recordings of a real PX4."""

import os
from pathlib import Path

import pytest


@pytest.fixture
def recordings_folder(reference_data: Path) -> Path:
    """The folder with all recordings; tests that use it compute for minutes, so `make test` skips them."""
    if os.environ.get("ALL_DIALOGUES") != "1":
        pytest.skip("make nightly compares whole recordings (ALL_DIALOGUES=1)")
    return reference_data / "px4"
