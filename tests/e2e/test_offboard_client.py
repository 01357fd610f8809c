"""The Python client with real processes: offboard blocks, streamed setpoints, a path, limits."""

from __future__ import annotations

import asyncio
import math
from typing import Any

import pytest

from gcs_server.client import Gcs, Invalid, Refused, setpoints
from tests.e2e.fast_station import Station, take_off_to_hold

pytestmark = pytest.mark.realtime


def distance_m(first: Any, second: Any) -> float:
    return math.dist(tuple(first), tuple(second))


def test_streamed_setpoints_and_a_path_are_flown_within_the_limits(station: Station) -> None:
    take_off_to_hold(station.drone)
    asyncio.run(fly_setpoints_and_path(station.url))


async def fly_setpoints_and_path(url: str) -> None:
    async with Gcs(url, client="path", client_id="e2e") as gcs:
        drone = gcs.vehicle("101")
        limits = await drone.set_offboard_limits(speed_max_m_s=6, distance_max_m=60)
        assert limits["vehicle"]["speed_max_m_s"] == 12.0
        assert limits["operator"]["distance_max_m"] == 60.0
        failsafe = await drone.set_offboard_failsafe("hold", after_s=1.5)
        assert (failsafe["action"], failsafe["after_s"]) == ("hold", 1.5)

        position = await drone.position_ned_m()
        # Without a setpoint the block holds the position.
        async with drone.offboard(valid_for_s=5) as offboard:
            assert offboard.started["ordered_type"] == "position_body"
            assert distance_m(offboard.started["setpoint"]["position_ned_m"], position) < 2
            with pytest.raises(Refused, match="limit of 60 m from home"):
                await offboard.position_ned(100, 0, -10)
            with pytest.raises(Refused, match="MAVLink link carries no actuators"):
                await offboard.actuators([0.5] * 4)
            with pytest.raises(Invalid, match="north and east are needed together"):
                await offboard.send({"type": "position", "position_ned_m": [1, None, -5]})

            async with offboard.live() as live:
                for step in range(60):
                    reply = await live.velocity_body(9.0, 0.0, 0.0, yaw_rate_ned_rad_s=0.3)
                    assert reply["applied"]["type"] == "velocity_body", step
                    await asyncio.sleep(0.01)
                assert math.hypot(*reply["applied"]["velocity_frd_m_s"]) == pytest.approx(6.0, abs=0.01)
                assert "speed limited to 6 m/s" in reply["limited"]
                with pytest.raises(Invalid, match="length 1"):
                    await live.attitude(0.5, q_ned_frd=(1, 1, 0, 0))
                start = await drone.position_ned_m()
                await live.position_body(0, 0, 0)

            await asyncio.sleep(1.5)
            start = await drone.position_ned_m()
            corners = ((0, 0), (4, 0), (4, 4))
            points = [(3.0 * i, (start[0] + n, start[1] + e, start[2])) for i, (n, e) in enumerate(corners)]
            await offboard.follow_path(points)
            await asyncio.sleep(0.7)
            assert distance_m(await drone.position_ned_m(), points[-1][1]) < 1.5
            status = await offboard.status()
            assert status["ordered_type"] == "path"
            assert status["available"]["attitude"] == {"can": True, "why_not": None, "needs": ["heading"]}
            assert "MAVLink link" in status["available"]["thrust_torque"]["why_not"]
            assert status["health"]["position_error_m"] < 1.5
            assert status["failsafe"]["action"] == "hold"
        assert (await drone.status())["mode"] == "hold"
        with pytest.raises(Refused, match="no setpoint stream"):
            await drone.request("POST", "/offboard/setpoint", {"setpoint": setpoints.position_ned(0, 0, -10)})
