"""The interface between the event loop and the setpoint streams."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from gcs_server.links.base import DdsAddress
from gcs_server.ros2.external_mode import ModeDeclaration, Registration
from gcs_server.ros2.mode_executor import ExecutorCommand
from gcs_server.streamer.separation.guard import Finding, GroupGuard, GuardState
from gcs_server.streamer.transport.sender import PayloadSender
from gcs_server.streamer.values.events import StreamEvent
from gcs_server.streamer.values.snapshot import Snapshot
from gcs_server.streamer.values.stream_request import StreamRequest
from missions.avoidance.setpoints import AvoidanceStatus
from missions.runner.script import ScriptChange, ScriptProgress
from missions.setpoints import DirectSetpoint


@dataclass(frozen=True, slots=True)
class StreamState:
    """The state of a stream at one time."""

    phase: str = "idle"
    request: StreamRequest | None = None
    sent: DirectSetpoint | None = None
    """The sent setpoint; None while nothing is sent."""
    limited: tuple[str, ...] = ()
    """Current reductions by the limits, as texts."""
    rate_hz: float = 50.0
    rate_achieved_hz: float | None = None
    age_s: float | None = None
    sent_age_s: float | None = None
    valid_left_s: float | None = None
    sends_failed: int = 0
    last_end: StreamEvent | None = None
    number: int = 0
    """Number of this stream, counted for each vehicle."""
    steady_s: float = 0.0
    """Time for which setpoints have been sent without a pause [s]."""
    avoiding: AvoidanceStatus | None = None
    """State of obstacle avoidance; None: avoidance is off."""
    progress: ScriptProgress | None = None
    """Progress of an offboard mission; None: no mission."""


class Streams(Protocol):
    """All streams of the server.

    In the server, the streams run in a separate process (`process/stream_process.py`); tests run the
    scheduler directly. Only the event loop calls these methods. A method that is not a coroutine never waits
    for the process; a coroutine waits for the process's answer.
    """

    def start(self) -> None:
        """Starts the streams; nothing is sent before `begin`."""
        ...

    def close(self) -> None:
        """Ends the streams; nothing is sent afterwards."""
        ...

    def update_snapshots(self, snapshots: Mapping[str, Snapshot]) -> None:
        """Passes the snapshots of vehicles with a stream. The event loop calls this periodically, which also
        shows that the event loop is running."""
        ...

    def links_changed(self) -> None:
        """Releases the sockets of closed links; called when a link was opened or closed."""
        ...

    def attach(self, vehicle_id: str, sender: PayloadSender, target: tuple[int, int]) -> None:
        """Adds a vehicle with its (system, component) id; sends nothing."""
        ...

    def forget(self, vehicle_id: str) -> None:
        """Removes a vehicle without a stream, and drops its route."""
        ...

    def active(self) -> list[str]:
        """Ids of the vehicles with a stream."""
        ...

    def state(self, vehicle_id: str) -> StreamState:
        """State of a vehicle's stream."""
        ...

    async def ready(self) -> None:
        """Returns once a stream can begin without blocking the event loop.

        Raises:
            Refused: streams cannot run now.
        """
        ...

    async def begin(self, vehicle_id: str, request: StreamRequest, rate_hz: float, snapshot: Snapshot) -> int:
        """Starts a stream and returns its number; 0: the vehicle already has a stream.

        Raises:
            Refused: the stream process is being restarted.
            ValueError: the setpoint cannot be flown.
        """
        ...

    def starting(self, vehicle_id: str, number: int) -> bool:
        """Whether this stream is still starting."""
        ...

    async def engage(self, vehicle_id: str, snapshot: Snapshot, number: int | None = None) -> bool:
        """Starts the validity of the setpoint, because the vehicle reports Offboard; returns False if this
        stream has ended."""
        ...

    def cancel_start(self, vehicle_id: str, snapshot: Snapshot, number: int) -> None:
        """Puts the vehicle into Hold if it still switches to Offboard; called when the start of this stream
        has failed after Offboard was requested."""
        ...

    async def change(self, vehicle_id: str, request: StreamRequest, snapshot: Snapshot) -> bool:
        """Sets a new setpoint and sends it immediately; returns False if there is no stream.

        Raises:
            ValueError: the setpoint cannot be flown; the previous setpoint continues.
        """
        ...

    def change_script(self, vehicle_id: str, change: ScriptChange) -> None:
        """Updates the offboard mission that is being flown, and renews it."""
        ...

    def request_stop(self, vehicle_id: str, snapshot: Snapshot) -> None:
        """Keeps the position by setpoints until Hold is confirmed."""
        ...

    def inhibit_mode_requests(self, vehicle_id: str) -> None:
        """Prevents mode requests of the stream for some seconds; called when a client commands a mode."""
        ...

    def force_hold(self, vehicle_id: str, why: str) -> None:
        """Stops a vehicle at its position and requests Hold, without waiting for the event loop."""
        ...

    def end(self, vehicle_id: str, code: str, text: str, number: int | None = None) -> None:
        """Ends the stream immediately; with `number`, only the stream with this number. The caller reports
        the end."""
        ...

    def take_reports(self) -> list[tuple[str, StreamEvent]]:
        """Returns the stream events since the last call."""
        ...

    async def register_mode(self, vehicle_id: str, address: DdsAddress, declaration: ModeDeclaration) -> None:
        """Begins to register a mode with PX4 over ROS 2; `modes` contains the result later.

        Raises:
            Refused: the stream process is being restarted.
            ValueError: the vehicle has a mode of this name, or too many modes.
        """
        ...

    def unregister_mode(self, vehicle_id: str, name: str) -> None:
        """Removes a mode of this server from PX4."""
        ...

    def set_mode_ready(self, vehicle_id: str, name: str, ready: bool) -> None:
        """Sets whether PX4 may arm the vehicle in a mode of this server, given by its name."""
        ...

    def complete_mode(self, vehicle_id: str, mode: str, success: bool) -> None:
        """Reports to PX4 that a mode (`external_1` …) is complete, or that it has failed."""
        ...

    def execute_command(self, vehicle_id: str, mode: str, command: ExecutorCommand) -> None:
        """Sends a command of a mode's executor to PX4; `modes` contains the outcome later."""
        ...

    def modes(self) -> Mapping[str, tuple[Registration, ...]]:
        """The modes of this server in PX4, by vehicle."""
        ...

    def watch(self, guard: GroupGuard) -> None:
        """Adds a guard, which keeps a group's vehicles apart and starts them together."""
        ...

    def unwatch(self, name: str) -> None:
        """Removes the guard of a group that has ended."""
        ...

    def disable_guard(self, name: str) -> None:
        """Disables the guard of a group that is being stopped."""
        ...

    def guard(self, name: str) -> GuardState | None:
        """State of a group's guard; None if there is no guard with this name."""
        ...

    async def change_together(
        self,
        name: str,
        requests: Mapping[str, StreamRequest],
        snapshots: Mapping[str, Snapshot],
        until_s: float,
    ) -> bool:
        """Sets new setpoints for members of a group. The setpoints are sent immediately and expire together.
        Returns False if no setpoint was accepted."""
        ...

    def watched(self) -> dict[str, StreamRequest | None]:
        """Vehicles of groups, each with its first request; None after the common start."""
        ...

    def take_findings(self) -> list[tuple[str, Finding]]:
        """Returns the findings of groups since the last call."""
        ...
