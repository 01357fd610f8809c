"""How a vehicle's offboard mission stands, as the topic `offboard_mission` has it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from missions.runner.flown import FlownSample

MissionState = Literal[
    "ready", "taking_off", "starting", "flying", "waiting", "pausing", "paused", "landing", "suspended",
    "done", "aborted", "stopped",
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class MissionName:
    """Which mission it is."""

    name: str
    plan_id: str | None
    """Of the plan that the server keeps; None: it was sent with the start."""
    version: int | None


@dataclass(frozen=True, slots=True)
class OffboardMissionStatus:
    """The topic `offboard_mission`, and what the calls below `…/offboard_mission` answer."""

    state: MissionState
    """waiting: for a person or a condition; paused: in Offboard, on its path; suspended: the vehicle is not
    flown by the mission, which a person can resume; done, aborted, stopped: it is over."""
    name: str
    plan_id: str | None
    """Of the plan that the server keeps; None: it was sent with the start."""
    version: int | None
    client: str
    """Who started it."""
    started_unix_s: float
    place: str | None
    """Which step: "step 3", "step 4.2"; None when it is over."""
    title: str | None
    """The step's name, or what it is."""
    duration_s: float
    """Of the whole mission by plan, on the longest way."""
    remaining_s: float | None
    """By plan, on the longest way; None when it is over."""
    deviation_m: float | None
    """From the position that is sent."""
    outside_corridor_m: float | None
    """How far it is outside the dry run's corridor, 0 inside; None: none was given at the start."""
    question: str | None
    """What a person is asked; answered by `go_on`."""
    reason: str | None
    """Why it is suspended, or over."""
    if_stream_stops: str | None
    """What the vehicle will do by itself should the server or its link die, in words."""


@dataclass(frozen=True, slots=True)
class FlownMission:
    """What was flown of a vehicle's newest mission, beside what was planned."""

    name: str
    started_unix_s: float
    samples: tuple[FlownSample, ...]
    """Two a second; of a flight longer than half an hour fewer."""
    deviation_mean_m: float | None
    """From the places that were sent; null: none was."""
    deviation_max_m: float | None
    """The greatest of it; null: no place was sent."""
