"""MAVSDK streaming a position: `python -m tests.bench.mavsdk_streamer UDP_PORT`; prints a line when it
streams."""

from __future__ import annotations

import asyncio
import socket
import sys

from mavsdk import System
from mavsdk.offboard import PositionNedYaw

from tests.station import free_port


async def main(port: str) -> None:
    """Runs until it is terminated."""
    drone = System(port=free_port(socket.SOCK_STREAM))
    await drone.connect(system_address=f"udpin://127.0.0.1:{port}")
    async for state in drone.core.connection_state():
        if state.is_connected:
            break
    await drone.offboard.set_position_ned(PositionNedYaw(0.0, 0.0, -5.0, 0.0))
    await drone.offboard.start()
    print("streaming", flush=True)
    await asyncio.Event().wait()


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1]))
