"""A simulated vehicle with a connected MAVSDK `System`, and functions that wait for its streams."""

from __future__ import annotations

import asyncio
import os
import socket
import sys
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from contextlib import ExitStack, asynccontextmanager, contextmanager, suppress
from typing import TypeVar

from mavsdk import System

from gcs_server.client import SyncGcs
from tests.station import free_port, running_process, running_server, wait_until

SPEED_FACTOR = 3
"""Speed of the simulation as a multiple of real time; MAVSDK's timeouts use the real clock."""
TIMEOUT_S = 200.0
"""Limit for one test: a flight of two minutes, also on a machine that cannot simulate faster than real
time."""
GUARDED = bool(os.environ.get("GUARDED"))
"""Whether the programs fly through a guarded link of a server; `make nightly` runs them both ways."""
T = TypeVar("T")


@contextmanager
def vehicle_at(port: int, *, arguments: Sequence[str] = (), guarded: bool = GUARDED) -> Iterator[None]:
    """Runs a vehicle that can be armed, in a separate process, with a TCP port for a program.

    Args:
        port: the TCP port.
        arguments: further arguments of the simulator.
        guarded: whether the port is a guarded link of a server to which the vehicle is connected.
    """
    gcs_port, tcp_port = free_port(), 0 if guarded else port
    command = [sys.executable, "-m", "vehicle_sim", "--no-api", "--gcs-local-port", "0"]
    command += ["--gcs-remote-port", str(gcs_port), "--speed", str(SPEED_FACTOR), "--tcp-port", str(tcp_port)]
    with ExitStack() as stack:
        stack.enter_context(running_process([*command, *arguments]))
        if guarded:
            guard = f"tcpin://127.0.0.1:{port}?guard=free"
            url, _ = stack.enter_context(running_server([f"udpin://127.0.0.1:{gcs_port}", guard]))
            gcs = stack.enter_context(SyncGcs(url, client="observer"))
            gcs.wait_for_vehicle("1", ready=True)
        wait_until(lambda: listens(port), "the simulator's start")
        yield


@asynccontextmanager
async def connected_drone(*, arguments: Sequence[str] = (), guarded: bool = GUARDED) -> AsyncIterator[System]:
    """Starts a vehicle, and connects MAVSDK to its TCP port; the arguments are those of `vehicle_at`."""
    port = free_port(socket.SOCK_STREAM)
    with vehicle_at(port, arguments=arguments, guarded=guarded):
        drone = System(port=free_port(socket.SOCK_STREAM))
        try:
            await asyncio.wait(
                {asyncio.ensure_future(drone.connect(f"tcpout://127.0.0.1:{port}"))}, timeout=90
            )
            await until(
                drone.telemetry.health(), lambda h: h.is_armable and h.is_home_position_ok, "ready to arm"
            )
            yield drone
        finally:
            # Otherwise mavsdk_server connects to this port again until the interpreter ends, even if another
            # process uses the port then.
            drone._stop_mavsdk_server()


def listens(port: int) -> bool:
    """Whether something accepts connections at a TCP port."""
    with suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0):
        return True
    return False


async def until(
    stream: AsyncIterator[T], condition: Callable[[T], object], what: str, within_s: float = 100.0
) -> T:
    """The first value of a stream for which `condition` is true.

    Raises:
        TimeoutError: there was no such value in time; the message has the last value.
    """
    last: T | None = None
    try:
        async with asyncio.timeout(within_s):
            async for value in stream:
                last = value
                if condition(value):
                    return value
    except TimeoutError:
        raise TimeoutError(f"no {what} within {within_s} s; the last value was {last}") from None
    raise TimeoutError(f"the stream ended before {what}; the last value was {last}")


async def next_value(stream: AsyncIterator[T], within_s: float = 10) -> T:
    """The next value of a stream."""
    return await until(stream, lambda _: True, "value", within_s)


async def take_off(drone: System, alt_home_m: float) -> None:
    """Arms the vehicle and takes off to an altitude above home."""
    await drone.action.set_takeoff_altitude(alt_home_m)
    await drone.action.arm()
    await drone.action.takeoff()
    await until(
        drone.telemetry.position(),
        lambda p: p.relative_altitude_m > alt_home_m - 0.7,
        f"altitude of {alt_home_m} m above home",
    )


async def land(drone: System) -> None:
    """Lands and waits until the vehicle has disarmed itself."""
    await drone.action.land()
    await until(drone.telemetry.armed(), lambda armed: not armed, "disarming after the landing")
