"""The same client for programs without an event loop: `with SyncGcs() as gcs`.

Each call runs its asynchronous twin (`aio.py`) on a loop of its own thread and waits for it.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager, contextmanager
from typing import Any

from anyio.from_thread import BlockingPortal, start_blocking_portal

from gcs_server.client import aio
from gcs_server.client.control import Control, OnLost
from gcs_server.client.gimbal import Gimbal
from gcs_server.client.group import Group, Setpoints
from gcs_server.client.offboard import Offboard, Steering
from gcs_server.client.setpoints import Body, Expiry, PathPoints


class SyncGcs:
    """A connection to the server; arguments as `aio.Gcs`."""

    def __init__(
        self,
        url: str = "http://localhost:8080",
        *,
        client: str = "python",
        timeout_s: float = 60.0,
        token: str | None = None,
        client_id: str | None = None,
    ) -> None:
        self._gcs = aio.Gcs(url, client=client, timeout_s=timeout_s, token=token, client_id=client_id)
        self._starting: AbstractContextManager[BlockingPortal] = start_blocking_portal()
        self._portal: BlockingPortal | None = None

    def __enter__(self) -> SyncGcs:
        self._portal = self._starting.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self.portal.call(self._gcs.__aexit__)
        self._starting.__exit__(None, None, None)

    @property
    def portal(self) -> BlockingPortal:
        """The loop's thread.

        Raises:
            RuntimeError: used outside its `with` block.
        """
        if self._portal is None:
            raise RuntimeError("Use the client in a block: with SyncGcs() as gcs: …")
        return self._portal

    def request(self, method: str, path: str, body: Body | None = None) -> Any:
        """One call below `/api/v1`; errors as `aio.Gcs.request`."""
        return self.portal.call(self._gcs.request, method, path, body)

    def vehicles(self) -> list[SyncVehicle]:
        """All vehicles that the server has heard."""
        return [SyncVehicle(self, vehicle) for vehicle in self.portal.call(self._gcs.vehicles)]

    def vehicle(self, vehicle_id: str) -> SyncVehicle:
        """A vehicle by its id, without asking whether it is there."""
        return SyncVehicle(self, self._gcs.vehicle(vehicle_id))

    def wait_for_vehicle(
        self, vehicle_id: str | None = None, *, ready: bool = False, timeout_s: float = 60.0
    ) -> SyncVehicle:
        """As `aio.Gcs.wait_for_vehicle`."""
        found = self.portal.call(
            lambda: self._gcs.wait_for_vehicle(vehicle_id, ready=ready, timeout_s=timeout_s)
        )
        return SyncVehicle(self, found)

    @contextmanager
    def group(
        self,
        setpoints: Setpoints,
        *,
        minimum_separation_m: float | None = None,
        start_at_unix_s: float | None = None,
        rate_hz: float | None = None,
        valid_for_s: float | None = None,
        on_expiry: Expiry | None = None,
        hold_for_s: float | None = None,
        others_go_on: bool = False,
    ) -> Generator[SyncGroup]:
        """As `aio.Gcs.group`."""
        block = self._gcs.group(
            setpoints,
            minimum_separation_m=minimum_separation_m,
            start_at_unix_s=start_at_unix_s,
            rate_hz=rate_hz,
            valid_for_s=valid_for_s,
            on_expiry=on_expiry,
            hold_for_s=hold_for_s,
            others_go_on=others_go_on,
        )
        with self.portal.wrap_async_context_manager(block) as group:
            yield SyncGroup(self, group)


class SyncGroup:
    """Vehicles that fly together; methods as `group.Group`."""

    def __init__(self, gcs: SyncGcs, group: Group) -> None:
        self._gcs = gcs
        self._group = group
        self.id = group.id
        self.started = group.started

    def send(self, setpoints: Setpoints) -> dict[str, Any]:
        """New setpoints for some members or all, sent at one instant."""
        return self._gcs.portal.call(self._group.send, setpoints)

    def renew(self) -> dict[str, Any]:
        """All fly on as they do, for another `valid_for_s`."""
        return self._gcs.portal.call(self._group.renew)

    def status(self) -> dict[str, Any]:
        """State, members, the two that are nearest, findings, why it ended."""
        return self._gcs.portal.call(self._group.status)

    def hold(self) -> dict[str, Any]:
        """Puts all members that still fly it into Hold."""
        return self._gcs.portal.call(self._group.hold)


class SyncVehicle:
    """One vehicle; methods as `aio.Vehicle`."""

    def __init__(self, gcs: SyncGcs, vehicle: aio.Vehicle) -> None:
        self._gcs = gcs
        self._vehicle = vehicle
        self.id = vehicle.id
        self.gimbal = SyncGimbal(gcs, vehicle.gimbal)
        self.control = SyncControl(gcs, vehicle.control)

    def request(self, method: str, path: str = "", body: Body | None = None) -> Any:
        """One call below `/api/v1/vehicles/{id}`."""
        return self._gcs.portal.call(self._vehicle.request, method, path, body)

    def show(self) -> dict[str, Any]:
        """Identity, status and the newest sample of every topic."""
        return self._gcs.portal.call(self._vehicle.show)

    def status(self) -> dict[str, Any]:
        """Armed, mode, landed state, link."""
        return self._gcs.portal.call(self._vehicle.status)

    def topic(self, name: str) -> dict[str, Any] | None:
        """The newest value of a topic, or None before the first."""
        return self._gcs.portal.call(self._vehicle.topic, name)

    def position_ned_m(self) -> tuple[float, float, float]:
        """Where the vehicle believes to be [m]."""
        return self._gcs.portal.call(self._vehicle.position_ned_m)

    def until(
        self, condition: Callable[[dict[str, Any]], bool], *, timeout_s: float = 60.0, what: str = "it"
    ) -> dict[str, Any]:
        """Waits until `condition` holds for what `show` answers."""
        return self._gcs.portal.call(lambda: self._vehicle.until(condition, timeout_s=timeout_s, what=what))

    def until_disarmed(self, *, timeout_s: float = 120.0) -> None:
        """Waits for the motors to stop."""
        self._gcs.portal.call(lambda: self._vehicle.until_disarmed(timeout_s=timeout_s))

    def arm(self) -> None:
        """Starts the motors."""
        self._gcs.portal.call(self._vehicle.arm)

    def disarm(self) -> None:
        """Stops the motors; refused in flight."""
        self._gcs.portal.call(self._vehicle.disarm)

    def takeoff(self, alt_home_m: float) -> None:
        """Arms where needed and takes off [m above home]."""
        self._gcs.portal.call(self._vehicle.takeoff, alt_home_m)

    def land(self) -> None:
        """Lands where it is."""
        self._gcs.portal.call(self._vehicle.land)

    def land_now(self) -> None:
        """Lands where it is, whoever has control."""
        self._gcs.portal.call(self._vehicle.land_now)

    def rtl(self) -> None:
        """Returns and lands."""
        self._gcs.portal.call(self._vehicle.rtl)

    def hold(self) -> None:
        """Stops and stays."""
        self._gcs.portal.call(self._vehicle.hold)

    def set_mode(self, mode: str) -> None:
        """Changes the flight mode."""
        self._gcs.portal.call(self._vehicle.set_mode, mode)

    def goto(self, lat_deg: float, lon_deg: float, **altitude_and_more: float) -> None:
        """Flies there; `alt_amsl_m` or `alt_home_m`, optionally `yaw_ned_deg`, `max_distance_m`."""
        self._gcs.portal.call(lambda: self._vehicle.goto(lat_deg, lon_deg, **altitude_and_more))

    def kill(self) -> None:
        """Stops the motors in flight, too: the vehicle falls."""
        self._gcs.portal.call(self._vehicle.kill)

    def param(self, name: str) -> float:
        """One parameter's value."""
        return self._gcs.portal.call(self._vehicle.param, name)

    def set_param(self, name: str, value: float) -> None:
        """Sets one parameter, verified."""
        self._gcs.portal.call(self._vehicle.set_param, name, value)

    def set_offboard_limits(self, **limits: object) -> dict[str, Any]:
        """Replaces the operator's limits."""
        return self._gcs.portal.call(lambda: self._vehicle.set_offboard_limits(**limits))

    def set_offboard_failsafe(
        self, action: str | None = None, *, after_s: float | None = None
    ) -> dict[str, Any]:
        """What the vehicle does by itself when the stream stops."""
        return self._gcs.portal.call(lambda: self._vehicle.set_offboard_failsafe(action, after_s=after_s))

    @contextmanager
    def offboard(
        self,
        first: Body | None = None,
        *,
        position_ned_m: Sequence[float] | None = None,
        velocity_ned_m_s: Sequence[float] | None = None,
        yaw_ned_rad: float | None = None,
        yaw_rate_ned_rad_s: float | None = None,
        rate_hz: float | None = None,
        valid_for_s: float | None = None,
        on_expiry: Expiry | None = None,
        hold_for_s: float | None = None,
    ) -> Generator[SyncOffboard]:
        """As `aio.Vehicle.offboard`."""
        block = self._vehicle.offboard(
            first,
            position_ned_m=position_ned_m,
            velocity_ned_m_s=velocity_ned_m_s,
            yaw_ned_rad=yaw_ned_rad,
            yaw_rate_ned_rad_s=yaw_rate_ned_rad_s,
            rate_hz=rate_hz,
            valid_for_s=valid_for_s,
            on_expiry=on_expiry,
            hold_for_s=hold_for_s,
        )
        with self._gcs.portal.wrap_async_context_manager(block) as stream:
            yield SyncOffboard(self._gcs, stream)


class SyncOffboard(Steering[dict[str, Any]]):
    """A running stream; methods as `Offboard`."""

    def __init__(self, gcs: SyncGcs, stream: Offboard) -> None:
        self._gcs = gcs
        self._stream = stream
        self.started = stream.started

    def send(self, body: Body) -> dict[str, Any]:
        """Any setpoint's body; answers how the stream then stands."""
        return self._gcs.portal.call(self._stream.send, body)

    def follow_path(self, points: PathPoints) -> None:
        """Flies a curve through points in time and returns at its end."""
        self._gcs.portal.call(self._stream.follow_path, points)

    def status(self) -> dict[str, Any]:
        """Rate achieved, age of the setpoint, validity left; limits, failsafe, what can be flown."""
        return self._gcs.portal.call(self._stream.status)

    def stop(self) -> None:
        """Ends in Hold."""
        self._gcs.portal.call(self._stream.stop)


class SyncControl:
    """Who may command a vehicle; methods as `control.Control`."""

    def __init__(self, gcs: SyncGcs, control: Control) -> None:
        self._gcs = gcs
        self._control = control

    def show(self) -> dict[str, Any]:
        """Who has it, since when, who asks for it."""
        return self._gcs.portal.call(self._control.show)

    def take(self, *, force: bool = False, on_expiry: OnLost | None = None) -> dict[str, Any]:
        """Takes control."""
        return self._gcs.portal.call(lambda: self._control.take(force=force, on_expiry=on_expiry))

    def request(self, reason: str | None = None, *, wait_s: float = 0.0) -> dict[str, Any]:
        """Asks the holder; with `wait_s` waits so long for the answer."""
        return self._gcs.portal.call(lambda: self._control.request(reason, wait_s=wait_s))

    def grant(self, client: str) -> dict[str, Any]:
        """Hands control to one who asks, by key or name."""
        return self._gcs.portal.call(self._control.grant, client)

    def deny(self, client: str, reason: str | None = None) -> dict[str, Any]:
        """Keeps control; the one who asks may then force it."""
        return self._gcs.portal.call(self._control.deny, client, reason)

    def release(self) -> dict[str, Any]:
        """Gives it up; nothing changes in flight."""
        return self._gcs.portal.call(self._control.release)

    @contextmanager
    def held(self, *, force: bool = False, on_expiry: OnLost | None = None) -> Generator[dict[str, Any]]:
        """Has control for the length of a block."""
        block = self._control.held(force=force, on_expiry=on_expiry)
        with self._gcs.portal.wrap_async_context_manager(block) as status:
            yield status


class SyncGimbal:
    """The vehicle's gimbal; methods as `Gimbal`."""

    def __init__(self, gcs: SyncGcs, gimbal: Gimbal) -> None:
        self._gcs = gcs
        self._gimbal = gimbal

    def take(self) -> None:
        """Takes control."""
        self._gcs.portal.call(self._gimbal.take)

    def release(self) -> None:
        """Gives control back."""
        self._gcs.portal.call(self._gimbal.release)

    def angles(
        self, pitch_deg: float, yaw_deg: float, *, roll_deg: float | None = None, yaw_lock: bool = False
    ) -> None:
        """Points it; yaw from the nose, from north with `yaw_lock`."""
        self._gcs.portal.call(
            lambda: self._gimbal.angles(pitch_deg, yaw_deg, roll_deg=roll_deg, yaw_lock=yaw_lock)
        )

    def rates(self, pitch_rate_deg_s: float, yaw_rate_deg_s: float, *, yaw_lock: bool = False) -> None:
        """Turns it steadily until told otherwise; zeros stop both axes."""
        self._gcs.portal.call(lambda: self._gimbal.rates(pitch_rate_deg_s, yaw_rate_deg_s, yaw_lock=yaw_lock))

    def roi(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> None:
        """Keeps looking at a place."""
        self._gcs.portal.call(self._gimbal.roi, lat_deg, lon_deg, alt_amsl_m)

    def clear_roi(self) -> None:
        """Stops looking at a place."""
        self._gcs.portal.call(self._gimbal.clear_roi)
