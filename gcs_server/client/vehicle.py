"""A vehicle of the client (`gcs.vehicle("1")`) and its gimbals."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager
from typing import Any, Protocol, TypeVar

from websockets.asyncio.client import ClientConnection

from gcs_server.client.control import Control, VehicleApi
from gcs_server.client.errors import ApiError, Timeout, Unreachable
from gcs_server.client.files import Files
from gcs_server.client.flights import LogStream
from gcs_server.client.manual_control import Sticks, sticks_of
from gcs_server.client.mission import Mission, MissionModes, OffboardMission
from gcs_server.client.offboard import Offboard
from gcs_server.client.params import Params
from gcs_server.client.plans import Operations
from gcs_server.client.setpoints import Body, ExpiryAction, first_setpoint, validity_fields


class Gimbal:
    """The vehicle's gimbal; angles in degrees, pitch up positive."""

    def __init__(self, vehicle: VehicleApi, query: str = "") -> None:
        self._vehicle = vehicle
        self._query = query

    def at(self, *, component: int | None = None, device: int | None = None) -> Gimbal:
        """Selects another gimbal of the vehicle; the topic `gimbal` lists them in `gimbals`.

        Args:
            component: MAVLink component id of the gimbal manager (`component_id`).
            device: `gimbal_device_id`, if the gimbal manager has several gimbals.
        """
        selectors = (("component", component), ("device", device))
        query = "&".join(f"{name}={value}" for name, value in selectors if value is not None)
        return Gimbal(self._vehicle, f"?{query}" if query else "")

    async def _post(self, path: str, body: Body | None = None) -> Any:
        return await self._vehicle.request("POST", f"/gimbal/{path}{self._query}", body)

    async def take(self) -> None:
        """Takes control of the gimbal."""
        await self._post("take")

    async def release(self) -> None:
        """Releases control of the gimbal."""
        await self._post("release")

    async def angles(
        self, pitch_deg: float, yaw_deg: float, *, roll_deg: float | None = None, yaw_lock: bool = False
    ) -> dict[str, Any] | None:
        """Points the gimbal; yaw is relative to the nose, or to north with `yaw_lock`.

        Returns:
            The angles at which a limit stopped the gimbal (`limited` of the response); None if it reached the
            commanded angles.
        """
        body: Body = {"pitch_deg": pitch_deg, "yaw_deg": yaw_deg, "yaw_lock": yaw_lock}
        if roll_deg is not None:
            body = {**body, "roll_deg": roll_deg}
        return (await self._post("angles", body))["limited"]

    async def rates(
        self, pitch_rate_deg_s: float, yaw_rate_deg_s: float, *, yaw_lock: bool | None = None
    ) -> None:
        """Turns the gimbal at constant rates until the next command; zeros stop both axes. `yaw_lock` None
        keeps the gimbal's current setting."""
        body: Body = {"pitch_rate_deg_s": pitch_rate_deg_s, "yaw_rate_deg_s": yaw_rate_deg_s}
        await self._post("rates", {**body, "yaw_lock": yaw_lock})

    async def roi(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> None:
        """Keeps the camera pointed at a location."""
        await self._post("roi", {"lat_deg": lat_deg, "lon_deg": lon_deg, "alt_amsl_m": alt_amsl_m})

    async def clear_roi(self) -> None:
        """Stops pointing at a location."""
        await self._post("roi/clear")

    async def pose(self, pose: str) -> None:
        """Moves to the `neutral` or `retract` position, or to the `centre`."""
        await self._post("pose", {"pose": pose})

    async def try_axis(
        self, axis: str, angle_deg: float, *, while_armed: bool = False
    ) -> dict[str, Any] | None:
        """Turns one axis (`roll`, `pitch`, `yaw`), and the others to zero, on the bench; refused while the
        vehicle is armed, unless `while_armed`. Returns the same as `angles`."""
        body: Body = {"axis": axis, "angle_deg": angle_deg, "while_armed": while_armed}
        return (await self._post("try", body))["limited"]

    async def setup(self) -> dict[str, Any]:
        """Parameters, `outputs`, the `module`, and `findings`: what keeps the gimbal from working, and the
        `changes` that mend it. The vehicle's parameters must have been read."""
        return (await self._vehicle.request("GET", "/gimbal/setup"))["setup"]

    async def module(self, action: str = "status") -> dict[str, Any]:
        """State of PX4's gimbal module (`status`), which `start` starts, or starts again with its present
        parameters."""
        return (await self._post("module", {"action": action}))["module"]


T = TypeVar("T")

POLL_S = 0.1
"""Polling period of all waits [s]."""


class GcsApi(Protocol):
    """The part of `Gcs` that a vehicle uses."""

    async def request(self, method: str, path: str, body: Body | None = None) -> Any: ...
    async def raw(self, method: str, path: str) -> bytes: ...
    async def socket(self, path: str) -> ClientConnection: ...
    def operations(self) -> Operations: ...


class Vehicle:
    """One vehicle. Every command returns once the vehicle's own state shows the result."""

    def __init__(self, gcs: GcsApi, vehicle_id: str) -> None:
        self._gcs = gcs
        self.id = vehicle_id
        self.gimbal = Gimbal(self)
        self.control = Control(self)
        self.params = Params(self)
        self.files = Files(self, gcs.operations())
        self.log_stream = LogStream(self)
        self.mission = Mission(self, gcs.operations())
        self.offboard_mission = OffboardMission(self)
        self.mission_modes = MissionModes(self)

    async def request(self, method: str, path: str = "", body: Body | None = None) -> Any:
        """Sends one request below `/api/v1/vehicles/{id}`; raises the same errors as `Gcs.request`."""
        return await self._gcs.request(method, f"/vehicles/{self.id}{path}", body)

    async def raw(self, method: str, path: str) -> bytes:
        """Sends one request below `/api/v1/vehicles/{id}` whose response is a file."""
        return await self._gcs.raw(method, f"/vehicles/{self.id}{path}")

    async def show(self) -> dict[str, Any]:
        """Identity, status and the newest sample of every topic."""
        return await self.request("GET")

    async def status(self) -> dict[str, Any]:
        """Armed, mode, landed state, link."""
        return (await self.show())["status"]

    async def topic(self, name: str) -> dict[str, Any] | None:
        """The newest value of a topic; None if none was received yet."""
        sample = (await self.show())["topics"].get(name)
        return None if sample is None else sample["value"]

    async def position_ned_m(self) -> tuple[float, float, float]:
        """The vehicle's estimated local position [m].

        Raises:
            Timeout: the vehicle has not reported a position yet.
        """
        local = await self.topic("local_position")
        if local is None:
            raise Timeout(f"Vehicle {self.id} has not reported a local position yet.")
        north, east, down = local["position_ned_m"]
        return north, east, down

    async def is_ready(self) -> bool:
        """Whether the vehicle reports that it can be armed, in its mode or in another one.

        After a landing PX4 stays in Offboard and cannot be armed there without a stream: the start of a
        flight changes the mode; for `arm` alone choose one before.
        """
        state = await self.show()
        health = state["topics"].get("health")
        if health is None or health["value"]["ready_to_arm"]:
            return health is not None
        readiness = await self.request("GET", "/readiness")
        if readiness["known"]:
            return bool(readiness["offers"])
        return state["status"]["mode"] == "offboard"  # over ROS 2 there is no report

    async def until(
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

        async def poll() -> dict[str, Any] | None:
            state = await self.show()
            return state if condition(state) else None

        return await poll_until_found(poll, timeout_s, what)

    async def until_disarmed(self, *, timeout_s: float = 120.0) -> None:
        """Waits for the motors to stop."""
        await self.until(lambda v: not v["status"]["armed"], timeout_s=timeout_s, what="the motors to stop")

    async def arm(self) -> None:
        """Starts the motors."""
        await self.request("POST", "/arm")

    async def disarm(self) -> None:
        """Stops the motors; refused in flight."""
        await self.request("POST", "/disarm")

    async def takeoff(self, alt_home_m: float) -> None:
        """Arms if needed and takes off to an altitude [m above home]."""
        await self.request("POST", "/takeoff", {"alt_home_m": alt_home_m})

    async def land(self) -> None:
        """Lands at the current position."""
        await self.request("POST", "/land")

    async def land_now(self) -> None:
        """Lands at the current position, even if another client has control."""
        await self.request("POST", "/land_now", {"confirm": f"vehicle {self.id} lands now"})

    async def rtl(self) -> None:
        """Returns to launch and lands."""
        await self.request("POST", "/rtl")

    async def hold(self) -> None:
        """Switches to Hold."""
        await self.request("POST", "/hold")

    async def set_mode(self, mode: str) -> None:
        """Changes the flight mode: hold, position, land, …"""
        await self.request("POST", "/mode", {"mode": mode})

    async def modes(self) -> list[dict[str, Any]]:
        """The modes that the vehicle offers: `mode`, `label`, `settable`, `can_run`, and `reasons` why one
        cannot be entered now."""
        return (await self.request("GET", "/modes"))["modes"]

    async def goto(self, lat_deg: float, lon_deg: float, **options: object) -> None:
        """Flies to a position; give `alt_amsl_m` or `alt_home_m`, and optionally `yaw_ned_deg`, `speed_m_s`,
        `max_distance_m`, and `despite` (codes of findings about the geofence that you accept)."""
        await self.request("POST", "/goto", {"lat_deg": lat_deg, "lon_deg": lon_deg, **options})

    async def futures(self, *, horizon_s: float = 20.0, **command: object) -> dict[str, Any]:
        """Where the vehicle may be when with a command that is not sent: flown a hundred times in simulation
        from its present state.

        Args:
            horizon_s: how far the flights reach [s].
            command: one of `goto`, `altitude`, `orbit`, `mode` and `setpoint`, as their own calls take them;
                also `flights`, `seed` and `obstacles`.

        Raises:
            Refused: the vehicle is not flying, or has no position.
        """
        return await self.request("POST", "/futures", {"horizon_s": horizon_s, **command})

    async def change_altitude(self, **options: object) -> None:
        """Climbs or descends in Hold; give `alt_amsl_m` or `alt_home_m`, and optionally `max_distance_m` and
        `despite`."""
        await self.request("POST", "/altitude", {**options})

    async def change_heading(self, yaw_ned_deg: float) -> None:
        """Turns to a heading, clockwise from north [deg], in Hold; returns once the vehicle has turned."""
        await self.request("POST", "/heading", {"yaw_ned_deg": yaw_ned_deg})

    async def change_speed(self, speed_m_s: float) -> None:
        """Changes the ground speed in Hold or Mission [m/s]."""
        await self.request("POST", "/speed", {"speed_m_s": speed_m_s})

    async def orbit(
        self, lat_deg: float, lon_deg: float, *, radius_m: float, speed_m_s: float, **options: object
    ) -> None:
        """Circles around a point; give `alt_amsl_m` or `alt_home_m`, and optionally `clockwise`, `yaw`
        (`center`, `initial`, `tangent`, `uncontrolled`), `max_distance_m` and `despite`."""
        body: Body = {"lat_deg": lat_deg, "lon_deg": lon_deg, "radius_m": radius_m, "speed_m_s": speed_m_s}
        await self.request("POST", "/orbit", {**body, **options})

    async def set_home(
        self, lat_deg: float | None = None, lon_deg: float | None = None, **options: float
    ) -> None:
        """Sets home to a position, with `alt_amsl_m` and `max_distance_m` as options; without a position, to
        the vehicle's own."""
        body: Body = {"here": True} if lat_deg is None else {"lat_deg": lat_deg, "lon_deg": lon_deg}
        await self.request("POST", "/home", {**body, **options})

    async def autotune(self, *, despite: Sequence[str] = ()) -> dict[str, Any]:
        """Starts PX4's autotune: the vehicle moves about its axes by itself for about 40 s. Returns the
        operation, whose `text` says the axis; `gcs.operations().wait` waits for its end, and
        `gcs.flights().autotuned` has the gains of the flight's log.

        Args:
            despite: accepted codes: the vehicle writes the gains itself, or is low.
        """
        return await self.request("POST", "/autotune", {"despite": list(despite)})

    async def end_autotune(self) -> None:
        """Ends autotune by a change of the mode; the vehicle is then in Hold."""
        await self.request("DELETE", "/autotune")

    async def kill(self) -> None:
        """Stops the motors, even in flight: the vehicle falls."""
        await self.request("POST", "/kill", {"confirm": f"motors stop, vehicle {self.id} falls"})

    async def param(self, name: str) -> float:
        """One parameter's value."""
        return (await self.request("GET", f"/params/{name}"))["value"]

    async def set_param(self, name: str, value: float) -> None:
        """Sets one parameter and verifies it."""
        await self.request("PUT", f"/params/{name}", {"value": value})

    async def restart(self) -> None:
        """Restarts the autopilot; refused while armed. PX4 in simulation refuses, too."""
        await self.request("POST", "/restart", {"confirm": f"vehicle {self.id} restarts"})

    @asynccontextmanager
    async def manual_control(self) -> AsyncGenerator[Sticks]:
        """Flies by stick (MANUAL_CONTROL) in a mode such as Position; its sticks are centred but for the time
        of a call of `fly`. At the end of the block sending stops, and the vehicle does what its parameters
        select (`manual_control_rules`): select Hold before, and COM_RCL_EXCEPT for it to stay there.

        Raises:
            Refused: the vehicle ignores stick positions, or another client's are sent.
        """
        async with sticks_of(self) as sticks:
            yield sticks

    async def manual_control_rules(self) -> dict[str, Any]:
        """`problem`: why the vehicle ignores stick positions (None: it does not); `loss`: what it does when
        they stop."""
        return (await self.request("GET", "/manual_control"))["rules"]

    async def shell(self, line: str, *, while_armed: bool = False, wait_s: float = 2.0) -> str:
        """Sends a line to the vehicle's console (PX4's shell); returns its output.

        Args:
            line: the line, without its end.
            while_armed: whether it is also sent while the vehicle is armed; it acts at once, unchecked.
            wait_s: maximum wait for the end of the output [s].
        """
        body: Body = {"line": line, "while_armed": while_armed, "wait_s": wait_s}
        return str((await self.request("POST", "/shell", body))["output"])

    async def set_offboard_limits(self, **limits: object) -> dict[str, Any]:
        """Replaces the operator's limits: `speed_max_m_s`, `height_max_m`, `distance_max_m`, `fence`, …

        Omitted limits are removed. Returns these limits and the vehicle's own.
        """
        return await self.request("PUT", "/offboard/limits", limits)

    async def set_obstacle_avoidance(self, on: bool, *, way: str = "over") -> dict[str, Any]:
        """Switches obstacle avoidance on or off. The vehicle climbs over obstacles, or flies around them with
        `way="around"`."""
        return await self.request("PUT", "/offboard/avoidance", {"on": on, "way": way})

    async def set_offboard_failsafe(
        self, action: str | None = None, *, after_s: float | None = None
    ) -> dict[str, Any]:
        """Sets the vehicle's own `action` when setpoints stop for `after_s`: a mode (land, hold, rtl, …)."""
        options = {"action": action, "after_s": after_s}
        body: Body = {name: value for name, value in options.items() if value is not None}
        return await self.request("PUT", "/offboard/failsafe", body)

    async def socket(self, path: str) -> ClientConnection:
        """A WebSocket below `/api/v1/vehicles/{id}`."""
        return await self._gcs.socket(f"/vehicles/{self.id}{path}")

    @asynccontextmanager
    async def offboard(
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
    ) -> AsyncGenerator[Offboard]:
        """Flies setpoints inside a block. Leaving the block, even by an exception, switches the vehicle to
        Hold.

        The first setpoint is `first` (any of `gcs_server.client.setpoints`), a position, a velocity, or the
        current position. If the vehicle has landed or has left Offboard, the block sends nothing at its end.
        If this program hangs, the setpoint expires after `valid_for_s` and the server executes `on_expiry`.
        If an exception ends the block and Hold fails too, a note on the exception states why Hold failed.

        Yields:
            The stream; `started` is the server's response, which includes the vehicle's failsafe.
        """
        setpoint = first_setpoint(first, position_ned_m, velocity_ned_m_s, yaw_ned_rad, yaw_rate_ned_rad_s)
        validity = validity_fields(valid_for_s, on_expiry, hold_for_s)
        rate: Body = {} if rate_hz is None else {"rate_hz": rate_hz}
        started = await self.request("POST", "/offboard/start", {"setpoint": setpoint, **rate, **validity})
        stream = Offboard(self, started, validity)
        async with hold_at_end(f"Vehicle {self.id}", stream.stop):
            yield stream


@asynccontextmanager
async def hold_at_end(name: str, hold: Callable[[], Awaitable[object]]) -> AsyncGenerator[None]:
    """Calls `hold` at the end of a block. After an exception, that exception is raised, with a note if `hold`
    fails too."""
    try:
        yield
    except BaseException as block_error:
        try:
            await asyncio.shield(hold())
        except (ApiError, Unreachable) as hold_error:
            block_error.add_note(f"{name} could not be put into Hold: {hold_error}")
        raise
    await hold()


async def poll_until_found(poll: Callable[[], Awaitable[T | None]], timeout_s: float, what: str) -> T:
    """Polls until `poll` returns a value.

    Raises:
        Timeout: `poll` returned no value in time.
    """
    loop = asyncio.get_running_loop()
    end_s = loop.time() + timeout_s
    while True:
        value = await poll()
        if value is not None:
            return value
        if loop.time() > end_s:
            raise Timeout(f"Waited {timeout_s:g} s for {what}.")
        await asyncio.sleep(POLL_S)
