"""A mission that is registered with PX4 as a flight mode, and its status."""

from __future__ import annotations

from dataclasses import dataclass

from gcs_server.ros2.external_mode import RegistrationState
from gcs_server.streamer.missions.status import MissionName


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
