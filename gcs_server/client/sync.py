"""The same client without `await`: each call runs on an event loop in a thread of this object's own."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Coroutine, Iterator, Sequence
from typing import Any, TypeVar

import httpx

from gcs_server.client.gcs import Gcs, Json, Offboard, Vector3, Vehicle

T = TypeVar("T")


class _Loop:
    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="gcs-client", daemon=True)
        self._thread.start()

    def run(self, work: Coroutine[Any, Any, T]) -> T:
        future = asyncio.run_coroutine_threadsafe(work, self._loop)
        try:
            return future.result()
        except KeyboardInterrupt:
            future.cancel()
            raise

    def close(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()


class SyncGcs:
    """As `Gcs`: `with SyncGcs() as gcs: gcs.vehicle("1").arm()`."""

    def __init__(
        self,
        url: str = "http://localhost:8080",
        *,
        client: str = "python",
        transport: httpx.AsyncBaseTransport | None = None,
    ) -> None:
        self._loop = _Loop()
        self._gcs = Gcs(url, client=client, transport=transport)

    def __enter__(self) -> SyncGcs:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Gives the connections back; vehicles are not touched."""
        self._loop.run(self._gcs.close())
        self._loop.close()

    def call(self, method: str, path: str, body: Json | None = None, **query: Any) -> Any:
        """As `Gcs.call`."""
        return self._loop.run(self._gcs.call(method, path, body, **query))

    def vehicle(self, vehicle_id: str) -> SyncVehicle:
        """As `Gcs.vehicle`."""
        return SyncVehicle(self._loop, self._gcs.vehicle(vehicle_id))

    def vehicles(self) -> list[SyncVehicle]:
        """As `Gcs.vehicles`."""
        return [SyncVehicle(self._loop, v) for v in self._loop.run(self._gcs.vehicles())]

    def wait_for_vehicle(
        self, vehicle_id: str | None = None, *, ready: bool = False, timeout_s: float = 30.0
    ) -> SyncVehicle:
        """As `Gcs.wait_for_vehicle`."""
        work = self._gcs.wait_for_vehicle(vehicle_id, ready=ready, timeout_s=timeout_s)
        return SyncVehicle(self._loop, self._loop.run(work))

    def telemetry(
        self,
        vehicles: Sequence[str] | None = None,
        topics: Sequence[str] | None = None,
        *,
        rate_hz: float = 20.0,
    ) -> Iterator[Json]:
        """As `Gcs.telemetry`."""
        stream = self._gcs.telemetry(vehicles, topics, rate_hz=rate_hz)

        async def following() -> Json | None:
            return await anext(stream, None)

        try:
            while (item := self._loop.run(following())) is not None:
                yield item
        finally:
            self._loop.run(stream.aclose())


class SyncVehicle:
    """As `Vehicle`."""

    def __init__(self, loop: _Loop, vehicle: Vehicle) -> None:
        self._loop = loop
        self._vehicle = vehicle
        self.id = vehicle.id

    def call(self, method: str, path: str, body: Json | None = None, **query: Any) -> Any:
        """As `Vehicle.call`."""
        return self._loop.run(self._vehicle.call(method, path, body, **query))

    def state(self) -> Json:
        """Everything known of it now."""
        return self._loop.run(self._vehicle.state())

    def status(self) -> Json:
        """Armed, mode, landed state."""
        return self._loop.run(self._vehicle.status())

    def value(self, topic: str) -> Json | None:
        """A topic's newest value."""
        return self._loop.run(self._vehicle.value(topic))

    def arm(self) -> Json:
        """Starts the motors."""
        return self._loop.run(self._vehicle.arm())

    def disarm(self) -> Json:
        """Stops the motors on the ground."""
        return self._loop.run(self._vehicle.disarm())

    def takeoff(self, alt_home_m: float) -> Json:
        """Arms where needed and climbs."""
        return self._loop.run(self._vehicle.takeoff(alt_home_m))

    def land(self) -> Json:
        """Lands where it is."""
        return self._loop.run(self._vehicle.land())

    def rtl(self) -> Json:
        """Returns to launch."""
        return self._loop.run(self._vehicle.rtl())

    def hold(self) -> Json:
        """Stops and stays."""
        return self._loop.run(self._vehicle.hold())

    def set_mode(self, mode: str) -> Json:
        """Any flight mode by name."""
        return self._loop.run(self._vehicle.set_mode(mode))

    def goto(self, lat_deg: float, lon_deg: float, **more: float) -> Json:
        """As `Vehicle.goto`."""
        return self._loop.run(self._vehicle.goto(lat_deg, lon_deg, **more))

    def gimbal(self, action: str, **arguments: float | bool) -> Json:
        """As `Vehicle.gimbal`."""
        return self._loop.run(self._vehicle.gimbal(action, **arguments))

    def param(self, name: str) -> float:
        """Reads a parameter."""
        return self._loop.run(self._vehicle.param(name))

    def set_param(self, name: str, value: float) -> float:
        """Writes a parameter."""
        return self._loop.run(self._vehicle.set_param(name, value))

    def wait_until(self, reached: Callable[[Json], bool], what: str, *, timeout_s: float = 60.0) -> Json:
        """As `Vehicle.wait_until`."""
        return self._loop.run(self._vehicle.wait_until(reached, what, timeout_s=timeout_s))

    def wait_until_disarmed(self, *, timeout_s: float = 120.0) -> Json:
        """As `Vehicle.wait_until_disarmed`."""
        return self._loop.run(self._vehicle.wait_until_disarmed(timeout_s=timeout_s))

    def offboard(
        self,
        *,
        position_ned_m: Vector3 | None = None,
        velocity_ned_m_s: Vector3 | None = None,
        yaw_ned_rad: float | None = None,
        rate_hz: float = 50.0,
        valid_for_s: float = 1.0,
        hold_for_s: float = 5.0,
    ) -> SyncOffboard:
        """As `Vehicle.offboard`, with `with`."""
        stream = self._vehicle.offboard(
            position_ned_m=position_ned_m,
            velocity_ned_m_s=velocity_ned_m_s,
            yaw_ned_rad=yaw_ned_rad,
            rate_hz=rate_hz,
            valid_for_s=valid_for_s,
            hold_for_s=hold_for_s,
        )
        return SyncOffboard(self._loop, stream)


class SyncOffboard:
    """As `Offboard`."""

    def __init__(self, loop: _Loop, offboard: Offboard) -> None:
        self._loop = loop
        self._offboard = offboard

    @property
    def started(self) -> Json:
        """The server's answer to the start."""
        return self._offboard.started

    def __enter__(self) -> SyncOffboard:
        self._loop.run(self._offboard.__aenter__())
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        self._loop.run(self._offboard.__aexit__(kind, error, trace))

    def stop(self) -> Json:
        """As `Offboard.stop`."""
        return self._loop.run(self._offboard.stop())

    def position_ned(self, north_m: float, east_m: float, down_m: float, **yaw: float | None) -> Json:
        """As `Offboard.position_ned`."""
        return self._loop.run(self._offboard.position_ned(north_m, east_m, down_m, **yaw))

    def velocity_ned(self, north_m_s: float, east_m_s: float, down_m_s: float, **yaw: float | None) -> Json:
        """As `Offboard.velocity_ned`."""
        return self._loop.run(self._offboard.velocity_ned(north_m_s, east_m_s, down_m_s, **yaw))

    def fly_to(
        self,
        north_m: float,
        east_m: float,
        down_m: float,
        *,
        yaw_ned_rad: float | None = None,
        within_m: float = 0.3,
        timeout_s: float = 60.0,
    ) -> Json:
        """As `Offboard.fly_to`."""
        work = self._offboard.fly_to(
            north_m, east_m, down_m, yaw_ned_rad=yaw_ned_rad, within_m=within_m, timeout_s=timeout_s
        )
        return self._loop.run(work)

    def stay(
        self, north_m: float, east_m: float, down_m: float, for_s: float, *, yaw_ned_rad: float | None = None
    ) -> None:
        """As `Offboard.stay`."""
        self._loop.run(self._offboard.stay(north_m, east_m, down_m, for_s, yaw_ned_rad=yaw_ned_rad))
