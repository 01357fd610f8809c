"""Reads compiled missions, which come from a process that reads foreign documents."""

from __future__ import annotations

import asyncio

from gcs_server.errors import Refused
from gcs_server.plans import typed_values
from gcs_server.plans.tasks import Answer
from missions.offboard.timeline import Timeline
from missions.trajectory.limits import MotionLimits

CompiledMission = tuple[Timeline, MotionLimits]
"""The timeline of one vehicle, and its limits for pauses and approaches."""


async def compiled_missions(answer: Answer) -> dict[str | None, CompiledMission]:
    """The result of the task `compile`, by role; read in a thread, because a long mission takes a tenth of a
    second. Raises Refused if it cannot be read."""
    try:
        return await asyncio.to_thread(
            typed_values.from_bytes, answer.body, dict[str | None, CompiledMission]
        )
    except typed_values.WrongValue as error:
        raise Refused(f"The compiled mission cannot be read: {error}.") from error
