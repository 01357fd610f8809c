"""One interface to MAVSDK 3 and MAVSDK 4: a program that uses it runs with the installed version.

Both packages are called `mavsdk`; they differ in how they connect, in the names of their plug-in classes and
in the prefix `subscribe_` of streams.
"""

from __future__ import annotations

import asyncio
import importlib
import socket
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

READY_TIMEOUT_S = 90.0
"""Time that a vehicle on a busy machine needs to boot, to align its estimator, and to get a position."""


class Drone:
    """A connected vehicle.

    Args:
        version: version of MAVSDK, 3 or 4.
        system: MAVSDK's object for a vehicle.
    """

    def __init__(self, version: int, system: Any) -> None:
        self.version, self._system = version, system
        self._plugins: dict[str, Any] = {}

    def __getattr__(self, plugin: str) -> Any:
        """A plug-in by its name, such as `drone.action`."""
        if self.version == 3:
            return getattr(self._system, plugin)
        if plugin not in self._plugins:
            module = importlib.import_module(f"mavsdk.asyncio.plugins.{plugin}")
            name = "".join(word.capitalize() for word in plugin.split("_"))
            self._plugins[plugin] = getattr(module, f"{name}Async")(self._system)
        return self._plugins[plugin]

    def types(self, plugin: str) -> Any:
        """The module with the plug-in's data classes."""
        return importlib.import_module(f"mavsdk.{'plugins.' if self.version == 4 else ''}{plugin}")

    def stream(self, name: str) -> AsyncIterator[Any]:
        """A telemetry stream."""
        return getattr(self.telemetry, f"subscribe_{name}" if self.version == 4 else name)()

    async def until(
        self, name: str, condition: Callable[[Any], object], what: str, within_s: float = 60.0
    ) -> Any:
        """The first value of a telemetry stream for which `condition` is true.

        Raises:
            SystemExit: there was no such value in time; the message has the last value.
        """
        last = None
        try:
            async with asyncio.timeout(within_s):
                async for value in self.stream(name):
                    last = value
                    if condition(value):
                        return value
        except TimeoutError:
            pass
        raise SystemExit(f"no {what} within {within_s} s; the last value was {last}")

    async def until_mode(self, mode: str) -> None:
        """Waits for a flight mode by its name, such as "RETURN_TO_LAUNCH"."""
        await self.until("flight_mode", lambda value: value.name == mode, f"mode {mode}")

    async def until_disarmed(self) -> None:
        """Waits until the vehicle has landed and disarmed."""
        await self.until("armed", lambda armed: not armed, "disarming after the landing")


@asynccontextmanager
async def connected(port: int) -> AsyncIterator[Drone]:
    """Connects to the vehicle on this TCP port of this machine, and waits until the vehicle can be armed."""
    address = f"tcpout://127.0.0.1:{port}"
    try:
        from mavsdk.asyncio import Mavsdk
    except ImportError:
        from mavsdk import System

        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            server_port = probe.getsockname()[1]
        system = System(port=server_port)
        try:
            async with asyncio.timeout(READY_TIMEOUT_S):
                await system.connect(address)
            yield await _wait_until_ready(Drone(3, system))
        finally:
            system._stop_mavsdk_server()
    else:
        from mavsdk import ComponentType, Configuration

        configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
        async with Mavsdk(configuration) as mavsdk:
            await mavsdk.add_any_connection(address)
            yield await _wait_until_ready(Drone(4, await mavsdk.first_autopilot(timeout_s=READY_TIMEOUT_S)))


async def _wait_until_ready(drone: Drone) -> Drone:
    began_s = time.monotonic()
    await drone.until(
        "health", lambda h: h.is_armable and h.is_home_position_ok, "ready to arm", READY_TIMEOUT_S
    )
    await drone.until(
        "home", lambda _: True, "home", max(1.0, READY_TIMEOUT_S - (time.monotonic() - began_s))
    )
    return drone
