"""Playback of a recording: its clock, its current position, and the records that restore the state at a given
time. No function of this module waits."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import BinaryIO

from gcs_server.clock import Clock
from gcs_server.replay.index import CHANGES_RESTORED, EVENT_MESSAGES, TEXTS_RESTORED, Index
from gcs_server.replay.records import Batch, Cursor, Record, read_at, read_batch

MIN_SPEED, MAX_SPEED = 0.25, 50.0
JUMP_GAP_S = 1e6
"""Gap in the monotonic time at each jump [s], so that no time occurs twice."""


class ReplayClock(Clock):
    """The clock of a recording: it stops during a pause, and runs at playback speed.

    Args:
        jump_count: number of jumps so far. Each jump creates the vehicles anew, so that no vehicle's time
            runs backwards.
    """

    def __init__(self, begin_us: int, jump_count: int) -> None:
        self._begin_us = begin_us
        self._offset_s = jump_count * JUMP_GAP_S
        self.time_us = begin_us

    def monotonic_s(self) -> float:
        """Time since the start of the recording, plus `JUMP_GAP_S` for each jump [s]."""
        return self._offset_s + (self.time_us - self._begin_us) / 1e6

    def unix_s(self) -> float:
        """Time by the clock of the computer that made the recording [s since 1970 UTC]."""
        return self.time_us / 1e6

    async def sleep(self, seconds: float) -> None:
        """Not supported, because no code waits for a time in a recording.

        Raises:
            RuntimeError: always.
        """
        raise RuntimeError("the clock of a recording cannot wait")


class PlaybackPosition:
    """Position, speed and state of playback at a given time."""

    def __init__(self, begin_us: int, end_us: int, *, speed: float, playing: bool) -> None:
        self.begin_us, self.end_us = begin_us, end_us
        self._speed = speed
        self._playing = playing
        self._start_us = begin_us
        """Position at the last change of playback [us since 1970]."""
        self._since_s: float | None = None
        """Time of the last change of playback [s, monotonic]; None before the first use of the position."""

    @property
    def speed(self) -> float:
        """Playback speed; 1 is real time."""
        return self._speed

    def playing(self, now_s: float) -> bool:
        """Whether the recording is playing; False at the end."""
        return self._playing and self.position_us(now_s) < self.end_us

    def position_us(self, now_s: float) -> int:
        """The position at this time [us since 1970]."""
        if not self._playing:
            return self._start_us
        if self._since_s is None:
            self._since_s = now_s
        played_us = int((now_s - self._since_s) * 1e6 * self._speed)
        return min(self.end_us, self._start_us + played_us)

    def play(self, now_s: float) -> None:
        """Starts playing."""
        self._restart(now_s, self.position_us(now_s), True)

    def pause(self, now_s: float) -> None:
        """Pauses playback."""
        self._restart(now_s, self.position_us(now_s), False)

    def set_speed(self, now_s: float, speed: float) -> None:
        """Sets the playback speed."""
        self._restart(now_s, self.position_us(now_s), self._playing)
        self._speed = speed

    def jump(self, now_s: float, time_us: int) -> int:
        """Jumps to the nearest recorded time, and returns it."""
        self._restart(now_s, min(self.end_us, max(self.begin_us, time_us)), self._playing)
        return self._start_us

    def _restart(self, now_s: float, start_us: int, playing: bool) -> None:
        self._start_us, self._since_s, self._playing = start_us, now_s, playing


@dataclass(frozen=True, slots=True)
class RestoredState:
    """The records that restore the state at one time."""

    records: list[Record]
    """Records in recorded order: the newest record of each message up to that time, and the events so far."""
    following: list[Record]
    """Records that were already read and are later."""
    after: Cursor
    """Where in the file reading continues."""
    at_end: bool


def condense(records: Iterable[Record]) -> list[Record]:
    """The newest record of each message, and every record of an event or a state change, in order. These
    records restore the same state as all records.
    """
    all_records = list(records)
    newest = {record.key: record.offset for record in all_records}
    return [r for r in all_records if newest[r.key] == r.offset or r.key & 0xFFFFFF in EVENT_MESSAGES]


def state_at(file: BinaryIO, index: Index, time_us: int) -> RestoredState:
    """The records that restore the state at `time_us`; reads a limited part of the file.

    Raises:
        OSError: the file cannot be read.
    """
    checkpoint = index.checkpoint(time_us)
    time_us_by_offset = dict(zip(checkpoint.newest[1::2], checkpoint.newest[::2], strict=True))
    time_us_by_offset |= {offset: at_us for at_us, offset in index.events_until(time_us)}
    time_us_by_offset |= {offset: at_us for at_us, offset in index.first_heartbeats if at_us <= time_us}
    batch = Batch([], checkpoint.cursor, at_end=False, bytes_skipped=0)
    recent: list[Record] = []
    following: list[Record] = []
    while not batch.at_end and not following:
        batch = read_batch(file, batch.after)
        recent = _newest_events(condense([*recent, *(r for r in batch.records if r.time_us <= time_us)]))
        following = batch.records[len(batch.records) - sum(r.time_us > time_us for r in batch.records) :]
    earlier = [
        Record(time_us_by_offset[offset], offset, 0, read_at(file, offset))
        for offset in sorted(time_us_by_offset)
        if offset < checkpoint.cursor.offset
    ]
    return RestoredState([*earlier, *recent], following, batch.after, batch.at_end)


def _newest_events(records: list[Record]) -> list[Record]:
    """Drops the oldest events if there are more than the message list shows."""
    offsets = [record.offset for record in records if record.key & 0xFFFFFF in EVENT_MESSAGES]
    if len(offsets) <= CHANGES_RESTORED + TEXTS_RESTORED:
        return records
    newest = {record.key: record.offset for record in records}
    first_offset = offsets[-(CHANGES_RESTORED + TEXTS_RESTORED)]
    return [r for r in records if r.offset >= first_offset or newest[r.key] == r.offset]
