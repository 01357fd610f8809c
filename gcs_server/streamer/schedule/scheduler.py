"""The setpoint streams and groups of all vehicles: `step` sends due setpoints and returns the time of the
next call.

It uses no thread, socket or process: `process/worker.py` runs it in a separate process, and tests call it
directly.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass

from gcs_server.clock import Clock
from gcs_server.links.base import DdsAddress
from gcs_server.ros2.external_mode import ModeDeclaration, Registration
from gcs_server.streamer.schedule.external_modes import ExternalModes, OpenModePort, no_mode_port
from gcs_server.streamer.schedule.stream import VehicleStream
from gcs_server.streamer.separation import Actions, Finding, GroupGuard, GuardState, MemberView
from gcs_server.streamer.transport.ros2 import Ros2Transport
from gcs_server.streamer.transport.vehicle_transport import (
    PayloadSender,
    Topics,
    VehicleTransport,
    no_topics,
)
from gcs_server.streamer.values.snapshot import Snapshot
from gcs_server.streamer.values.stream_request import OFFBOARD, WARNING, StreamEvent, StreamRequest
from missions.avoidance.setpoints import AvoidanceStatus
from missions.runner.script import ScriptChange, ScriptProgress
from missions.setpoints import DirectSetpoint

log = logging.getLogger(__name__)


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


@dataclass(slots=True)
class _Stream:
    machine: VehicleStream
    transport: VehicleTransport
    snapshot: Snapshot
    sends_failed: int = 0
    number: int = 0
    """Number of the newest stream; calls for an earlier stream have no effect."""


class StreamScheduler:
    """All streams and groups, in the stream process; `process/streams.py` is the server's side. After any
    call, call `step` soon.

    A fault affects one vehicle or group only: the vehicle's stream ends (the vehicle's failsafe takes
    over), or the group's members are put into Hold. All other vehicles continue.

    Args:
        clock: monotonic time, and the time of ROS 2 messages.
        server_silent_limit_s: time without a message from the event loop after which sending stops.
        own_ids: system and component id of mode requests over ROS 2.
        open_mode_port: opens the topics with which modes are registered.
    """

    def __init__(
        self,
        clock: Clock,
        *,
        server_silent_limit_s: float = 1.5,
        own_ids: tuple[int, int] = (255, 191),
        open_mode_port: OpenModePort = no_mode_port,
    ) -> None:
        self._clock, self._own_ids = clock, own_ids
        self._silent_limit_s = server_silent_limit_s
        self._streams: dict[str, _Stream] = {}
        self._guards: dict[str, GroupGuard] = {}
        self._loop_message_s = clock.monotonic_s()
        """Time of the last message from the event loop."""
        self.external_modes = ExternalModes(clock, open_mode_port)
        """The modes of this server in PX4."""

    def close(self) -> None:
        """Unregisters the modes, and ends the streams; nothing is sent afterwards."""
        self.external_modes.close()
        self._streams.clear()
        self._guards.clear()

    def step(self) -> float:
        """Runs all streams once; returns the time of the next step [s, monotonic]; infinity: no step is
        due."""
        now_s = self._clock.monotonic_s()
        server_alive = now_s - self._loop_message_s < self._silent_limit_s
        due_s = self.external_modes.step(now_s, server_alive=server_alive, flown=self._flies_mode)
        for guard in self._guards.values():
            self._run_guard(guard)
            due_s = min(due_s, guard.due_s)
        for vehicle_id, stream in self._streams.items():
            machine = stream.machine
            if not machine.streaming:
                continue
            try:
                for outgoing in machine.tick(
                    self._clock.monotonic_s(), stream.snapshot, self._loop_message_s
                ):
                    if not stream.transport.send(outgoing):
                        stream.sends_failed += 1
                        machine.cadence.not_sent(self._clock.monotonic_s())
            except Exception as error:
                self._end_failed_stream(vehicle_id, error)
            due_s = min(due_s, machine.due_s(self._loop_message_s))
        return due_s

    def update_snapshots(self, snapshots: Mapping[str, Snapshot]) -> None:
        """Takes the snapshots of vehicles, periodically while the event loop runs."""
        self._record_loop_message(self._clock.monotonic_s())
        for vehicle_id, snapshot in snapshots.items():
            stream = self._streams.get(vehicle_id)
            if stream is None:
                continue
            try:
                stream.snapshot = snapshot.plausible()
            except Exception as error:  # the other snapshots are still used
                self._end_failed_stream(vehicle_id, error)

    # --- one vehicle's stream ---------------------------------------------------------------------

    def attach(
        self,
        vehicle_id: str,
        sender: PayloadSender,
        target: tuple[int, int],
        number: int = 0,
        topics: Topics = no_topics,
    ) -> None:
        """Adds a vehicle with its (system, component) id; sends nothing.

        Args:
            number: number of the vehicle's last stream.
            topics: the vehicle's ROS 2 topics, while the vehicle is reached over ROS 2.
        """
        ros2 = Ros2Transport(target, self._own_ids, lambda: int(self._clock.unix_s() * 1e6))
        transport = VehicleTransport(sender, target, topics, ros2)
        machine = VehicleStream(transport, server_silent_limit_s=self._silent_limit_s)
        no_snapshot = Snapshot(-1.0, "", None, None, None)
        self._streams[vehicle_id] = _Stream(machine, transport, no_snapshot, number=number)

    def active(self) -> list[str]:
        """Ids of the vehicles with a stream."""
        return [vehicle_id for vehicle_id, stream in self._streams.items() if stream.machine.streaming]

    def state(self, vehicle_id: str) -> StreamState:
        """State of a vehicle's stream."""
        stream = self._streams[vehicle_id]
        machine, cadence, now_s = stream.machine, stream.machine.cadence, self._clock.monotonic_s()
        return StreamState(
            machine.phase,
            machine.request if machine.streaming else None,
            machine.sent if machine.streaming else None,
            machine.limited if machine.streaming else (),
            cadence.rate_hz,
            cadence.achieved_hz(now_s) if machine.streaming else None,
            machine.age_s(now_s),
            cadence.age_s(now_s) if machine.streaming else None,
            machine.valid_left_s(now_s),
            stream.sends_failed,
            machine.last_end,
            stream.number,
            cadence.steady_s if machine.streaming else 0.0,
            machine.avoiding if machine.streaming else None,
            machine.progress,
        )

    def phases(self) -> dict[str, tuple[str, int]]:
        """Phase and number of each vehicle's newest stream."""
        return {
            vehicle_id: (stream.machine.phase, stream.number) for vehicle_id, stream in self._streams.items()
        }

    def guard_states(self) -> dict[str, GuardState]:
        """Guard state of all watched groups."""
        return {name: guard.state() for name, guard in self._guards.items()}

    def guard_phases(self) -> list[tuple[str, str, int]]:
        """Name, phase and number of held members of each watched group."""
        return [(name, guard.phase, len(guard.held)) for name, guard in self._guards.items()]

    @property
    def has_pending_reports(self) -> bool:
        """Whether there are reports or findings to take."""
        return any(stream.machine.reports for stream in self._streams.values()) or any(
            guard.findings for guard in self._guards.values()
        )

    def begin(self, vehicle_id: str, request: StreamRequest, rate_hz: float, snapshot: Snapshot) -> int:
        """Starts a stream and returns its number; 0: the vehicle already has a stream.

        Raises:
            ValueError: the setpoint cannot be flown.
        """
        stream, now_s = self._streams[vehicle_id], self._clock.monotonic_s()
        if stream.machine.streaming:
            return 0
        stream.snapshot = snapshot.plausible()
        stream.number += 1
        stream.sends_failed = 0
        self._record_loop_message(now_s)
        try:
            stream.machine.begin(now_s, request, rate_hz, stream.snapshot)
        except Exception as error:
            stream.machine.end("refused", f"The setpoint stream did not begin: {error}", report=False)
            raise
        return stream.number

    def engage(self, vehicle_id: str, snapshot: Snapshot, number: int | None = None) -> bool:
        """Starts the validity of the setpoint, because the vehicle reports Offboard; returns False if this
        stream has ended."""
        stream = self._streams[vehicle_id]
        if number not in (None, stream.number):
            return False
        stream.snapshot = snapshot.plausible()
        return stream.machine.engage(self._clock.monotonic_s())

    def cancel_start(self, vehicle_id: str, snapshot: Snapshot, number: int) -> None:
        """Puts the vehicle into Hold if it still switches to Offboard; called when the start of this stream
        has failed after Offboard was requested."""
        stream = self._streams[vehicle_id]
        if stream.number == number:
            stream.snapshot = snapshot.plausible()
            stream.machine.cancel_start(self._clock.monotonic_s(), stream.snapshot)

    def change(self, vehicle_id: str, request: StreamRequest, snapshot: Snapshot) -> bool:
        """Sets a new setpoint and sends it immediately; returns False if there is no stream.

        Raises:
            ValueError: the setpoint cannot be flown; the previous setpoint continues.
        """
        stream = self._streams[vehicle_id]
        stream.snapshot = snapshot.plausible()
        return stream.machine.change(self._clock.monotonic_s(), request, stream.snapshot)

    def change_script(self, vehicle_id: str, change: ScriptChange) -> None:
        """Updates the offboard mission that is being flown, and renews it."""
        self._streams[vehicle_id].machine.change_script(self._clock.monotonic_s(), change)

    def request_stop(self, vehicle_id: str, snapshot: Snapshot) -> None:
        """Keeps the position by setpoints until Hold is confirmed."""
        stream = self._streams[vehicle_id]
        stream.snapshot = snapshot.plausible()
        stream.machine.request_stop(self._clock.monotonic_s(), stream.snapshot)

    def inhibit_mode_requests(self, vehicle_id: str) -> None:
        """Prevents mode requests of the stream for some seconds; called when a client commands a mode."""
        self._streams[vehicle_id].machine.inhibit_mode_requests(self._clock.monotonic_s())

    def force_hold(self, vehicle_id: str, why: str) -> None:
        """Stops a vehicle at its position and requests Hold, without waiting for the event loop."""
        stream = self._streams[vehicle_id]
        stream.machine.force_hold(self._clock.monotonic_s(), stream.snapshot, "group", why)

    def end(self, vehicle_id: str, code: str, text: str, number: int | None = None) -> None:
        """Ends the stream immediately; with `number`, only the stream with this number. The caller reports
        the end."""
        stream = self._streams[vehicle_id]
        if number in (None, stream.number):
            stream.machine.end(code, text, report=False)

    def take_reports(self) -> list[tuple[str, StreamEvent]]:
        """Returns the stream events since the last call."""
        reports: list[tuple[str, StreamEvent]] = []
        for vehicle_id, stream in self._streams.items():
            while stream.machine.reports:
                reports.append((vehicle_id, stream.machine.reports.popleft()))
        return reports

    # --- modes registered with PX4 ----------------------------------------------------------------

    def register_mode(self, vehicle_id: str, address: DdsAddress, declaration: ModeDeclaration) -> None:
        """Begins to register a mode with PX4; see `ExternalModes.register`."""
        self._record_loop_message(self._clock.monotonic_s())
        self.external_modes.register(vehicle_id, address, declaration)

    def modes(self) -> dict[str, tuple[Registration, ...]]:
        """The modes of this server in PX4, by vehicle."""
        return self.external_modes.states()

    def _flies_mode(self, vehicle_id: str) -> bool:
        """Whether a stream flies the vehicle in a registered mode, and ROS 2 carries its setpoints."""
        stream = self._streams.get(vehicle_id)
        if stream is None or not stream.machine.streaming or stream.machine.mode == OFFBOARD:
            return False
        return stream.transport.topics() is not None

    # --- groups -----------------------------------------------------------------------------------

    def watch(self, guard: GroupGuard) -> None:
        """Adds a guard, which keeps a group's vehicles apart and starts them together."""
        self._guards[guard.name] = guard

    def unwatch(self, name: str) -> None:
        """Removes the guard of a group that has ended."""
        self._guards.pop(name, None)

    def disable_guard(self, name: str) -> None:
        """Disables the guard of a group that is being stopped."""
        guard = self._guards.get(name)
        if guard is not None:
            guard.disable_guard()

    def take_findings(self) -> list[tuple[str, Finding]]:
        """Returns the findings of groups since the last call."""
        findings: list[tuple[str, Finding]] = []
        for name, guard in self._guards.items():
            while guard.findings:
                findings.append((name, guard.findings.popleft()))
        return findings

    def change_together(
        self,
        name: str,
        requests: Mapping[str, StreamRequest],
        snapshots: Mapping[str, Snapshot],
        until_s: float,
    ) -> bool:
        """Sets new setpoints for members of a group. The setpoints are sent immediately and expire together;
        the other members' are renewed. Returns False if no setpoint was accepted."""
        guard, now_s = self._guards.get(name), self._clock.monotonic_s()
        if guard is None:
            return False
        flying = [v for v in guard.members if v not in guard.held]
        phases = {self._streams[v].machine.phase for v in flying}
        if guard.phase != "flying" or not flying or not phases <= {"streaming", "holding"}:
            return False
        if not set(requests) <= set(flying) or ("holding" in phases and set(requests) != set(flying)):
            return False  # expired setpoints are not renewed, because a path would start again
        for vehicle_id in requests:
            self._streams[vehicle_id].snapshot = snapshots[vehicle_id].plausible()
        self._execute(guard, now_s, Actions(new_requests=dict(requests)), until_s)
        return True

    def _run_guard(self, guard: GroupGuard) -> None:
        now_s = self._clock.monotonic_s()
        if now_s < guard.due_s:
            return
        try:
            actions = guard.check(now_s, {v: self._view_of(v) for v in guard.members})
        except Exception as error:  # a failure of the guard must be reported
            guard.skip_check(now_s)
            actions = guard.stop_on_fault(now_s, f"The check that keeps the group apart failed ({error})")
            if actions.hold:
                log.exception("the guard of group %s failed", guard.name)
        self._execute(guard, now_s, actions, guard.until_s)

    def _view_of(self, vehicle_id: str) -> MemberView:
        stream = self._streams[vehicle_id]
        machine = stream.machine
        ended = machine.last_end.text if machine.last_end is not None and not machine.streaming else None
        return MemberView(
            machine.phase, machine.request if machine.streaming else None, stream.snapshot, ended
        )

    def _execute(self, guard: GroupGuard, now_s: float, actions: Actions, until_s: float) -> None:
        """Applies all actions before another setpoint is sent to a member."""
        refused = None
        for vehicle_id, request in actions.new_requests.items():
            stream = self._streams[vehicle_id]
            try:
                if not stream.machine.change(now_s, request, stream.snapshot):
                    refused = f"Vehicle {vehicle_id} could not start"
            except Exception as error:
                if not isinstance(error, ValueError):
                    log.exception("the setpoint of vehicle %s failed", vehicle_id)
                refused = f"Vehicle {vehicle_id} could not start ({error})"
        if refused is not None:
            actions = guard.stop_on_fault(now_s, refused)
        elif actions.new_requests or until_s != guard.until_s:
            guard.set_expiry(until_s)
            for vehicle_id in guard.members:
                if vehicle_id not in guard.held:
                    self._streams[vehicle_id].machine.set_expiry(until_s)
        for vehicle_id, why in actions.hold.items():
            stream = self._streams[vehicle_id]
            try:
                stream.machine.force_hold(now_s, stream.snapshot, actions.code, why)
            except Exception as error:  # the other members must still be held
                self._end_failed_stream(vehicle_id, error)

    def _end_failed_stream(self, vehicle_id: str, error: Exception) -> None:
        """Ends only the stream that failed."""
        log.exception("the stream to vehicle %s failed", vehicle_id)
        text = f"The setpoint stream failed: {error}"
        self._streams[vehicle_id].machine.end("fault", text, WARNING)

    def _record_loop_message(self, now_s: float) -> None:
        """Records a message from the event loop. If this process stalled, first ends the streams that should
        have ended during the stall.
        """
        if now_s - self._loop_message_s >= self._silent_limit_s:
            for vehicle_id, stream in self._streams.items():
                try:
                    stream.machine.tick(now_s, stream.snapshot, self._loop_message_s)
                except Exception as error:
                    self._end_failed_stream(vehicle_id, error)
        self._loop_message_s = max(self._loop_message_s, now_s)
