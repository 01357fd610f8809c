"""The same client for programs without an event loop: `with SyncGcs() as gcs`.

Each call runs the asynchronous call in an event loop on a separate thread, and waits for its result.
Made by tools/build_sync_client.py from the asynchronous client: change that, then run `make types`.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from anyio.from_thread import BlockingPortal

from gcs_server.client import (
    aio,
    vehicle,
)
from gcs_server.client.blocking_parts import (
    SyncControl,
    SyncGimbal,
    SyncGroup,
    SyncMission,
    SyncOffboard,
    SyncOffboardMission,
)
from gcs_server.client.blocking_work import SyncDryRuns, SyncMissionModes, SyncOperations, SyncPlans
from gcs_server.client.group import Setpoints
from gcs_server.client.plans import Plan
from gcs_server.client.portal import LoopThread, iterate
from gcs_server.client.setpoints import Body, ExpiryAction


class SyncGcs(LoopThread):
    """A connection to the server.

    Args:
        url: address of the server.
        client: name of this program in the journal.
        timeout_s: maximum wait for one response [s]. The response to a command arrives once the vehicle's
            state shows its result.
        token: access token, required if other machines can reach the server. Default: the token in `url`, or
            else `GCS_TOKEN`.
        client_id: distinguishes this program from others with the same name. Default: `GCS_CLIENT_ID`, or
            else a random id.
    """

    def __init__(
        self,
        url: str = "http://localhost:8080",
        *,
        client: str = "python",
        timeout_s: float = 60.0,
        token: str | None = None,
        client_id: str | None = None,
    ) -> None:
        self._inner = aio.Gcs(url, client=client, timeout_s=timeout_s, token=token, client_id=client_id)
        super().__init__(self._inner.__aexit__)
        self.url = self._inner.url

    def request(self, method: str, path: str, body: Body | None = None) -> Any:
        """Sends one request below `/api/v1`.

        Raises:
            ApiError: the server or the vehicle refused.
            Unreachable: the server did not respond.
        """
        return self._portal.call(lambda: self._inner.request(method, path, body))

    def raw(self, method: str, path: str, *, body: Body | None = None, content: bytes | None = None) -> bytes:
        """Sends one request below `/api/v1` whose body or response is a file; raises the same errors as
        `request`.
        """
        return self._portal.call(lambda: self._inner.raw(method, path, body=body, content=content))

    def vehicles(self) -> list[SyncVehicle]:
        """All vehicles that the server knows."""
        return [
            SyncVehicle(found, self._portal) for found in self._portal.call(lambda: self._inner.vehicles())
        ]

    def vehicle(self, vehicle_id: str) -> SyncVehicle:
        """A vehicle by its id, without asking the server whether it exists."""
        return SyncVehicle(self._inner.vehicle(vehicle_id), self._portal)

    def hold(self, vehicles: Sequence[str] | None = None) -> list[dict[str, Any]]:
        """Switches several vehicles to Hold at the same time, even if another client has control.

        Args:
            vehicles: ids of the vehicles; default: all armed vehicles.

        Returns:
            One object per vehicle: `vehicle` (its id), `held`, and `problem` if it did not switch to Hold.
        """
        return self._portal.call(lambda: self._inner.hold(vehicles))

    def operations(self) -> SyncOperations:
        """Operations (long-running work of the server): list them, wait for their end, cancel them."""
        return SyncOperations(self._inner.operations(), self._portal)

    def plans(self) -> SyncPlans:
        """The plans stored on the server."""
        return SyncPlans(self._inner.plans(), self._portal)

    def dry_runs(self) -> SyncDryRuns:
        """Plans flown in simulation before a vehicle flies them."""
        return SyncDryRuns(self._inner.dry_runs(), self._portal)

    def wait_for_vehicle(
        self, vehicle_id: str | None = None, *, ready: bool = False, timeout_s: float = 60.0
    ) -> SyncVehicle:
        """Waits until a vehicle (default: any) is connected; with `ready`, until it reports that it can arm.

        Raises:
            Timeout: no vehicle connected or became ready in time.
        """
        return SyncVehicle(
            self._portal.call(
                lambda: self._inner.wait_for_vehicle(vehicle_id, ready=ready, timeout_s=timeout_s)
            ),
            self._portal,
        )

    @contextmanager
    def group(
        self,
        setpoints: Setpoints,
        *,
        minimum_separation_m: float | None = None,
        start_at_unix_s: float | None = None,
        rate_hz: float | None = None,
        valid_for_s: float | None = None,
        on_expiry: ExpiryAction | None = None,
        hold_for_s: float | None = None,
        others_go_on: bool = False,
    ) -> Generator[SyncGroup]:
        """Flies several vehicles as a group inside a block; leaving the block in any way puts all into Hold.

        All vehicles start at the same time, each with its setpoint (any of `gcs_server.client.setpoints`). If
        one vehicle cannot start, no vehicle moves. All setpoints expire together, `valid_for_s` after the end
        of the longest path. If an exception ends the block and Hold fails too, a note on the exception states
        why Hold failed.

        With `others_go_on`, the other members continue if a member leaves the group.

        Yields:
            The group, once all vehicles are in Offboard; `started["start_unix_s"]` is the common start.

        Raises:
            Refused: a vehicle cannot fly, two vehicles would come too close, or another client has control of
                a vehicle.
        """
        with self._portal.wrap_async_context_manager(
            self._inner.group(
                setpoints,
                minimum_separation_m=minimum_separation_m,
                start_at_unix_s=start_at_unix_s,
                rate_hz=rate_hz,
                valid_for_s=valid_for_s,
                on_expiry=on_expiry,
                hold_for_s=hold_for_s,
                others_go_on=others_go_on,
            )
        ) as found:
            yield SyncGroup(found, self._portal)

    def start_together(
        self,
        vehicles: Mapping[str, str],
        mission: Plan | None = None,
        *,
        plan_id: str | None = None,
        version: int | None = None,
        dry_run: str | None = None,
        despite: Sequence[str] = (),
    ) -> list[dict[str, Any]]:
        """Flies a mission with roles: all vehicles start, or none. `pause`, `resume` and `abort` of one
        vehicle's `offboard_mission` act on all vehicles.

        Args:
            vehicles: the vehicle's id for each role.
            mission: the mission's document; or give the `plan_id` of a stored mission.
            plan_id: id of a stored mission.
            version: version of the stored mission; default: the newest.
            dry_run: id of a dry run of this mission with several flights; the server reports when a vehicle
                leaves the corridor of these flights.
            despite: codes of error findings that are accepted.

        Returns:
            One object per vehicle: `vehicle` (its id) and `mission`, as `offboard_mission.state()`.

        Raises:
            Refused: a vehicle cannot start, another client has control of a vehicle, or the mission has
                errors that `despite` does not list.
        """
        return self._portal.call(
            lambda: self._inner.start_together(
                vehicles, mission, plan_id=plan_id, version=version, dry_run=dry_run, despite=despite
            )
        )

    def telemetry(
        self, *, vehicles: Sequence[str] | str = "*", topics: Sequence[str] | str = "*", rate_hz: float = 10.0
    ) -> Generator[dict[str, Any]]:
        """Yields samples and events as they arrive: `{"type": "sample" | "event", …}`. Only the newest value
        of a topic is sent.

        Raises:
            ApiError: the server refused the connection.
            Unreachable: the server did not respond.
        """
        return iterate(self._portal, self._inner.telemetry(vehicles=vehicles, topics=topics, rate_hz=rate_hz))


class SyncVehicle:
    """One vehicle. Every command returns once the vehicle's own state shows the result."""

    def __init__(self, inner: vehicle.Vehicle, portal: BlockingPortal) -> None:
        self._inner = inner
        self._portal = portal
        self.id = self._inner.id
        self.gimbal = SyncGimbal(self._inner.gimbal, self._portal)
        self.control = SyncControl(self._inner.control, self._portal)
        self.mission = SyncMission(self._inner.mission, self._portal)
        self.offboard_mission = SyncOffboardMission(self._inner.offboard_mission, self._portal)
        self.mission_modes = SyncMissionModes(self._inner.mission_modes, self._portal)

    def request(self, method: str, path: str = "", body: Body | None = None) -> Any:
        """Sends one request below `/api/v1/vehicles/{id}`; raises the same errors as `Gcs.request`."""
        return self._portal.call(lambda: self._inner.request(method, path, body))

    def show(self) -> dict[str, Any]:
        """Identity, status and the newest sample of every topic."""
        return self._portal.call(lambda: self._inner.show())

    def status(self) -> dict[str, Any]:
        """Armed, mode, landed state, link."""
        return self._portal.call(lambda: self._inner.status())

    def topic(self, name: str) -> dict[str, Any] | None:
        """The newest value of a topic; None if none was received yet."""
        return self._portal.call(lambda: self._inner.topic(name))

    def position_ned_m(self) -> tuple[float, float, float]:
        """The vehicle's estimated local position [m].

        Raises:
            Timeout: the vehicle has not reported a position yet.
        """
        return self._portal.call(lambda: self._inner.position_ned_m())

    def is_ready(self) -> bool:
        """Whether the vehicle reports that it can arm."""
        return self._portal.call(lambda: self._inner.is_ready())

    def until(
        self,
        condition: Callable[[dict[str, Any]], bool],
        *,
        timeout_s: float = 60.0,
        what: str = "the condition",
    ) -> dict[str, Any]:
        """Waits until `condition` is true for the result of `show`, and returns that result. `what` names the
        condition in the error.

        Raises:
            Timeout: the condition did not become true in time.
        """
        return self._portal.call(lambda: self._inner.until(condition, timeout_s=timeout_s, what=what))

    def until_disarmed(self, *, timeout_s: float = 120.0) -> None:
        """Waits for the motors to stop."""
        self._portal.call(lambda: self._inner.until_disarmed(timeout_s=timeout_s))

    def arm(self) -> None:
        """Starts the motors."""
        self._portal.call(lambda: self._inner.arm())

    def disarm(self) -> None:
        """Stops the motors; refused in flight."""
        self._portal.call(lambda: self._inner.disarm())

    def takeoff(self, alt_home_m: float) -> None:
        """Arms if needed and takes off to an altitude [m above home]."""
        self._portal.call(lambda: self._inner.takeoff(alt_home_m))

    def land(self) -> None:
        """Lands at the current position."""
        self._portal.call(lambda: self._inner.land())

    def land_now(self) -> None:
        """Lands at the current position, even if another client has control."""
        self._portal.call(lambda: self._inner.land_now())

    def rtl(self) -> None:
        """Returns to launch and lands."""
        self._portal.call(lambda: self._inner.rtl())

    def hold(self) -> None:
        """Switches to Hold."""
        self._portal.call(lambda: self._inner.hold())

    def set_mode(self, mode: str) -> None:
        """Changes the flight mode: hold, position, land, …"""
        self._portal.call(lambda: self._inner.set_mode(mode))

    def goto(self, lat_deg: float, lon_deg: float, **options: float) -> None:
        """Flies to a position; give `alt_amsl_m` or `alt_home_m`, and optionally `yaw_ned_deg` and
        `max_distance_m`.
        """
        self._portal.call(lambda: self._inner.goto(lat_deg, lon_deg, **options))

    def kill(self) -> None:
        """Stops the motors, even in flight: the vehicle falls."""
        self._portal.call(lambda: self._inner.kill())

    def param(self, name: str) -> float:
        """One parameter's value."""
        return self._portal.call(lambda: self._inner.param(name))

    def set_param(self, name: str, value: float) -> None:
        """Sets one parameter and verifies it."""
        self._portal.call(lambda: self._inner.set_param(name, value))

    def set_offboard_limits(self, **limits: object) -> dict[str, Any]:
        """Replaces the operator's limits: `speed_max_m_s`, `height_max_m`, `distance_max_m`, `fence`, …

        Omitted limits are removed. Returns these limits and the vehicle's own.
        """
        return self._portal.call(lambda: self._inner.set_offboard_limits(**limits))

    def set_obstacle_avoidance(self, on: bool, *, way: str = "over") -> dict[str, Any]:
        """Switches obstacle avoidance on or off. The vehicle climbs over obstacles, or flies around them with
        `way="around"`.
        """
        return self._portal.call(lambda: self._inner.set_obstacle_avoidance(on, way=way))

    def set_offboard_failsafe(
        self, action: str | None = None, *, after_s: float | None = None
    ) -> dict[str, Any]:
        """Sets the vehicle's own `action` when setpoints stop for `after_s`: a mode (land, hold, rtl, …)."""
        return self._portal.call(lambda: self._inner.set_offboard_failsafe(action, after_s=after_s))

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
        on_expiry: ExpiryAction | None = None,
        hold_for_s: float | None = None,
    ) -> Generator[SyncOffboard]:
        """Flies setpoints inside a block. Leaving the block, even by an exception, switches the vehicle to
        Hold.

        The first setpoint is `first` (any of `gcs_server.client.setpoints`), a position, a velocity, or the
        current position. If the vehicle has landed or has left Offboard, the block sends nothing at its end.
        If this program hangs, the setpoint expires after `valid_for_s` and the server executes `on_expiry`.
        If an exception ends the block and Hold fails too, a note on the exception states why Hold failed.

        Yields:
            The stream; `started` is the server's response, which includes the vehicle's failsafe.
        """
        with self._portal.wrap_async_context_manager(
            self._inner.offboard(
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
        ) as found:
            yield SyncOffboard(found, self._portal)
