"""Scenarios for tests: a short mission with its scenario in a folder."""

from __future__ import annotations

from pathlib import Path

MISSION = """
format: offboard-gcs-mission
version: 1
name: Out and back
steps:
  - {step: take_off, height_m: 5}
  - step: fly
    points: [{offset_ned_m: [10, 0, -5]}, {offset_ned_m: [0, 0, -5]}]
  - {step: land}
"""
HEAD = """
format: offboard-gcs-scenario
version: 1
name: Out
mission: mission.yaml
"""


PROGRAM_HEAD = """
format: offboard-gcs-scenario
version: 1
name: Program
"""


def program_scenario(folder: Path, text: str) -> Path:
    """Writes a scenario without a mission; returns its path."""
    path = folder / "program.yaml"
    path.write_text(PROGRAM_HEAD + text, encoding="utf-8")
    return path


def scenario_file(folder: Path, text: str, name: str = "scenario.yaml") -> Path:
    """Writes a scenario of the short mission, with further fields; returns its path."""
    (folder / "mission.yaml").write_text(MISSION, encoding="utf-8")
    path = folder / name
    path.write_text(HEAD + text, encoding="utf-8")
    return path
