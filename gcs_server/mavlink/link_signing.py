"""Signing of the server's links: keys, link ids, refusals and warnings."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field

from gcs_server.clock import Clock
from gcs_server.errors import InvalidRequest
from gcs_server.links.base import SigningOptions, SigningReport
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame
from gcs_server.mavlink.key_store import KeyStore, KeyUnusable
from gcs_server.mavlink.signing import (
    TICKS_PER_S,
    FrameSigner,
    KeyVerifier,
    Refusal,
    SecretKey,
    SigningClock,
    is_signed,
)

log = logging.getLogger(__name__)

UNSIGNED_ACCEPTED = frozenset({d.MAVLINK_MSG_ID_RADIO_STATUS})
"""Messages that are accepted without a signature, because telemetry radios add them and have no key (MAVLink
guide, "Accepting Unsigned Packets")."""
WARNED_FOR_S = 60.0
"""Time for which a warning is shown after the last refusal [s]."""
STORE_INTERVAL_S = 10.0
"""Period at which the newest timestamp is stored [s]; the MAVLink guide requires once a minute."""
MAX_LINK_IDS = 256

_REFUSAL_TEXT = {
    Refusal.UNSIGNED: "sends frames without a signature, and this link requires one. "
    "Store the key on the vehicle, or open the link with signing=allowed.",
    Refusal.WRONG_SIGNATURE: "sends frames with a wrong signature: it has another key, or somebody forges "
    "frames with this system id. Store the key of this link on the vehicle.",
    Refusal.REPLAYED: "sends frames that are not newer than earlier ones: someone replays them, or two "
    "senders with this key have the same system id, component and link id.",
    Refusal.TOO_OLD: "signs with a time more than a minute behind this server's. "
    "The vehicle should adopt this server's time from received frames; if it does not, set its clock.",
    Refusal.TOO_MANY_STREAMS: "exceeds the maximum number of senders with this key. Restart the server.",
}


@dataclass(slots=True)
class _RefusalCount:
    count: int = 0
    last_s: float = float("-inf")
    system_id: int = 0


@dataclass(slots=True, eq=False)
class LinkSigning:
    """Signing of one link."""

    link: str
    options: SigningOptions
    signer: FrameSigner
    verifier: KeyVerifier
    clock: Clock
    _refused: dict[Refusal, _RefusalCount] = field(
        default_factory=lambda: {refusal: _RefusalCount() for refusal in Refusal}
    )

    def accepts(self, frame: Frame) -> bool:
        """Whether a received frame may be recorded, forwarded and handled; counts refusals."""
        raw = frame.raw
        if not is_signed(raw) and (not self.options.required or frame.msg_id in UNSIGNED_ACCEPTED):
            return True
        refusal = self.verifier.refusal(raw, frame.system_id, frame.component_id)
        if refusal is None:
            return True
        now_s, refused = self.clock.monotonic_s(), self._refused[refusal]
        is_first = now_s - refused.last_s > WARNED_FOR_S
        refused.count, refused.last_s, refused.system_id = refused.count + 1, now_s, frame.system_id
        if is_first:
            log.warning("link %s: %s", self.link, self._text(refusal, refused))
        return False

    def report(self) -> SigningReport:
        """Report for `GET /links`."""
        return SigningReport(
            key=self.options.key,
            mode="required" if self.options.required else "allowed",
            link_id=self.signer.link_id,
            **{refusal.value: refused.count for refusal, refused in self._refused.items()},
        )

    def refused(self) -> int:
        """Number of refused frames, for any reason."""
        return sum(refused.count for refused in self._refused.values())

    def warnings(self) -> list[str]:
        """Warnings about recently refused frames."""
        before_s = self.clock.monotonic_s() - WARNED_FOR_S
        return [self._text(refusal, r) for refusal, r in self._refused.items() if r.last_s >= before_s]

    def _text(self, refusal: Refusal, refused: _RefusalCount) -> str:
        key = f"(key {self.options.key!r}; refused so far: {refused.count})"
        return f"System {refused.system_id} {_REFUSAL_TEXT[refusal]} {key}"


class Signing:
    """Signing of one server: keys in use, time, link ids.

    Args:
        store: the stored keys; None: this server stores no keys.
    """

    def __init__(self, clock: Clock, store: KeyStore | None) -> None:
        self._clock = clock
        self._store = store
        self.clock = SigningClock(clock.unix_s)
        newest = 0 if store is None else store.newest_timestamp()
        if newest >= self.clock.now():  # the system clock was set back, or a vehicle's clock was ahead
            # timestamps may have been used after the last one was stored
            max_unstored_ticks = round(STORE_INTERVAL_S * TICKS_PER_S)
            self.clock = SigningClock(clock.unix_s, newest + max_unstored_ticks)
        self._verifiers: list[tuple[SecretKey, KeyVerifier]] = []
        """Verifiers stay after the links of a key are closed, because they contain the received
        timestamps."""
        self._link_ids: set[int] = set()
        self._store_failed = False
        """Whether the newest timestamp could not be stored at the last attempt."""

    @property
    def in_use(self) -> bool:
        """Whether any link signs."""
        return bool(self._link_ids)

    def open(self, link: str, options: SigningOptions) -> LinkSigning:
        """Sets up signing for a new link.

        Raises:
            InvalidRequest: the key cannot be used, or no link id is free.
        """
        try:
            if self._store is None:
                raise KeyUnusable("This server stores no signing keys.")
            key = self._store.read(options.key)
        except KeyUnusable as error:
            raise InvalidRequest("url", error.message, remedy=error.remedy) from None
        link_id = next((n for n in range(MAX_LINK_IDS) if n not in self._link_ids), None)
        if link_id is None:
            raise InvalidRequest("url", f"{MAX_LINK_IDS} links already sign.", remedy="Close one of them.")
        self._link_ids.add(link_id)
        signer = FrameSigner(key, link_id, self.clock)
        return LinkSigning(link, options, signer, self._verifier(key), self._clock)

    def _verifier(self, key: SecretKey) -> KeyVerifier:
        """The verifier of a key. Links with the same key share the verifier, also if the key has several
        names, because a frame received on one link is a replay on another."""
        for known, verifier in self._verifiers:
            if known == key:
                return verifier
        verifier = KeyVerifier(key, self.clock)
        self._verifiers.append((key, verifier))
        return verifier

    def release(self, signing: LinkSigning) -> None:
        """Frees the link id; called when the link is closed."""
        self._link_ids.discard(signing.signer.link_id)

    def store_timestamp(self) -> None:
        """Stores the newest timestamp; from any thread."""
        if self._store is None or not self._verifiers:
            return
        try:
            self._store.store_timestamp(self.clock.now())
            self._store_failed = False
        except OSError as error:
            if not self._store_failed:
                log.warning("the newest signing timestamp cannot be stored: %s", error.strerror or error)
            self._store_failed = True
