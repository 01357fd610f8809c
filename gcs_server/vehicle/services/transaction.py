"""Runs one command from the request until the vehicle's state shows the result, over a link that loses
packets.

PX4 acknowledges immediately and may refuse milliseconds later. Therefore a command has succeeded only when
the state that the vehicle reports after the request shows the result; an acknowledgement only speeds this up.
Every message requests a state (armed, a mode, a target), so that a repetition has no further effect.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass

from gcs_server.errors import Disconnected, NoReply, Rejected, bounded_reasons
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.dialect import MAVLink_message
from gcs_server.mavlink.mailbox import Reply, Waiter
from gcs_server.vehicle.reducers import FlightState
from gcs_server.vehicle.services.port import VehiclePort
from gcs_server.vehicle.tickets import Ticket

ReportProgress = Callable[[str, float | None], None]
"""Called with (text, fraction 0–1 or None)."""

RESEND_S = 0.5
RESEND_ACCEPTED_S = 1.5
RESEND_IN_PROGRESS_S = 3.0
"""Time until the request is sent again: without an acknowledgement, after an acceptance, and while the
command is in progress [s]."""
IN_PROGRESS_TIMEOUT_S = 6.0
MAX_DURATION_S = 60.0
REQUEST_PERIOD_S = 0.4
REASONS_WAIT_S = 0.6
REASONS_WAIT_AFTER_FIRST_S = 0.25
"""Time after a refusal in which its reasons arrive [s]; the shorter time applies once a reason has
arrived."""
OTHER_STATE_AFTER_S = 1.0
"""Time after an acceptance from which a report of another state counts [s]."""
MAX_ACCEPTED = 3
"""Number of acceptances without the requested state after which the command has failed."""

RESULT_TEXT = {
    d.MAV_RESULT_TEMPORARILY_REJECTED: "not possible now",
    d.MAV_RESULT_DENIED: "denied",
    d.MAV_RESULT_UNSUPPORTED: "not supported by this vehicle",
    d.MAV_RESULT_FAILED: "failed",
    d.MAV_RESULT_CANCELLED: "cancelled",
}
STATE_IDS = (
    d.MAVLINK_MSG_ID_HEARTBEAT,
    d.MAVLINK_MSG_ID_CURRENT_MODE,
    d.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
)


@dataclass(frozen=True, slots=True)
class Request:
    """A MAV_CMD with its parameters 1–7.

    With `frame` the request is a COMMAND_INT; parameters 5 and 6 are degrees, and are sent as 1e-7 degrees.
    """

    command: int
    params: tuple[float, float, float, float, float, float, float]
    frame: int | None = None

    def message(self, system_id: int, component_id: int, confirmation: int, as_int: bool) -> MAVLink_message:
        """The message to send."""
        if as_int:
            p1, p2, p3, p4, x, y, z = self.params
            frame = d.MAV_FRAME_GLOBAL if self.frame is None else self.frame
            xy = (round(x * 1e7), round(y * 1e7)) if self.frame is not None else (int(x), int(y))
            return d.MAVLink_command_int_message(
                system_id, component_id, frame, self.command, 0, 0, p1, p2, p3, p4, *xy, z
            )
        return d.MAVLink_command_long_message(
            system_id, component_id, self.command, confirmation, *self.params
        )


@dataclass(frozen=True, slots=True)
class Goal:
    """Defines when a command has succeeded.

    Args:
        action: the command in error texts: "arm", "switch to Hold".
        reached: (state, time of the first request) → success; only reports after that time count.
        requested_ids: messages to request while waiting, instead of waiting for slow streams.
        ack_is_enough: the vehicle's state cannot show the result, so the acknowledgement is the result.
        listen: further messages after which the goal is checked.
        present_problems: returns texts of the vehicle's current problems that prevent the command.
        repeat_s: period of repetition until the goal or the deadline, whatever the vehicle acknowledges.
            None: repeated only without an acknowledgement.
        on_lost_link: a lost link does not end the command before its deadline.
    """

    action: str
    reached: Callable[[FlightState, float], bool]
    deadline_s: float
    requested_ids: tuple[int, ...] = (d.MAVLINK_MSG_ID_CURRENT_MODE,)
    ack_is_enough: bool = False
    listen: tuple[int, ...] = ()
    present_problems: Callable[[], tuple[str, ...]] | None = None
    repeat_s: float | None = None
    on_lost_link: bool = False


class Transaction:
    """Runs one request until its goal is reached; used once.

    Args:
        request: the request; None: only waits for the goal.
        ticket: permission of the command; looked at directly before each message.
        replaces_request: another request of the same MAV_CMD still waits, so the first refusal may
            belong to that request.
        component_id: the component to which command and requests are sent; None: the autopilot.
    """

    def __init__(
        self,
        vehicle: VehiclePort,
        request: Request | None,
        goal: Goal,
        progress: ReportProgress | None = None,
        ticket: Ticket | None = None,
        replaces_request: bool = False,
        component_id: int | None = None,
    ) -> None:
        self._vehicle = vehicle
        self._request = request
        self._goal = goal
        self._progress = progress
        self._ticket = ticket
        self._ignores_first_refusal = replaces_request
        self._component_id = component_id
        self._as_int = request is not None and request.frame is not None
        self._tried_forms = 1
        self._send_count = 0
        self._accepted_count = 0
        self._accepted_s = float("inf")
        self._refusal: int | None = None
        """MAV_RESULT of the refusal."""
        self._refused_s = float("inf")
        self._first_event = vehicle.events.last_index
        self._start_s = vehicle.clock.monotonic_s()
        self._deadline_s = self._start_s + goal.deadline_s
        self._next_send_s = self._start_s if request is not None else float("inf")
        self._next_request_s = self._start_s + (REQUEST_PERIOD_S / 2 if request is not None else 0.0)

    async def run(self) -> None:
        """Returns once the goal is reached.

        Raises:
            Rejected: the vehicle refused the command, or accepted it and did not reach the goal.
            NoReply: the vehicle did not answer by the deadline.
            Interrupted: the command's ticket was cancelled: a later command, or the end of its client's
                control.
            Disconnected: the vehicle or its link was lost, and the goal does not allow for it.
        """
        ids = (d.MAVLINK_MSG_ID_COMMAND_ACK, *STATE_IDS, *self._goal.listen)
        while True:
            try:
                with self._vehicle.mailbox.expect(*ids) as waiter:
                    await self._until_done(waiter)
                return
            except Disconnected:
                if not self._goal.on_lost_link:
                    raise

    async def _until_done(self, waiter: Waiter) -> None:
        while True:
            now_s = self._vehicle.clock.monotonic_s()
            if self._is_done():
                return
            self._raise_if_ended(now_s)
            if now_s >= self._next_send_s:
                self._send(now_s)
            if now_s >= self._next_request_s:
                self._request_messages(now_s)
            wake_s = min(self._deadline_s, self._next_send_s, self._next_request_s)
            if self._goal.repeat_s is None:
                wake_s = min(wake_s, self._refused_s + self._reasons_wait_s())
            try:
                async with asyncio.timeout(max(0.0, wake_s - now_s)):
                    message = await waiter.next()
            except TimeoutError:
                continue
            self._take(message)
            while (next_message := waiter.take()) is not None:
                self._take(next_message)

    def _is_done(self) -> bool:
        if self._goal.ack_is_enough:
            return self._accepted_count > 0 and self._refusal is None
        return self._goal.reached(self._vehicle.flight_state, self._start_s)

    def _raise_if_ended(self, now_s: float) -> None:
        if self._ticket is not None:
            self._ticket.require()
        goal, vehicle = self._goal, self._vehicle
        is_repeated = goal.repeat_s is not None
        refused_s = self._deadline_s if is_repeated else self._refused_s + self._reasons_wait_s()
        if self._refusal is not None and now_s >= refused_s:
            reason = RESULT_TEXT.get(self._refusal, f"result {self._refusal}")
            raise self._rejected(f"Vehicle {vehicle.id} refused to {goal.action}: {reason}.", self._refusal)
        if not is_repeated and self._accepted_count >= MAX_ACCEPTED and self._reports_another_state():
            raise self._rejected(
                f"Vehicle {vehicle.id} accepted the request to {goal.action}, but does not do it.", None
            )
        if now_s >= self._deadline_s:
            if self._accepted_count and self._reports_another_state():
                raise self._rejected(
                    f"Vehicle {vehicle.id} accepted the request to {goal.action}, but did not do it within "
                    f"{goal.deadline_s:g} s.",
                    None,
                )
            if self._request is None and self._reports_another_state():
                raise self._rejected(
                    f"Vehicle {vehicle.id} did not {goal.action} within {goal.deadline_s:g} s.", None
                )
            raise NoReply(
                f"Vehicle {vehicle.id} did not answer the request to {goal.action} "
                f"within {goal.deadline_s:g} s.",
                deadline_s=goal.deadline_s,
                remedy="Check the link, then check the vehicle's state before you repeat the command.",
            )

    def _reasons_wait_s(self) -> float:
        return REASONS_WAIT_AFTER_FIRST_S if self._warnings() else REASONS_WAIT_S

    def _warnings(self) -> list[str]:
        """Warnings of the vehicle since the request."""
        return [
            event.text
            for event in self._vehicle.events.since(self._first_event)
            if event.kind in ("status_text", "event") and event.severity <= d.MAV_SEVERITY_WARNING
        ]

    def _reports_another_state(self) -> bool:
        """Whether the vehicle still reports another state some time after its last acceptance."""
        flight_state = self._vehicle.flight_state
        since_s = self._accepted_s if self._accepted_count else self._start_s
        return min(flight_state.mode_s, flight_state.heartbeat_s) > since_s + OTHER_STATE_AFTER_S

    def _send(self, now_s: float) -> None:
        assert self._request is not None
        message = self._request.message(*self._target(), min(self._send_count, 255), self._as_int)
        self._vehicle.send(message, until_s=self._deadline_s)
        self._send_count += 1
        resend_s = RESEND_ACCEPTED_S if self._accepted_count else RESEND_S
        self._next_send_s = now_s + (self._goal.repeat_s or resend_s)
        if self._progress is not None:
            attempt_text = f" (attempt {self._send_count})" if self._send_count > 1 else ""
            self._progress(
                f"Commanding vehicle {self._vehicle.id} to {self._goal.action}{attempt_text}", None
            )

    def _request_messages(self, now_s: float) -> None:
        for msg_id in self._goal.requested_ids:
            request = Request(d.MAV_CMD_REQUEST_MESSAGE, (float(msg_id), 0, 0, 0, 0, 0, 0))
            self._vehicle.send(request.message(*self._target(), 0, False))
        self._next_request_s = now_s + REQUEST_PERIOD_S if self._goal.requested_ids else float("inf")

    def _target(self) -> tuple[int, int]:
        """System and component."""
        identity = self._vehicle.identity
        return identity.system_id, self._component_id or identity.component_id

    def _take(self, message: Reply) -> None:
        if message.get_msgId() != d.MAVLINK_MSG_ID_COMMAND_ACK or self._request is None:
            return
        if not is_our_ack(message, self._vehicle, self._request.command, self._component_id):
            return
        now_s = self._vehicle.clock.monotonic_s()
        result = message.result
        if result == d.MAV_RESULT_ACCEPTED:
            self._accepted_count += 1
            self._accepted_s = now_s
            self._refusal = None if self._goal.repeat_s else self._refusal
            if self._goal.repeat_s is None:
                self._next_send_s = now_s + RESEND_ACCEPTED_S
            if self._goal.requested_ids:
                self._next_request_s = min(self._next_request_s, now_s + 0.02)
        elif result == d.MAV_RESULT_IN_PROGRESS:
            if self._goal.repeat_s is None:
                self._extend_deadline(message.progress, now_s)
        elif (
            result in (d.MAV_RESULT_COMMAND_LONG_ONLY, d.MAV_RESULT_COMMAND_INT_ONLY)
            and self._tried_forms < 2
        ):
            self._tried_forms += 1
            self._as_int = result == d.MAV_RESULT_COMMAND_INT_ONLY
            self._next_send_s = now_s
        elif self._ignores_first_refusal:
            self._ignores_first_refusal = False
            self._next_send_s = now_s  # a second refusal belongs to this request
        else:
            if self._refusal is None:
                self._refused_s = now_s
                if self._goal.present_problems is not None:
                    self._request_checks()
            self._refusal = result
            if self._goal.repeat_s is None:
                self._next_send_s = float("inf")

    def _request_checks(self) -> None:
        """Requests PX4's check results, which it sends only when they change or on request."""
        identity = self._vehicle.identity
        request = Request(d.MAV_CMD_RUN_PREARM_CHECKS, (0, 0, 0, 0, 0, 0, 0))
        self._vehicle.send(request.message(identity.system_id, identity.component_id, 0, False))

    def _extend_deadline(self, percent: int, now_s: float) -> None:
        latest_s = self._start_s + MAX_DURATION_S
        self._deadline_s = min(max(self._deadline_s, now_s + IN_PROGRESS_TIMEOUT_S), latest_s)
        self._next_send_s = now_s + RESEND_IN_PROGRESS_S
        if self._progress is not None:
            self._progress(
                f"Vehicle {self._vehicle.id}: {self._goal.action}", percent / 100 if percent <= 100 else None
            )

    def _rejected(self, message: str, mav_result: int | None) -> Rejected:
        warnings = self._warnings()
        problems = self._goal.present_problems() if self._goal.present_problems is not None else ()
        reasons = bounded_reasons(dict.fromkeys((*warnings, *problems)))
        if reasons:
            message += f" Reason: {'; '.join(reasons)}."
        return Rejected(message, mav_result=mav_result, reasons=reasons)


def is_our_ack(message: Reply, vehicle: VehiclePort, command: int, component_id: int | None = None) -> bool:
    """Whether an acknowledgement is for this server's request: by command, sender and target; MAVLink 1 has
    no target (0/0). `component_id` is the commanded component; None: the autopilot."""
    identity = vehicle.identity
    sender = (message.get_srcSystem(), message.get_srcComponent())
    target = (message.target_system, message.target_component)
    return (
        message.command == command
        and sender == (identity.system_id, component_id or identity.component_id)
        and target in (vehicle.own_ids, (0, 0), (vehicle.own_ids[0], 0))
    )
