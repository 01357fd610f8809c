"""A log that has been read: topics with their values, parameters, messages, and the vehicle's states."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from missions.values import hidden_character

Kind = Literal["ulog", "tlog", "mcap"]
"""How topics are named and times are known; that of a file that `exports/mcap_file.py` has written is its
log's."""
Column = NDArray[np.generic]
Times = NDArray[np.float64]
Number = float | int

MAX_TOPICS = 2000
MAX_FIELDS = 30_000
"""Fields of all topics; a log of PX4 has about 2500."""
MAX_MESSAGES = 5000
MAX_TEXT = 400
"""Maximum length of a message, and of any text of a log."""
MAX_NAME = 120
"""Maximum length of a topic's or a field's name."""
MAX_PARAMETERS = 5000
MAX_CHANGES = 5000
MAX_SPANS = 5000
"""Maximum number of spans (modes, armed, failsafe) of a vehicle, and of dropouts."""
MAX_DURATION_S = 7 * 86_400.0
"""Values with a later time are left out: their time is damaged."""


class UnreadableLog(ValueError):
    """A file is not a log, or nothing of it can be read; the text says why."""


@dataclass(slots=True)
class Topic:
    """The values of one topic, or of one message of one sender."""

    name: str
    instance: str
    """ULog: number of the instance. tlog: `system.component`, with the message's own instance as third. MCAP
    of several vehicles: the vehicle, otherwise 0."""
    times_s: Times
    """Time of each sample since the log's start, ascending."""
    columns: dict[str, Column]
    """Values by field, as long as `times_s`."""
    units: dict[str, str]
    """Units by field; missing: not known."""

    @property
    def id(self) -> str:
        """Name and instance: `vehicle_attitude:0`, `ATTITUDE:1.1`."""
        return f"{self.name}:{self.instance}"


@dataclass(frozen=True, slots=True)
class Span:
    """A time in which the vehicle was in one state."""

    begin_s: float
    end_s: float
    name: str
    """Label of a mode; otherwise the kind of the span."""


@dataclass(slots=True)
class VehicleStates:
    """What one vehicle of a log was doing."""

    id: str
    """MAVLink system id; empty: not known."""
    modes: list[Span] = field(default_factory=list[Span])
    armed: list[Span] = field(default_factory=list[Span])
    failsafe: list[Span] = field(default_factory=list[Span])
    uid: str | None = None
    """Hexadecimal uid of the autopilot; None: not known."""


@dataclass(frozen=True, slots=True)
class Message:
    """A text that the vehicle has logged or sent."""

    t_s: float
    severity: int
    """MAV_SEVERITY: 0 emergency to 7 debug."""
    text: str


@dataclass(slots=True)
class Log:
    """All of a log that can be shown; times are seconds since its start."""

    kind: Kind
    start_unix_s: float | None
    """Start [s since 1970 UTC]; None: the vehicle did not know the time."""
    duration_s: float
    topics: list[Topic]
    vehicles: list[VehicleStates]
    firmware: str | None = None
    hardware: str | None = None
    parameters: dict[str, Number] = field(default_factory=dict[str, Number])
    """The first known value of each parameter."""
    parameter_changes: list[tuple[float, str, Number]] = field(
        default_factory=list[tuple[float, str, Number]]
    )
    """Time, name, new value."""
    messages: list[Message] = field(default_factory=list[Message])
    dropouts: list[tuple[float, float]] = field(default_factory=list[tuple[float, float]])
    """Time and duration of each gap in which the vehicle could not write."""
    problems: list[str] = field(default_factory=list[str])
    """What of the file is missing or damaged, as sentences."""
    start_boot_s: float | None = None
    """The start by the vehicle's clock [s since its boot]; None: not known, or each message has it (tlog)."""


def clean_text(text: str) -> str:
    """A text of a log without control characters, of bounded length."""
    text = text[: 2 * MAX_TEXT].split("\0", 1)[0].strip()
    text = "".join("�" if hidden_character(c) is not None else c for c in text.replace("\t", " "))
    return text if len(text) <= MAX_TEXT else f"{text[:MAX_TEXT]}…"


def usable_name(name: str) -> bool:
    """Whether a topic or field of this name is shown."""
    return bool(name) and len(name) <= MAX_NAME and name.isascii() and name.isprintable() and "{" not in name


def is_float(value: float) -> bool:
    """Whether a parameter's value can be written as JSON."""
    return bool(np.isfinite(value))


class Parameters:
    """Collects parameters: the first value of each, then its changes."""

    def __init__(self) -> None:
        self.first: dict[str, Number] = {}
        self.changes: list[tuple[float, str, Number]] = []
        self._current: dict[str, Number] = {}

    def add(self, t_s: float, name: str, value: Number) -> None:
        """A parameter has this value from this time on."""
        if not usable_name(name) or not is_float(value) or len(self.first) >= MAX_PARAMETERS:
            return
        if name not in self.first:
            self.first[name] = value
        elif self._current[name] != value and len(self.changes) < MAX_CHANGES:
            self.changes.append((t_s, name, value))
        self._current[name] = value


def limit_fields(topics: list[Topic], problems: list[str]) -> list[Topic]:
    """The topics within the limits; what is left out is a problem."""
    kept: list[Topic] = []
    fields = left_out = 0
    for topic in topics:
        if len(kept) >= MAX_TOPICS or fields + len(topic.columns) > MAX_FIELDS:
            left_out += 1
            continue
        fields += len(topic.columns)
        kept.append(topic)
    if left_out:
        problems.append(f"The log has too many topics or fields: {left_out:,} topics are left out.")
    return kept
