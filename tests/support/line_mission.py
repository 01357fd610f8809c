"""A short offboard mission for tests of missions as flight modes: it flies 8 m north and holds."""

from __future__ import annotations

from typing import Any

MODE_NAME = "Short line"
"""Name of the mission's flight mode."""
MISSION: dict[str, Any] = {
    "format": "offboard-gcs-mission",
    "version": 1,
    "name": "Line",
    "steps": [
        {"step": "fly", "points": [{"offset_ned_m": [8, 0, 0]}], "speed_m_s": 3},
        {"step": "hold", "duration_s": 2},
    ],
}
