"""Setpoint calls of a program; each call immediately replaces the setpoint of the running stream.

`SetpointCalls` contains the calls for all clients; they return the result of `send`, which is a value or an
awaitable.
"""

from __future__ import annotations

import asyncio
import json
from abc import ABC, abstractmethod
from collections.abc import AsyncGenerator, Awaitable, Sequence
from contextlib import asynccontextmanager
from typing import Any, Generic, Literal, Protocol, TypeVar

from websockets.asyncio.client import ClientConnection
from websockets.exceptions import ConnectionClosed

from gcs_server.client import setpoints
from gcs_server.client.errors import Timeout, Unreachable, raise_problem
from gcs_server.client.setpoints import Body, Partial, PathPoints

R_co = TypeVar("R_co", covariant=True)
POLL_S = 0.1
Response = dict[str, Any]
"""Response to a setpoint: the state of the stream (as `GET …/offboard`), or `applied` and `limited` over the
WebSocket."""


class SetpointCalls(ABC, Generic[R_co]):
    """One call for each type of setpoint; subclasses implement `send`."""

    @abstractmethod
    def send(self, body: Body) -> R_co:
        """Sends any setpoint body (`gcs_server.client.setpoints`)."""

    def position_ned(
        self,
        north_m: float,
        east_m: float,
        down_m: float,
        *,
        yaw_ned_rad: float | None = None,
        yaw_rate_ned_rad_s: float | None = None,
    ) -> R_co:
        """Flies to a local position and keeps it."""
        body = setpoints.position_ned(
            north_m, east_m, down_m, yaw_ned_rad=yaw_ned_rad, yaw_rate_ned_rad_s=yaw_rate_ned_rad_s
        )
        return self.send(body)

    def position_global(
        self,
        lat_deg: float,
        lon_deg: float,
        *,
        alt_amsl_m: float | None = None,
        alt_home_m: float | None = None,
        yaw_ned_rad: float | None = None,
    ) -> R_co:
        """Flies to a global position, with exactly one altitude."""
        body = setpoints.position_global(
            lat_deg, lon_deg, alt_amsl_m=alt_amsl_m, alt_home_m=alt_home_m, yaw_ned_rad=yaw_ned_rad
        )
        return self.send(body)

    def position_body(
        self, forward_m: float, right_m: float, down_m: float, *, yaw_offset_rad: float | None = None
    ) -> R_co:
        """Flies to an offset from the current position, in the heading frame."""
        return self.send(setpoints.position_body(forward_m, right_m, down_m, yaw_offset_rad=yaw_offset_rad))

    def velocity_ned(
        self,
        north_m_s: float,
        east_m_s: float,
        down_m_s: float,
        *,
        yaw_ned_rad: float | None = None,
        yaw_rate_ned_rad_s: float | None = None,
    ) -> R_co:
        """Flies at a velocity in the local NED frame."""
        body = setpoints.velocity_ned(
            north_m_s, east_m_s, down_m_s, yaw_ned_rad=yaw_ned_rad, yaw_rate_ned_rad_s=yaw_rate_ned_rad_s
        )
        return self.send(body)

    def velocity_body(
        self,
        forward_m_s: float,
        right_m_s: float,
        down_m_s: float,
        *,
        yaw_ned_rad: float | None = None,
        yaw_rate_ned_rad_s: float | None = None,
    ) -> R_co:
        """Flies at a velocity in the heading frame."""
        body = setpoints.velocity_body(
            forward_m_s, right_m_s, down_m_s, yaw_ned_rad=yaw_ned_rad, yaw_rate_ned_rad_s=yaw_rate_ned_rad_s
        )
        return self.send(body)

    def acceleration_ned(
        self,
        north_m_s2: float,
        east_m_s2: float,
        down_m_s2: float,
        *,
        yaw_ned_rad: float | None = None,
    ) -> R_co:
        """Flies at an acceleration in the local NED frame, without gravity."""
        body = setpoints.acceleration_ned(north_m_s2, east_m_s2, down_m_s2, yaw_ned_rad=yaw_ned_rad)
        return self.send(body)

    def trajectory(
        self,
        *,
        position_ned_m: Partial | None = None,
        velocity_ned_m_s: Partial | None = None,
        acceleration_ned_m_s2: Partial | None = None,
        yaw_ned_rad: float | None = None,
        yaw_rate_ned_rad_s: float | None = None,
    ) -> R_co:
        """Flies to a position, with velocity and acceleration as feed-forward."""
        body = setpoints.trajectory(
            position_ned_m=position_ned_m,
            velocity_ned_m_s=velocity_ned_m_s,
            acceleration_ned_m_s2=acceleration_ned_m_s2,
            yaw_ned_rad=yaw_ned_rad,
            yaw_rate_ned_rad_s=yaw_rate_ned_rad_s,
        )
        return self.send(body)

    def attitude(
        self,
        thrust: float,
        *,
        roll_rad: float | None = None,
        pitch_rad: float | None = None,
        yaw_ned_rad: float | None = None,
        q_ned_frd: Sequence[float] | None = None,
        yaw_rate_ned_rad_s: float | None = None,
    ) -> R_co:
        """Flies an attitude, given by three angles or a quaternion, with collective thrust (0 to 1)."""
        body = setpoints.attitude(
            thrust,
            roll_rad=roll_rad,
            pitch_rad=pitch_rad,
            yaw_ned_rad=yaw_ned_rad,
            q_ned_frd=q_ned_frd,
            yaw_rate_ned_rad_s=yaw_rate_ned_rad_s,
        )
        return self.send(body)

    def rates(self, roll_rad_s: float, pitch_rad_s: float, yaw_rad_s: float, thrust: float) -> R_co:
        """Flies body rates with collective thrust."""
        return self.send(setpoints.rates(roll_rad_s, pitch_rad_s, yaw_rad_s, thrust))

    def thrust_torque(self, thrust_frd: Sequence[float], torque_frd: Sequence[float]) -> R_co:
        """Applies body thrust and torque; refused on MAVLink links."""
        return self.send(setpoints.thrust_torque(thrust_frd, torque_frd))

    def actuators(self, motors: Partial = (), servos: Partial = ()) -> R_co:
        """Sets individual motors and servos; refused on MAVLink links."""
        return self.send(setpoints.actuators(motors, servos))

    def path(self, points: PathPoints) -> R_co:
        """Starts a curve through timed points; the server sends its setpoints even if this program ends."""
        return self.send(setpoints.path(points))

    def follow(
        self,
        vehicle_id: str,
        *,
        offset_ned_m: Sequence[float] | None = None,
        offset_frd_m: Sequence[float] | None = None,
        yaw: Literal["keep", "same", "face"] = "keep",
    ) -> R_co:
        """Keeps a position relative to another vehicle; the server updates the setpoint when it moves."""
        body = setpoints.follow(vehicle_id, offset_ned_m=offset_ned_m, offset_frd_m=offset_frd_m, yaw=yaw)
        return self.send(body)


class VehicleApi(Protocol):
    """The part of a vehicle that this module uses."""

    async def request(self, method: str, path: str = "", body: Body | None = None) -> Any: ...
    async def socket(self, path: str) -> ClientConnection: ...


class Offboard(SetpointCalls[Awaitable[Response]]):
    """A running setpoint stream.

    Args:
        vehicle: the vehicle.
        started: the server's response to the start.
        validity: validity of each setpoint, and the action on expiry.
    """

    def __init__(self, vehicle: VehicleApi, started: Response, validity: Body) -> None:
        self._vehicle = vehicle
        self._validity = validity
        self.started = started

    async def send(self, body: Body) -> Response:
        """Sends any setpoint body; returns the stream's state.

        Raises:
            Invalid: a value is invalid.
            Refused: the setpoint cannot be flown, or the stream has ended.
        """
        return await self._vehicle.request("POST", "/offboard/setpoint", {"setpoint": body, **self._validity})

    async def follow_path(self, points: PathPoints) -> None:
        """Flies a curve through timed points and returns at its end; the vehicle then keeps the position of
        the last point.

        Raises:
            Timeout: another setpoint, mode or client has interrupted the path.
        """
        point_list = list(points)
        state = await self.path(point_list)
        duration_s = point_list[-1][0]
        while (state["age_s"] or 0.0) < duration_s:
            await asyncio.sleep(POLL_S)
            state = await self.status()
            if state["ordered_type"] != "path":
                raise Timeout(state["ended"] or "Another setpoint has replaced the path.")

    @asynccontextmanager
    async def live(self) -> AsyncGenerator[LiveOffboard]:
        """Opens a WebSocket for setpoints at up to 100 Hz; the stream continues after the block.

        Yields:
            An object with the same calls; each call returns once the server has responded.
        """
        socket = await self._vehicle.socket("/offboard/stream")
        async with socket:
            yield LiveOffboard(socket, self._validity)

    async def status(self) -> Response:
        """Achieved rate, age and remaining validity of the setpoint; limits, failsafe, available setpoint
        types.
        """
        return await self._vehicle.request("GET", "/offboard")

    async def stop(self) -> None:
        """Switches the vehicle to Hold and ends the stream; does nothing if the stream has ended already."""
        await self._vehicle.request("POST", "/offboard/stop")


class LiveOffboard(SetpointCalls[Awaitable[Response]]):
    """Setpoints over a WebSocket."""

    def __init__(self, socket: ClientConnection, validity: Body) -> None:
        self._socket = socket
        self._validity = validity
        self._seq = 0

    async def send(self, body: Body) -> Response:
        """Sends any setpoint body; returns the `applied` setpoint and what the limits changed (`limited`).

        Raises:
            Invalid, Refused: as with `Offboard.send`; the socket stays open.
            Unreachable: the server has closed the connection.
        """
        self._seq += 1
        try:
            await self._socket.send(json.dumps({"setpoint": body, **self._validity, "seq": self._seq}))
            while True:
                response = json.loads(await self._socket.recv())
                if response.get("seq") == self._seq:
                    break
        except ConnectionClosed as error:
            raise Unreachable(f"The server closed the setpoint stream: {error}.") from error
        if "error" in response:
            raise_problem(response["error"])
        return response
