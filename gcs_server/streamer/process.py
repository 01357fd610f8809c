"""The server's side of the process that flies all setpoint streams (`worker.py`).

Measured with ten streams beside 5,000 messages a second, ten WebSocket clients and a browser's 3D view on
two cores (docs/performance.md): a thread of the server's was late by 12 ms and more (p99), since whoever
holds the interpreter lock may itself wait for a processor; a process with real-time priority is not.
"""

from __future__ import annotations

import logging
import sys
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from gcs_server.clock import Clock
from gcs_server.errors import Refused
from gcs_server.faults import FaultLog
from gcs_server.streamer.child import STARTS_WITHIN_S, Child, Gone
from gcs_server.streamer.group_guard import Finding, GroupGuard, GuardState
from gcs_server.streamer.news import WARNING, Report, Snapshot
from gcs_server.streamer.setpoints import Order
from gcs_server.streamer.streams import PayloadSender, Streams, StreamState
from gcs_server.streamer.worker import Route

log = logging.getLogger(__name__)

STATES_FRESH_S = 0.05
SWITCH_INTERVAL_S = 0.0005
"""What the process hands back (for serial and TCP links) is sent by a thread, which must not wait long for
the loop: Python's own 5 ms are a quarter of a stream's period."""
LOOK_EVERY_S = 0.02
"""Whether the process has started is looked at so often."""
NOT_UP = "The process that flies setpoint streams is being started again."
ENDED = "The process that flies setpoint streams ended; nothing is sent any more, and the vehicle fails safe."


@dataclass(slots=True)
class _Known:
    """What the server keeps of a vehicle's streams."""

    sender: PayloadSender
    target: tuple[int, int]
    last: StreamState = field(default_factory=StreamState)
    """As it stood when it was last seen idle."""
    number: int = 0
    """Of its newest stream."""


class StreamProcess(Streams):
    """See `Streams`. Should the process end, it is started again; no stream is.

    Args:
        clock: the machine's: the process has the same.
        own_ids: system and component id of what is sent. The component is not the server's own, so that each
            has its own sequence numbers.
        server_silent_limit_s: the loop's silence after which sending stops.
    """

    def __init__(self, clock: Clock, own_ids: tuple[int, int], *, server_silent_limit_s: float = 1.5) -> None:
        self._clock = clock
        self._own_ids = own_ids
        self._silent_limit_s = server_silent_limit_s
        self._wanted = False
        self._child: Child | None = None
        self._vehicles: dict[str, _Known] = {}
        self._begun: set[str] = set()
        """Who may be streamed to; of all others it is known that nobody does."""
        self._groups: set[str] = set()
        self._may_report = False
        self._reports: list[tuple[str, Report]] = []
        """Of the process's own end."""
        self._states: dict[str, StreamState] = {}
        self._states_s = float("-inf")
        self._faults = FaultLog("setpoint streams")

    @property
    def pid(self) -> int | None:
        """Of the process; None where there is none."""
        return None if self._child is None else self._child.pid

    def start(self) -> None:
        """The process itself begins with the first vehicle."""
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        self._wanted = True
        self._spawn()

    def close(self) -> None:
        self._wanted = False
        if self._child is not None:
            self._child.end()
            self._child = None
        self._begun.clear()
        self._groups.clear()

    def beat(self, snapshots: Mapping[str, Snapshot]) -> None:
        if self._child is not None and self._child.dead:
            self._gone()
        self._spawn()
        if self._begun:
            self._ask("routes", self._routes(self._begun))
            self._ask("beat", dict(snapshots))
        elif self._child is not None and self._child.holds_sockets:
            self._ask("routes", self._routes(set()))  # a closed link's port is free for whoever wants it

    # --- one vehicle's stream ---------------------------------------------------------------------

    def attach(self, vehicle_id: str, sender: PayloadSender, target: tuple[int, int]) -> None:
        self._vehicles[vehicle_id] = _Known(sender, target)
        self._spawn()

    def active(self) -> list[str]:
        return [vehicle_id for vehicle_id in sorted(self._begun) if self.state(vehicle_id).phase != "idle"]

    def state(self, vehicle_id: str) -> StreamState:
        if vehicle_id not in self._begun:
            return self._vehicles[vehicle_id].last
        now_s = self._clock.monotonic_s()
        if now_s - self._states_s > STATES_FRESH_S:
            self._states = self._ask("states", otherwise={})
            self._states_s = now_s
        state = self._states.get(vehicle_id)
        if state is None:  # the process has ended
            return self._vehicles[vehicle_id].last
        if state.phase == "idle":
            self._begun.discard(vehicle_id)
            self._vehicles[vehicle_id].last = state
            return state
        return _older(state, now_s - self._states_s)

    async def ready(self) -> None:
        until_s = self._clock.monotonic_s() + STARTS_WITHIN_S
        while not self._is_up():
            if not self._wanted or self._clock.monotonic_s() >= until_s:
                raise Refused(NOT_UP, remedy="Try again in a second.")
            await self._clock.sleep(LOOK_EVERY_S)

    def _is_up(self) -> bool:
        try:
            return self._child is not None and self._child.is_up()
        except Gone:
            self._gone()
            return False

    def begin(self, vehicle_id: str, order: Order, rate_hz: float, snapshot: Snapshot) -> int:
        """See `Streams`. Raises Refused where the process is just being started again."""
        child, known = self._child, self._vehicles[vehicle_id]
        try:
            if child is None:
                raise Gone
            if vehicle_id not in child.known:
                child.call("attach", vehicle_id, known.target, known.number)
                child.known.add(vehicle_id)
            child.call("routes", self._routes(self._begun | {vehicle_id}))
            number: int = child.call("begin", vehicle_id, order, rate_hz, snapshot)
        except Gone:
            self._gone()
            raise Refused(NOT_UP, remedy="Try again in a second.") from None
        self._begun.add(vehicle_id)
        known.number = max(known.number, number)
        self._changed()
        return number

    def starting(self, vehicle_id: str, number: int) -> bool:
        return vehicle_id in self._begun and self._ask("starting", vehicle_id, number, otherwise=False)

    def engage(self, vehicle_id: str, snapshot: Snapshot, number: int | None = None) -> bool:
        return vehicle_id in self._begun and self._tell("engage", vehicle_id, snapshot, number) is True

    def abandon(self, vehicle_id: str, snapshot: Snapshot, number: int) -> None:
        if vehicle_id in self._begun:
            self._tell("abandon", vehicle_id, snapshot, number)

    def change(self, vehicle_id: str, order: Order, snapshot: Snapshot) -> bool:
        if vehicle_id not in self._begun:
            return False
        self._may_report = True
        taken, states = self._ask("changed", vehicle_id, order, snapshot, otherwise=(False, {}))
        self._states, self._states_s = states, self._clock.monotonic_s()
        return taken

    def wind_down(self, vehicle_id: str, snapshot: Snapshot) -> None:
        if vehicle_id in self._begun:
            self._tell("wind_down", vehicle_id, snapshot)

    def refrain(self, vehicle_id: str) -> None:
        if vehicle_id in self._begun:
            self._tell("refrain", vehicle_id)

    def call_off(self, vehicle_id: str, why: str) -> None:
        if vehicle_id in self._begun:
            self._tell("call_off", vehicle_id, why)

    def end(self, vehicle_id: str, code: str, text: str, number: int | None = None) -> None:
        if vehicle_id in self._begun:
            self._tell("end", vehicle_id, code, text, number)

    def take_reports(self) -> list[tuple[str, Report]]:
        taken, self._reports = self._reports, []
        if self._may_report:
            self._may_report = bool(self._begun)  # whoever is idle by now has reported why
            taken += self._ask("take_reports", otherwise=[])
        return taken

    # --- groups -----------------------------------------------------------------------------------

    def watch(self, guard: GroupGuard) -> None:
        self._groups.add(guard.name)
        self._tell("watch", guard)

    def unwatch(self, name: str) -> None:
        if name in self._groups:
            self._tell("unwatch", name)
            self._groups.discard(name)

    def stand_down(self, name: str) -> None:
        if name in self._groups:
            self._tell("stand_down", name)

    def guard(self, name: str) -> GuardState | None:
        return self._ask("guard", name) if name in self._groups else None

    def change_together(
        self, name: str, orders: Mapping[str, Order], snapshots: Mapping[str, Snapshot], until_s: float
    ) -> bool:
        return self._tell("change_together", name, dict(orders), dict(snapshots), until_s) is True

    def watched(self) -> dict[str, Order | None]:
        return self._ask("watched", otherwise={}) if self._groups else {}

    def take_findings(self) -> list[tuple[str, Finding]]:
        return self._ask("take_findings", otherwise=[]) if self._groups else []

    # --- the process ------------------------------------------------------------------------------

    def _spawn(self) -> None:
        if self._child is not None or not self._wanted or not self._vehicles:
            return
        child = self._child = Child(self._own_ids, self._silent_limit_s)
        threading.Thread(target=self._pass_on, args=(child,), name="offboard-mail", daemon=True).start()

    def _routes(self, vehicles: set[str]) -> dict[str, Route | None]:
        assert self._child is not None
        return self._child.routes({v: self._vehicles[v].sender for v in vehicles})

    def _tell(self, name: str, *arguments: object) -> Any:
        """A call after which the streams may stand otherwise."""
        result = self._ask(name, *arguments)
        self._changed()
        return result

    def _ask(self, name: str, *arguments: object, otherwise: Any = None) -> Any:
        """What the process answers; `otherwise` where it has ended."""
        if self._child is None:
            return otherwise
        try:
            return self._child.call(name, *arguments)
        except Gone:
            self._gone()
            return otherwise

    def _changed(self) -> None:
        self._states_s = float("-inf")
        self._may_report = True

    def _gone(self) -> None:
        """It ended, or does not answer: nothing is streamed any more, and who was is told."""
        child, self._child = self._child, None
        if child is None:
            return
        log.error("the process that flies setpoint streams (%d) ended", child.pid)
        child.end()
        report = Report("fault", WARNING, ENDED)
        for vehicle_id in sorted(self._begun):
            known = self._vehicles[vehicle_id]
            known.last = StreamState(last_end=report, number=known.number)
            self._reports.append((vehicle_id, report))
        self._begun.clear()
        self._groups.clear()
        self._states = {}
        self._spawn()

    def _pass_on(self, child: Child) -> None:
        """A thread of its own: sends what the process cannot, records what it sent."""
        while (mail := child.mail()) is not None:
            try:
                self._take_mail(child, mail)
            except Exception as error:  # the thread goes on: other vehicles' setpoints pass through it
                self._faults.add(error, "passing on what the process sends")

    def _take_mail(self, child: Child, mail: tuple[Any, ...]) -> None:
        if mail[0] == "relay":
            _, vehicle_id, msg_id, payload = mail
            self._vehicles[vehicle_id].sender.send_payload(msg_id, payload)
        else:
            for number, time_us, raw in mail[1]:
                connection = child.connections.get(number)
                if connection is not None:
                    connection.sent_elsewhere(time_us, raw)


def _older(state: StreamState, by_s: float) -> StreamState:
    """As it stands a moment after it was read."""
    if by_s <= 0:
        return state
    left_s = state.valid_left_s
    return replace(
        state,
        age_s=None if state.age_s is None else state.age_s + by_s,
        sent_age_s=None if state.sent_age_s is None else state.sent_age_s + by_s,
        valid_left_s=None if left_s is None else max(0.0, left_s - by_s),
    )
