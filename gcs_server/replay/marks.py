"""The marks of a replay's time bar: modes, armed periods and messages of the vehicles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from gcs_server.mavlink.codec import FrameParser, full_payload
from gcs_server.replay.index import EVENT, HEARTBEAT, STATUSTEXT, Index
from gcs_server.replay.playback import ReplayClock
from gcs_server.replay.records import open_log, read_at
from gcs_server.vehicle.event_logger import EventLogger
from gcs_server.vehicle.events import EventFeed
from gcs_server.vehicle.px4.events import ARMING_SUMMARY_ID, HEALTH_SUMMARY_ID, decode_event
from gcs_server.vehicle.reducers import REDUCERS, FlightState

MAX_MESSAGES = 1000
"""Maximum number of messages per vehicle; the least severe messages are left out."""


@dataclass(frozen=True, slots=True)
class ModeSpan:
    """A period in one flight mode."""

    begin_unix_s: float
    end_unix_s: float
    mode: str
    """As in `status.mode`."""
    mode_label: str
    """Name of the mode on the page."""


@dataclass(frozen=True, slots=True)
class ArmedSpan:
    """A period in which the vehicle is armed."""

    begin_unix_s: float
    end_unix_s: float


@dataclass(frozen=True, slots=True)
class MessageMark:
    """A status text or event."""

    unix_s: float
    severity: int
    """MAV_SEVERITY: 0 emergency … 6 info, 7 debug."""
    text: str


@dataclass(frozen=True, slots=True)
class VehicleMarks:
    """The marks of one vehicle in a recording."""

    system_id: int
    modes: tuple[ModeSpan, ...]
    armed: tuple[ArmedSpan, ...]
    messages: tuple[MessageMark, ...]
    """Messages, oldest first."""
    messages_left_out: int


@dataclass(slots=True)
class _VehicleReader:
    """State of one vehicle while the recording is read."""

    component_id: int
    clock: ReplayClock
    feed: EventFeed = field(default_factory=lambda: EventFeed(length=100_000))
    flight_state: FlightState = field(default_factory=FlightState)
    changes: list[tuple[float, FlightState]] = field(default_factory=list[tuple[float, FlightState]])
    in_report: bool = False
    """Whether the next event belongs to a health and arming report; such events are not marked."""

    def __post_init__(self) -> None:
        self.event_logger = EventLogger(self.feed, self.clock)

    event_logger: EventLogger = field(init=False)


def make_marks(path: Path, index: Index) -> tuple[VehicleMarks, ...]:
    """Reads a recording once; call in a worker thread.

    Raises:
        OSError: the file cannot be read.
    """
    readers: dict[int, _VehicleReader] = {}
    parser = FrameParser()
    clock = ReplayClock(index.begin_us, 0)
    with open_log(path) as file:
        for time_us, offset in index.events():
            clock.time_us = time_us
            for frame in parser.feed(read_at(file, offset), clock.monotonic_s()):
                reader = readers.get(frame.system_id)
                if reader is None and frame.msg_id == HEARTBEAT:
                    reader = readers[frame.system_id] = _VehicleReader(frame.component_id, clock)
                if reader is not None and frame.component_id == reader.component_id:
                    _add_frame(reader, frame.msg_id, full_payload(frame), clock)
    clock.time_us = index.end_us
    for reader in readers.values():
        reader.event_logger.tick()
    return tuple(
        _marks(system_id, reader, index.end_us / 1e6) for system_id, reader in sorted(readers.items())
    )


def _add_frame(reader: _VehicleReader, msg_id: int, payload: bytes, clock: ReplayClock) -> None:
    if msg_id == STATUSTEXT:
        reader.event_logger.text(payload, reader)
    elif msg_id == EVENT:
        event = decode_event(payload)
        in_report = event.id in (ARMING_SUMMARY_ID, HEALTH_SUMMARY_ID) or reader.in_report
        reader.in_report = event.id == ARMING_SUMMARY_ID or (in_report and event.id != HEALTH_SUMMARY_ID)
        if not in_report:
            reader.event_logger.event(event)
    elif msg_id in REDUCERS:
        reader.flight_state = REDUCERS[msg_id](reader.flight_state, payload, clock.monotonic_s())
        reader.changes.append((clock.unix_s(), reader.flight_state))


def _marks(system_id: int, reader: _VehicleReader, end_unix_s: float) -> VehicleMarks:
    messages = [MessageMark(e.unix_s, e.severity, e.text) for e in reader.feed.since() if e.text]
    most_severe = sorted(messages, key=lambda s: s.severity)[:MAX_MESSAGES]
    return VehicleMarks(
        system_id,
        tuple(
            ModeSpan(begin_s, end_s, *flight_state.mode_name)
            for begin_s, end_s, flight_state in _spans(reader.changes, end_unix_s, lambda f: f.custom_mode)
        ),
        tuple(
            ArmedSpan(begin_s, end_s)
            for begin_s, end_s, flight_state in _spans(reader.changes, end_unix_s, lambda f: f.armed)
            if flight_state.armed
        ),
        tuple(sorted(most_severe, key=lambda s: s.unix_s)),
        len(messages) - len(most_severe),
    )


def _spans(
    changes: list[tuple[float, FlightState]], end_unix_s: float, state_of: Callable[[FlightState], object]
) -> list[tuple[float, float, FlightState]]:
    begins: list[tuple[float, FlightState]] = []
    for at_s, flight_state in changes:
        if not begins or state_of(begins[-1][1]) != state_of(flight_state):
            begins.append((at_s, flight_state))
    ends = [at_s for at_s, _ in begins[1:]] + [end_unix_s]
    return [(at_s, end_s, flight_state) for (at_s, flight_state), end_s in zip(begins, ends, strict=True)]
