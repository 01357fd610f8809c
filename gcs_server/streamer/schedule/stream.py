"""One vehicle's stream as a state machine without I/O: the setpoint to send, and the time to stop.

    idle ── begin ──► starting ── engage ──► streaming ◄── change ──┐
      ▲                                         │ expiry            │
      │                 ┌───────────────────────┼───────────────────┤
      │              landing                 holding ── time ──► to_hold
      └── end ◄─────────┴───────────────────────┴───────────────────┘

After a failsafe without setpoints, PX4 returns to Offboard as soon as they arrive again, and flies to them at
its own speed. The phase `interrupted` keeps the vehicle at its place until a new setpoint, or until expiry.

After a failed start, the stream stays in the phase `undoing` for a while: the vehicle may still switch to
Offboard, and must then be put into Hold.

The module uses no clock, thread or socket: `tick` receives the time and an immutable snapshot of the vehicle.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

from gcs_server.streamer.schedule.cadence import Cadence
from gcs_server.streamer.schedule.pipeline import SetpointPipeline
from gcs_server.streamer.values.snapshot import MAX_EXTRAPOLATION_S, Snapshot
from gcs_server.streamer.values.stream_request import (
    INFO,
    NOTICE,
    OFFBOARD,
    WARNING,
    ModeRequest,
    Outgoing,
    SetpointDue,
    SetpointLoader,
    StreamEvent,
    StreamRequest,
    mode_label,
)
from missions.avoidance.setpoints import AvoidanceStatus
from missions.frames import Vector3
from missions.runner.script import Script, ScriptChange, ScriptProgress
from missions.setpoints import DirectSetpoint, Path

MODE_REQUEST_PERIOD_S = 1.0
MAX_MODE_REQUESTS = 5
"""Number of unconfirmed mode requests after which the stream stops; PX4's own failsafe then takes over."""
LOST_S = MAX_MODE_REQUESTS * MODE_REQUEST_PERIOD_S
"""Time after the loss of the connection in which the stream still tries to hold the vehicle [s]: later PX4
has acted, and setpoints that arrive again would make it leave its Return for Offboard."""
MAX_START_S = 20.0
"""Time within which Offboard must be confirmed [s]."""
STOP_TIMEOUT_S = 7.0
"""Time after which the stream requests Hold itself, if the event loop has not completed a stop [s]."""
UNDO_S = 2.5
"""Time in which a vehicle may still report Offboard after a failed start [s]; one heartbeat may be lost."""
INHIBIT_MODE_REQUESTS_S = 6.5
"""Time after a pilot's mode command in which the stream requests no mode itself [s]."""
INTERRUPTED_S = 5.0
"""Time for which the stream keeps a vehicle in failsafe at its place; then it ends [s]."""
UNKNOWN_PLACE_S = 0.5
"""Time after which it ends if the vehicle has no position: the failsafe then has another cause [s]."""
FAILSAFE_MODES = frozenset({"position", "altitude", "manual", "stabilized", "hold"})
"""Modes of a failsafe from which the stream lets the vehicle return. A Land or Return that the vehicle has
begun is never interrupted."""
UNSEEN_S = 1.5
"""Time without a position of the vehicle after which it may not have received setpoints [s]."""
FOLLOWED_WITHIN_M = 2.0
"""A vehicle that was not seen has followed if it is at most this far from its setpoint [m]."""
JUMP_M, JUMP_M_S = 5.0, 20.0
"""The local origin has moved if the local position changes by more than JUMP_M + JUMP_M_S × time."""


class VehicleStream:
    """The stream of one vehicle; the module's docstring shows its phases.

    Args:
        loader: the transport; packs each setpoint that is to be sent.
        server_silent_limit_s: time without a message from the event loop after which the stream stops.
    """

    def __init__(self, loader: SetpointLoader, *, server_silent_limit_s: float = 1.5) -> None:
        self._silent_limit_s = server_silent_limit_s
        self._pipeline = SetpointPipeline(loader)
        self._end_reason = ""
        """Why the stream itself ended the flight; reported when the stream ends."""
        self.phase = "idle"
        self.request: StreamRequest | None = None
        self.mode = OFFBOARD
        self.cadence = Cadence()
        """Times of the setpoints; while idle, the times of the last stream."""
        self.reports: deque[StreamEvent] = deque(maxlen=50)
        self.last_end: StreamEvent | None = None
        self._since_s = 0.0  # start of the request's age and validity, or of the phase `undoing`
        self._engaged_s = math.inf  # time from which leaving Offboard ends the stream
        self._phase_until_s = math.inf
        self._requested_mode: str | None = None
        self._mode_requests = 0
        self._next_request_s = 0.0
        self._inhibited_until_s = -math.inf
        self._was_armed = False
        self._lost_s = math.inf  # since when the connection to the vehicle is lost
        self._last_estimate: tuple[float, Vector3] | None = None
        self._interrupted_s = self._place_s = 0.0  # start of the interruption; when its place was last known
        self._in_failsafe = False
        self._seen_s = math.inf  # when the position was last known, and setpoints were sent

    # --- calls of the event loop ------------------------------------------------------------------

    def begin(self, now_s: float, request: StreamRequest, rate_hz: float, snapshot: Snapshot) -> None:
        """Starts streaming before Offboard is requested; the validity starts with `engage`."""
        self.cadence.begin(rate_hz)
        self._requested_mode, self.last_end, self._last_estimate = None, None, None
        self._engaged_s, self._was_armed, self.mode = math.inf, False, request.mode
        self._seen_s = math.inf
        self._enter("starting", now_s, MAX_START_S)
        self._pipeline.reset()
        self._accept(now_s, request, snapshot)

    def engage(self, now_s: float) -> bool:
        """Starts the validity, because the vehicle reports Offboard. False if the stream has ended."""
        if self.phase != "starting" or self.request is None:
            return False
        self._engaged_s = self._since_s = now_s
        self._pipeline.restart_path(now_s)
        self._enter("streaming", now_s, self.request.duration_s)
        return True

    def change(self, now_s: float, request: StreamRequest, snapshot: Snapshot) -> bool:
        """Applies a new setpoint immediately; returns False if no stream accepts setpoints."""
        if self.phase == "interrupted" and self._in_failsafe and snapshot.mode == self.mode:
            self._on_return(now_s, snapshot)
        accepts = self.phase in ("starting", "streaming", "holding") or (
            self.phase == "interrupted" and not self._in_failsafe
        )
        if not accepts or self._requested_mode is not None:
            return False
        self._accept(now_s, request, snapshot)
        if self.phase != "starting":
            self._enter("streaming", now_s, request.duration_s)
        return True

    def change_script(self, now_s: float, change: ScriptChange) -> None:
        """Applies a change to the script that is being flown, and renews its validity."""
        if self.phase in ("starting", "streaming") and self._pipeline.change_script(change):
            self._since_s = now_s
            if self.request is not None and self.phase == "streaming":
                self._enter("streaming", now_s, self.request.duration_s)

    def set_expiry(self, until_s: float) -> None:
        """Sets the expiry time of the setpoint; used by groups, whose setpoints expire together."""
        if self.phase == "streaming" and self.request is not None:
            path_s = self.request.duration_s - self.request.valid_for_s
            self.request = replace(self.request, valid_for_s=max(0.0, until_s - self._since_s - path_s))
            self._phase_until_s = self._since_s + self.request.duration_s

    def force_hold(self, now_s: float, snapshot: Snapshot, code: str, why: str) -> None:
        """Stops the vehicle and requests Hold, or Land without a position estimate; ignores `on_expiry`."""
        if self.phase in ("streaming", "interrupted", "holding") and self._requested_mode is None:
            self._end_reason = why
            self._hold_and_request_mode(now_s, snapshot, code, why, land=False)

    def request_stop(self, now_s: float, snapshot: Snapshot) -> None:
        """Keeps the position while the event loop requests Hold for a client. If this takes too long, the
        stream itself requests Hold.
        """
        if self.phase in ("streaming", "interrupted", "holding"):
            self._hold_position(now_s, snapshot)
            self._enter("holding", now_s, STOP_TIMEOUT_S)
            self._requested_mode = "hold"

    def cancel_start(self, now_s: float, snapshot: Snapshot) -> None:
        """Offboard was not confirmed: puts the vehicle into Hold if it still switches to Offboard."""
        if self.phase == "starting":
            self._since_s = now_s
            self._hold_position(now_s, snapshot)
            self._enter("undoing", now_s, UNDO_S)

    def inhibit_mode_requests(self, now_s: float) -> None:
        """Sends no mode requests for some seconds, because a pilot commands a mode."""
        self._inhibited_until_s = now_s + INHIBIT_MODE_REQUESTS_S

    def end(self, code: str, text: str, severity: int = NOTICE, *, report: bool = True) -> None:
        """Ends the stream: nothing more is sent."""
        if self.phase == "idle":
            return
        self.phase = "idle"
        self._phase_until_s = math.inf
        self.last_end = StreamEvent(code, severity, text)
        if report:
            self.reports.append(self.last_end)

    # --- calls of the scheduler -------------------------------------------------------------------

    def due_s(self, loop_message_s: float) -> float:
        """Time at which `tick` must be called next; infinity while idle."""
        if self.phase == "idle":
            return math.inf
        return min(self.cadence.next_s, self._phase_until_s, loop_message_s + self._silent_limit_s)

    def tick(self, now_s: float, snapshot: Snapshot, loop_message_s: float) -> list[Outgoing]:
        """Returns the messages to send now.

        Args:
            now_s: current time [s, monotonic].
            snapshot: the newest snapshot.
            loop_message_s: time of the last message from the event loop.
        """
        if self.phase == "idle":
            return []
        if now_s - loop_message_s >= self._silent_limit_s:
            self.end(
                "server_silent",
                f"The server's event loop was stalled for {self._silent_limit_s:g} s: the setpoint stream "
                "was stopped, and the vehicle's failsafe takes over.",
                WARNING,
            )
            return []
        if self._end_if_offboard_left(now_s, snapshot):
            return []
        self._lost_s = min(self._lost_s, now_s) if snapshot.lost else math.inf
        self._check_links_and_origin(now_s, snapshot)
        self._check_following(now_s, snapshot)
        if now_s >= self._phase_until_s:
            self._on_phase_timeout(now_s, snapshot)
        outgoing: list[Outgoing] = []
        if self.phase in ("to_hold", "landing"):
            self._send_mode_request(now_s, outgoing)
        if self.phase != "idle" and now_s >= self.cadence.next_s:
            self._refresh_setpoint(now_s, snapshot)
            if not self.streaming:
                return outgoing
            outgoing.append(SetpointDue(now_s, snapshot.mode == self.mode, self.mode))
            self.cadence.sent(now_s)
        return outgoing

    # --- state ------------------------------------------------------------------------------------

    @property
    def sent(self) -> DirectSetpoint | None:
        """The setpoint that is being sent: the requested setpoint within all limits, or the position that is
        kept after expiry."""
        return self._pipeline.sent

    @property
    def limited(self) -> tuple[str, ...]:
        """Current reductions by the limits, as texts."""
        return self._pipeline.limited

    @property
    def avoiding(self) -> AvoidanceStatus | None:
        """State of obstacle avoidance; None: avoidance is off."""
        return self._pipeline.avoiding

    @property
    def progress(self) -> ScriptProgress | None:
        """Progress of the mission that is being flown; None: no mission."""
        return self._pipeline.progress if self.streaming else None

    @property
    def streaming(self) -> bool:
        """Whether setpoints are sent."""
        return self.phase != "idle"

    def age_s(self, now_s: float) -> float | None:
        """Age of the request."""
        return None if self.request is None or self.phase == "idle" else now_s - self._since_s

    def valid_left_s(self, now_s: float) -> float | None:
        """Time until the setpoint expires (it does not count down while starting); None while idle."""
        if self.request is None or self.phase == "idle":
            return None
        if self.phase == "starting":
            return self.request.duration_s
        return max(0.0, self._since_s + self.request.duration_s - now_s)

    # --- inside -----------------------------------------------------------------------------------

    def _enter(self, phase: str, now_s: float, for_s: float) -> None:
        self.phase = phase
        self._phase_until_s = now_s + for_s

    def _accept(self, now_s: float, request: StreamRequest, snapshot: Snapshot) -> None:
        self._pipeline.accept(now_s, request.setpoint, snapshot)
        self._end_reason, self._seen_s = "", math.inf
        self.request, self._since_s = request, now_s
        self.cadence.send_now(now_s)

    def _refresh_setpoint(self, now_s: float, snapshot: Snapshot) -> None:
        flies_request = self.phase in ("starting", "streaming")
        stop = self._pipeline.refresh(now_s, snapshot, waiting=self.phase == "starting")
        self.reports.extend(self._pipeline.take_reports())
        if stop is None or not flies_request:
            return
        if self.phase == "starting":
            self.end("fence", f"{stop}; the setpoint stream has ended.", WARNING)
        else:
            self._execute_expiry_action(now_s, snapshot, "fence", stop)

    def _end_if_offboard_left(self, now_s: float, snapshot: Snapshot) -> bool:
        """Ends the stream if the vehicle has disarmed or left Offboard; returns True if so. A failsafe that
        may end by itself only interrupts the stream."""
        if snapshot.taken_s < self._engaged_s:
            return False
        if snapshot.mode == self.mode:
            disarmed = self._was_armed and not snapshot.armed
            self._was_armed = snapshot.armed
            if disarmed:  # otherwise the vehicle would fly immediately when armed again
                self.end("disarmed", "The vehicle disarmed; the setpoint stream has ended.")
            elif self.phase == "interrupted" and self._in_failsafe:
                self._on_return(now_s, snapshot)
            return disarmed
        if self._is_failsafe(snapshot):
            if self.phase in ("streaming", "holding") and self._requested_mode is None:
                self._interrupt(now_s, snapshot)
            if self.phase in ("interrupted", "to_hold"):
                return False
        if snapshot.mode == self._requested_mode:
            mode = snapshot.mode
            code = "held" if mode == "hold" else "landing"
            reason = f" ({self._end_reason[0].lower()}{self._end_reason[1:]})" if self._end_reason else ""
            self.end(code, f"The vehicle is in {mode.capitalize()}; the setpoint stream has ended{reason}.")
        elif snapshot.mode_requested_by is not None:
            self.end("commanded", f"{snapshot.mode_requested_by}; the setpoint stream has ended.", INFO)
        else:
            self._end_left(snapshot)
        return True

    def _is_failsafe(self, snapshot: Snapshot) -> bool:
        """Whether the vehicle is in a failsafe from which it may return to its setpoints."""
        assert self.request is not None
        returns = snapshot.armed and snapshot.failsafe and snapshot.mode in FAILSAFE_MODES
        return returns and self.request.on_expiry.action != "stop_stream"

    def _interrupt(self, now_s: float, snapshot: Snapshot) -> None:
        self._interrupted_s, self._place_s, self._in_failsafe = now_s, now_s, True
        self._report(
            "interrupted",
            f"The vehicle's failsafe left {mode_label(self.mode)} for {snapshot.mode!r}: for up to "
            f"{INTERRUPTED_S:g} s, setpoints keep the vehicle where it is, in case it returns.",
        )
        self._hold_position(now_s, snapshot)
        self._enter("interrupted", now_s, INTERRUPTED_S)

    def _on_return(self, now_s: float, snapshot: Snapshot) -> None:
        """The vehicle follows setpoints again, which keep it at its place until a new one arrives."""
        assert self.request is not None
        for_s = now_s - self._interrupted_s
        why = f"For {for_s:.1f} s the vehicle did not follow its setpoints"
        self._end_reason, self._in_failsafe = why, False
        if self.request.on_expiry.action != "hold":
            self._request_expiry_mode(now_s, snapshot, "interrupted", why)
            return
        hold_for_s = self.request.on_expiry.hold_for_s
        self._report(
            "interrupted",
            f"{why}: holding here for {hold_for_s:g} s, then Hold mode, without a new setpoint.",
        )
        self._hold_position(now_s, snapshot)
        self._enter("interrupted", now_s, hold_for_s)

    def _check_following(self, now_s: float, snapshot: Snapshot) -> None:
        """Keeps the place of a vehicle that is interrupted, or that is not where a path or mission has led
        it, after a time in which the vehicle was not seen."""
        if self.phase == "interrupted" and self._in_failsafe:
            self._keep_place(now_s, snapshot)
            return
        is_timeline = self.request is not None and isinstance(self.request.setpoint, Script | Path)
        if self.phase != "streaming" or not is_timeline:
            return
        position = snapshot.position_at(now_s)
        self._pipeline.set_received(self.cadence.is_sending)
        if position is None or not self.cadence.is_sending:
            return
        seen_s, self._seen_s = self._seen_s, now_s
        target = getattr(self._pipeline.sent, "position_ned_m", None)
        if now_s - seen_s < UNSEEN_S or target is None or None in target:
            return
        if math.dist(target, position) > FOLLOWED_WITHIN_M:
            self._interrupted_s = seen_s
            self._on_return(now_s, snapshot)

    def _keep_place(self, now_s: float, snapshot: Snapshot) -> None:
        """Moves the held position to where the vehicle is now. Ends the stream if the vehicle has an attitude
        but no position; if it sends neither, the link is lost."""
        is_known = snapshot.position_at(now_s) is not None
        if is_known:
            self._pipeline.hold_position(now_s, snapshot)
        if is_known or snapshot.yaw_ned_rad is None:
            self._place_s = now_s
        elif now_s - self._place_s > UNKNOWN_PLACE_S:
            self._end_left(snapshot)

    def _end_left(self, snapshot: Snapshot) -> None:
        text = f"The vehicle left {mode_label(self.mode)} for {snapshot.mode!r}; the stream has ended."
        self.end("left_offboard", text, WARNING)

    def _check_links_and_origin(self, now_s: float, snapshot: Snapshot) -> None:
        """Reacts to a lost link, a lost leader and a moved local origin."""
        jumped_m = self._jumped_m(snapshot)
        if self.phase == "undoing" and snapshot.taken_s > self._since_s:
            # also after a lost link, so that Offboard is not the last requested mode
            if snapshot.mode == self.mode or snapshot.lost:
                self._request_mode("hold", now_s)
        elif self.phase == "to_hold" and self._engaged_s == math.inf and not snapshot.lost:
            self._engaged_s = now_s  # after a failed start, the vehicle's mode is checked from now on
        elif snapshot.lost and self.phase in ("streaming", "interrupted", "holding"):
            self._request_expiry_mode(now_s, snapshot, "lost", "Connection to the vehicle lost")
        elif self.phase == "streaming" and self._pipeline.leader_is_lost(now_s, snapshot):
            why = f"No connection to the followed vehicle {self._pipeline.followed_vehicle}"
            self._execute_expiry_action(now_s, snapshot, "leader_lost", why)
        elif jumped_m is not None and self._pipeline.depends_on_local_origin():
            why = f"The vehicle's local position jumped by {jumped_m:.0f} m (its origin moved)"
            if self.phase == "streaming":
                self._request_expiry_mode(now_s, snapshot, "jumped", f"{why}: the setpoint is invalid now")
            elif self.phase in ("interrupted", "holding", "to_hold", "landing", "undoing"):
                self._hold_position(now_s, snapshot)

    def _jumped_m(self, snapshot: Snapshot) -> float | None:
        """Distance by which the local position jumped; None if it did not jump."""
        if snapshot.position_ned_m is None:
            return None
        previous, self._last_estimate = self._last_estimate, (snapshot.received_s, snapshot.position_ned_m)
        if previous is None:
            return None
        moved_m = math.dist(previous[1], snapshot.position_ned_m)
        allowed_m = JUMP_M + JUMP_M_S * max(snapshot.received_s - previous[0], 0.0)
        return moved_m if moved_m > allowed_m else None

    def _on_phase_timeout(self, now_s: float, snapshot: Snapshot) -> None:
        if self.phase == "undoing":
            self.end(
                "not_confirmed", "Offboard was not confirmed; the setpoint stream has ended.", report=False
            )
        elif self.phase == "starting":
            self.end("not_confirmed", "Offboard was never confirmed; the setpoint stream has ended.", WARNING)
        elif self.phase == "streaming":
            self._on_expiry(now_s, snapshot)
        elif self.phase == "interrupted" and self._in_failsafe:
            self._end_left(snapshot)
        elif self.phase in ("holding", "interrupted"):
            self._request_mode("hold", now_s)

    def _on_expiry(self, now_s: float, snapshot: Snapshot) -> None:
        assert self.request is not None
        subject = "mission" if isinstance(self.request.setpoint, Script) else "setpoint"
        client, duration_s = self.request.client or "a client", self.request.duration_s
        why = f"The {subject} of {client} expired after {duration_s:g} s"
        self._execute_expiry_action(now_s, snapshot, "expired", why)

    def _execute_expiry_action(self, now_s: float, snapshot: Snapshot, code: str, why: str) -> None:
        """Executes the expiry action of the request; before Hold, keeps the position if possible."""
        assert self.request is not None
        self._end_reason = why
        if self.request.on_expiry.action == "hold" and snapshot.position_at(now_s) is not None:
            hold_for_s = self.request.on_expiry.hold_for_s
            self._report(code, f"{why}: holding here for {hold_for_s:g} s, then Hold mode.")
            self._hold_position(now_s, snapshot)
            self._enter("holding", now_s, hold_for_s)
        else:
            self._request_expiry_mode(now_s, snapshot, code, why)

    def _request_expiry_mode(self, now_s: float, snapshot: Snapshot, code: str, why: str) -> None:
        """Executes the expiry action of the request when setpoints cannot keep the position."""
        assert self.request is not None
        self._end_reason = why
        action = self.request.on_expiry.action
        if action == "stop_stream":
            self.end(code, f"{why}: the stream stopped; the vehicle's failsafe takes over.", WARNING)
            return
        self._hold_and_request_mode(now_s, snapshot, code, why, land=action == "land")

    def _hold_and_request_mode(
        self, now_s: float, snapshot: Snapshot, code: str, why: str, *, land: bool
    ) -> None:
        self._hold_position(now_s, snapshot)
        is_recent = snapshot.yaw_ned_rad is not None and now_s - snapshot.received_s <= MAX_EXTRAPOLATION_S
        if land:
            self._report(code, f"{why}: landing.")
            self._request_mode("land", now_s)
        elif is_recent and snapshot.position_ned_m is None:
            self._report(code, f"{why}: landing (no position estimate to hold).")
            self._request_mode("land", now_s)
        else:  # without a recent snapshot, the vehicle may have a position estimate
            self._report(code, f"{why}: requesting Hold mode.")
            self._request_mode("hold", now_s)

    def _hold_position(self, now_s: float, snapshot: Snapshot) -> None:
        """Keeps the position by setpoints until the mode has changed."""
        self._pipeline.hold_position(now_s, snapshot)
        self.cadence.send_now(now_s)

    def _request_mode(self, mode: str, now_s: float) -> None:
        self._requested_mode, self._mode_requests, self._next_request_s = mode, 0, now_s
        self._enter("to_hold" if mode == "hold" else "landing", now_s, math.inf)

    def _send_mode_request(self, now_s: float, outgoing: list[Outgoing]) -> None:
        assert self._requested_mode is not None
        are_used_up = self._mode_requests >= MAX_MODE_REQUESTS and now_s >= self._next_request_s
        if are_used_up or now_s - self._lost_s >= LOST_S:
            self.end(
                "not_confirmed",
                f"The vehicle did not change to {self._requested_mode.capitalize()} after "
                f"{self._mode_requests} requests: the stream stopped; the vehicle's failsafe takes over.",
                WARNING,
            )
            return
        if now_s < max(self._next_request_s, self._inhibited_until_s):
            return
        outgoing.append(ModeRequest(self._requested_mode, self._mode_requests))
        self._mode_requests += 1
        self._next_request_s = now_s + MODE_REQUEST_PERIOD_S

    def _report(self, code: str, text: str) -> None:
        self.reports.append(StreamEvent(code, WARNING, text))
