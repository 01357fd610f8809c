"""Status of a vehicle's offboard mission, as in the topic `offboard_mission`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from gcs_server.ros2.external_mode import RegistrationState
from gcs_server.streamer.values.stream_request import OFFBOARD
from missions.offboard.timeline import Timeline
from missions.runner.corridor import Corridor
from missions.trajectory.limits import MotionLimits

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


@dataclass(frozen=True, slots=True)
class MissionAsMode:
    """A mission to register with PX4 as an external flight mode (not PX4's own mode Mission)."""

    name: str
    """The mode's name: 1 to 24 printable ASCII characters."""
    mission: MissionName
    text: bytes
    """The mission's document, as JSON."""
    despite: tuple[str, ...]
    """Codes of the mission's error findings that the client accepts."""
    client: str
    defer_failsafes_s: int = 0
    """How long PX4 may defer a failsafe while the vehicle flies in the mode [s]; 0: never."""
    takes_off: bool = False
    """Whether the mission begins with a take-off; then the mode has an executor."""


@dataclass(frozen=True, slots=True)
class MissionModeStatus:
    """A mission that is registered with PX4 as a flight mode."""

    name: str
    """The mode's name, as all ground stations show it."""
    state: RegistrationState
    """registering: PX4 has not answered yet. registered: the mode can be selected: on the ground if the
    mission begins with a take-off, otherwise in the air. refused, lost: the mode cannot be selected."""
    mode: str | None
    """The mode as in `status.mode`: external_1 to external_8; null while the mode is not registered."""
    ready: bool
    """Whether the mission can begin now. A mission with a take-off begins when the vehicle is armed in the
    mode, any other mission when the mode is selected in the air. While `ready` is false, PX4 does not arm in
    the mode."""
    reason: str
    """Why the registration was refused or lost, or why the mode is registered but not ready; otherwise
    empty."""
    mission: str
    """Name of the mission."""
    plan_id: str | None
    version: int | None
    """Version of the stored plan that the mode flies, even if newer versions were saved later."""
    client: str
    """Client that registered the mode."""
    defer_failsafes_s: int
    """How long PX4 may defer a failsafe while the vehicle flies in the mode; 0: never."""
    failsafe_deferred: bool
    """Whether PX4 defers a failsafe now, because the vehicle flies in the mode."""
    takes_off: bool
    """Whether the mission begins with a take-off. If true, it starts on the ground, when the vehicle is armed
    in the mode. If false, it starts in flight, when the mode is selected."""
