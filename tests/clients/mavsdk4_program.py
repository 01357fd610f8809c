"""What users of MAVSDK 4 write, in its own environment: no pause between commands, each heard in its place.

`python mavsdk4_program.py PORT`: the vehicle's TCP port on this machine.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import AsyncIterator, Callable
from typing import Any

from mavsdk import ComponentType, Configuration
from mavsdk.asyncio import Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.telemetry import FlightMode

METRES_A_DEGREE = 111_195.0
NORTH_M, UP_M = 40.0, 10.0


async def until(stream: AsyncIterator[Any], holds: Callable[[Any], object], what: str) -> Any:
    last = None
    try:
        async with asyncio.timeout(100.0):
            async for value in stream:
                last = value
                if holds(value):
                    return value
    except TimeoutError:
        pass
    raise SystemExit(f"no {what}; last came {last}")


async def fly(port: int) -> None:
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with Mavsdk(configuration) as mavsdk:
        await mavsdk.add_any_connection(f"tcpout://127.0.0.1:{port}")
        system = await mavsdk.first_autopilot(timeout_s=30.0)
        action, telemetry = ActionAsync(system), TelemetryAsync(system)
        await until(telemetry.subscribe_health(), lambda h: h.is_armable and h.is_home_position_ok, "ready")
        home = await until(telemetry.subscribe_home(), lambda _: True, "home")
        lat_deg = home.latitude_deg + NORTH_M / METRES_A_DEGREE

        # A go-to before lift-off is flown.
        await action.arm()
        await action.takeoff()
        await action.goto_location(lat_deg, home.longitude_deg, home.absolute_altitude_m + UP_M, 0.0)
        await until(
            telemetry.subscribe_position(),
            lambda p: abs(p.latitude_deg - lat_deg) * METRES_A_DEGREE < 2.0 and p.relative_altitude_m > 8.0,
            "arrival",
        )
        # Hold, and Return at once: it ends in Return.
        await action.hold()
        await action.return_to_launch()
        await until(
            telemetry.subscribe_flight_mode(), lambda mode: mode == FlightMode.RETURN_TO_LAUNCH, "Return"
        )
        await action.land()
        await until(telemetry.subscribe_armed(), lambda armed: not armed, "landing")


if __name__ == "__main__":
    asyncio.run(fly(int(sys.argv[1])))
