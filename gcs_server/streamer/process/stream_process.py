"""The server's interface to the process that runs all setpoint streams (`worker.py`).

A process with real-time priority sends setpoints on time. A thread of the server sent 1 % of its setpoints at
least 12 ms late, because the thread that has the interpreter lock may wait for a processor (measured on two
cores with ten streams, 5,000 messages a second, ten WebSocket clients and a browser's 3D view:
docs/performance.md).
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from gcs_server.clock import Clock
from gcs_server.errors import Refused
from gcs_server.links.base import DdsAddress
from gcs_server.ros2.external_mode import REPLIES_ENDED, ModeDeclaration, Registration
from gcs_server.ros2.mode_executor import ExecutorCommand
from gcs_server.streamer.process import messages, mode_messages
from gcs_server.streamer.process.calls import WorkerCalls, WorkerDied
from gcs_server.streamer.schedule.streams import Streams, StreamState
from gcs_server.streamer.separation.guard import Finding, GroupGuard, GuardState
from gcs_server.streamer.transport.sender import NoSender, PayloadSender
from gcs_server.streamer.values.events import NOTICE, WARNING, StreamEvent
from gcs_server.streamer.values.snapshot import Snapshot
from gcs_server.streamer.values.stream_request import StreamRequest
from missions.runner.script import ScriptChange

START_TIMEOUT_S = 10.0
SWITCH_INTERVAL_S = 0.0005
"""Python's switch interval [s]. A thread sends setpoints over links that the process cannot use (serial and
TCP), and must not wait long for the interpreter lock: Python's default of 5 ms is a quarter of a stream's
period."""
CHECK_PERIOD_S = 0.02
"""Period at which the start of the process is checked [s]."""
RESTARTING = "The setpoint streams' process is being restarted."
PROCESS_ENDED = (
    "The setpoint streams' process ended: the setpoint stream stopped, and the vehicle's failsafe takes over."
)


@dataclass(slots=True)
class _VehicleRecord:
    """The server's data of a vehicle's streams."""

    sender: PayloadSender
    target: tuple[int, int]
    last: StreamState = field(default_factory=StreamState)
    """State of the stream when it was last idle."""
    number: int = 0
    """Number of the vehicle's newest stream."""


@dataclass(frozen=True, slots=True)
class _ReportedState:
    """The state of a stream as the process last reported it."""

    state: StreamState
    at_s: float


@dataclass(slots=True)
class _Group:
    """The server's data of a watched group."""

    requests: Mapping[str, StreamRequest | None]
    """First request of each member, at the common start."""
    state: GuardState | None


class StreamProcess(Streams):
    """Runs the streams in a separate process; see `Streams`. If the process ends, it is restarted without
    its streams. The process sends updates of all streams (`messages.Update`), so that the state is at
    most 50 ms old and never older than the last answer. Only coroutines wait for the process.

    Args:
        clock: the system's monotonic clock, which the process shares.
        own_ids: system and component id of the sent messages. The component id differs from the
            server's own, so that process and server have separate sequence numbers.
        server_silent_limit_s: time without a message from the event loop after which sending stops.
    """

    def __init__(self, clock: Clock, own_ids: tuple[int, int], *, server_silent_limit_s: float = 1.5) -> None:
        self._clock = clock
        self._calls = WorkerCalls(
            clock, own_ids, server_silent_limit_s, self._on_update, self._on_process_end, self._relay
        )
        self._started = False
        self._vehicles: dict[str, _VehicleRecord] = {}
        self._begun: set[str] = set()
        """Vehicles that may have a stream; all other vehicles have no stream."""
        self._beginning: list[str] = []
        """Vehicles whose `begin` has no answer yet."""
        self._reported: dict[str, _ReportedState] = {}
        self._groups: dict[str, _Group] = {}
        self._reports: list[tuple[str, StreamEvent]] = []
        self._findings: list[tuple[str, Finding]] = []
        self._modes: Mapping[str, tuple[Registration, ...]] = {}

    @property
    def pid(self) -> int | None:
        """Process id; None if there is no process."""
        return None if self._calls.worker is None else self._calls.worker.pid

    def start(self) -> None:
        """Allows the process to run; it is started with the first vehicle."""
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        self._started = True
        self._spawn()

    def close(self) -> None:
        self._started = False
        self._calls.close()
        self._clear_streams()

    def update_snapshots(self, snapshots: Mapping[str, Snapshot]) -> None:
        self._calls.check_alive()
        self._spawn()
        if self._begun or self._beginning or self._groups or self._modes:
            self._post_routes()
            self._post(messages.SnapshotUpdate.pickled(snapshots))
        else:
            self.links_changed()

    def links_changed(self) -> None:
        worker = self._calls.worker
        idle = not self._begun and not self._beginning
        if worker is not None and (worker.has_closed_sockets or (idle and worker.has_sockets)):
            self._post_routes()

    # --- one vehicle's stream ---------------------------------------------------------------------

    def attach(self, vehicle_id: str, sender: PayloadSender, target: tuple[int, int]) -> None:
        self._vehicles[vehicle_id] = _VehicleRecord(sender, target)
        if self._calls.worker is not None and vehicle_id not in self._begun:
            self._calls.worker.attached.discard(vehicle_id)  # the vehicle's component id may have changed
        self._spawn()

    def forget(self, vehicle_id: str) -> None:
        for mode in self._modes.get(vehicle_id, ()):
            self.unregister_mode(vehicle_id, mode.name)
        self._vehicles[vehicle_id].sender = NoSender()

    def active(self) -> list[str]:
        return [vehicle_id for vehicle_id in sorted(self._begun) if self.state(vehicle_id).phase != "idle"]

    def state(self, vehicle_id: str) -> StreamState:
        reported = self._reported.get(vehicle_id) if vehicle_id in self._begun else None
        if reported is None:
            return self._vehicles[vehicle_id].last
        return _aged(reported.state, self._clock.monotonic_s() - reported.at_s)

    async def ready(self) -> None:
        until_s = self._clock.monotonic_s() + START_TIMEOUT_S
        while self._calls.worker is None or not self._calls.worker.started:
            self._spawn()
            if not self._started or self._clock.monotonic_s() >= until_s:
                raise Refused(RESTARTING, remedy="Try again in a second.")
            await self._clock.sleep(CHECK_PERIOD_S)

    async def begin(self, vehicle_id: str, request: StreamRequest, rate_hz: float, snapshot: Snapshot) -> int:
        await self.ready()
        record = self._vehicles[vehicle_id]
        self._attach_to_worker(vehicle_id)
        self._beginning.append(vehicle_id)

        def on_begun(number: int) -> None:
            if number:
                self._begun.add(vehicle_id)
                record.number = max(record.number, number)
            if number and future.cancelled():
                self.end(vehicle_id, "refused", "Offboard did not start: it was cancelled.", number)

        self._post_routes()
        future = self._calls.request(messages.BeginStream(vehicle_id, request, rate_hz, snapshot), on_begun)
        future.add_done_callback(lambda _: self._beginning.remove(vehicle_id))
        try:
            return await self._calls.wait_for_answer(future)
        except WorkerDied:
            raise Refused(RESTARTING, remedy="Try again in a second.") from None

    def starting(self, vehicle_id: str, number: int) -> bool:
        state = self.state(vehicle_id)
        return state.number == number and state.phase == "starting"

    async def engage(self, vehicle_id: str, snapshot: Snapshot, number: int | None = None) -> bool:
        return vehicle_id in self._begun and await self._request(
            messages.EngageStream(vehicle_id, snapshot, number)
        )

    def cancel_start(self, vehicle_id: str, snapshot: Snapshot, number: int) -> None:
        if vehicle_id in self._begun:
            self._post(messages.CancelStart(vehicle_id, snapshot, number))

    async def change(self, vehicle_id: str, request: StreamRequest, snapshot: Snapshot) -> bool:
        return vehicle_id in self._begun and await self._request(
            messages.ChangeSetpoint(vehicle_id, request, snapshot)
        )

    def change_script(self, vehicle_id: str, change: ScriptChange) -> None:
        if vehicle_id in self._begun:
            self._post(messages.ChangeScript(vehicle_id, change))

    def request_stop(self, vehicle_id: str, snapshot: Snapshot) -> None:
        if vehicle_id in self._begun:
            self._post(messages.RequestStop(vehicle_id, snapshot))

    def inhibit_mode_requests(self, vehicle_id: str) -> None:
        if vehicle_id in self._begun:
            self._post(messages.InhibitModeRequests(vehicle_id))

    def force_hold(self, vehicle_id: str, why: str) -> None:
        if vehicle_id in self._begun:
            self._post(messages.ForceHold(vehicle_id, why))

    def end(self, vehicle_id: str, code: str, text: str, number: int | None = None) -> None:
        if vehicle_id not in self._begun:
            return
        self._post(messages.EndStream(vehicle_id, code, text, number))
        state = self.state(vehicle_id)
        if state.phase != "idle" and number in (None, state.number):
            self._begun.discard(vehicle_id)  # the end counts immediately, before the process reports it
            self._vehicles[vehicle_id].last = StreamState(
                rate_hz=state.rate_hz,
                sends_failed=state.sends_failed,
                last_end=StreamEvent(code, NOTICE, text),
                number=state.number,
            )

    def take_reports(self) -> list[tuple[str, StreamEvent]]:
        reports, self._reports = self._reports, []
        return reports

    # --- modes registered with PX4 ----------------------------------------------------------------

    async def register_mode(self, vehicle_id: str, address: DdsAddress, declaration: ModeDeclaration) -> None:
        await self.ready()
        self._attach_to_worker(vehicle_id)
        try:
            await self._calls.wait_for_answer(
                self._calls.request(mode_messages.RegisterMode(vehicle_id, address, declaration))
            )
        except WorkerDied:
            raise Refused(RESTARTING, remedy="Try again in a second.") from None

    def unregister_mode(self, vehicle_id: str, name: str) -> None:
        self._post(mode_messages.UnregisterMode(vehicle_id, name))

    def set_mode_ready(self, vehicle_id: str, name: str, ready: bool) -> None:
        self._post(mode_messages.SetModeReady(vehicle_id, name, ready))

    def complete_mode(self, vehicle_id: str, mode: str, success: bool) -> None:
        self._post(mode_messages.CompleteMode(vehicle_id, mode, success))

    def execute_command(self, vehicle_id: str, mode: str, command: ExecutorCommand) -> None:
        self._post(mode_messages.ExecuteCommand(vehicle_id, mode, command))

    def modes(self) -> Mapping[str, tuple[Registration, ...]]:
        return self._modes

    # --- groups -----------------------------------------------------------------------------------

    def watch(self, guard: GroupGuard) -> None:
        if self._calls.worker is None:
            return  # `guard` reports that the group is not monitored
        for vehicle_id in guard.members:
            self._attach_to_worker(vehicle_id)
        requests = {vehicle_id: guard.pending_request(vehicle_id) for vehicle_id in guard.members}
        self._groups[guard.name] = _Group(requests, guard.state())
        self._post(messages.WatchGroup(guard))

    def unwatch(self, name: str) -> None:
        if self._groups.pop(name, None) is not None:
            self._post(messages.UnwatchGroup(name))

    def disable_guard(self, name: str) -> None:
        if name in self._groups:
            self._post(messages.DisableGuard(name))

    def guard(self, name: str) -> GuardState | None:
        group = self._groups.get(name)
        return None if group is None else group.state

    async def change_together(
        self,
        name: str,
        requests: Mapping[str, StreamRequest],
        snapshots: Mapping[str, Snapshot],
        until_s: float,
    ) -> bool:
        group = self._groups.get(name)
        if group is None:
            return False
        members = tuple(group.requests)
        return await self._request(
            messages.ChangeSetpoints(name, dict(requests), dict(snapshots), until_s, members)
        )

    def watched(self) -> dict[str, StreamRequest | None]:
        return {
            vehicle_id: request if group.state is not None and group.state.phase == "waiting" else None
            for group in self._groups.values()
            for vehicle_id, request in group.requests.items()
        }

    def take_findings(self) -> list[tuple[str, Finding]]:
        findings, self._findings = self._findings, []
        return findings

    # --- the process ------------------------------------------------------------------------------

    def _spawn(self) -> None:
        if self._started and self._vehicles:
            self._calls.spawn()

    def _post(self, message: messages.Post) -> None:
        self._calls.post(message)

    def _attach_to_worker(self, vehicle_id: str) -> None:
        worker, record = self._calls.worker, self._vehicles[vehicle_id]
        if worker is not None and vehicle_id not in worker.attached:
            self._post(messages.Attach(vehicle_id, record.target, record.number))
            worker.attached.add(vehicle_id)

    def _post_routes(self) -> None:
        worker = self._calls.worker
        if worker is not None:
            streamed = {*self._begun, *self._beginning}
            self._post(messages.Routes(worker.routes({v: self._vehicles[v].sender for v in streamed})))

    async def _request(self, message: messages.Request[bool]) -> bool:
        """Sends a request and returns the answer; False if the process has ended."""
        try:
            return await self._calls.wait_for_answer(self._calls.request(message))
        except WorkerDied:
            return False

    def _on_update(self, update: messages.Update) -> None:
        for vehicle_id, reported in update.states.items():
            previous, state = self._reported.get(vehicle_id), reported
            if vehicle_id in update.unchanged_requests and previous is not None:
                state = replace(reported, request=previous.state.request)
            self._reported[vehicle_id] = _ReportedState(state, update.at_s)
            record = self._vehicles[vehicle_id]
            if vehicle_id in self._begun and state.phase == "idle" and state.number >= record.number:
                self._begun.discard(vehicle_id)
                record.last = state
        for name, guard in update.guards.items():
            group = self._groups.get(name)
            if group is not None:
                group.state = guard
        self._modes = update.modes
        self._reports += update.reports
        self._findings += update.findings

    def _on_process_end(self) -> None:
        """Publishes an event for each stream that stopped; called when the process has ended."""
        report = StreamEvent("fault", WARNING, PROCESS_ENDED)
        for vehicle_id in sorted(self._begun):
            record = self._vehicles[vehicle_id]
            record.last = StreamState(last_end=report, number=record.number)
            self._reports.append((vehicle_id, report))
        self._clear_streams()
        self._spawn()

    def _clear_streams(self) -> None:
        self._begun.clear()
        self._groups.clear()
        self._reported.clear()
        self._modes = {
            vehicle_id: tuple(
                replace(mode, state="lost", reason=REPLIES_ENDED, executor=None) for mode in modes
            )
            for vehicle_id, modes in self._modes.items()
        }

    def _relay(self, vehicle_id: str, msg_id: int, payload: bytes, created_s: float) -> None:
        """Runs in a thread: sends over a link that the process cannot use (serial or TCP). A setpoint that is
        too old is not sent."""
        self._vehicles[vehicle_id].sender.send_payload(msg_id, payload, created_s=created_s)


def _aged(state: StreamState, elapsed_s: float) -> StreamState:
    """The state after `elapsed_s` without an update: the ages are greater, the remaining validity is
    shorter."""
    if elapsed_s <= 0:
        return state
    left_s = state.valid_left_s
    return replace(
        state,
        age_s=None if state.age_s is None else state.age_s + elapsed_s,
        sent_age_s=None if state.sent_age_s is None else state.sent_age_s + elapsed_s,
        valid_left_s=None if left_s is None else max(0.0, left_s - elapsed_s),
    )
