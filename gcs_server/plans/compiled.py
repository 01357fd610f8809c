"""Reads compiled missions, which come from a process that reads foreign documents."""

from __future__ import annotations

import asyncio
from typing import TypeVar

from gcs_server.errors import Refused
from gcs_server.plans import typed_values
from gcs_server.plans.tasks import Answer
from missions.offboard.timeline import Timeline
from missions.trajectory.limits import MotionLimits

CompiledMission = tuple[Timeline, MotionLimits]
"""The timeline of one vehicle, and its limits for pauses and approaches."""
T = TypeVar("T")


async def compiled_mission(answer: Answer) -> CompiledMission:
    """The result of the task `compile`. Raises Refused if it cannot be read."""
    return await _read(answer, CompiledMission)


async def compiled_roles(answer: Answer) -> dict[str, CompiledMission]:
    """The result of the task `compile_roles`, by role. Raises Refused if it cannot be read."""
    return await _read(answer, dict[str, CompiledMission])


async def _read(answer: Answer, expected: type[T]) -> T:
    """In a thread, because a long mission takes a tenth of a second."""
    try:
        return await asyncio.to_thread(typed_values.from_bytes, answer.body, expected)
    except typed_values.WrongValue as error:
        raise Refused(f"The compiled mission cannot be read: {error}.") from error
