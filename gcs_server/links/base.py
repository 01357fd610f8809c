"""Base class of all links: receives bytes from peers, and sends bytes from any thread."""

from __future__ import annotations

import asyncio
import errno
import socket
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from gcs_server.clock import Clock
from gcs_server.faults import FaultLog
from gcs_server.links.send_queue import Packet, SendCounts
from gcs_server.links.writer import LinkWriter

FIRST_RETRY_S = 0.5
MAX_RETRY_S = 5.0
OPENING_FAILED = "The link could not be opened: a fault in this server (see its log). The server tries again."


@dataclass(frozen=True, slots=True)
class DdsAddress:
    """The DDS domain, network interface and namespace of a vehicle's ROS 2 topics."""

    domain_id: int
    interface: str | None
    """Network interface; None: loopback."""
    namespace: str
    """Namespace of the topics; empty: none."""
    formats: tuple[tuple[str, str, str, int], ...] = ()
    """The topics whose layout the vehicle has confirmed (`ros2.formats.TopicFormat`)."""


@dataclass(frozen=True, slots=True)
class Peer:
    """A remote end of a link. A UDP link has one peer for each `host:port`, any other link has one peer."""

    name: str
    address: tuple[str, int] | None = None
    dds: DdsAddress | None = None
    """Address of the vehicle's ROS 2 topics, to which another process may also publish; None over MAVLink."""


class UnusableTopic(NamedTuple):
    """A ROS 2 topic of a peer that this server cannot use."""

    text: str
    """Why, and what is not available; without a full stop."""
    awaited: bool = False
    """Whether the vehicle may still announce the topic, or answer for it."""


@dataclass(frozen=True, slots=True)
class Recording:
    """The recording of a link."""

    file: str | None
    """Name of the tlog in the folder `recordings`; null before the first frame."""
    bytes: int
    """Size of this file; at the maximum size, the next file begins."""
    started_unix_s: float | None
    """Start time of this file."""
    stopped: str | None
    """Why recording has stopped; null while recording works."""


@dataclass(frozen=True, slots=True)
class SigningOptions:
    """Signing options of a link, from its URL."""

    key: str
    """Name of the key; the key itself is never in a URL."""
    required: bool
    """Whether unsigned frames are refused. Wrongly signed frames are always refused."""


@dataclass(frozen=True, slots=True)
class GuardOptions:
    """Options of a guarded link, on which a program takes this server for its vehicle (`guard/`)."""

    control: str
    """ask: control is taken if nobody has it, and asked for if somebody has. free: it is only taken if nobody
    has it. read: the program may not command."""
    vehicle: str | None = None
    """Id of the vehicle; None: the only one that is connected."""
    client: str | None = None
    """Name of the program as a client; None: from the link's name."""
    valid_for_s: float = 0.5
    """Time after which a setpoint of the program has expired if no other follows [s]."""
    on_expiry: str = "hold"
    """Action when a setpoint has expired: hold, land, stop_stream."""
    same_for_s: float = 10.0
    """Time for which a setpoint that moves the vehicle is flown without any change; then it expires, because
    a library may send the last one on while its program hangs [s]. 0: for ever."""


@dataclass(frozen=True, slots=True)
class SigningReport:
    """Signing of a link, and its refused frames."""

    key: str
    """The key's name."""
    mode: str
    """required: unsigned frames are refused; allowed: they are accepted. Wrongly signed frames are always
    refused."""
    link_id: int
    """The link id in all signatures of this link, 0 to 255."""
    unsigned: int
    """Frames refused because they have no signature, although one is required."""
    wrong_signature: int
    """Frames refused because they were signed with another key or changed in transfer."""
    replayed: int
    """Frames refused because they are not newer than an earlier frame of the same sender."""
    too_old: int
    """First frames of a sender refused because they are more than a minute behind this server's time."""
    too_many_streams: int
    """Frames refused because there are more senders with this key than the server can track."""


@dataclass(frozen=True, slots=True)
class LinkInfo:
    """State and counters of one link, for `GET /links`."""

    name: str
    url: str
    state: str
    """connecting, open, waiting (the server tries again), closed, ended (a replay at its end)."""
    detail: str
    """The problem and what to do about it; empty if there is no problem."""
    replay: bool
    forward: bool
    guard: bool
    """Whether programs are connected over this link, to which the server is their vehicle."""
    peers: tuple[str, ...]
    bytes_received: int
    bytes_sent: int
    bytes_dropped: int
    """Bytes not sent because the queue was full, the system refused them, or no peer was connected."""
    frames_sent: int = 0
    """Sent frames."""
    frames_waiting: int = 0
    """Frames waiting in the queue."""
    frames_replaced: int = 0
    """Waiting frames replaced by newer ones: setpoints, repeated or replaced commands."""
    frames_expired: int = 0
    """Frames that waited too long and were not sent: a setpoint after 0.1 s, a command after 0.5 s."""
    frames_dropped: int = 0
    """Frames not sent because the queue was full or the link failed."""
    frames_received: int = 0
    """Received MAVLink frames. This counter and the next four include former peers."""
    frames_unknown: int = 0
    """Frames of messages that are not in the dialect."""
    frames_lost: int = 0
    """Lost frames, counted by gaps in sequence numbers; not counted in a recording."""
    crc_errors: int = 0
    """Frames with a wrong checksum."""
    bytes_skipped: int = 0
    """Bytes that are not part of a frame: garbage, another protocol, a wrong baud rate."""
    handler_errors: int = 0
    """Messages that were skipped because of an error in this server."""
    frames_refused: int = 0
    """Frames refused because of a wrong or missing signature; `signing` contains the reasons."""
    frames_unverified: int = 0
    """Signed frames accepted without a check, because this link has no key."""
    signing: SigningReport | None = None
    """Null if the link has no key."""
    recording: Recording | None = None
    """Null if the link is not recorded: a replay, or a server with --no-record."""


OnBytes = Callable[[bytes, Peer, float], None]
"""(data, peer, received_monotonic_s); called in the event loop."""

OnPeerGone = Callable[[Peer], None]
OnChange = Callable[[], None]
"""Called when the state or the peers have changed."""


class Link(ABC):
    """Transports bytes only. After `start`, the link opens, and opens again after a loss.

    Subclasses implement `_open`, `_close`, `_writer`; they call `_opened`, `_lost` and `_received`.
    Everything but `submit` and `send` happens in the event loop.
    """

    protocol = "MAVLink"
    """MAVLink or ROS 2: decides which kinds of setpoint the link can carry."""
    replay = False
    """Whether the link plays a recording, so that nothing can be sent."""
    clock: Clock | None = None
    """The clock of the vehicles on this link. A recording has its own clock; None: the server's clock."""
    signing: SigningOptions | None = None
    """The signing key; None: frames are not signed, and signatures are not checked."""
    guard: GuardOptions | None = None
    """Set if programs are connected over the link, to which this server is their vehicle."""
    simulated = False
    """Whether the operator says that only simulated vehicles are connected over the link."""
    suppresses_events = False
    """True while received frames only restore a vehicle's state and publish no events."""

    def __init__(self, name: str, url: str, *, forward: bool = False) -> None:
        self.name = name
        self.url = url
        self.forward = forward
        """Whether the link leads to another ground station, to which the vehicles' messages are forwarded."""
        self._state = "closed"
        self._detail = ""
        self._peers: dict[str, Peer] = {}
        self._bytes_received = 0
        self._counts = SendCounts()
        self._retry_s = FIRST_RETRY_S
        self._retry: asyncio.TimerHandle | None = None
        self._should_be_open = False
        self.faults = FaultLog(f"link {name}")
        """Errors in this server's code while it handled this link."""
        self.now_s: Callable[[], float] = time.monotonic
        """The clock for the expiry of packets: the event loop's clock after the start. May be called from any
        thread."""
        self._loop: asyncio.AbstractEventLoop
        self._on_bytes: OnBytes
        self._on_peer_gone: OnPeerGone
        self._on_change: OnChange

    @property
    def leads_to_vehicles(self) -> bool:
        """Whether vehicles are at the other end, and not another ground station or a program."""
        return not self.forward and self.guard is None

    def start(self, on_bytes: OnBytes, on_peer_gone: OnPeerGone, on_change: OnChange) -> None:
        """Starts the link. Temporary problems (a port in use, a missing device) raise no error: see
        `info()`."""
        self._loop = asyncio.get_running_loop()
        self.now_s = self._loop.time
        self._on_bytes, self._on_peer_gone, self._on_change = on_bytes, on_peer_gone, on_change
        self._should_be_open = True
        try:
            self._try_to_open()
        except BaseException:  # after a fault of this program, release what was opened
            self._should_be_open = False
            self._close_and_forget_peers()
            raise

    def submit(self, packet: Packet) -> bool:
        """Sends a packet or queues it by priority, from any thread. Returns False if it was dropped."""
        writer = None if self._state != "open" or self.replay else self._writer(packet.peer)
        if writer is not None:
            return writer.submit(packet)
        with self._counts.lock:
            self._counts.frames_dropped += 1
            self._counts.bytes_dropped += packet.size_bytes
        return False

    def send(self, data: bytes, peer: Peer) -> bool:
        """Sends bytes with the lowest priority and without expiry; otherwise like `submit`."""
        return self.submit(Packet(peer, len(data), lambda: data))

    def datagram_socket(self) -> socket.socket | None:
        """The open socket of a datagram link, with which another process may also send; otherwise None."""
        return None

    def count_sent_elsewhere(self, size_bytes: int) -> None:
        """Counts a frame that another process has sent with this link's socket."""
        with self._counts.lock:
            self._counts.frames_sent += 1
            self._counts.bytes_sent += size_bytes

    def unusable_topics(self, peer: Peer) -> Mapping[str, UnusableTopic]:
        """ROS 2 topics of a peer that this server cannot use, and why; empty over MAVLink."""
        return {}

    def dds_address(self, peer: Peer) -> DdsAddress | None:
        """Address of a peer's ROS 2 topics with their current formats; None over MAVLink."""
        return peer.dds

    def peers(self) -> tuple[Peer, ...]:
        """Current peers."""
        return tuple(self._peers.values())

    def info(self) -> LinkInfo:
        """Current state and counters."""
        counts = self._counts
        writers = {writer for peer in self.peers() if (writer := self._writer(peer)) is not None}
        return LinkInfo(
            name=self.name,
            url=self.url,
            state=self._state,
            detail=self._detail,
            replay=self.replay,
            forward=self.forward,
            guard=self.guard is not None,
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
        """Closes the link; returns once the socket or device is released."""
        self._should_be_open = False
        if self._retry is not None:
            self._retry.cancel()
        self._close_and_forget_peers()
        self._set_state("closed", "")

    # --- for subclasses --------------------------------------------------------------------------

    @abstractmethod
    def _open(self) -> None:
        """Starts opening; later calls `_opened()` or `_lost(why)`. May raise OSError."""

    @abstractmethod
    def _close(self) -> None:
        """Releases everything that `_open` acquired; may be called at any time."""

    @abstractmethod
    def _writer(self, peer: Peer) -> LinkWriter | None:
        """The writer for this peer, which may be used from any thread; None if there is no peer."""

    def _explain(self, error: OSError) -> str:
        """The error as a message for the operator."""
        if error.errno in (errno.EMFILE, errno.ENFILE):
            return "This server has too many files and connections open. Close some; the server tries again."
        return f"{error.strerror or error}"

    def _opened(self) -> None:
        self._retry_s = FIRST_RETRY_S
        self._set_state("open", "")

    def _lost(self, reason: str) -> None:
        """Closes the link and schedules a retry."""
        self._close_and_forget_peers()
        if not self._should_be_open:
            return
        self._set_state("waiting", reason)
        if self._retry is not None:
            self._retry.cancel()
        self._retry = self._loop.call_later(self._retry_s, self._try_to_open)
        self._retry_s = min(self._retry_s * 2, MAX_RETRY_S)

    def _received(self, data: bytes, peer: Peer, now_s: float | None = None) -> None:
        """Passes received bytes to the handler; an error in the handler does not close the link.

        Args:
            now_s: the event loop's time, if the caller knows it.
        """
        self._bytes_received += len(data)
        try:
            self._on_bytes(data, peer, self._loop.time() if now_s is None else now_s)
        except Exception as error:
            self.faults.add(error, "handling received bytes")

    def _forget(self, peer: Peer) -> None:
        if self._peers.pop(peer.name, None) is not None:
            try:
                self._on_peer_gone(peer)
            except Exception as error:
                self.faults.add(error, "handling a disconnected peer")

    def _changed(self) -> None:
        """Reports a change of the state or the peers."""
        try:
            self._on_change()
        except Exception as error:
            self.faults.add(error, "handling a change of the link's state")

    def _set_state(self, state: str, detail: str) -> None:
        if (state, detail) != (self._state, self._detail):
            self._state, self._detail = state, detail
            self._changed()

    def _run_opening_step(self, step: Callable[..., None], *arguments: object) -> None:
        """Runs a step of opening the link; if the step fails, opening is tried again."""
        try:
            step(*arguments)
        except OSError as error:
            self._lost(self._explain(error))
        except Exception as error:
            self.faults.add(error, "opening")
            self._lost(OPENING_FAILED)

    def _try_to_open(self) -> None:
        self._retry = None
        if not self._should_be_open:
            return
        if self._state != "waiting":
            self._set_state("connecting", "")
        self._run_opening_step(self._open)

    def _close_and_forget_peers(self) -> None:
        try:
            self._close()
        except Exception as error:
            self.faults.add(error, "closing")
        for peer in self.peers():
            self._forget(peer)
