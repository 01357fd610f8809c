"""An open link, with one MAVLink parser per peer, the recording, and this server's sequence numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from gcs_server.clock import Clock
from gcs_server.links.base import Link, LinkInfo, Peer
from gcs_server.links.send_queue import Packet
from gcs_server.mavlink.codec import MIN_V2_BYTES, SIGNATURE, Frame, FrameParser, encode_frame
from gcs_server.mavlink.link_signing import LinkSigning
from gcs_server.mavlink.priority import classify, classify_forwarded
from gcs_server.mavlink.signing import FrameSigner
from gcs_server.mavlink.tables import NAMES
from gcs_server.mavlink.tlog_writer import TlogChannel, stamp


@dataclass(frozen=True, slots=True)
class ParserCounts:
    """Counts of one peer's frames and bytes."""

    frames: int
    frames_unknown: int
    bytes_skipped: int
    crc_errors: int
    frames_lost: int
    frames_signed: int = 0

    def plus(self, other: ParserCounts) -> ParserCounts:
        """The sum of both counts."""
        return ParserCounts(
            self.frames + other.frames,
            self.frames_unknown + other.frames_unknown,
            self.bytes_skipped + other.bytes_skipped,
            self.crc_errors + other.crc_errors,
            self.frames_lost + other.frames_lost,
            self.frames_signed + other.frames_signed,
        )


class FrameSender:
    """Completes all outgoing frames, so that all threads share the sequence numbers. A frame is completed
    when it is sent, with the link's lock held: `_finish` returns the bytes to send, and `_on_sent` advances
    the sequence number. Each peer has its own sequence; otherwise a vehicle would count frames to other
    vehicles on the same link as lost.
    """

    def __init__(
        self,
        link: Link,
        system_id: int,
        component_id: int,
        record: Callable[[bytes], None],
        signer: FrameSigner | None = None,
    ) -> None:
        self._link = link
        self._system_id = system_id
        self._component_id = component_id
        self._record = record
        self._signer = signer
        self._seq: dict[str, int] = {}

    def send(
        self,
        msg_id: int,
        payload: bytes,
        peer: Peer,
        *,
        created_s: float | None = None,
        until_s: float | None = None,
    ) -> bool:
        """Sends or queues a message, from any thread. Returns False if it was dropped.

        Args:
            created_s: creation time of the message on the link's clock; None: now.
            until_s: the message is not sent after this time, even if its type has a longer lifetime.
        """
        urgency = classify(msg_id, payload)
        expires_s = (self._link.now_s() if created_s is None else created_s) + urgency.lifetime_s
        packet = Packet(
            peer,
            len(payload) + MIN_V2_BYTES + SIGNATURE,
            lambda: self._finish(msg_id, payload, peer),
            lambda raw: self._on_sent(raw, peer),
            urgency.priority,
            expires_s if until_s is None else min(expires_s, until_s),
            urgency.key,
            urgency.flight,
        )
        return self._link.submit(packet)

    def forward(self, frame: Frame, peer: Peer) -> bool:
        """Forwards a frame unchanged; this server neither numbers nor signs it."""
        return self._relay(frame, peer, lambda: frame.raw, self._record)

    def relay(self, frame: Frame, payload: bytes, peer: Peer) -> bool:
        """Sends the message of a frame with a payload that may differ, numbered and signed for this peer."""
        msg_id = frame.msg_id
        return self._relay(
            frame, peer, lambda: self._finish(msg_id, payload, peer), lambda raw: self._on_sent(raw, peer)
        )

    def _relay(
        self, frame: Frame, peer: Peer, finish: Callable[[], bytes], on_sent: Callable[[bytes], None]
    ) -> bool:
        urgency = classify_forwarded(frame)
        expires_s = self._link.now_s() + urgency.lifetime_s
        size = len(frame.raw) + SIGNATURE
        return self._link.submit(
            Packet(peer, size, finish, on_sent, urgency.priority, expires_s, urgency.key)
        )

    def forget(self, peer: Peer) -> None:
        """Called when a peer is lost; the sequence numbers for it restart."""
        self._seq.pop(peer.name, None)

    def _finish(self, msg_id: int, payload: bytes, peer: Peer) -> bytes:
        seq = self._seq.get(peer.name, 0)
        return encode_frame(msg_id, payload, seq, self._system_id, self._component_id, self._signer)

    def _on_sent(self, raw: bytes, peer: Peer) -> None:
        self._seq[peer.name] = (self._seq.get(peer.name, 0) + 1) & 0xFF
        self._record(raw)


OnFrame = Callable[[Frame, "Connection", Peer], None]


class Connection:
    """An open link, with parsers, recording and signing.

    Args:
        recording: records every accepted and every sent frame; None for replays.
        signing: signs sent frames and refuses wrongly signed ones; None: no signing.
        on_frame: called with each received frame.
    """

    def __init__(
        self,
        link: Link,
        clock: Clock,
        *,
        system_id: int,
        component_id: int,
        recording: TlogChannel | None,
        signing: LinkSigning | None = None,
        on_frame: OnFrame,
        on_new_peer: Callable[[Connection, Peer], None],
        on_peer_gone: Callable[[Connection, Peer], None],
        on_state: Callable[[Connection], None],
    ) -> None:
        self.link = link
        self._clock = clock
        self._recording = recording
        self.signing = signing
        self._on_frame = on_frame
        self._on_new_peer = on_new_peer
        self._on_peer_gone = on_peer_gone
        self._on_state = on_state
        self._parsers: dict[str, FrameParser] = {}
        self._stamped_s, self._stamp = -1.0, b""
        """Arrival time of the newest bytes: monotonic [s], and encoded for the recording."""
        self._former = ParserCounts(0, 0, 0, 0, 0)
        """Sum of the counts of former peers."""
        self._senders: dict[tuple[int, int], FrameSender] = {}
        self.sender = self.sender_as(system_id, component_id)

    @property
    def name(self) -> str:
        """The link's name."""
        return self.link.name

    @property
    def protocol(self) -> str:
        """The link's protocol, which determines the supported kinds of setpoint."""
        return self.link.protocol

    def start(self) -> None:
        """Opens the link."""
        self.link.start(self._handle_bytes, self._peer_gone, lambda: self._on_state(self))

    async def close(self) -> None:
        """Closes the link and ends the recording."""
        await self.link.close()
        if self._recording is not None:
            self._recording.closing = True

    def sender_as(self, system_id: int, component_id: int) -> FrameSender:
        """Sends frames with these ids, which have sequence numbers of their own."""
        sender = self._senders.get((system_id, component_id))
        if sender is None:
            signer = None if self.signing is None else self.signing.signer
            sender = FrameSender(self.link, system_id, component_id, self._record, signer)
            self._senders[system_id, component_id] = sender
        return sender

    def forward(self, frame: Frame, peer: Peer) -> None:
        """Forwards a frame unchanged."""
        self.sender.forward(frame, peer)

    def count_sent_elsewhere(self, time_us: int, raw: bytes) -> None:
        """Records a frame that the stream process has sent with this link's socket, with its time [us since
        1970]. May be called from any thread."""
        self.link.count_sent_elsewhere(len(raw))
        if self._recording is not None:
            self._recording.append(stamp(time_us), raw)

    def mavlink_peers(self) -> tuple[Peer, ...]:
        """Peers to which heartbeats are sent: all except those that have sent bytes, but no MAVLink frame."""
        return tuple(
            peer
            for peer in self.link.peers()
            if (parser := self._parsers.get(peer.name)) is None or parser.frames
        )

    def info(self) -> LinkInfo:
        """The link's state with frame counts and recording."""
        total = self._former
        for counts in self.counts().values():
            total = total.plus(counts)
        return replace(
            self.link.info(),
            frames_received=total.frames,
            frames_unknown=total.frames_unknown,
            frames_lost=0 if self.link.replay else total.frames_lost,  # jumps of a replay cause gaps
            crc_errors=total.crc_errors,
            bytes_skipped=total.bytes_skipped,
            frames_refused=0 if self.signing is None else self.signing.refused(),
            frames_unverified=total.frames_signed if self.signing is None and not self.link.replay else 0,
            signing=None if self.signing is None else self.signing.report(),
            recording=None if self._recording is None else self._recording.info(),
        )

    def counts(self) -> dict[str, ParserCounts]:
        """Counts by peer."""
        return {name: _counts_of(parser) for name, parser in self._parsers.items()}

    def _handle_bytes(self, data: bytes, peer: Peer, received_s: float) -> None:
        parser = self._parsers.get(peer.name)
        if parser is None:
            parser = self._parsers[peer.name] = FrameParser()
        is_new = not parser.frames
        frames = parser.feed(data, received_s)
        if not frames:
            return
        # Called before frames are refused: `on_new_peer` sends a heartbeat, from which the vehicle adopts the
        # signing time.
        if is_new:
            try:
                self._on_new_peer(self, peer)
            except Exception as error:
                self.link.faults.add(error, "handling a new peer")
        if self.signing is not None:
            frames = [frame for frame in frames if self.signing.accepts(frame)]
        recording, on_frame = self._recording, self._on_frame
        if recording is not None and received_s != self._stamped_s:  # many datagrams are read at once
            self._stamped_s, self._stamp = received_s, stamp(int(self._clock.unix_s() * 1e6))
        for frame in frames:
            if recording is not None:
                recording.append(self._stamp, frame.raw)
            try:  # a fault affects this frame only
                on_frame(frame, self, peer)
            except Exception as error:
                name = NAMES.get(frame.msg_id, f"message {frame.msg_id}")
                self.link.faults.add(error, f"handling {name}")

    def _peer_gone(self, peer: Peer) -> None:
        parser = self._parsers.pop(peer.name, None)
        if parser is not None:
            self._former = self._former.plus(_counts_of(parser))
        for sender in self._senders.values():
            sender.forget(peer)
        self._on_peer_gone(self, peer)

    def _record(self, raw: bytes) -> None:
        if self._recording is not None:
            self._recording.append(stamp(int(self._clock.unix_s() * 1e6)), raw)


def _counts_of(parser: FrameParser) -> ParserCounts:
    return ParserCounts(
        parser.frames,
        parser.frames_unknown,
        parser.bytes_skipped,
        parser.crc_errors,
        sum(parser.lost.values()),
        parser.frames_signed,
    )
