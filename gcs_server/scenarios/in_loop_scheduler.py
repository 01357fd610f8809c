"""The setpoint scheduler in the event loop instead of in the stream process."""

# pyright: reportIncompatibleMethodOverride=false
# Its methods are those of `Streams`, which wait for the process.

from __future__ import annotations

from collections.abc import Mapping

from gcs_server.links.base import DdsAddress
from gcs_server.ros2.external_mode import ModeDeclaration
from gcs_server.ros2.mode_executor import ExecutorCommand
from gcs_server.streamer.schedule.scheduler import StreamScheduler
from gcs_server.streamer.separation import GuardState
from gcs_server.streamer.transport.vehicle_transport import NoSender, no_topics
from gcs_server.streamer.values.snapshot import Snapshot
from gcs_server.streamer.values.stream_request import StreamRequest


class InLoopScheduler(StreamScheduler):
    """The scheduler with the methods of `Streams`, without a process."""

    def start(self) -> None:
        """Does nothing: there is no process."""

    def forget(self, vehicle_id: str) -> None:
        self.external_modes.forget(vehicle_id)
        transport = self._streams[vehicle_id].transport
        transport.mavlink.sender, transport.topics = NoSender(), no_topics

    async def ready(self) -> None:
        """Returns at once: there is no process to wait for."""

    def links_changed(self) -> None:
        """Does nothing: there are no sockets."""

    async def begin(self, vehicle_id: str, request: StreamRequest, rate_hz: float, snapshot: Snapshot) -> int:
        return super().begin(vehicle_id, request, rate_hz, snapshot)

    async def engage(self, vehicle_id: str, snapshot: Snapshot, number: int | None = None) -> bool:
        return super().engage(vehicle_id, snapshot, number)

    async def change(self, vehicle_id: str, request: StreamRequest, snapshot: Snapshot) -> bool:
        return super().change(vehicle_id, request, snapshot)

    async def change_together(
        self,
        name: str,
        requests: Mapping[str, StreamRequest],
        snapshots: Mapping[str, Snapshot],
        until_s: float,
    ) -> bool:
        return super().change_together(name, requests, snapshots, until_s)

    async def register_mode(self, vehicle_id: str, address: DdsAddress, declaration: ModeDeclaration) -> None:
        super().register_mode(vehicle_id, address, declaration)

    def starting(self, vehicle_id: str, number: int) -> bool:
        state = self.state(vehicle_id)
        return state.number == number and state.phase == "starting"

    def unregister_mode(self, vehicle_id: str, name: str) -> None:
        self.external_modes.unregister(vehicle_id, name)

    def set_mode_ready(self, vehicle_id: str, name: str, ready: bool) -> None:
        self.external_modes.set_ready(vehicle_id, name, ready)

    def complete_mode(self, vehicle_id: str, mode: str, success: bool) -> None:
        self.external_modes.complete(vehicle_id, mode, success)

    def execute_command(self, vehicle_id: str, mode: str, command: ExecutorCommand) -> None:
        self.external_modes.execute(vehicle_id, mode, command)

    def guard(self, name: str) -> GuardState | None:
        guard = self._guards.get(name)
        return None if guard is None else guard.state()

    def watched(self) -> dict[str, StreamRequest | None]:
        return {v: guard.pending_request(v) for guard in self._guards.values() for v in guard.members}
