"""One vehicle's stream as a pure state machine: what goes out now, and when to stop.

    idle ── begin ──► starting ── engage ──► streaming ◄── change ──┐
      ▲                                         │ expiry            │
      │                 ┌───────────────────────┼───────────────────┤
      │              landing                 holding ── time ──► to_hold
      └── end ◄─────────┴───────────────────────┴───────────────────┘

It knows no clock, thread or socket: `tick` is handed the time and an immutable snapshot of the vehicle.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

from gcs_server.streamer.setpoints import (
    MSG_COMMAND_LONG,
    MSG_SET_POSITION_TARGET_LOCAL_NED,
    Order,
    Setpoint,
    SetpointPacket,
    Vector3,
    mode_command,
)

WARNING, NOTICE, INFO = 4, 5, 6

MODE_ASK_PERIOD_S = 1.0
MODE_ASKS = 5
"""Asked this often without the vehicle's word, the stream stops and PX4's own failsafe takes over."""
LONGEST_START_S = 20.0
LONGEST_EXTRAPOLATION_S = 0.5


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The vehicle as the event loop last saw it."""

    taken_s: float
    mode: str
    position_ned_m: Vector3 | None
    """None where there is no fresh estimate."""
    velocity_ned_m_s: Vector3 | None
    yaw_ned_rad: float | None
    mode_asked_by: str | None = None
    """Where a command of ours brought the vehicle into this mode: which, and whose."""

    def position_at(self, now_s: float) -> Vector3 | None:
        """The estimate carried on with its velocity over the snapshot's age."""
        if self.position_ned_m is None:
            return None
        age_s = min(max(now_s - self.taken_s, 0.0), LONGEST_EXTRAPOLATION_S)
        n, e, d = self.position_ned_m
        vn, ve, vd = self.velocity_ned_m_s or (0.0, 0.0, 0.0)
        return (n + vn * age_s, e + ve * age_s, d + vd * age_s)


@dataclass(frozen=True, slots=True)
class Outgoing:
    """A payload to send."""

    msg_id: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class Report:
    """Something a person should be told."""

    code: str
    """expired, held, landing, commanded, left_offboard, server_silent, not_confirmed, fault."""
    severity: int
    text: str


class StreamCore:
    """See the module's drawing.

    Args:
        target_system: the vehicle's MAVLink system id.
        target_component: its autopilot's component id.
        server_silent_limit_s: how long the event loop may be silent before the stream stops.
    """

    def __init__(
        self, target_system: int, target_component: int, *, server_silent_limit_s: float = 1.5
    ) -> None:
        self._target = (target_system, target_component)
        self._silent_limit_s = server_silent_limit_s
        self._packet = SetpointPacket(target_system, target_component)
        self.phase = "idle"
        self.order: Order | None = None
        self.sent: Setpoint | None = None
        """What goes out now: the order's setpoint, or the place held after it expired."""
        self.rate_hz = 50.0
        self.reports: deque[Report] = deque(maxlen=50)
        self.last_end: Report | None = None
        self._sent_at: deque[float] = deque(maxlen=101)
        self._period_s = 0.02
        self._next_send_s = 0.0
        self._since_s = 0.0
        self._engaged_s = math.inf
        self._phase_until_s = math.inf
        self._asked_mode: str | None = None
        self._mode_asks = 0
        self._next_ask_s = 0.0
        self._yaw_kept = False

    # --- what the loop asks for -------------------------------------------------------------------

    def begin(self, now_s: float, order: Order, rate_hz: float, snapshot: Snapshot) -> None:
        """Starts to stream before Offboard is asked for; validity counts from `engage`."""
        self.rate_hz, self._period_s = rate_hz, 1.0 / rate_hz
        self._sent_at.clear()
        self._asked_mode, self.last_end = None, None
        self._engaged_s = math.inf
        self._enter("starting", now_s, LONGEST_START_S)
        self.sent = None
        self._take(now_s, order, snapshot)

    def engage(self, now_s: float) -> bool:
        """The vehicle reports Offboard: validity counts from now. False: the stream has ended meanwhile."""
        if self.phase != "starting" or self.order is None:
            return self.phase != "idle"
        self._engaged_s = self._since_s = now_s
        self._enter("streaming", now_s, self.order.valid_for_s)
        return True

    def change(self, now_s: float, order: Order, snapshot: Snapshot) -> bool:
        """A new setpoint, at once; False where the stream is not (or no longer) to be had."""
        if self.phase not in ("starting", "streaming", "holding") or self._asked_mode is not None:
            return False
        self._take(now_s, order, snapshot)
        if self.phase != "starting":
            self._enter("streaming", now_s, order.valid_for_s)
        return True

    def wind_down(self, now_s: float, snapshot: Snapshot) -> None:
        """Somebody asked to stop: hold the place while the loop asks the vehicle for Hold.

        If the loop then fails to, the thread asks itself, as after an expiry.
        """
        if self.phase in ("streaming", "holding"):
            self._hold_here(now_s, snapshot)
            self._asked_mode = "hold"

    def end(self, code: str, text: str, severity: int = NOTICE, *, tell: bool = True) -> None:
        """Nothing is sent from here on."""
        if self.phase == "idle":
            return
        self.phase = "idle"
        self._phase_until_s = math.inf
        self.last_end = Report(code, severity, text)
        if tell:
            self.reports.append(self.last_end)

    # --- what the thread asks for -----------------------------------------------------------------

    def due_s(self, beat_s: float) -> float:
        """When `tick` wants to be called next; infinity while idle."""
        if self.phase == "idle":
            return math.inf
        return min(self._next_send_s, self._phase_until_s, beat_s + self._silent_limit_s)

    def tick(self, now_s: float, snapshot: Snapshot, beat_s: float) -> list[Outgoing]:
        """What goes out now.

        Args:
            now_s: monotonic time.
            snapshot: the newest one.
            beat_s: when the event loop last showed that it lives.
        """
        if self.phase == "idle":
            return []
        if now_s - beat_s >= self._silent_limit_s:
            self.end(
                "server_silent",
                f"The server's event loop was silent for {self._silent_limit_s:g} s: the setpoint stream "
                "was stopped so that the vehicle fails safe.",
                WARNING,
            )
            return []
        if self._has_left(snapshot):
            return []
        if now_s >= self._phase_until_s:
            self._time_is_up(now_s, snapshot)
        outgoing: list[Outgoing] = []
        if self.phase in ("to_hold", "landing"):
            self._ask_for_mode(now_s, outgoing)
        if self.phase != "idle" and now_s >= self._next_send_s:
            outgoing.append(Outgoing(MSG_SET_POSITION_TARGET_LOCAL_NED, self._packet.stamped(now_s)))
            self._sent_at.append(now_s)
            missed = math.floor((now_s - self._next_send_s) / self._period_s + 1e-6)
            self._next_send_s += (missed + 1) * self._period_s
        return outgoing

    # --- what can be read -------------------------------------------------------------------------

    @property
    def streaming(self) -> bool:
        """Whether setpoints go out."""
        return self.phase != "idle"

    def rate_achieved_hz(self, now_s: float) -> float | None:
        """Over the last setpoints sent; None before there were two within two seconds."""
        recent = [sent_s for sent_s in tuple(self._sent_at) if now_s - sent_s <= 2.0]
        if self.phase == "idle" or len(recent) < 2:
            return None
        return (len(recent) - 1) / (recent[-1] - recent[0])

    def age_s(self, now_s: float) -> float | None:
        """Age of the order."""
        return None if self.order is None or self.phase == "idle" else now_s - self._since_s

    def valid_left_s(self, now_s: float) -> float | None:
        """Until the order expires (it has not begun to while starting); None while idle."""
        if self.order is None or self.phase == "idle":
            return None
        if self.phase == "starting":
            return self.order.valid_for_s
        return max(0.0, self._since_s + self.order.valid_for_s - now_s)

    # --- inside -----------------------------------------------------------------------------------

    def _enter(self, phase: str, now_s: float, for_s: float) -> None:
        self.phase = phase
        self._phase_until_s = now_s + for_s

    def _take(self, now_s: float, order: Order, snapshot: Snapshot) -> None:
        setpoint = order.setpoint
        if setpoint.yaw_ned_rad is None and setpoint.yaw_rate_ned_rad_s is None:
            before = self.sent.yaw_ned_rad if self._yaw_kept and self.sent is not None else None
            setpoint = replace(setpoint, yaw_ned_rad=snapshot.yaw_ned_rad if before is None else before)
            self._yaw_kept = True
        else:
            self._yaw_kept = False
        self.order, self._since_s = order, now_s
        self._send_from_now(now_s, setpoint)

    def _send_from_now(self, now_s: float, setpoint: Setpoint) -> None:
        self.sent = setpoint
        self._packet.load(setpoint)
        self._next_send_s = now_s

    def _has_left(self, snapshot: Snapshot) -> bool:
        """Ends where the vehicle flies another mode than Offboard, by whoever's will: never fights for it."""
        if snapshot.taken_s < self._engaged_s or snapshot.mode == "offboard":
            return False
        if snapshot.mode == self._asked_mode:
            mode = snapshot.mode
            code = "held" if mode == "hold" else "landing"
            self.end(code, f"The vehicle is in {mode.capitalize()}; the setpoint stream has ended.")
        elif snapshot.mode_asked_by is not None:
            self.end("commanded", f"{snapshot.mode_asked_by}; the setpoint stream has ended.", INFO)
        else:
            self.end(
                "left_offboard",
                f"The vehicle left Offboard for {snapshot.mode!r}; the setpoint stream has ended.",
                WARNING,
            )
        return True

    def _time_is_up(self, now_s: float, snapshot: Snapshot) -> None:
        if self.phase == "starting":
            self.end("not_confirmed", "Offboard was never confirmed; the setpoint stream has ended.", WARNING)
        elif self.phase == "streaming":
            self._expired(now_s, snapshot)
        elif self.phase == "holding":
            self._ask("hold", now_s)

    def _expired(self, now_s: float, snapshot: Snapshot) -> None:
        assert self.order is not None
        why = f"The setpoint of {self.order.client or 'a client'} expired after {self.order.valid_for_s:g} s"
        action = self.order.on_expiry.action
        if action == "stop_stream":
            self.end("expired", f"{why}: the stream stopped, the vehicle fails safe.", WARNING)
        elif action == "land" or snapshot.position_ned_m is None:
            reason = "" if action == "land" else " (no position estimate to hold)"
            self._report("expired", f"{why}: landing{reason}.")
            self._stand_still(now_s, snapshot)
            self._ask("land", now_s)
        else:
            hold_for_s = self.order.on_expiry.hold_for_s
            self._report("expired", f"{why}: holding here for {hold_for_s:g} s, then Hold mode.")
            self._hold_here(now_s, snapshot)

    def _hold_here(self, now_s: float, snapshot: Snapshot) -> None:
        assert self.order is not None
        self._stand_still(now_s, snapshot)
        self._enter("holding", now_s, self.order.on_expiry.hold_for_s)

    def _stand_still(self, now_s: float, snapshot: Snapshot) -> None:
        """The place reached, or without an estimate no speed: what is sent until the mode has changed."""
        position = snapshot.position_at(now_s)
        yaw = snapshot.yaw_ned_rad
        if position is not None:
            self._send_from_now(now_s, Setpoint(position_ned_m=position, yaw_ned_rad=yaw))
        else:
            self._send_from_now(now_s, Setpoint(velocity_ned_m_s=(0.0, 0.0, 0.0), yaw_rate_ned_rad_s=0.0))
        self._yaw_kept = False

    def _ask(self, mode: str, now_s: float) -> None:
        self._asked_mode, self._mode_asks, self._next_ask_s = mode, 0, now_s
        self._enter("to_hold" if mode == "hold" else "landing", now_s, math.inf)

    def _ask_for_mode(self, now_s: float, outgoing: list[Outgoing]) -> None:
        if now_s < self._next_ask_s:
            return
        assert self._asked_mode is not None
        if self._mode_asks >= MODE_ASKS:
            self.end(
                "not_confirmed",
                f"The vehicle did not change to {self._asked_mode.capitalize()} when asked "
                f"{MODE_ASKS} times: the stream stopped, the vehicle fails safe.",
                WARNING,
            )
            return
        payload = mode_command(self._asked_mode, *self._target, self._mode_asks)
        outgoing.append(Outgoing(MSG_COMMAND_LONG, payload))
        self._mode_asks += 1
        self._next_ask_s = now_s + MODE_ASK_PERIOD_S

    def _report(self, code: str, text: str) -> None:
        self.reports.append(Report(code, WARNING, text))
