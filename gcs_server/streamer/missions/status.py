"""How a vehicle's offboard mission stands, as the topic `offboard_mission` has it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

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
    question: str | None
    """What a person is asked; answered by `go_on`."""
    reason: str | None
    """Why it is suspended, or over."""
    if_stream_stops: str | None
    """What the vehicle will do by itself should the server or its link die, in words."""
