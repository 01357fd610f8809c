"""Joins the chunks of long STATUSTEXTs within limits, and limits the number of lines per vehicle."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

_text = struct.Struct("<B50sHB")
WAIT_FOR_CHUNKS_S = 1.0
MAX_PENDING = 8
"""Maximum number of texts whose chunks are awaited. If there is one more, the oldest text is
published incomplete."""
MAX_CHUNKS = 20
"""Maximum number of chunks of 50 bytes in one text; further chunks are ignored."""
MAX_BURST_LINES, MAX_LINES_PER_S = 200.0, 20.0
"""Maximum number of lines of one vehicle in a burst, and average per second. PX4 sends about 60 lines when it
starts."""


@dataclass(slots=True)
class _Pending:
    severity: int
    began_s: float
    chunks: dict[int, bytes] = field(default_factory=dict[int, bytes])
    has_last_chunk: bool = False


class TextJoiner:
    """Joins chunks with the same id to one text; a lost chunk is shown as ‹…›."""

    def __init__(self) -> None:
        self._pending: dict[int, _Pending] = {}

    def feed(self, payload: bytes, now_s: float) -> list[tuple[int, str]]:
        """(severity, text) of the texts that are complete with this message."""
        severity, raw, text_id, chunk = _text.unpack(payload)
        is_last = b"\0" in raw
        part = raw.split(b"\0", 1)[0]
        if text_id == 0:
            return [*self.expire(now_s), (severity, _decode(part))]
        if chunk >= MAX_CHUNKS:
            return []
        texts: list[tuple[int, str]] = []
        pending = self._pending.get(text_id)
        if pending is not None and chunk in pending.chunks and pending.chunks[chunk] != part:
            texts.append(self._finish(text_id))  # the id was reused
            pending = None
        if pending is None:
            if len(self._pending) >= MAX_PENDING:
                texts.append(self._finish(next(iter(self._pending))))
            pending = self._pending[text_id] = _Pending(severity, now_s)
        pending.chunks[chunk] = part
        last = max(pending.chunks)
        pending.has_last_chunk = pending.has_last_chunk or is_last
        if pending.has_last_chunk and len(pending.chunks) == last + 1:
            texts.append(self._finish(text_id))
        return texts

    def expire(self, now_s: float) -> list[tuple[int, str]]:
        """Texts whose missing chunks have not arrived in time."""
        if not self._pending:
            return []
        expired = [i for i, p in self._pending.items() if now_s - p.began_s > WAIT_FOR_CHUNKS_S]
        return [self._finish(text_id) for text_id in expired]

    def _finish(self, text_id: int) -> tuple[int, str]:
        pending = self._pending.pop(text_id)
        parts = [
            _decode(pending.chunks[i]) if i in pending.chunks else "‹…›"
            for i in range(max(pending.chunks) + 1)
        ]
        if not pending.has_last_chunk:
            parts.append("‹…›")
        return pending.severity, "".join(parts)


class LineRateLimiter:
    """Limits the rate of a vehicle's lines (token bucket), and counts the dropped lines."""

    def __init__(self) -> None:
        self._tokens = MAX_BURST_LINES
        self._filled_s: float | None = None
        self._dropped = 0

    def allow(self, now_s: float) -> bool:
        """Whether one more line may be published; if not, counts it as dropped."""
        if self._filled_s is not None:
            self._tokens = min(MAX_BURST_LINES, self._tokens + (now_s - self._filled_s) * MAX_LINES_PER_S)
        self._filled_s = now_s
        if self._tokens < 1.0:
            self._dropped += 1
            return False
        self._tokens -= 1.0
        return True

    def take_dropped(self, now_s: float) -> int:
        """Number of lines dropped since the last call; 0 while the vehicle still sends too fast."""
        if not self._dropped or self._filled_s is None:
            return 0
        if self._tokens + (now_s - self._filled_s) * MAX_LINES_PER_S < MAX_LINES_PER_S / 2:
            return 0
        count, self._dropped = self._dropped, 0
        return count


def _decode(raw: bytes) -> str:
    return raw.decode("utf-8", errors="replace")
