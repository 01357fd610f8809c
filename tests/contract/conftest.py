"""The fake station of the simulator's own tests, and the recorded dialogues."""

import os
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "unit" / "vehicle_sim"))
sys.path.insert(0, str(Path(__file__).resolve().parent))


@pytest.fixture
def recorded(shared: Path) -> Path:
    """The recordings, for a test that compares whole ones: minutes of computing."""
    if os.environ.get("ALL_DIALOGUES") != "1":
        pytest.skip("whole recordings are compared by make test-clients (ALL_DIALOGUES=1)")
    return shared / "px4"
