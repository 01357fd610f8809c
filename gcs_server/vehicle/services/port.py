"""The interface of a vehicle for its services."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from typing import Any, Protocol

from gcs_server.clock import Clock
from gcs_server.mavlink.codec import Frame
from gcs_server.mavlink.dialect import MAVLink_message
from gcs_server.mavlink.mailbox import Mailbox
from gcs_server.vehicle.components import Components
from gcs_server.vehicle.endpoint import Endpoint
from gcs_server.vehicle.events import EventFeed
from gcs_server.vehicle.gimbals import GimbalAddress
from gcs_server.vehicle.identity import Identity
from gcs_server.vehicle.px4.modes import ModeNames
from gcs_server.vehicle.reach import Feature
from gcs_server.vehicle.reducers import FlightState
from gcs_server.vehicle.samples import Sample, Status
from gcs_server.vehicle.services.ftp_codec import DirectoryEntry, Packet
from gcs_server.vehicle.services.ftp_pieces import PartialFile
from gcs_server.vehicle.tickets import Tickets


class HealthChecks(Protocol):
    """Results of the vehicle's arming checks, and its events."""

    def arming_problems(self, nav_state: int | None) -> tuple[str, ...]: ...
    async def receive_all_events(self) -> None: ...


class GimbalAddresses(Protocol):
    """The connected gimbals."""

    def addresses(self) -> tuple[GimbalAddress, ...]: ...


class Files(Protocol):
    """The vehicle's files, by FTP."""

    async def list(self, path: str) -> list[DirectoryEntry]: ...
    async def read_parts(
        self,
        path: str,
        file_of: Callable[[int], PartialFile],
        progress: Callable[[int, int], None] | None = None,
    ) -> None: ...
    async def read(self, path: str, *, max_bytes: int = ...) -> bytes: ...
    async def crc32(self, path: str, *, wait_s: float = 0.0) -> int: ...
    async def write(
        self, path: str, content: bytes, progress: Callable[[int, int], None] | None = None
    ) -> None: ...
    async def change(self, request: Packet, path: str, activity: str) -> None: ...


class VehiclePort(Protocol):
    """The vehicle as its services use it."""

    id: str
    clock: Clock
    mailbox: Mailbox
    events: EventFeed
    components: Components
    mode_names: ModeNames
    tickets: Tickets

    @property
    def gimbals(self) -> GimbalAddresses: ...
    @property
    def health(self) -> HealthChecks: ...
    @property
    def ftp(self) -> Files: ...

    taps: tuple[Callable[[Frame, Endpoint], None], ...]
    """Called with each message of the vehicle before it is handled."""
    own_ids: tuple[int, int]
    """This server's (system id, component id), to which acknowledgements must be addressed."""

    @property
    def identity(self) -> Identity: ...
    @property
    def status(self) -> Status: ...
    @property
    def flight_state(self) -> FlightState: ...
    def topic(self, name: str) -> Sample | None: ...
    def newest_payload(
        self, msg_id: int, component_id: int | None = None, instance: int | None = None
    ) -> tuple[bytes, float] | None: ...
    def require_commandable(self, *, on_lost_link: bool = False) -> None: ...
    def require(self, feature: Feature) -> None: ...
    def send(self, message: MAVLink_message, *, until_s: float | None = None) -> bool: ...
    def send_payload(self, msg_id: int, payload: bytes) -> bool: ...
    def in_background(self, name: str, work: Coroutine[Any, Any, Any]) -> None: ...
