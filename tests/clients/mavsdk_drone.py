"""A simulated vehicle with a MAVSDK `System` on it, and how its streams are waited for."""

from __future__ import annotations

import asyncio
import socket
import sys
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from typing import TypeVar

from mavsdk import System

from tests.station import free_port, running, wait_until

SPEED = 3
"""Times real time; MAVSDK resends and gives up by the real clock."""
PATIENCE_S = 200.0
"""For one test: a flight of two minutes, on a machine too busy to fly it faster than real time."""
T = TypeVar("T")


@asynccontextmanager
async def flying_school(*, more: Sequence[str] = ()) -> AsyncIterator[System]:
    """A vehicle that may be armed, in a process of its own, and MAVSDK connected to its TCP port."""
    port = free_port(socket.SOCK_STREAM)
    command = [sys.executable, "-m", "vehicle_sim", "--no-api", "--gcs-local-port", "0"]
    command += ["--gcs-remote-port", str(free_port()), "--tcp-port", str(port), "--speed", str(SPEED), *more]
    with running(command):
        await asyncio.to_thread(wait_until, lambda: _listens(port), "the simulator's start")
        drone = System(port=free_port())
        try:
            await asyncio.wait(
                {asyncio.ensure_future(drone.connect(f"tcpout://127.0.0.1:{port}"))}, timeout=90
            )
            await until(
                drone.telemetry.health(), lambda h: h.is_armable and h.is_home_position_ok, "ready to arm"
            )
            yield drone
        finally:
            # Else its helper process knocks at this port until the interpreter ends, whoever gets it next.
            drone._stop_mavsdk_server()


def _listens(port: int) -> bool:
    with suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0):
        return True
    return False


async def until(
    stream: AsyncIterator[T], holds: Callable[[T], object], what: str, within_s: float = 100.0
) -> T:
    """The first value of a stream for which `holds`.

    Raises:
        TimeoutError: there was none in time; says what came last.
    """
    last: T | None = None
    try:
        async with asyncio.timeout(within_s):
            async for value in stream:
                last = value
                if holds(value):
                    return value
    except TimeoutError:
        raise TimeoutError(f"no {what} within {within_s} s; last came {last}") from None
    raise TimeoutError(f"the stream ended before {what}; last came {last}")


async def first(stream: AsyncIterator[T], within_s: float = 10) -> T:
    """The next value of a stream."""
    return await until(stream, lambda _: True, "value", within_s)


async def take_off(drone: System, height_m: float) -> None:
    """Armed and up, in Hold."""
    await drone.action.set_takeoff_altitude(height_m)
    await drone.action.arm()
    await drone.action.takeoff()
    await until(
        drone.telemetry.position(),
        lambda p: p.relative_altitude_m > height_m - 0.7,
        f"{height_m} m of height",
    )


async def land(drone: System) -> None:
    """Down, and disarmed by itself."""
    await drone.action.land()
    await until(drone.telemetry.armed(), lambda armed: not armed, "disarming after the landing")
