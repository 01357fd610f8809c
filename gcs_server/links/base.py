"""The base of all links: bytes in with the peer they came from, bytes out from any thread."""

from __future__ import annotations

import asyncio
import errno
import socket
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

from gcs_server.clock import Clock
from gcs_server.faults import FaultLog
from gcs_server.links.send_queue import Packet, SendCounts
from gcs_server.links.writer import LinkWriter

FIRST_RETRY_S = 0.5
LONGEST_RETRY_S = 5.0
OPENING_FAILED = "A fault in this server kept the link from opening; its log says more. This is tried again."


@dataclass(frozen=True, slots=True)
class Peer:
    """The other end: `host:port` for UDP, one for the whole link otherwise."""

    name: str
    address: tuple[str, int] | None = None


@dataclass(frozen=True, slots=True)
class Recording:
    """The recording of a link."""

    file: str | None
    """The tlog's name in the data folder's `recordings`; null before the first frame."""
    bytes: int
    """Written to this file; a full one is followed by the next."""
    started_unix_s: float | None
    """When this file began."""
    stopped: str | None
    """Why nothing is recorded now, for people; null while all is well."""


@dataclass(frozen=True, slots=True)
class SigningOptions:
    """How a link's MAVLink frames are signed, as its URL says."""

    key: str
    """The key's name; the key itself stands in no URL."""
    required: bool
    """Whether unsigned frames are refused; wrongly signed ones always are."""


@dataclass(frozen=True, slots=True)
class SigningReport:
    """Signing of a link, and how many frames it refused."""

    key: str
    """The key's name."""
    mode: str
    """required: unsigned frames are refused; allowed: they are taken. Wrongly signed ones are refused."""
    link_id: int
    """The link id in all signatures of this link, 0 to 255."""
    unsigned: int
    """Refused: no signature, where one is required."""
    wrong_signature: int
    """Refused: signed with another key, or changed on the way."""
    replayed: int
    """Refused: no later than a frame that this sender has sent already."""
    too_old: int
    """Refused: a sender's first frame, more than a minute behind this server's time."""
    too_many_streams: int
    """Refused: another sender with this key, where there are too many."""


@dataclass(frozen=True, slots=True)
class LinkInfo:
    """One line of `GET /links`."""

    name: str
    url: str
    state: str
    """connecting, open, waiting (it will try again), closed, ended (a replay that came to its end)."""
    detail: str
    """For people: what is wrong and what to do about it; empty when all is well."""
    replay: bool
    forward: bool
    peers: tuple[str, ...]
    bytes_received: int
    bytes_sent: int
    bytes_dropped: int
    """Not sent because too much waited, the system refused it, or nobody was connected."""
    frames_sent: int = 0
    """Frames that have left."""
    frames_waiting: int = 0
    """Frames that wait now, because the link takes no more at the moment."""
    frames_replaced: int = 0
    """Frames that waited until a newer one took their place: setpoints, commands sent again or overtaken."""
    frames_expired: int = 0
    """Frames that waited too long and were not sent: a setpoint after 0.1 s, a command after 0.5 s."""
    frames_dropped: int = 0
    """Frames not sent because too much waited or the link failed."""
    frames_received: int = 0
    """Whole MAVLink frames, of peers that have gone, too; so are the next four."""
    frames_unknown: int = 0
    """Frames of messages that the dialect does not have."""
    frames_lost: int = 0
    """Counted by gaps in the sequence numbers; not counted in a recording."""
    crc_errors: int = 0
    """Frames whose checksum is wrong."""
    bytes_skipped: int = 0
    """Bytes that belong to no frame: garbage, another protocol, a wrong baud rate."""
    handler_errors: int = 0
    """Messages that were skipped and logged because of an error in this server."""
    frames_refused: int = 0
    """Frames that were refused because of their signature or its absence; `signing` says why."""
    frames_unverified: int = 0
    """Signed frames that were taken as they are, since this link has no key."""
    signing: SigningReport | None = None
    """Null where the link's URL names no key."""
    recording: Recording | None = None
    """Null where nothing is to be recorded: a replay, or a server with --no-record."""


OnBytes = Callable[[bytes, Peer, float], None]
"""(data, peer, received_monotonic_s); called in the event loop."""

OnPeerGone = Callable[[Peer], None]
OnState = Callable[[], None]


class Link(ABC):
    """Bytes only; a link opens itself, and again after it was lost.

    Kinds implement `_open`, `_close`, `_writer`; they call `_opened`, `_lost` and `_received`.
    Everything but `submit` and `send` happens in the event loop.
    """

    replay = False
    """True where what arrives is a recording; nothing can be sent."""
    clock: Clock | None = None
    """Whose time it is for those heard here: a recording has its own; None is the server's."""
    signing: SigningOptions | None = None
    """Which key signs what is sent and heard; None: nothing is signed, and no signature is checked."""
    quiet = False
    """True while what arrives only makes a vehicle what it was: nobody is told of its events."""

    def __init__(self, name: str, url: str, *, forward: bool = False) -> None:
        self.name = name
        self.url = url
        self.forward = forward
        """True for a link to another ground station, which gets what the vehicles say."""
        self._state = "closed"
        self._detail = ""
        self._peers: dict[str, Peer] = {}
        self._bytes_received = 0
        self._counts = SendCounts()
        self._retry_s = FIRST_RETRY_S
        self._retry: asyncio.TimerHandle | None = None
        self._wanted = False
        self.faults = FaultLog(f"link {name}")
        """Errors of this server's own code in serving this link."""
        self.now_s: Callable[[], float] = time.monotonic
        """The clock by which packets expire: the loop's, once started; from any thread."""
        self._loop: asyncio.AbstractEventLoop
        self._on_bytes: OnBytes
        self._on_peer_gone: OnPeerGone
        self._on_state: OnState

    def start(self, on_bytes: OnBytes, on_peer_gone: OnPeerGone, on_state: OnState) -> None:
        """Starts the link; never raises for problems that may pass (a port in use, a missing device): see
        `info()`."""
        self._loop = asyncio.get_running_loop()
        self.now_s = self._loop.time
        self._on_bytes, self._on_peer_gone, self._on_state = on_bytes, on_peer_gone, on_state
        self._wanted = True
        try:
            self._try()
        except BaseException:  # an error of our own: release what was opened
            self._wanted = False
            self._shut()
            raise

    def submit(self, packet: Packet) -> bool:
        """Sends or queues by priority; callable from any thread; False where it was dropped at once."""
        writer = None if self._state != "open" or self.replay else self._writer(packet.peer)
        if writer is not None:
            return writer.submit(packet)
        with self._counts.lock:
            self._counts.frames_dropped += 1
            self._counts.bytes_dropped += packet.size_bytes
        return False

    def send(self, data: bytes, peer: Peer) -> bool:
        """As `submit`, for plain bytes with the lowest priority and no expiry."""
        return self.submit(Packet(peer, len(data), lambda: data))

    def datagrams(self) -> socket.socket | None:
        """The open socket where each send is a datagram: another process may send by it, too."""
        return None

    def sent_elsewhere(self, size_bytes: int) -> None:
        """Another process has sent a frame of this size by this link's socket."""
        with self._counts.lock:
            self._counts.frames_sent += 1
            self._counts.bytes_sent += size_bytes

    def peers(self) -> tuple[Peer, ...]:
        """The peers at the other end now."""
        return tuple(self._peers.values())

    def info(self) -> LinkInfo:
        """State and counters now."""
        counts = self._counts
        writers = {writer for peer in self.peers() if (writer := self._writer(peer)) is not None}
        return LinkInfo(
            name=self.name,
            url=self.url,
            state=self._state,
            detail=self._detail,
            replay=self.replay,
            forward=self.forward,
            peers=tuple(self._peers),
            bytes_received=self._bytes_received,
            bytes_sent=counts.bytes_sent,
            bytes_dropped=counts.bytes_dropped,
            frames_sent=counts.frames_sent,
            frames_waiting=sum(writer.waiting for writer in writers),
            frames_replaced=counts.frames_replaced,
            frames_expired=counts.frames_expired,
            frames_dropped=counts.frames_dropped,
            handler_errors=self.faults.count,
        )

    async def close(self) -> None:
        """Gives back the socket or device; returns when that is done."""
        self._wanted = False
        if self._retry is not None:
            self._retry.cancel()
        self._shut()
        self._set_state("closed", "")

    # --- for the kinds ---------------------------------------------------------------------------

    @abstractmethod
    def _open(self) -> None:
        """Begins to open; ends in `_opened()` or `_lost(why)`; may raise OSError."""

    @abstractmethod
    def _close(self) -> None:
        """Gives back what `_open` took; may be called at any time."""

    @abstractmethod
    def _writer(self, peer: Peer) -> LinkWriter | None:
        """The writer for this peer, usable from any thread; None if there is no peer."""

    def _explain(self, error: OSError) -> str:
        """The error in words for people."""
        if error.errno in (errno.EMFILE, errno.ENFILE):
            return "This server has too many files and connections open. Close some; this is tried again."
        return f"{error.strerror or error}"

    def _opened(self) -> None:
        self._retry_s = FIRST_RETRY_S
        self._set_state("open", "")

    def _lost(self, why: str) -> None:
        """Closes what is left and tries again later."""
        self._shut()
        if not self._wanted:
            return
        self._set_state("waiting", why)
        if self._retry is not None:
            self._retry.cancel()
        self._retry = self._loop.call_later(self._retry_s, self._try)
        self._retry_s = min(self._retry_s * 2, LONGEST_RETRY_S)

    def _received(self, data: bytes, peer: Peer, now_s: float | None = None) -> None:
        """Hands over what came; whoever handles it cannot end the link.

        Args:
            now_s: the loop's time, from a kind that knows it already.
        """
        self._bytes_received += len(data)
        try:
            self._on_bytes(data, peer, self._loop.time() if now_s is None else now_s)
        except Exception as error:
            self.faults.add(error, "handling what arrived")

    def _forget(self, peer: Peer) -> None:
        if self._peers.pop(peer.name, None) is not None:
            try:
                self._on_peer_gone(peer)
            except Exception as error:
                self.faults.add(error, "handling that a peer has gone")

    def _changed(self) -> None:
        """Tells that the state or the peers are others."""
        try:
            self._on_state()
        except Exception as error:
            self.faults.add(error, "handling a change of the link's state")

    def _set_state(self, state: str, detail: str) -> None:
        if (state, detail) != (self._state, self._detail):
            self._state, self._detail = state, detail
            self._changed()

    def _attempt(self, step: Callable[..., None], *arguments: object) -> None:
        """A step of opening, from the loop or a look-up: whatever fails, the link is tried again."""
        try:
            step(*arguments)
        except OSError as error:
            self._lost(self._explain(error))
        except Exception as error:
            self.faults.add(error, "opening")
            self._lost(OPENING_FAILED)

    def _try(self) -> None:
        self._retry = None
        if not self._wanted:
            return
        if self._state != "waiting":
            self._set_state("connecting", "")
        self._attempt(self._open)

    def _shut(self) -> None:
        try:
            self._close()
        except Exception as error:
            self.faults.add(error, "closing")
        for peer in self.peers():
            self._forget(peer)
