"""One program on a guarded link: what is known of it, what it was refused, and its newest setpoint."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from gcs_server.guard.rates import AskedRates
from gcs_server.links.base import Peer
from gcs_server.vehicle.tickets import Ticket
from missions.setpoints import Setpoint

PRESENT_S: Final = 2.0
"""A program that has sent nothing for this time is not present: another may command in its place [s]."""
MAX_REFUSALS: Final = 20
TELL_AGAIN_S: Final = 2.0
"""The same refusal is not sent again to the program within this time [s]."""
LATE_S: Final = 0.5
"""A setpoint that follows the one before after this time is late: PX4 needs two a second."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """Something that a program sent and that was not done."""

    unix_s: float
    """When [s since 1970 UTC]."""
    what: str
    """Name of the message or command."""
    text: str
    """Why, and what would be accepted."""
    repeated: int = 1
    """How often in a row."""


def note_refusal(refusals: deque[Refusal], unix_s: float, what: str, text: str) -> None:
    """Adds a refusal to those that are known, newest first; an equal one only counts."""
    newest = refusals[0] if refusals else None
    if newest is not None and (newest.what, newest.text) == (what, text):
        refusals[0] = Refusal(unix_s, what, text, newest.repeated + 1)
    else:
        refusals.appendleft(Refusal(unix_s, what, text))


@dataclass(frozen=True, slots=True)
class ProgramView:
    """A program on a guarded link."""

    address: str
    """Where it sends from."""
    system: int | None
    """Its MAVLink system id; null: it has sent nothing yet."""
    component: int | None
    """Its component id; null: it has sent nothing yet."""
    kind: str | None
    """What it says it is: the type in its heartbeat; null: no heartbeat yet."""
    age_s: float | None
    """Time since its newest message [s]; null: it has sent nothing yet."""
    messages: int
    """Messages that it has sent."""
    commanding: bool
    """Whether its commands and setpoints count; of several programs on a link those of one do."""
    setpoint: str | None
    """Kind of its newest setpoint; null: it has sent none."""
    setpoints: int
    """Setpoints that it has sent."""
    setpoint_rate_hz: float | None
    """Setpoints per second now [Hz]; null: fewer than two."""
    setpoints_late: int
    """Setpoints that came more than 0.5 s after the one before."""
    setpoints_refused: int
    """Setpoints that were not flown."""
    limited: tuple[str, ...]
    """What of its setpoint is reduced now, and by which limit."""
    left_out: tuple[str, ...]
    """Fields of its newest setpoint that are not sent."""
    refusals: tuple[Refusal, ...]
    """What it was refused, newest first."""


@dataclass(slots=True)
class Pending:
    """A command of a program that the vehicle has not answered yet."""

    ticket: Ticket | None
    payload: bytes


@dataclass(slots=True, eq=False)
class Program:
    """One peer of a guarded link."""

    peer: Peer
    own_component: int
    """Component of this server with which its messages are sent to the vehicle."""
    system: int | None = None
    component: int | None = None
    kind: str | None = None
    heard_s: float = float("-inf")
    """When it last sent something [s, monotonic]."""
    messages: int = 0
    rates: AskedRates = field(default_factory=AskedRates)
    setpoint_kind: str | None = None
    setpoint_times_s: deque[float] = field(default_factory=lambda: deque[float](maxlen=50))
    setpoints: int = 0
    setpoints_late: int = 0
    setpoints_refused: int = 0
    left_out: tuple[str, ...] = ()
    limited: tuple[str, ...] = ()
    waiting: Any = None
    """Its newest setpoint message that was not looked at yet; None: none."""
    newest: tuple[float, Setpoint] | None = None
    """Its newest setpoint that can be flown, and when it came [s, monotonic]."""
    same_since_s: float = float("-inf")
    """Since when its setpoint is the same [s, monotonic]."""
    arrived: asyncio.Event = field(default_factory=asyncio.Event)
    pending: dict[tuple[int, bytes], Pending] = field(default_factory=dict[tuple[int, bytes], Pending])
    """Its commands that wait for the vehicle's answer, by message id and payload."""
    after_start: dict[tuple[int, bytes], Callable[[], None]] = field(
        default_factory=dict[tuple[int, bytes], Callable[[], None]]
    )
    """Its commands to arm that wait until Offboard has started or failed, as `pending`."""
    refusals: deque[Refusal] = field(default_factory=lambda: deque[Refusal](maxlen=MAX_REFUSALS))
    told_s: dict[str, float] = field(default_factory=dict[str, float])
    """When each text was last sent to it [s, monotonic]."""
    inputs: dict[str, tuple[float, int]] = field(default_factory=dict[str, tuple[float, int]])
    """Time of the last journal line and number of messages since, of each kind of input."""
    second_s: float = float("-inf")
    """Start of the second in which `in_second` messages came [s, monotonic]."""
    in_second: int = 0

    @property
    def source(self) -> str:
        """Address and ids, for the journal."""
        return f"{self.peer.name} ({self.system}/{self.component})"

    def is_present(self, now_s: float) -> bool:
        """Whether it has sent something lately."""
        return now_s - self.heard_s <= PRESENT_S

    def take_setpoint(self, now_s: float) -> None:
        """Counts a setpoint."""
        times_s = self.setpoint_times_s
        if times_s and now_s - times_s[-1] > LATE_S:
            self.setpoints_late += 1
        times_s.append(now_s)
        self.setpoints += 1

    def refuse(self, unix_s: float, what: str, text: str) -> None:
        """Notes a refusal."""
        note_refusal(self.refusals, unix_s, what, text)

    def may_tell(self, text: str, now_s: float) -> bool:
        """Whether a text is sent to the program now: not again within `TELL_AGAIN_S`."""
        for known in [known for known, told_s in self.told_s.items() if now_s - told_s > TELL_AGAIN_S]:
            del self.told_s[known]
        if text in self.told_s:
            return False
        self.told_s[text] = now_s
        return True

    def view(self, now_s: float, commanding: bool) -> ProgramView:
        """The program as the API shows it."""
        times_s = [each for each in self.setpoint_times_s if now_s - each <= 2.0]
        span_s = times_s[-1] - times_s[0] if len(times_s) > 1 else 0.0
        return ProgramView(
            self.peer.name,
            self.system,
            self.component,
            self.kind,
            None if self.system is None else max(0.0, now_s - self.heard_s),
            self.messages,
            commanding,
            self.setpoint_kind,
            self.setpoints,
            (len(times_s) - 1) / span_s if span_s > 0.0 else None,
            self.setpoints_late,
            self.setpoints_refused,
            self.limited,
            self.left_out,
            tuple(self.refusals),
        )
