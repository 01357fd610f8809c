"""The interface for sending the bytes of a stream over a vehicle's link."""

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
        """Sends a payload; returns False if nothing was sent. `created_s` is the monotonic time at which
        the payload was created; a payload that is too old is not sent."""
        ...

    def send_path(self) -> SendPath | None:
        """Current link and peer; None: the vehicle has no link."""
        ...


class NoSender(PayloadSender):
    """The sender of a removed vehicle, which sends nothing."""

    def send_payload(self, msg_id: int, payload: bytes, *, created_s: float | None = None) -> bool:
        return False

    def send_path(self) -> None:
        return None
