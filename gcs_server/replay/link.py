"""A link that plays a telemetry log: with playback speed, pause, and jumps to any time."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, TypeVar
from urllib.parse import SplitResult, unquote

from gcs_server.errors import InvalidRequest, LinkError
from gcs_server.links.base import Link, Peer
from gcs_server.links.names import checked_path, derived_name
from gcs_server.links.url import REMEDY, parsed_number
from gcs_server.replay.index import Index, UnreadableRecording, explain
from gcs_server.replay.index_process import IndexProcess
from gcs_server.replay.playback import PlaybackPosition, ReplayClock, RestoredState, condense, state_at
from gcs_server.replay.records import Batch, Cursor, Record, open_log, read_batch

TICK_S = 0.02
RECORDS_PER_TICK = 500
"""Limits a tick to about 10 ms of the event loop; if more is due, the replay falls behind."""
CONDENSE_FROM = 100
"""If more records than this are due at the same time, only those needed for the vehicles' state are
played."""
READ_AHEAD = 4000
"""Number of pending records below which the next batch is read from the file."""
AT_END = "The recording is at its end."

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class ReplayState:
    """The state of a replay."""

    state: str
    """connecting (the file is being read), open, or ended (at the end, or the file cannot be played: see
    `detail`)."""
    detail: str
    """Message for the operator; empty if there is no problem."""
    playing: bool
    speed: float
    """Playback speed; 1 is real time, 0 is as fast as possible."""
    position_unix_s: float | None
    """Current time in the recording, by the clock of the computer that recorded it; null while the file is
    being read."""
    begin_unix_s: float | None
    end_unix_s: float | None


class TlogLink(Link):
    """Plays a recording at `speed` times real time; 0 is as fast as possible, without dropping records.

    The clock of its vehicles is the recording's (`clock`). A jump removes the peer and adds it again, so that
    the previous vehicles and their state are removed.

    Args:
        index: index of this file; None: a separate process creates the index.
    """

    replay = True

    def __init__(
        self, name: str, url: str, path: Path, speed: float = 1.0, *, index: Index | None = None
    ) -> None:
        super().__init__(name, url)
        self.path = path
        self.index = index
        self._speed = speed
        self._peer = Peer(path.name)
        self._file: BinaryIO | None = None
        self._reader: ThreadPoolExecutor | None = None
        """The only thread that reads the file, so that the file is never closed during a read."""
        self._indexing: IndexProcess | None = None
        self._playback: PlaybackPosition | None = None
        self._replay_clock: ReplayClock | None = None
        self._pending: deque[Record] = deque()
        self._cursor, self._at_end, self._reading = Cursor(), False, False
        self._jump_count = 0
        """Number of jumps so far; data that was requested before a jump is dropped."""
        self._jump_to_us: int | None = None
        self._jumping = False
        self._jump_waiters: list[asyncio.Future[None]] = []
        self._timer: asyncio.Handle | None = None
        self._opened_or_failed = asyncio.Event()

    async def opened(self) -> None:
        """Returns once the recording plays, or cannot be played: see `replay_state`."""
        await self._opened_or_failed.wait()

    # --- controls ---------------------------------------------------------------------------------

    def replay_state(self) -> ReplayState:
        """The current state of the replay."""
        playback, clock = self._playback, self._replay_clock
        if playback is None or clock is None:
            return ReplayState(self._state, self._detail, False, self._speed, None, None, None)
        now_s = self._loop.time()
        position_us = playback.position_us(now_s) if self._jump_to_us is None else self._jump_to_us
        return ReplayState(
            self._state,
            self._detail,
            playback.playing(now_s),
            self._speed,
            (position_us if self._jumping else clock.time_us) / 1e6,
            playback.begin_us / 1e6,
            playback.end_us / 1e6,
        )

    def play(self) -> None:
        """Starts playing; at the end of the recording, from its beginning."""
        playback, now_s = self._require_playback(), self._loop.time()
        if playback.position_us(now_s) >= playback.end_us and not self._jumping:
            self._jump(playback.begin_us)
        playback.play(now_s)

    def pause(self) -> None:
        """Pauses the replay."""
        self._require_playback().pause(self._loop.time())

    def set_speed(self, speed: float) -> None:
        """Sets the replay speed."""
        self._require_playback().set_speed(self._loop.time(), speed)
        self._speed = speed

    async def seek(self, time_us: int) -> None:
        """Jumps to a time, or to the nearest recorded time; returns once the vehicles have the state of
        that time."""
        self._require_playback()
        self._jump_waiters.append(jumped := self._loop.create_future())
        self._jump(time_us)
        await jumped

    # --- opening ----------------------------------------------------------------------------------

    def _open(self) -> None:
        self._set_state("connecting", "The recording is being read.")
        self._reader = ThreadPoolExecutor(1, thread_name_prefix="replay")
        if self.index is None:
            self._indexing = IndexProcess(self.path)
        index, indexing = self.index, self._indexing

        def prepare() -> tuple[BinaryIO, Index]:
            ready_index = index if index is not None else indexing.run() if indexing is not None else None
            assert ready_index is not None
            return open_log(self.path), ready_index

        self._run_in_reader(prepare, self._on_prepared)

    def _explain(self, error: OSError) -> str:
        return explain(self.path, error)

    def _on_prepared(self, prepared: tuple[BinaryIO, Index]) -> None:
        file, index = prepared
        if self._reader is None:  # closed meanwhile
            file.close()
            return
        self._file, self.index = file, index
        as_fast_as_possible = self._speed == 0
        speed = 1.0 if as_fast_as_possible else self._speed
        self._playback = PlaybackPosition(index.begin_us, index.end_us, speed=speed, playing=True)
        self._replay_clock = self.clock = ReplayClock(index.begin_us, self._jump_count)
        self._peers[self._peer.name] = self._peer
        self._opened()
        self._opened_or_failed.set()
        self._timer = self._loop.call_soon(self._tick)

    def _run_in_reader(self, work: Callable[[], T], on_result: Callable[[T], None]) -> None:
        """Runs `work` in the reading thread and `on_result` in the event loop; an error ends the replay."""

        def on_done(future: asyncio.Future[T]) -> None:
            if future.cancelled():
                return
            error = future.exception()
            if error is None:
                try:
                    on_result(future.result())
                except Exception as fault:
                    self.faults.add(fault, "playing")
                    self._end(f"{self.path.name} cannot be played.")
            elif isinstance(error, OSError):
                self._end(self._explain(error))
            elif isinstance(error, UnreadableRecording):
                self._end(f"{self.path.name}: {error}")
            else:
                self._end(f"{self.path.name} cannot be played.")
                self._loop.call_exception_handler({"message": "replay failed", "exception": error})

        assert self._reader is not None
        self._loop.run_in_executor(self._reader, work).add_done_callback(on_done)

    def _end(self, why: str) -> None:
        if self._should_be_open:
            self._should_be_open = False
            self._close()
            self._set_state("ended", why)

    # --- playing ----------------------------------------------------------------------------------

    def _tick(self) -> None:
        playback, clock = self._playback, self._replay_clock
        if playback is None or clock is None:
            return
        try:
            if not self._jumping:
                self._play_due(playback, clock)
        except Exception as error:
            self.faults.add(error, "playing")
        if self._should_be_open and self._playback is not None:
            play_next_now = self._speed == 0 and bool(self._pending)
            self._timer = self._loop.call_later(0.0 if play_next_now else TICK_S, self._tick)

    def _play_due(self, playback: PlaybackPosition, clock: ReplayClock) -> None:
        position_us = playback.position_us(self._loop.time())
        as_fast_as_possible = self._speed == 0 and playback.playing(self._loop.time())
        due: list[Record] = []
        pending = self._pending
        while pending and (pending[0].time_us <= position_us or as_fast_as_possible):
            if as_fast_as_possible and len(due) >= RECORDS_PER_TICK:
                break
            due.append(pending.popleft())
        if len(pending) < READ_AHEAD and not self._at_end:
            self._read_next_batch()
        if not as_fast_as_possible and len(due) > CONDENSE_FROM:
            due = condense(due)
        pending.extendleft(reversed(due[RECORDS_PER_TICK:]))
        is_behind = as_fast_as_possible or len(due) > RECORDS_PER_TICK
        self._feed(due[:RECORDS_PER_TICK], clock)
        if not pending and not self._at_end:
            return  # the file is read more slowly than it is played
        if is_behind:
            playback.jump(self._loop.time(), clock.time_us)
        else:
            clock.time_us = max(clock.time_us, position_us)
        if not pending and self._at_end and clock.time_us >= playback.end_us:
            playback.pause(self._loop.time())
            self._set_state("ended", AT_END)

    def _feed(self, records: list[Record], clock: ReplayClock) -> None:
        for record in records:
            clock.time_us = max(clock.time_us, record.time_us)
            self._received(record.raw, self._peer, clock.monotonic_s())
            if not self._should_be_open:  # the handler closed the link
                return

    def _read_next_batch(self) -> None:
        file, cursor, jump_count = self._file, self._cursor, self._jump_count
        if self._reading or file is None:
            return
        self._reading = True

        def read(batch: Batch) -> None:
            self._reading = False
            if jump_count == self._jump_count and not self._jumping and self._file is file:
                self._pending.extend(batch.records)
                self._cursor, self._at_end = batch.after, batch.at_end

        self._run_in_reader(lambda: read_batch(file, cursor), read)

    # --- jumping ----------------------------------------------------------------------------------

    def _require_playback(self) -> PlaybackPosition:
        if self._playback is None:
            raise UnreadableRecording(self._detail or "The recording is closed.")
        return self._playback

    def _jump(self, time_us: int) -> None:
        self._jump_to_us = self._require_playback().jump(self._loop.time(), time_us)
        if not self._jumping:
            self._jumping = True
            self._read_state()

    def _read_state(self) -> None:
        file, index, target_us = self._file, self.index, self._jump_to_us
        assert file is not None
        assert index is not None
        assert target_us is not None

        def on_state(restored: RestoredState) -> None:
            if self._playback is None or self._file is not file:
                return
            if self._jump_to_us != target_us:  # another jump was requested meanwhile
                self._read_state()
                return
            self._restore(restored, index, target_us)

        self._run_in_reader(lambda: state_at(file, index, target_us), on_state)

    def _restore(self, restored: RestoredState, index: Index, time_us: int) -> None:
        self._jump_count += 1
        jump_count = self._jump_count
        self._pending = deque(restored.following)
        self._cursor, self._at_end = restored.after, restored.at_end
        self._forget(self._peer)
        self._replay_clock = self.clock = clock = ReplayClock(index.begin_us, self._jump_count)
        self._peers[self._peer.name] = self._peer
        self.suppresses_events = True
        self._feed_restored(deque(restored.records), clock, time_us, jump_count)

    def _feed_restored(
        self, records: deque[Record], clock: ReplayClock, time_us: int, jump_count: int
    ) -> None:
        """Feeds the frames that restore the vehicles' state, in several iterations of the event loop."""
        if self._playback is None or jump_count != self._jump_count:
            return
        self._feed([records.popleft() for _ in range(min(len(records), RECORDS_PER_TICK))], clock)
        if records:
            self._loop.call_soon(self._feed_restored, records, clock, time_us, jump_count)
        elif self._jump_to_us != time_us:  # another jump was requested meanwhile
            self._read_state()
        else:
            self.suppresses_events = False
            clock.time_us = max(clock.time_us, time_us)
            self._jumping, self._jump_to_us = False, None
            self._set_state("open", "")
            self._resolve_jumps()

    def _resolve_jumps(self) -> None:
        waiting, self._jump_waiters = self._jump_waiters, []
        for future in waiting:
            if not future.done():
                future.set_result(None)

    # --- closing ----------------------------------------------------------------------------------

    def _writer(self, peer: Peer) -> None:
        return None

    def _close(self) -> None:
        self.suppresses_events = False
        self._opened_or_failed.set()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._indexing is not None:
            self._indexing.stop()
        self._playback = None
        self._pending.clear()
        self._resolve_jumps()
        file, self._file = self._file, None
        reader, self._reader = self._reader, None
        if reader is not None:
            if file is not None:
                reader.submit(file.close)
            reader.shutdown(wait=False)


def replay_link(url: str, name: str | None, parts: SplitResult, options: dict[str, str]) -> TlogLink:
    """The link of a URL `tlog:…`: a `LinkMaker`.

    Raises:
        InvalidRequest: the URL is not valid.
        LinkError: the recording does not exist.
    """
    for key in options.keys() - {"speed"}:
        raise InvalidRequest("url", f"{url!r}: tlog links have no option {key!r}.", remedy=REMEDY)
    path_text = checked_path(url, unquote(parts.path))
    path = Path(path_text)
    if not path_text or not path.is_file():
        raise LinkError(
            f"There is no recording {path_text or url!r}.", remedy="Give the path of a .tlog file."
        )
    speed = parsed_number(url, "speed", options.get("speed", "1"))
    if not 0 <= speed <= 1000:
        raise InvalidRequest("url", f"{url!r}: speed must be from 0 (as fast as possible) to 1000.")
    return TlogLink(name or derived_name(f"replay-{path.name}"), url, path, speed)
