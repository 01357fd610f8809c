"""Messages of the server to the stream process about the modes that are registered with PX4."""

from __future__ import annotations

from dataclasses import dataclass

from gcs_server.links.base import DdsAddress
from gcs_server.ros2.external_mode import ModeDeclaration
from gcs_server.ros2.mode_executor import ExecutorCommand
from gcs_server.streamer.process.messages import Post, Request, WorkerInterface


@dataclass(frozen=True, slots=True)
class RegisterMode(Request[None]):
    """See `Streams.register_mode`."""

    vehicle_id: str
    address: DdsAddress
    declaration: ModeDeclaration

    def apply(self, worker: WorkerInterface) -> None:
        worker.scheduler.register_mode(self.vehicle_id, self.address, self.declaration)


@dataclass(frozen=True, slots=True)
class UnregisterMode(Post):
    """See `Streams.unregister_mode`."""

    vehicle_id: str
    name: str

    def apply(self, worker: WorkerInterface) -> None:
        worker.scheduler.unregister_mode(self.vehicle_id, self.name)


@dataclass(frozen=True, slots=True)
class SetModeReady(Post):
    """See `Streams.set_mode_ready`."""

    vehicle_id: str
    name: str
    ready: bool

    def apply(self, worker: WorkerInterface) -> None:
        worker.scheduler.set_mode_ready(self.vehicle_id, self.name, self.ready)


@dataclass(frozen=True, slots=True)
class CompleteMode(Post):
    """See `Streams.complete_mode`."""

    vehicle_id: str
    mode: str
    success: bool

    def apply(self, worker: WorkerInterface) -> None:
        worker.scheduler.complete_mode(self.vehicle_id, self.mode, self.success)


@dataclass(frozen=True, slots=True)
class ExecuteCommand(Post):
    """See `Streams.execute_command`."""

    vehicle_id: str
    mode: str
    command: ExecutorCommand

    def apply(self, worker: WorkerInterface) -> None:
        worker.scheduler.execute_command(self.vehicle_id, self.mode, self.command)
