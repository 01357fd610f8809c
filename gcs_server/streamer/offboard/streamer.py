"""The setpoint streams of all vehicles: the periodic update by the event loop, and a clean shutdown."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from dataclasses import dataclass

from gcs_server.clock import Clock
from gcs_server.errors import GcsError, NoReply, UnknownVehicle
from gcs_server.faults import Isolation
from gcs_server.streamer.offboard.control import OffboardControl
from gcs_server.streamer.offboard.limit_store import LimitStore, VehicleOperatorLimits
from gcs_server.streamer.process.streams import Streams
from gcs_server.streamer.values.snapshot import Snapshot
from gcs_server.streamer.values.stream_request import StreamRequest
from gcs_server.supervise import Supervisor
from gcs_server.vehicle.vehicle import Vehicle
from missions.frames import Vector3
from missions.setpoints import complete_vector

log = logging.getLogger(__name__)

SNAPSHOT_PERIOD_S = 0.1
UPDATES_PER_IDENTITY_CHECK = 5
STOP_ALL_S = 3.0
"""Maximum wait for all vehicles to be in Hold at shutdown [s]."""


@dataclass(frozen=True, slots=True)
class StopResult:
    """Result of stopping one vehicle's stream at shutdown."""

    vehicle: str
    error: GcsError | None
    """None if the vehicle is in Hold."""
    duration_s: float


class Streamer:
    """Manages the streams, updates them periodically, and creates each vehicle's `offboard`.

    Args:
        streams: runs the streams; the stream process, or a scheduler in tests.
        limits: stores the operator's limits; None: the limits are only in memory.
    """

    def __init__(self, clock: Clock, streams: Streams, limits: LimitStore | None = None) -> None:
        self._clock = clock
        self._streams = streams
        self._controls: dict[str, OffboardControl] = {}
        """By the vehicle's id."""
        self._updates = 0
        self._isolation = Isolation(clock, log, "The setpoint streams")
        self.limits = limits or LimitStore()
        self._limit_owners: dict[str, str] = {}

    def attach(self, vehicle: Vehicle) -> None:
        """Creates a vehicle's offboard control."""
        limits = VehicleOperatorLimits(vehicle, self.limits, self._limit_owners)
        control = OffboardControl(self._clock, vehicle, self._streams, self._find, limits)
        vehicle.offboard = self._controls[vehicle.id] = control

    def detach(self, vehicle: Vehicle) -> None:
        """Drops a vehicle's offboard control, unless a stream is running; called before the vehicle is
        removed."""
        control = self._controls.get(vehicle.id)
        is_current = control is not None and control.vehicle is vehicle
        if is_current and self._streams.state(vehicle.id).phase == "idle":
            del self._controls[vehicle.id]
            self._streams.forget(vehicle.id)
        for key in [key for key, owner in self._limit_owners.items() if owner == vehicle.id]:
            del self._limit_owners[key]

    def start(self, supervisor: Supervisor) -> None:
        """Starts the streams and their periodic update."""
        self._streams.start()
        supervisor.repeat("offboard-update_snapshots", self.update_once, SNAPSHOT_PERIOD_S)

    def close(self) -> None:
        """Stops all streams; the vehicles' failsafes take over."""
        self._streams.close()
        self.limits.close()

    def links_changed(self) -> None:
        """Releases the sockets of closed links; called when a link was opened or closed."""
        self._streams.links_changed()

    def target(self, vehicle_id: str) -> tuple[Vector3 | None, Vector3 | None, float | None] | None:
        """The streamed (position, velocity, yaw), for the target in the scene; None while nothing is
        streamed."""
        sent = self._streams.state(vehicle_id).sent
        if sent is None:
            return None
        position = getattr(sent, "position_ned_m", None)
        velocity = getattr(sent, "velocity_ned_m_s", None)
        return (
            None if position is None else complete_vector(position),
            None if velocity is None else complete_vector(velocity),
            getattr(sent, "yaw_ned_rad", None),
        )

    def offboard(self, vehicle_id: str) -> OffboardControl:
        """The control of a vehicle's stream. Raises UnknownVehicle."""
        control = self._controls.get(vehicle_id)
        if control is None:
            raise UnknownVehicle(vehicle_id, sorted(self._controls))
        return control

    def _find(self, vehicle_id: str) -> Vehicle:
        return self.offboard(vehicle_id).vehicle

    async def stop_all(self) -> list[StopResult]:
        """Puts all vehicles with a stream into Hold at the same time, for a clean shutdown. If a vehicle is
        not in Hold within `STOP_ALL_S`, its stream ends and its failsafe takes over. An unconfirmed Stop
        motors command is repeated for the same time.
        """
        async with asyncio.TaskGroup() as group:
            stops = [group.create_task(self._stop_one(vehicle_id)) for vehicle_id in self._streams.active()]
            group.create_task(self._wait_for_kills())
        return [stop.result() for stop in stops]

    async def _wait_for_kills(self) -> None:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(STOP_ALL_S):
                for control in self._controls.values():
                    await control.vehicle.command.wait_for_kill()

    async def _stop_one(self, vehicle_id: str) -> StopResult:
        start_s = self._clock.monotonic_s()
        error: GcsError | None = None
        try:
            async with asyncio.timeout(STOP_ALL_S):
                await self._controls[vehicle_id].stop()
        except GcsError as problem:
            error = problem
        except TimeoutError:
            error = NoReply(
                f"Vehicle {vehicle_id} did not report Hold before the server shut down; its failsafe "
                f"takes over.",
                deadline_s=STOP_ALL_S,
            )
        if error is not None:
            self._publish(
                vehicle_id, f"The vehicle could not be put into Hold when the server shut down: {error}", 4
            )
        return StopResult(vehicle_id, error, self._clock.monotonic_s() - start_s)

    def update_once(self) -> None:
        """Signals that the event loop runs, updates the snapshots, restores limits and publishes reports."""
        if self._updates % UPDATES_PER_IDENTITY_CHECK == 0:
            self._restore_limits()
        self._updates += 1
        first_requests = self._streams.watched()
        requests = dict.fromkeys(self._streams.active()) | first_requests
        controlled = [vehicle_id for vehicle_id in requests if vehicle_id in self._controls]
        self._streams.update_snapshots(
            {vid: s for vid in controlled if (s := self._snapshot(vid, requests[vid])) is not None}
        )
        for vehicle_id in controlled:
            control = self._controls[vehicle_id]
            control.vehicle.isolation.run(
                "the rates of its distance sensors", control.avoidance.request_rates
            )
        for vehicle_id, report in self._streams.take_reports():
            self._publish(vehicle_id, report.text, report.severity, report.code)

    def _restore_limits(self) -> None:
        for vehicle_id, control in self._controls.items():
            if control.operator_limits.identity_changed:
                self._isolation.run(f"the limits of vehicle {vehicle_id}", control.operator_limits.recognise)

    def faults(self) -> list[str]:
        """Messages about current faults."""
        return self._isolation.faults

    def _snapshot(self, vehicle_id: str, request: StreamRequest | None) -> Snapshot | None:
        """Snapshot of the vehicle for its stream; if this fails, a snapshot without estimates. If both
        fail, None: the stream then uses the previous snapshot, which expires after a second.
        """
        control = self._controls[vehicle_id]
        run = control.vehicle.isolation.run
        snapshot = run("the snapshot for its stream", control.snapshot, request)
        return snapshot or run("the status for its stream", control.snapshot_without_estimates)

    def _publish(self, vehicle_id: str, text: str, severity: int, code: str = "offboard") -> None:
        kind = "warning" if severity <= 4 else "command"
        control = self._controls.get(vehicle_id)
        if control is not None:
            data = {"source": "offboard", "code": code}
            control.vehicle.events.add(kind, self._clock.unix_s(), text, severity=severity, data=data)
