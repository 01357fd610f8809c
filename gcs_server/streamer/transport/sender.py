"""How the bytes of a stream are sent: over a vehicle's link, to its peer."""

from __future__ import annotations

from typing import Protocol

from gcs_server.links.base import Peer
from gcs_server.mavlink.connection import Connection


class SendPath(Protocol):
    """Link and peer of a vehicle."""

    @property
    def connection(self) -> Connection: ...

    @property
    def peer(self) -> Peer: ...


class PayloadSender(Protocol):
    """Sends payloads to one vehicle; may be called from any thread."""

    def send_payload(self, msg_id: int, payload: bytes, *, created_s: float | None = None) -> bool:
        """False if nothing was sent. `created_s`: when the payload was made (monotonic); its lifetime counts
        from then."""
        ...

    def send_path(self) -> SendPath | None:
        """Link and peer in use now; None if there are none."""
        ...


class NoSender(PayloadSender):
    """The sender of a removed vehicle: sends nothing."""

    def send_payload(self, msg_id: int, payload: bytes, *, created_s: float | None = None) -> bool:
        return False

    def send_path(self) -> None:
        return None
