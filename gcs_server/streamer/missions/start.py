"""The mission that is started, and the type of the function that starts its background tasks."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from typing import Any, Protocol

from gcs_server.streamer.missions.status import MissionName
from gcs_server.streamer.values.stream_request import OFFBOARD
from missions.offboard.timeline import Timeline
from missions.runner.corridor import Corridor
from missions.trajectory.limits import MotionLimits


class Task(Protocol):
    """A background task that can be cancelled."""

    def cancel(self) -> object:
        """Cancels the task."""
        ...

    def done(self) -> bool:
        """Whether the task has ended."""
        ...


Spawn = Callable[[str, Coroutine[Any, Any, None]], Task]
"""Starts a background task with a name."""


@dataclass(frozen=True, slots=True)
class Start:
    """A mission to fly, and the client that starts it."""

    mission: MissionName
    timeline: Timeline
    motion: MotionLimits
    client: str
    low_battery_share: float
    corridor: Corridor | None = None
    """Corridor of the dry run that the client named at the start; None: no corridor is monitored."""
    role: str | None = None
    """Role of the vehicle in a mission of several vehicles; None: the mission has one vehicle."""
    dry_run: str | None = None
    """Id of the dry run that computed `corridor`."""
    mode: str = OFFBOARD
    """Mode in which the mission is flown: Offboard, or the mode that is registered with PX4 for it."""
