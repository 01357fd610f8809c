"""The server's side of the setpoint streams, which run in a process of their own.

A method that only reaches the process is declared once, where the process executes it: `_told` and `_asked`
make the server's method from it, with the same arguments.
"""

from __future__ import annotations

import functools
import logging
import sys
from collections.abc import Callable, Coroutine, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Concatenate, ParamSpec

from gcs_server.clock import Clock
from gcs_server.errors import Refused
from gcs_server.links.base import DdsAddress
from gcs_server.ros2.external_mode import REPLIES_ENDED, ModeDeclaration, Registration
from gcs_server.streamer.process.calls import WorkerCalls, WorkerDied
from gcs_server.streamer.process.message_pipe import pickled
from gcs_server.streamer.process.messages import Relay, Update, WorkerMethods
from gcs_server.streamer.schedule.external_modes import ExternalModes
from gcs_server.streamer.schedule.scheduler import StreamScheduler, StreamState
from gcs_server.streamer.separation import Finding, GroupGuard, GuardState
from gcs_server.streamer.transport.vehicle_transport import NoSender, PayloadSender
from gcs_server.streamer.values.snapshot import Snapshot
from gcs_server.streamer.values.stream_request import NOTICE, WARNING, StreamEvent, StreamRequest

log = logging.getLogger(__name__)
P = ParamSpec("P")

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


def _told(
    method: Callable[Concatenate[StreamScheduler, str, P], None],
) -> Callable[Concatenate[Streams, str, P], None]:
    """A method of the scheduler that the server calls for a vehicle with a stream, without waiting."""

    @functools.wraps(method)
    def tell(streams: Streams, vehicle_id: str, *arguments: P.args, **named: P.kwargs) -> None:
        if vehicle_id in streams.begun:
            streams.calls.post(method, vehicle_id, *arguments, **named)

    return tell


def _asked(
    method: Callable[Concatenate[StreamScheduler, str, P], bool],
) -> Callable[Concatenate[Streams, str, P], Coroutine[Any, Any, bool]]:
    """A method of the scheduler whose result the server awaits; False if the vehicle has no stream."""

    @functools.wraps(method)
    async def ask(streams: Streams, vehicle_id: str, *arguments: P.args, **named: P.kwargs) -> bool:
        if vehicle_id not in streams.begun:
            return False
        calls = streams.calls
        return await calls.result_or_false(
            calls.request(method, (vehicle_id,), None, vehicle_id, *arguments, **named)
        )

    return ask


def _told_modes(
    method: Callable[Concatenate[ExternalModes, str, P], None],
) -> Callable[Concatenate[Streams, str, P], None]:
    """A method for the modes that are registered with PX4, which the server calls without waiting."""

    @functools.wraps(method)
    def tell(streams: Streams, vehicle_id: str, *arguments: P.args, **named: P.kwargs) -> None:
        streams.calls.post(method, vehicle_id, *arguments, **named)

    return tell


class Streams:
    """All setpoint streams of the server. If their process ends, it is restarted without its streams. It
    sends updates of all streams (`messages.Update`), so that the state is at most 50 ms old and never older
    than the last answer.

    Only the event loop calls these methods. A method that is not a coroutine never waits for the process; a
    coroutine waits for the process's answer. Tests run the scheduler in the loop instead.

    Args:
        clock: the system's monotonic clock, which the process shares.
        own_ids: system and component id of the sent messages. The component id differs from the
            server's own, so that process and server have separate sequence numbers.
        server_silent_limit_s: time without a message from the event loop after which sending stops.
    """

    def __init__(self, clock: Clock, own_ids: tuple[int, int], *, server_silent_limit_s: float = 1.5) -> None:
        self._clock = clock
        self.calls = WorkerCalls(
            clock, own_ids, server_silent_limit_s, self._on_update, self._on_process_end, self._relay
        )
        self._started = False
        self._vehicles: dict[str, _VehicleRecord] = {}
        self.begun: set[str] = set()
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
        return None if self.calls.worker is None else self.calls.worker.pid

    def start(self) -> None:
        """Allows the process to run; it is started with the first vehicle."""
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        self._started = True
        self._spawn()

    def close(self) -> None:
        """Ends the streams; nothing is sent afterwards."""
        self._started = False
        self.calls.close()
        self._clear_streams()

    def update_snapshots(self, snapshots: Mapping[str, Snapshot]) -> None:
        """Passes the snapshots of vehicles with a stream. The event loop calls this periodically, which also
        shows that the event loop is running."""
        self.calls.check_alive()
        self._spawn()
        if self.begun or self._beginning or self._groups or self._modes:
            self._post_routes()
            self.calls.post(WorkerMethods.update_snapshots, _pickled_each(snapshots))
        else:
            self.links_changed()

    def links_changed(self) -> None:
        """Releases the sockets of closed links; called when a link was opened or closed."""
        worker = self.calls.worker
        idle = not self.begun and not self._beginning
        if worker is not None and (worker.has_closed_sockets or (idle and worker.has_sockets)):
            self._post_routes()

    # --- one vehicle's stream ---------------------------------------------------------------------

    def attach(self, vehicle_id: str, sender: PayloadSender, target: tuple[int, int]) -> None:
        """Adds a vehicle with its (system, component) id; sends nothing."""
        self._vehicles[vehicle_id] = _VehicleRecord(sender, target)
        if self.calls.worker is not None and vehicle_id not in self.begun:
            self.calls.worker.attached.discard(vehicle_id)  # the vehicle's component id may have changed
        self._spawn()

    def forget(self, vehicle_id: str) -> None:
        """Removes a vehicle without a stream, and drops its route."""
        for mode in self._modes.get(vehicle_id, ()):
            self.unregister_mode(vehicle_id, mode.name)
        self._vehicles[vehicle_id].sender = NoSender()

    def active(self) -> list[str]:
        """Ids of the vehicles with a stream."""
        return [vehicle_id for vehicle_id in sorted(self.begun) if self.state(vehicle_id).phase != "idle"]

    def state(self, vehicle_id: str) -> StreamState:
        """State of a vehicle's stream."""
        reported = self._reported.get(vehicle_id) if vehicle_id in self.begun else None
        if reported is None:
            return self._vehicles[vehicle_id].last
        return _aged(reported.state, self._clock.monotonic_s() - reported.at_s)

    async def ready(self) -> None:
        """Returns once a stream can begin without blocking the event loop.

        Raises:
            Refused: streams cannot run now.
        """
        until_s = self._clock.monotonic_s() + START_TIMEOUT_S
        while self.calls.worker is None or not self.calls.worker.started:
            self._spawn()
            if not self._started or self._clock.monotonic_s() >= until_s:
                raise Refused(RESTARTING, remedy="Try again in a second.")
            await self._clock.sleep(CHECK_PERIOD_S)

    async def begin(self, vehicle_id: str, request: StreamRequest, rate_hz: float, snapshot: Snapshot) -> int:
        """Starts a stream and returns its number; 0: the vehicle already has a stream.

        Raises:
            Refused: the stream process is being restarted.
            ValueError: the setpoint cannot be flown.
        """
        await self.ready()
        record = self._vehicles[vehicle_id]
        self._attach_to_worker(vehicle_id)
        self._beginning.append(vehicle_id)

        def on_begun(number: int) -> None:
            if number:
                self.begun.add(vehicle_id)
                record.number = max(record.number, number)
            if number and future.cancelled():
                self.end(vehicle_id, "refused", "Offboard did not start: it was cancelled.", number)

        self._post_routes()
        future = self.calls.request(
            StreamScheduler.begin, (vehicle_id,), on_begun, vehicle_id, request, rate_hz, snapshot
        )
        future.add_done_callback(lambda _: self._beginning.remove(vehicle_id))
        try:
            return await self.calls.wait_for_answer(future)
        except WorkerDied:
            raise Refused(RESTARTING, remedy="Try again in a second.") from None

    def starting(self, vehicle_id: str, number: int) -> bool:
        """Whether this stream is still starting."""
        state = self.state(vehicle_id)
        return state.number == number and state.phase == "starting"

    engage = _asked(StreamScheduler.engage)
    change = _asked(StreamScheduler.change)
    cancel_start = _told(StreamScheduler.cancel_start)
    change_script = _told(StreamScheduler.change_script)
    request_stop = _told(StreamScheduler.request_stop)
    inhibit_mode_requests = _told(StreamScheduler.inhibit_mode_requests)
    force_hold = _told(StreamScheduler.force_hold)

    def end(self, vehicle_id: str, code: str, text: str, number: int | None = None) -> None:
        """Ends the stream immediately; with `number`, only the stream with this number. The caller reports
        the end."""
        if vehicle_id not in self.begun:
            return
        self.calls.post(StreamScheduler.end, vehicle_id, code, text, number)
        state = self.state(vehicle_id)
        if state.phase != "idle" and number in (None, state.number):
            self.begun.discard(vehicle_id)  # the end counts immediately, before the process reports it
            self._vehicles[vehicle_id].last = StreamState(
                rate_hz=state.rate_hz,
                sends_failed=state.sends_failed,
                last_end=StreamEvent(code, NOTICE, text),
                number=state.number,
            )

    def take_reports(self) -> list[tuple[str, StreamEvent]]:
        """Returns the stream events since the last call."""
        reports, self._reports = self._reports, []
        return reports

    # --- modes registered with PX4 ----------------------------------------------------------------

    async def register_mode(self, vehicle_id: str, address: DdsAddress, declaration: ModeDeclaration) -> None:
        """Begins to register a mode with PX4 over ROS 2; `modes` contains the result later.

        Raises:
            Refused: the stream process is being restarted.
            ValueError: the vehicle has a mode of this name, or too many modes.
        """
        await self.ready()
        self._attach_to_worker(vehicle_id)
        try:
            await self.calls.wait_for_answer(
                self.calls.request(StreamScheduler.register_mode, (), None, vehicle_id, address, declaration)
            )
        except WorkerDied:
            raise Refused(RESTARTING, remedy="Try again in a second.") from None

    unregister_mode = _told_modes(ExternalModes.unregister)
    set_mode_ready = _told_modes(ExternalModes.set_ready)
    complete_mode = _told_modes(ExternalModes.complete)
    execute_command = _told_modes(ExternalModes.execute)

    def modes(self) -> Mapping[str, tuple[Registration, ...]]:
        """The modes of this server in PX4, by vehicle."""
        return self._modes

    # --- groups -----------------------------------------------------------------------------------

    def watch(self, guard: GroupGuard) -> None:
        """Adds a guard, which keeps a group's vehicles apart and starts them together."""
        if self.calls.worker is None:
            return  # `guard` reports that the group is not monitored
        for vehicle_id in guard.members:
            self._attach_to_worker(vehicle_id)
        requests = {vehicle_id: guard.pending_request(vehicle_id) for vehicle_id in guard.members}
        self._groups[guard.name] = _Group(requests, guard.state())
        self.calls.post(StreamScheduler.watch, guard)

    def unwatch(self, name: str) -> None:
        """Removes the guard of a group that has ended."""
        if self._groups.pop(name, None) is not None:
            self.calls.post(StreamScheduler.unwatch, name)

    def disable_guard(self, name: str) -> None:
        """Disables the guard of a group that is being stopped."""
        if name in self._groups:
            self.calls.post(StreamScheduler.disable_guard, name)

    def guard(self, name: str) -> GuardState | None:
        """State of a group's guard; None if there is no guard with this name."""
        group = self._groups.get(name)
        return None if group is None else group.state

    async def change_together(
        self,
        name: str,
        requests: Mapping[str, StreamRequest],
        snapshots: Mapping[str, Snapshot],
        until_s: float,
    ) -> bool:
        """Sets new setpoints for members of a group. The setpoints are sent immediately and expire together;
        the other members' are renewed. Returns False if no setpoint was accepted."""
        group = self._groups.get(name)
        if group is None:
            return False
        members = tuple(group.requests)
        change = StreamScheduler.change_together
        return await self.calls.result_or_false(
            self.calls.request(change, members, None, name, dict(requests), dict(snapshots), until_s)
        )

    def watched(self) -> dict[str, StreamRequest | None]:
        """Vehicles of groups, each with its first request; None after the common start."""
        return {
            vehicle_id: request if group.state is not None and group.state.phase == "waiting" else None
            for group in self._groups.values()
            for vehicle_id, request in group.requests.items()
        }

    def take_findings(self) -> list[tuple[str, Finding]]:
        """Returns the findings of groups since the last call."""
        findings, self._findings = self._findings, []
        return findings

    # --- the process ------------------------------------------------------------------------------

    def _spawn(self) -> None:
        if self._started and self._vehicles:
            self.calls.spawn()

    def _attach_to_worker(self, vehicle_id: str) -> None:
        worker, record = self.calls.worker, self._vehicles[vehicle_id]
        if worker is not None and vehicle_id not in worker.attached:
            self.calls.post(WorkerMethods.attach, vehicle_id, record.target, record.number)
            worker.attached.add(vehicle_id)

    def _post_routes(self) -> None:
        worker = self.calls.worker
        if worker is not None:
            streamed = {*self.begun, *self._beginning}
            routes = worker.routes({v: self._vehicles[v].sender for v in streamed})
            self.calls.post(WorkerMethods.set_routes, routes)

    def _on_update(self, update: Update) -> None:
        for vehicle_id, reported in update.states.items():
            previous, state = self._reported.get(vehicle_id), reported
            if vehicle_id in update.unchanged_requests and previous is not None:
                state = replace(reported, request=previous.state.request)
            self._reported[vehicle_id] = _ReportedState(state, update.at_s)
            record = self._vehicles[vehicle_id]
            if vehicle_id in self.begun and state.phase == "idle" and state.number >= record.number:
                self.begun.discard(vehicle_id)
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
        for vehicle_id in sorted(self.begun):
            record = self._vehicles[vehicle_id]
            record.last = StreamState(last_end=report, number=record.number)
            self._reports.append((vehicle_id, report))
        self._clear_streams()
        self._spawn()

    def _clear_streams(self) -> None:
        self.begun.clear()
        self._groups.clear()
        self._reported.clear()
        self._modes = {
            vehicle_id: tuple(
                replace(mode, state="lost", reason=REPLIES_ENDED, executor=None) for mode in modes
            )
            for vehicle_id, modes in self._modes.items()
        }

    def _relay(self, relay: Relay) -> None:
        """Runs in a thread: sends over a link that the process cannot use (serial or TCP). A setpoint that is
        too old is not sent."""
        sender = self._vehicles[relay.vehicle_id].sender
        sender.send_payload(relay.msg_id, relay.payload, created_s=relay.created_s)


def _pickled_each(snapshots: Mapping[str, Snapshot]) -> dict[str, bytes]:
    """Pickles snapshots; a snapshot that cannot be pickled is logged and omitted."""
    pickled_snapshots: dict[str, bytes] = {}
    for vehicle_id, snapshot in snapshots.items():
        try:
            pickled_snapshots[vehicle_id] = pickled(snapshot)
        except Exception:
            log.exception("the snapshot of vehicle %s cannot be sent", vehicle_id)
    return pickled_snapshots


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
