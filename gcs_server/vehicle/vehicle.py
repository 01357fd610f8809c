"""One vehicle: identity, state, mailbox, and one attribute per service."""

from __future__ import annotations

from typing import Any

from gcs_server.mavlink.dialect import MAVLink_message
from gcs_server.mavlink.mailbox import Mailbox
from gcs_server.vehicle.events import EventFeed
from gcs_server.vehicle.identity import Identity
from gcs_server.vehicle.samples import Sample, Status
from gcs_server.vehicle.services.command import CommandService
from gcs_server.vehicle.services.gimbal import GimbalService
from gcs_server.vehicle.services.params import ParamService


class Vehicle:
    """A small aggregate; only the router's calls write its state."""

    id: str
    mailbox: Mailbox
    events: EventFeed
    command: CommandService
    gimbal: GimbalService
    params: ParamService
    offboard: Any
    """The offboard control (streamer/), set by whoever builds the server; None before."""

    @property
    def identity(self) -> Identity:
        """Who it is."""
        raise NotImplementedError

    @property
    def status(self) -> Status:
        """Armed, mode, landed state, link: what safety reads."""
        raise NotImplementedError

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the links on which it is heard, most recent first."""
        raise NotImplementedError

    def topic(self, name: str) -> Sample | None:
        """The newest sample of a topic, decoded now; None before the first."""
        raise NotImplementedError

    def history(self, topics: tuple[str, ...], since_unix_s: float) -> list[Sample]:
        """Samples at up to 4 Hz of the last five minutes, oldest first."""
        raise NotImplementedError

    def require_commandable(self) -> None:
        """Raises Refused for a replayed vehicle, NotVerified for a kind we have not verified,
        Disconnected while its link is lost."""
        raise NotImplementedError

    def send(self, message: MAVLink_message) -> bool:
        """Packs and sends on the vehicle's best link; from any thread; False: nothing went out."""
        raise NotImplementedError

    def send_payload(self, msg_id: int, payload: bytes) -> bool:
        """As `send`, for a payload already packed in wire order (the streamer's way)."""
        raise NotImplementedError
