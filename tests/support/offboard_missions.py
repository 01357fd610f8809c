"""Reads offboard missions from YAML, compiles them and samples their segments, for tests."""

from __future__ import annotations

from typing import Any

from missions.offboard.compiler import compile_mission
from missions.offboard.document import OffboardMission
from missions.offboard.positions import Start
from missions.offboard.reader import read
from missions.offboard.segments import Segment
from missions.offboard.timeline import Timeline
from missions.setpoints import Position, Trajectory
from missions.values import HomePosition

HOME = HomePosition(lat_deg=47.0, lon_deg=8.0, alt_amsl_m=480.0)
TAKE_OFF = "- {step: take_off, height_m: 10}\n"
LAND = "- {step: land}\n"


def flight_steps(*steps: str) -> str:
    """YAML of a take-off, these steps, and a landing."""
    return TAKE_OFF + "".join(f"- {{{step}}}\n" for step in steps) + LAND


def mission(steps: str, **fields: Any) -> OffboardMission:
    document = read(f"name: Test\nsteps:\n{steps}")
    return document.model_copy(update=fields)


def timeline(steps: str, start: Start | None = None, files: dict[str, bytes] | None = None) -> Timeline:
    return compile_mission(mission(steps), start=start, files=files)


def finding_codes(compiled_timeline: Timeline) -> set[str]:
    return {finding.code for finding in compiled_timeline.findings}


def segment_titles(compiled_timeline: Timeline) -> list[str]:
    return [segment.title for segment in compiled_timeline.segments]


def position_at(segment: Segment, t_s: float) -> tuple[float, ...]:
    setpoint = segment.at(t_s)
    assert isinstance(setpoint, Trajectory | Position)
    return tuple(axis or 0.0 for axis in setpoint.position_ned_m)
