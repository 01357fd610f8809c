"""The asynchronous client: `async with Gcs() as gcs: await gcs.vehicle("1").arm()`."""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections.abc import AsyncGenerator, Callable, Sequence
from types import TracebackType
from typing import Any

import httpx
import websockets.asyncio.client

from gcs_server.client.errors import GaveUp, GcsClientError, Unreachable, failed

Json = dict[str, Any]
Vector3 = tuple[float, float, float]

COMMAND_TIMEOUT_S = 45.0
"""Longer than any command's own deadline, so that the server's answer comes first."""
POLL_S = 0.1
STREAM_RATE_HZ = 10.0


class Gcs:
    """A ground-control station.

    Args:
        url: where it is.
        client: how this program is called in the journal.
        transport: another HTTP transport (tests).
    """

    def __init__(
        self,
        url: str = "http://localhost:8080",
        *,
        client: str = "python",
        transport: httpx.AsyncBaseTransport | None = None,
    ) -> None:
        self.url = url.rstrip("/")
        self._http = httpx.AsyncClient(
            base_url=f"{self.url}/api/v1/",
            headers={"X-Client": client},
            timeout=COMMAND_TIMEOUT_S,
            transport=transport,
        )

    async def __aenter__(self) -> Gcs:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Gives the connections back; vehicles are not touched."""
        await self._http.aclose()

    async def call(self, method: str, path: str, body: Json | None = None, **query: Any) -> Any:
        """Any call of the API by its path below /api/v1.

        Raises:
            RequestFailed: the server said no; a subclass by kind.
            Unreachable: it did not answer.
        """
        try:
            response = await self._http.request(method, path, json=body, params=query or None)
        except httpx.TransportError as error:
            raise Unreachable(f"{self.url} did not answer ({error or type(error).__name__}).") from error
        answer = response.json() if response.content else None
        if response.is_error:
            raise failed(response.status_code, answer)
        return answer

    def vehicle(self, vehicle_id: str) -> Vehicle:
        """A handle; asks nothing yet."""
        return Vehicle(self, vehicle_id)

    async def vehicles(self) -> list[Vehicle]:
        """Handles of all vehicles there are."""
        return [Vehicle(self, v["id"]) for v in (await self.call("GET", "vehicles"))["vehicles"]]

    async def wait_for_vehicle(
        self, vehicle_id: str | None = None, *, ready: bool = False, timeout_s: float = 30.0
    ) -> Vehicle:
        """The vehicle (the first one unless named), once it is heard; with `ready`, once it can arm.

        Raises:
            GaveUp: it did not come in time.
        """
        deadline_s = time.monotonic() + timeout_s
        while time.monotonic() < deadline_s:
            for state in (await self.call("GET", "vehicles"))["vehicles"]:
                if vehicle_id not in (None, state["id"]) or state["status"]["link_lost"]:
                    continue
                health = (state["topics"].get("health") or {}).get("value") or {}
                located = "local_position" in state["topics"]
                if not ready or (located and health.get("ready_to_arm") is not False):
                    return Vehicle(self, state["id"])
            await asyncio.sleep(POLL_S)
        what = "became ready to arm" if ready else "was heard"
        raise GaveUp(
            f"{f'Vehicle {vehicle_id}' if vehicle_id else 'No vehicle'} {what} within {timeout_s:g} s."
        )

    async def telemetry(
        self,
        vehicles: Sequence[str] | None = None,
        topics: Sequence[str] | None = None,
        *,
        rate_hz: float = 20.0,
    ) -> AsyncGenerator[Json]:
        """Samples (`topic`, `value`, …) and events (`kind`, `text`, …) as they come, newest values only."""
        request = {
            "type": "subscribe",
            "vehicles": "*" if vehicles is None else list(vehicles),
            "topics": "*" if topics is None else list(topics),
            "rate_hz": rate_hz,
        }
        address = "ws" + self.url.removeprefix("http") + "/api/v1/telemetry"
        try:
            async with websockets.asyncio.client.connect(address, compression=None) as socket:
                await socket.send(json.dumps(request))
                async for text in socket:
                    frame = json.loads(text)
                    if frame["type"] == "samples":
                        for sample in frame["samples"]:
                            yield sample
                    elif frame["type"] == "event":
                        yield frame["event"]
                    elif frame["type"] == "error":
                        raise GcsClientError(frame["detail"])
        except OSError as error:
            raise Unreachable(f"{self.url} did not answer ({error}).") from error


class Vehicle:
    """One vehicle; every command returns once the vehicle's own state shows it."""

    def __init__(self, gcs: Gcs, vehicle_id: str) -> None:
        self.id = vehicle_id
        self._gcs = gcs

    async def call(self, method: str, path: str, body: Json | None = None, **query: Any) -> Any:
        """Any call below /api/v1/vehicles/{id}."""
        return await self._gcs.call(method, f"vehicles/{self.id}{path}", body, **query)

    async def state(self) -> Json:
        """Everything known of it now."""
        return await self.call("GET", "")

    async def status(self) -> Json:
        """Armed, mode, landed state."""
        return (await self.state())["status"]

    async def value(self, topic: str) -> Json | None:
        """A topic's newest value; None before the first."""
        sample = (await self.state())["topics"].get(topic)
        return None if sample is None else sample["value"]

    async def arm(self) -> Json:
        """Starts the motors."""
        return await self.call("POST", "/arm")

    async def disarm(self) -> Json:
        """Stops the motors on the ground."""
        return await self.call("POST", "/disarm")

    async def takeoff(self, alt_home_m: float) -> Json:
        """Arms where needed and climbs."""
        return await self.call("POST", "/takeoff", {"alt_home_m": alt_home_m})

    async def land(self) -> Json:
        """Lands where it is; see `wait_until_disarmed`."""
        return await self.call("POST", "/land")

    async def rtl(self) -> Json:
        """Returns to launch."""
        return await self.call("POST", "/rtl")

    async def hold(self) -> Json:
        """Stops and stays."""
        return await self.call("POST", "/hold")

    async def set_mode(self, mode: str) -> Json:
        """Any flight mode by name."""
        return await self.call("POST", "/mode", {"mode": mode})

    async def goto(self, lat_deg: float, lon_deg: float, **more: float) -> Json:
        """Flies to a place in Hold: `alt_home_m` or `alt_amsl_m`, `yaw_ned_deg`, `max_distance_m`."""
        return await self.call("POST", "/goto", {"lat_deg": lat_deg, "lon_deg": lon_deg, **more})

    async def gimbal(self, action: str, **arguments: float | bool) -> Json:
        """`take`, `release`, `angles`, `rates`, `roi`, `roi/clear` with the API's arguments."""
        return await self.call("POST", f"/gimbal/{action}", arguments or None)

    async def param(self, name: str) -> float:
        """Reads a parameter."""
        return (await self.call("GET", f"/params/{name}"))["value"]

    async def set_param(self, name: str, value: float) -> float:
        """Writes a parameter; returns what the vehicle then reports."""
        return (await self.call("PUT", f"/params/{name}", {"value": value}))["value"]

    async def wait_until(
        self, reached: Callable[[Json], bool], what: str, *, timeout_s: float = 60.0
    ) -> Json:
        """Polls the state until `reached(state)`.

        Raises:
            GaveUp: in time it was not.
        """
        deadline_s = time.monotonic() + timeout_s
        while True:
            state = await self.state()
            if reached(state):
                return state
            if time.monotonic() > deadline_s:
                raise GaveUp(f"Vehicle {self.id} was not {what} within {timeout_s:g} s.")
            await asyncio.sleep(POLL_S)

    async def wait_until_disarmed(self, *, timeout_s: float = 120.0) -> Json:
        """After `land` or `rtl`: until it has landed and disarmed by itself."""
        return await self.wait_until(lambda s: not s["status"]["armed"], "disarmed", timeout_s=timeout_s)

    def offboard(
        self,
        *,
        position_ned_m: Vector3 | None = None,
        velocity_ned_m_s: Vector3 | None = None,
        yaw_ned_rad: float | None = None,
        rate_hz: float = 50.0,
        valid_for_s: float = 1.0,
        hold_for_s: float = 5.0,
    ) -> Offboard:
        """`async with vehicle.offboard(position_ned_m=(0, 0, -5)) as o:`; leaves by way of Hold.

        Args:
            position_ned_m: where to begin.
            velocity_ned_m_s: or how to begin.
            yaw_ned_rad: heading; kept unless given.
            rate_hz: of the server's stream to the vehicle.
            valid_for_s: how long a setpoint is good without being renewed: should this program die, the
                vehicle stops within this time.
            hold_for_s: how long it then holds by setpoints before Hold mode.
        """
        first = _setpoint(position_ned_m, velocity_ned_m_s, yaw_ned_rad, None)
        return Offboard(self, first, rate_hz, valid_for_s, {"action": "hold", "hold_for_s": hold_for_s})


class Offboard:
    """A running stream of setpoints to a vehicle."""

    def __init__(
        self, vehicle: Vehicle, first: Json, rate_hz: float, valid_for_s: float, on_expiry: Json
    ) -> None:
        self._vehicle = vehicle
        self._first = first
        self._rate_hz = rate_hz
        self._lasting: Json = {"valid_for_s": valid_for_s, "on_expiry": on_expiry}
        self.started: Json = {}
        """The server's answer to the start; `if_stream_stops` says what the vehicle does by itself."""

    async def __aenter__(self) -> Offboard:
        body = {"setpoint": self._first, "rate_hz": self._rate_hz, **self._lasting}
        self.started = await self._vehicle.call("POST", "/offboard/start", body)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            await asyncio.shield(self.stop())
        except GcsClientError:
            if error is None:  # else the first error is the one to tell
                raise

    async def stop(self) -> Json:
        """Into Hold, then the stream ends; does nothing where the vehicle has left Offboard already."""
        return await self._vehicle.call("POST", "/offboard/stop")

    async def position_ned(
        self,
        north_m: float,
        east_m: float,
        down_m: float,
        *,
        yaw_ned_rad: float | None = None,
        yaw_rate_ned_rad_s: float | None = None,
    ) -> Json:
        """A new place, sent at once; renew it within `valid_for_s`."""
        place = (north_m, east_m, down_m)
        return await self._send(_setpoint(place, None, yaw_ned_rad, yaw_rate_ned_rad_s))

    async def velocity_ned(
        self,
        north_m_s: float,
        east_m_s: float,
        down_m_s: float,
        *,
        yaw_ned_rad: float | None = None,
        yaw_rate_ned_rad_s: float | None = None,
    ) -> Json:
        """A new velocity, sent at once; renew it within `valid_for_s`."""
        velocity = (north_m_s, east_m_s, down_m_s)
        return await self._send(_setpoint(None, velocity, yaw_ned_rad, yaw_rate_ned_rad_s))

    async def fly_to(
        self,
        north_m: float,
        east_m: float,
        down_m: float,
        *,
        yaw_ned_rad: float | None = None,
        within_m: float = 0.3,
        timeout_s: float = 60.0,
    ) -> Json:
        """Renews the place at 10 Hz until the vehicle is there; returns its local position.

        Raises:
            GaveUp: it was not there in time.
        """
        deadline_s = time.monotonic() + timeout_s
        while time.monotonic() < deadline_s:
            await self.position_ned(north_m, east_m, down_m, yaw_ned_rad=yaw_ned_rad)
            local = await self._vehicle.value("local_position")
            if (
                local is not None
                and math.dist(local["position_ned_m"], (north_m, east_m, down_m)) <= within_m
            ):
                return local
            await asyncio.sleep(1.0 / STREAM_RATE_HZ)
        raise GaveUp(
            f"Vehicle {self._vehicle.id} was not within {within_m:g} m of the place in {timeout_s:g} s."
        )

    async def stay(
        self, north_m: float, east_m: float, down_m: float, for_s: float, *, yaw_ned_rad: float | None = None
    ) -> None:
        """Renews the place at 10 Hz for a time."""
        deadline_s = time.monotonic() + for_s
        while time.monotonic() < deadline_s:
            await self.position_ned(north_m, east_m, down_m, yaw_ned_rad=yaw_ned_rad)
            await asyncio.sleep(1.0 / STREAM_RATE_HZ)

    async def _send(self, setpoint: Json) -> Json:
        return await self._vehicle.call("POST", "/offboard/setpoint", {**setpoint, **self._lasting})


def _setpoint(
    position: Vector3 | None, velocity: Vector3 | None, yaw: float | None, yaw_rate: float | None
) -> Json:
    if (position is None) == (velocity is None):
        raise ValueError("give exactly one of position_ned_m and velocity_ned_m_s")
    body: Json = (
        {"type": "position", "position_ned_m": list(position)}
        if position is not None
        else {"type": "velocity", "velocity_ned_m_s": list(velocity or ())}
    )
    if yaw is not None:
        body["yaw_ned_rad"] = yaw
    if yaw_rate is not None:
        body["yaw_rate_ned_rad_s"] = yaw_rate
    return body
