"""Every kind of setpoint that MAVSDK streams, in one flight."""

from __future__ import annotations

import asyncio
import math

import pytest
from mavsdk import System
from mavsdk.offboard import (
    AccelerationNed,
    Attitude,
    AttitudeRate,
    OffboardError,
    OffboardResult,
    PositionGlobalYaw,
    PositionNedYaw,
    VelocityBodyYawspeed,
    VelocityNedYaw,
)
from mavsdk.telemetry import FlightMode, PositionVelocityNed

from tests.clients.mavsdk_drone import TIMEOUT_S, connected_drone, land, take_off, until

pytestmark = pytest.mark.timeout(TIMEOUT_S + 20.0)


@pytest.mark.parametrize("guarded", [False, True], ids=["direct", "guarded"])
def test_every_kind_of_setpoint_is_flown(guarded: bool) -> None:
    asyncio.run(_fly(guarded))


async def _fly(guarded: bool) -> None:
    async with asyncio.timeout(TIMEOUT_S), connected_drone(guarded=guarded) as drone:
        with pytest.raises(OffboardError) as refused:
            await drone.offboard.start()
        assert refused.value._result.result is OffboardResult.Result.NO_SETPOINT_SET
        await take_off(drone, 5.0)

        await drone.offboard.set_position_ned(PositionNedYaw(0.0, 0.0, -6.0, 90.0))
        await drone.offboard.start()
        assert await drone.offboard.is_active()
        await until(drone.telemetry.flight_mode(), lambda mode: mode is FlightMode.OFFBOARD, "Offboard")
        await until(drone.telemetry.heading(), lambda h: abs(h.heading_deg - 90.0) < 4.0, "nose to the east")
        await drone.offboard.set_position_ned(PositionNedYaw(5.0, 3.0, -6.0, 0.0))
        await _until_motion(drone, "5 m north", lambda n: math.dist(_position(n), (5.0, 3.0, -6.0)) < 1.0)

        await drone.offboard.set_velocity_ned(VelocityNedYaw(0.0, -2.0, 0.0, 0.0))
        await _until_motion(drone, "west at 2 m/s", lambda n: n.velocity.east_m_s < -1.4)
        await drone.offboard.set_velocity_body(VelocityBodyYawspeed(0.0, 2.0, 0.0, 0.0))
        await _until_motion(drone, "to the right, which is east", lambda n: n.velocity.east_m_s > 1.4)
        await drone.offboard.set_velocity_body(VelocityBodyYawspeed(0.0, 0.0, 0.0, 60.0))
        await until(
            drone.telemetry.attitude_angular_velocity_body(),
            lambda rates: rates.yaw_rad_s > math.radians(40.0),
            "a turn to the right",
        )
        await drone.offboard.set_position_velocity_ned(
            PositionNedYaw(0.0, 0.0, -7.0, 0.0), VelocityNedYaw(0.0, 0.0, 0.0, 0.0)
        )
        await _until_motion(
            drone, "back over the start", lambda n: math.dist(_position(n), (0.0, 0.0, -7.0)) < 1.0
        )
        await drone.offboard.set_position_velocity_acceleration_ned(
            PositionNedYaw(0.0, 4.0, -7.0, 0.0),
            VelocityNedYaw(0.0, 0.0, 0.0, 0.0),
            AccelerationNed(0.0, 0.0, 0.0),
        )
        await _until_motion(drone, "4 m to the east", lambda n: n.position.east_m > 3.0)

        home = await until(drone.telemetry.home(), lambda _: True, "home")
        await drone.offboard.set_position_global(
            PositionGlobalYaw(
                home.latitude_deg, home.longitude_deg, 9.0, 0.0, PositionGlobalYaw.AltitudeType.REL_HOME
            )
        )
        await until(
            drone.telemetry.position(),
            lambda p: (
                abs(p.relative_altitude_m - 9.0) < 1.0 and abs(p.longitude_deg - home.longitude_deg) < 1.5e-5
            ),
            "9 m over home",
        )

        await drone.offboard.set_acceleration_ned(AccelerationNed(1.5, 0.0, 0.0))
        await _until_motion(drone, "accelerating to the north", lambda n: n.velocity.north_m_s > 1.0)
        await drone.offboard.set_attitude(Attitude(0.0, 8.0, 0.0, 0.52))
        await until(drone.telemetry.attitude_euler(), lambda a: a.pitch_deg > 6.0, "pitch up")
        await drone.offboard.set_attitude_rate(AttitudeRate(0.0, 0.0, 45.0, 0.52))
        await until(
            drone.telemetry.attitude_angular_velocity_body(),
            lambda rates: rates.yaw_rad_s > math.radians(30.0),
            "a turn by yaw rate",
        )

        await drone.offboard.stop()
        assert not await drone.offboard.is_active()
        await until(drone.telemetry.flight_mode(), lambda mode: mode is FlightMode.HOLD, "Hold")
        await land(drone)


def _position(ned: PositionVelocityNed) -> tuple[float, float, float]:
    return ned.position.north_m, ned.position.east_m, ned.position.down_m


async def _until_motion(drone: System, what: str, condition: object) -> None:
    assert callable(condition)
    await until(drone.telemetry.position_velocity_ned(), condition, what)
