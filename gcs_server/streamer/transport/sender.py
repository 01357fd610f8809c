"""How the bytes of a stream leave: by a vehicle's link and peer."""

from __future__ import annotations

from typing import Protocol

from gcs_server.links.base import Peer
from gcs_server.mavlink.connection import Connection


class WayOut(Protocol):
    """The link and peer by which a vehicle is reached."""

    @property
    def connection(self) -> Connection: ...

    @property
    def peer(self) -> Peer: ...


class PayloadSender(Protocol):
    """Sends to one vehicle; may be called from any thread."""

    def send_payload(self, msg_id: int, payload: bytes, *, made_s: float | None = None) -> bool:
        """False where nothing was sent. `made_s`: when it was made (monotonic); it expires from then."""
        ...

    def way_out(self) -> WayOut | None:
        """The link and peer in use now; None where there is none."""
        ...


class NoSender(PayloadSender):
    """For a vehicle that has been removed."""

    def send_payload(self, msg_id: int, payload: bytes, *, made_s: float | None = None) -> bool:
        return False

    def way_out(self) -> None:
        return None
