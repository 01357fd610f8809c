"""What a flight that the simulated PX4 flies on is worth: unchanged beside its log, and how long it takes."""

from __future__ import annotations

import gzip
import json
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gcs_server.logbook import columns as log_columns
from gcs_server.logbook import overview, tasks
from gcs_server.logbook.ulog import read_ulog
from missions.frames import Vector3
from missions.offboard.document import write as write_mission
from missions.plan import write as write_plan
from missions.what_if.flight import NotFlyable
from tests.support.flown_mission import CALM, flown_mission, flown_offboard, square
from tests.support.offboard_missions import mission

from .fault_recordings import FAULTS

PART_S = 20.0
AFTER_CORNER_S = (-14.0, -8.0, 0.0, 6.0, 10.0, 15.0, 24.0, 30.0, 45.0)
"""Moments after the second corner of the square: legs, corners, Return, descent [s]."""
AFTER_BEGIN_S = (13.0, 16.0, 19.0, 23.0, 27.0, 32.0, 40.0, 50.0, 58.0, 62.0)
"""Moments after the begin of the offboard mission: legs, hold, circle, velocity [s]."""
OFFBOARD = """
- {step: take_off, height_m: 6}
- {step: fly, speed_m_s: 4, points: [{offset_ned_m: [20, 0, -6]}, {offset_ned_m: [20, 20, -8]}]}
- {step: hold, duration_s: 4}
- {step: orbit, center: {offset_ned_m: [10, 20, -8]}, radius_m: 8, turns: 2, speed_m_s: 4}
- {step: velocity, velocity_ned_m_s: [2, 0, 0], duration_s: 5}
- {step: land}
"""
CONDITIONS: tuple[tuple[str, bool, Vector3], ...] = (
    ("calm, without sensor noise", False, CALM),
    ("wind of 5 m/s, without sensor noise", False, (3.0, 4.0, 0.0)),
    ("calm, with sensor noise", True, CALM),
)
RECORDED = FAULTS.parent / "logs" / "flight-short.ulg.gz"
RECORDED_PARTS = (("Hold", 20.4, 3.7), ("a go-to in Hold", 24.5, 4.5), ("a landing", 29.5, 9.0))


@dataclass(frozen=True, slots=True)
class Unchanged:
    """One part that was flown on, unchanged."""

    error_m: float
    """Largest distance from the log; NaN: not flown."""
    took_s: float
    why_not: str = ""


def fly_on(folder: Path, from_s: float, duration_s: float, plan: dict[str, str] | None) -> Unchanged:
    """Flies on with the simulated PX4."""
    request: dict[str, Any] = {
        "flown_by": "autopilot", "parameters": {}, "wind_ned_m_s": None, "motor_health": None,
        "moved_ned_m": None, "battery_percent": None, "lost": [], "item": None, "step": None,
    }  # fmt: skip
    begin_s = time.perf_counter()
    try:
        result = json.loads(tasks.rerun(str(folder), from_s, from_s + duration_s, request, plan))
    except NotFlyable as error:
        return Unchanged(np.nan, 0.0, str(error))
    return Unchanged(result["max_error_m"], time.perf_counter() - begin_s)


def table() -> Iterator[str]:
    """Rows of Markdown."""
    yield f"| simulated PX4, {PART_S:.0f} s | flown | median | worst | time of each |"
    yield "|---|---|---|---|---|"
    for text, noise, wind in CONDITIONS:
        with tempfile.TemporaryDirectory() as folder:
            plan = {"kind": "waypoint_plan", "text": write_plan(square()).decode()}
            columns, moment_s = flown_mission(
                Path(folder), square(), until_item=2, fly_on_s=70.0, sensor_noise=noise, wind_ned_m_s=wind
            )
            parts = [fly_on(columns, moment_s + after_s, PART_S, plan) for after_s in AFTER_CORNER_S]
            yield from _rows(f"mission and Return, {text}", parts)
    for text, noise, wind in CONDITIONS:
        with tempfile.TemporaryDirectory() as folder:
            flown = mission(OFFBOARD)
            plan = {"kind": "offboard_mission", "text": write_mission(flown).decode()}
            columns, begin_s = flown_offboard(
                Path(folder), flown, for_s=85.0, sensor_noise=noise, wind_ned_m_s=wind
            )
            parts = [fly_on(columns, begin_s + after_s, PART_S, plan) for after_s in AFTER_BEGIN_S]
            yield from _rows(f"offboard mission, {text}", parts)
    if not RECORDED.exists():
        yield "The log of a real PX4 is not beside this checkout."
        return
    with tempfile.TemporaryDirectory() as folder:
        path, columns = Path(folder) / "flight.ulg", Path(folder) / "columns"
        path.write_bytes(gzip.decompress(RECORDED.read_bytes()))
        log = read_ulog(path)
        log_columns.write(log, overview.encode(log), columns)
        for text, from_s, duration_s in RECORDED_PARTS:
            parts = [fly_on(columns, from_s, duration_s, None)]
            yield from _rows(f"recorded PX4 v1.16, {text}, {duration_s:g} s", parts)


def _rows(text: str, parts: Sequence[Unchanged]) -> Iterator[str]:
    flew = [each for each in parts if np.isfinite(each.error_m)]
    errors_m = [each.error_m for each in flew] or [np.nan]
    took_s = float(np.median([each.took_s for each in flew] or [np.nan]))
    yield (
        f"| {text} | {len(flew)} of {len(parts)} | {np.median(errors_m):.2f} m | {max(errors_m):.2f} m | "
        f"{took_s:.1f} s |"
    )
    for each in parts:
        if each.why_not:
            yield f"| – | not flown: {each.why_not} | | | |"
