"""The setpoint scheduler in the test's own event loop instead of in the stream process."""

from __future__ import annotations

from collections.abc import Mapping

from gcs_server.links.base import DdsAddress
from gcs_server.ros2.external_mode import ModeDeclaration
from gcs_server.streamer.schedule.scheduler import StreamScheduler
from gcs_server.streamer.separation.guard import GroupGuard
from gcs_server.streamer.values.snapshot import Snapshot
from gcs_server.streamer.values.stream_request import StreamRequest


class InLoopScheduler(StreamScheduler):
    """The scheduler with the methods of `StreamProcess`, without a process."""

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

    def watch(self, guard: GroupGuard) -> None:
        super().watch(guard)
