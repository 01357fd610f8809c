"""Status of a vehicle's offboard mission, as in the topic `offboard_mission`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

MissionState = Literal[
    "ready", "taking_off", "starting", "flying", "not_following", "waiting", "pausing", "paused", "landing",
    "suspended", "done", "aborted", "stopped",
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class MissionName:
    """Name and origin of a mission."""

    name: str
    plan_id: str | None
    """Id of the stored plan; None: the mission was sent with the start."""
    version: int | None


@dataclass(frozen=True, slots=True)
class OffboardMissionStatus:
    """Status of an offboard mission: the topic `offboard_mission`, and the response of the routes below
    `…/offboard_mission`."""

    state: MissionState
    """not_following: the vehicle does not follow (failsafe, lost link, far behind), so the mission's time
    stops; it goes on by itself; waiting: for the operator or a condition; paused: the vehicle holds in
    Offboard, on the mission's path; suspended: the mission does not control the vehicle, and the operator can
    resume it; done, aborted, stopped: the mission has ended."""
    name: str
    plan_id: str | None
    """Id of the stored plan; None: the mission was sent with the start."""
    version: int | None
    client: str
    """Client that started the mission."""
    role: str | None
    """Role of the vehicle in a mission of several vehicles; None: the mission has one vehicle."""
    others: tuple[str, ...]
    """Ids of the other vehicles of the mission; pause, resume and abort act on all of them."""
    started_unix_s: float
    place: str | None
    """Current step: "step 3", "step 4.2"; None when the mission has ended."""
    title: str | None
    """Name of the step, or its kind."""
    duration_s: float
    """Planned duration of the whole mission, with the longest branch."""
    remaining_s: float | None
    """Planned time left, with the longest branch; None when the mission has ended."""
    deviation_m: float | None
    """Distance of the vehicle from the streamed position [m]."""
    outside_corridor_m: float | None
    """Distance of the vehicle from the dry run's corridor [m], 0 inside; None: no corridor is monitored."""
    dry_run: str | None
    """Id of the dry run whose corridor is monitored."""
    mode: str
    """Mode in which the mission is flown: offboard, or the mission's own mode (`external_1` …)."""
    executor_in_charge: bool | None
    """Whether PX4 has put the executor of this mode in charge of the vehicle. While it is false, PX4 rejects
    the mission's take-off, landing and mode changes, because another party commands the vehicle. null: the
    mode has no executor, or is not registered."""
    question: str | None
    """Question to the operator; answered by `go_on`."""
    reason: str | None
    """Why the mission is suspended or has ended."""
    if_stream_stops: str | None
    """Text: what the vehicle does if the server or its link fails."""
