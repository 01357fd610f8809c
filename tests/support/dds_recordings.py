"""Where the recordings of PX4's ROS 2 topics are, by version of PX4."""

from __future__ import annotations

from pathlib import Path

import pytest

_SHARED = Path(__file__).resolve().parents[3] / "shared" / "px4"
FOLDERS = {"1.16": _SHARED / "dds", "1.17": _SHARED / "v1.17" / "dds"}


def dds_folder(px4: str) -> Path:
    """The folder of a version; skips the test where the recordings are missing."""
    if not FOLDERS[px4].is_dir():
        pytest.skip(f"the ROS 2 recordings of PX4 v{px4} are not beside this checkout")
    return FOLDERS[px4]
