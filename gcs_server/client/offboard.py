"""Setpoint calls of a program; each call immediately replaces the setpoint of the running stream.

`SetpointCalls` contains the calls for all clients; they return the result of `send`, which is a value or an
awaitable.
"""

from __future__ import annotations

import asyncio
import functools
import json
from abc import ABC, abstractmethod
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any, Generic, ParamSpec, Protocol, TypeVar

from websockets.asyncio.client import ClientConnection
from websockets.exceptions import ConnectionClosed

from gcs_server.client import setpoints
from gcs_server.client.errors import Timeout, Unreachable, raise_problem
from gcs_server.client.setpoints import Body, PathPoints

P = ParamSpec("P")
R = TypeVar("R")
R_co = TypeVar("R_co", covariant=True)
POLL_S = 0.1
Response = dict[str, Any]
"""Response to a setpoint: the state of the stream (as `GET …/offboard`), or `applied` and `limited` over the
WebSocket."""


class _Call(Generic[P]):
    """A method that sends the setpoint of a function of `gcs_server.client.setpoints`."""

    def __init__(self, make: Callable[P, Body]) -> None:
        self._make = make
        self.__doc__ = make.__doc__

    def __get__(self, calls: SetpointCalls[R], owner: object = None) -> Callable[P, R]:
        @functools.wraps(self._make)
        def call(*args: P.args, **kwargs: P.kwargs) -> R:
            return calls.send(self._make(*args, **kwargs))

        return call


class SetpointCalls(ABC, Generic[R_co]):
    """One call for each type of setpoint; subclasses implement `send`."""

    @abstractmethod
    def send(self, body: Body) -> R_co:
        """Sends any setpoint body (`gcs_server.client.setpoints`)."""

    position_ned = _Call(setpoints.position_ned)
    position_global = _Call(setpoints.position_global)
    position_body = _Call(setpoints.position_body)
    velocity_ned = _Call(setpoints.velocity_ned)
    velocity_body = _Call(setpoints.velocity_body)
    acceleration_ned = _Call(setpoints.acceleration_ned)
    trajectory = _Call(setpoints.trajectory)
    attitude = _Call(setpoints.attitude)
    rates = _Call(setpoints.rates)
    thrust_torque = _Call(setpoints.thrust_torque)
    actuators = _Call(setpoints.actuators)
    path = _Call(setpoints.path)
    follow = _Call(setpoints.follow)
    follow_device = _Call(setpoints.follow_device)


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
