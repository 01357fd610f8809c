"""MAVLink 2 message signing: creates and checks signatures, with timestamps that always increase. No I/O.

Rules and layout are those of the MAVLink guide ("Message signing"): after the checksum, a frame has a link id
(one byte), a timestamp (48 bits, unit 10 us, since 2015-01-01) and the first 48 bits of the SHA-256 over the
secret key and all preceding bytes. A stream is one (link id, system, component). Its timestamps increase
with each frame; a new stream may be at most a minute behind the receiver.
"""

from __future__ import annotations

import hashlib
import hmac
import struct
import threading
from collections.abc import Callable
from enum import StrEnum
from typing import NoReturn

KEY_BYTES = 32
EPOCH_UNIX_S = 1_420_070_400.0
"""2015-01-01 00:00 UTC."""
TICKS_PER_S = 100_000
MAX_NEW_STREAM_AGE_TICKS = 60 * TICKS_PER_S
MAX_TIMESTAMP = (1 << 48) - 1
MAX_ADOPTED_TIMESTAMP = MAX_TIMESTAMP - 366 * 86_400 * TICKS_PER_S
"""Larger timestamps are not adopted, because the range of values would then soon be exhausted."""
MAX_STREAMS = 1024
"""Maximum number of streams per key. Only a sender with the key can start a new stream."""
STX_V2 = 0xFD
SIGNED_FLAG = 0x01
_time_low_high = struct.Struct("<IH")


class Refusal(StrEnum):
    """Why a frame is refused."""

    UNSIGNED = "unsigned"
    """The frame has no signature, and the link requires one."""
    WRONG_SIGNATURE = "wrong_signature"
    """The frame was signed with another key, or changed in transfer."""
    REPLAYED = "replayed"
    """The frame is not newer than an earlier frame of its stream."""
    TOO_OLD = "too_old"
    """The frame is the first of its stream, and more than a minute behind this server's time."""
    TOO_MANY_STREAMS = "too_many_streams"


class SecretKey:
    """A key of 32 bytes that never appears in `repr`, logs or errors."""

    __slots__ = ("_bytes",)

    def __init__(self, key: bytes) -> None:
        """Raises ValueError if the length is wrong; the error does not contain the key."""
        if len(key) != KEY_BYTES:
            raise ValueError(f"a signing key has {KEY_BYTES} bytes, not {len(key)}")
        self._bytes = bytes(key)

    def __repr__(self) -> str:
        return "SecretKey(not shown)"

    def __format__(self, format_spec: str) -> str:
        return repr(self)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SecretKey) and hmac.compare_digest(self._bytes, other._bytes)

    __hash__ = None  # type: ignore[assignment]

    def __reduce_ex__(self, protocol: object) -> NoReturn:
        raise TypeError("a signing key cannot be pickled; use `reveal`")

    def reveal(self) -> bytes:
        """The key's bytes, only for the stream process and the key's file."""
        return self._bytes

    def signature(self, frame: bytes) -> bytes:
        """The signature of a frame with its checksum, link id and timestamp."""
        return hashlib.sha256(self._bytes + frame).digest()[:6]


class SigningClock:
    """Timestamps for signing in one process: always increasing, from any thread.

    The timestamps follow the system clock. If a correctly signed frame has a larger timestamp, this clock
    adopts it and stays ahead of the system clock, because a vehicle refuses a new stream that is a minute
    behind the vehicle's time.

    Args:
        unix_s: the system clock [s since 1970].
        last_used: the largest timestamp used earlier; the first new timestamp is larger.
    """

    def __init__(self, unix_s: Callable[[], float], last_used: int = 0) -> None:
        self._unix_s = unix_s
        self._last = min(last_used, MAX_ADOPTED_TIMESTAMP)
        self._lock = threading.Lock()
        self.ahead_ticks = 0
        """Difference between the timestamps and the system clock [ticks]."""
        if last_used:
            self._run_ahead_to(self._last)

    def next(self) -> int:
        """The timestamp of the next frame."""
        with self._lock:
            self._last = max(self._system_clock_ticks() + self.ahead_ticks, self._last + 1)
            return self._last

    def now(self) -> int:
        """The current timestamp; `next` returns this or a larger one."""
        return max(self._system_clock_ticks() + self.ahead_ticks, self._last)

    def adopt(self, timestamp: int) -> None:
        """Adopts the timestamp of a correctly signed frame; later timestamps of this server are larger."""
        if self.now() < timestamp <= MAX_ADOPTED_TIMESTAMP:
            with self._lock:
                self._run_ahead_to(timestamp)

    def run_ahead(self, ticks: int) -> None:
        """Adopts the difference to the system clock that another process of this server uses [ticks]."""
        with self._lock:
            self.ahead_ticks = max(self.ahead_ticks, ticks)

    def _run_ahead_to(self, timestamp: int) -> None:
        # Never rounded up: vehicle and server adopt each other's time, and each exchange would add to it.
        self.ahead_ticks = max(self.ahead_ticks, timestamp - self._system_clock_ticks())

    def _system_clock_ticks(self) -> int:
        return max(0, int((self._unix_s() - EPOCH_UNIX_S) * TICKS_PER_S))


class FrameSigner:
    """Signs the frames of one link.

    Args:
        key: the link's key.
        link_id: distinguishes the links of one key, 0 to 255.
        clock: the signing clock of the process.
    """

    __slots__ = ("_link_id_byte", "clock", "key", "link_id")

    def __init__(self, key: SecretKey, link_id: int, clock: SigningClock) -> None:
        self.key = key
        self.link_id = link_id
        self._link_id_byte = bytes([link_id])
        self.clock = clock

    def trailer(self, frame: bytes) -> bytes:
        """The 13 bytes of the signature that follow a frame and its checksum. Call when the frame is sent, in
        the order of sending."""
        link_id_and_time = self._link_id_byte + self.clock.next().to_bytes(6, "little")
        return link_id_and_time + self.key.signature(frame + link_id_and_time)


class KeyVerifier:
    """Checks frames signed with one key, on all its links: each frame is accepted only once.

    Args:
        key: the key.
        clock: this server's signing clock; it adopts the timestamps of correctly signed frames.
    """

    def __init__(self, key: SecretKey, clock: SigningClock) -> None:
        self._key = key
        self._clock = clock
        self._newest: dict[tuple[int, int, int], int] = {}
        """Newest timestamp by stream."""

    def refusal(self, raw: bytes, system_id: int, component_id: int) -> Refusal | None:
        """Why a frame with a valid checksum is refused; None: accepted."""
        if not is_signed(raw):
            return Refusal.UNSIGNED
        if not hmac.compare_digest(self._key.signature(raw[:-6]), raw[-6:]):
            return Refusal.WRONG_SIGNATURE  # checked first: a wrong signature must not change any state
        low, high = _time_low_high.unpack_from(raw, len(raw) - 12)
        timestamp = low | high << 32
        stream = (raw[-13], system_id, component_id)
        newest = self._newest.get(stream)
        if newest is None:
            if timestamp + MAX_NEW_STREAM_AGE_TICKS < self._clock.now():
                return Refusal.TOO_OLD
            if len(self._newest) >= MAX_STREAMS:
                return Refusal.TOO_MANY_STREAMS
        elif timestamp <= newest:
            return Refusal.REPLAYED
        self._newest[stream] = timestamp
        self._clock.adopt(timestamp)
        return None


def is_signed(raw: bytes) -> bool:
    """Whether a frame has a signature."""
    return raw[0] == STX_V2 and bool(raw[2] & SIGNED_FLAG)
