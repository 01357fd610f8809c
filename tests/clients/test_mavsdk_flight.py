"""MAVSDK's action, follow-me, manual-control and failure plug-ins in flight."""

from __future__ import annotations

import asyncio
import math

import pytest
from mavsdk import System
from mavsdk.action import ActionError, ActionResult, OrbitYawBehavior
from mavsdk.failure import FailureError, FailureResult, FailureType, FailureUnit
from mavsdk.follow_me import Config, TargetLocation
from mavsdk.telemetry import FlightMode, LandedState, Position

from tests.clients.mavsdk_drone import TIMEOUT_S, connected_drone, land, next_value, take_off, until

METRES_PER_DEGREE = 111_195.0

pytestmark = pytest.mark.timeout(TIMEOUT_S + 20.0)


def offset_position(position: Position, north_m: float, east_m: float) -> tuple[float, float]:
    """Latitude and longitude of a point north and east of a position."""
    metres_per_degree_east = METRES_PER_DEGREE * math.cos(math.radians(position.latitude_deg))
    return (
        position.latitude_deg + north_m / METRES_PER_DEGREE,
        position.longitude_deg + east_m / metres_per_degree_east,
    )


def distance_m(position: Position, lat_deg: float, lon_deg: float) -> float:
    metres_per_degree_east = METRES_PER_DEGREE * math.cos(math.radians(lat_deg))
    return math.hypot(
        (position.latitude_deg - lat_deg) * METRES_PER_DEGREE,
        (position.longitude_deg - lon_deg) * metres_per_degree_east,
    )


async def _until_mode(drone: System, mode: FlightMode) -> None:
    await until(drone.telemetry.flight_mode(), lambda value: value is mode, f"mode {mode}")


def test_goto_orbit_and_return_are_flown() -> None:
    asyncio.run(_goto_orbit_and_return())


async def _goto_orbit_and_return() -> None:
    async with asyncio.timeout(TIMEOUT_S), connected_drone() as drone:
        with pytest.raises(ActionError) as refused:
            await drone.action.terminate()
        assert refused.value._result.result is ActionResult.Result.COMMAND_DENIED
        home = await next_value(drone.telemetry.home())
        await take_off(drone, 8.0)
        await until(drone.telemetry.landed_state(), lambda state: state is LandedState.IN_AIR, "in the air")
        with pytest.raises(ActionError) as refused:
            await drone.action.disarm()
        assert refused.value._result.result in (
            ActionResult.Result.COMMAND_DENIED, ActionResult.Result.COMMAND_DENIED_NOT_LANDED,
        )  # fmt: skip

        lat, lon = offset_position(home, 15.0, 5.0)
        await drone.action.goto_location(lat, lon, home.absolute_altitude_m + 10.0, 90.0)
        arrived_at = await until(
            drone.telemetry.position(), lambda p: distance_m(p, lat, lon) < 1.0, "arrival"
        )
        assert arrived_at.relative_altitude_m == pytest.approx(10.0, abs=1.5)
        await until(drone.telemetry.heading(), lambda h: abs(h.heading_deg - 90.0) < 5.0, "heading east")

        await drone.action.set_current_speed(4.0)
        await drone.action.do_orbit(
            6.0, 3.0, OrbitYawBehavior.HOLD_FRONT_TO_CIRCLE_CENTER, lat, lon, home.absolute_altitude_m + 10.0
        )
        sectors: set[int] = set()

        def completes_circle(position: Position) -> bool:
            radius_m = distance_m(position, lat, lon)
            if abs(radius_m - 6.0) < 1.0:
                angle = math.atan2(position.longitude_deg - lon, position.latitude_deg - lat)
                sectors.add(round(angle / math.radians(45.0)) % 8)
            return len(sectors) == 8

        await until(drone.telemetry.position(), completes_circle, "a whole circle at 6 m")

        await drone.action.hold()
        await _until_mode(drone, FlightMode.HOLD)
        await drone.action.set_return_to_launch_altitude(14.0)
        assert await drone.action.get_return_to_launch_altitude() == pytest.approx(14.0)
        await drone.action.return_to_launch()
        await _until_mode(drone, FlightMode.RETURN_TO_LAUNCH)
        await until(drone.telemetry.position(), lambda p: p.relative_altitude_m > 12.5, "the return altitude")
        await until(drone.telemetry.armed(), lambda armed: not armed, "home and disarmed")
        end = await next_value(drone.telemetry.position())
        assert distance_m(end, home.latitude_deg, home.longitude_deg) < 1.5


def test_follow_me_keeps_its_distance_from_a_target_that_moves() -> None:
    asyncio.run(_follow_target())


async def _follow_target() -> None:
    async with asyncio.timeout(TIMEOUT_S), connected_drone() as drone:
        home = await next_value(drone.telemetry.home())
        config = Config(8.0, 6.0, 0.1, Config.FollowAltitudeMode.CONSTANT, 5.0, 180.0)
        await drone.follow_me.set_config(config)
        assert (await drone.follow_me.get_config()).follow_distance_m == pytest.approx(6.0)
        await take_off(drone, 8.0)
        await drone.follow_me.start()
        await _until_mode(drone, FlightMode.FOLLOW_ME)
        assert await drone.follow_me.is_active()

        target_arrived = asyncio.Event()

        async def send_target() -> None:
            north_m = 0.0
            while True:
                lat, lon = offset_position(home, north_m, 0.0)
                location = TargetLocation(lat, lon, home.absolute_altitude_m, 1.0, 0.0, 0.0)
                await drone.follow_me.set_target_location(location)
                if north_m == 25.0:
                    target_arrived.set()
                await asyncio.sleep(0.3)
                north_m = min(25.0, north_m + 0.9)

        target_task = asyncio.ensure_future(send_target())
        await target_arrived.wait()
        lat, lon = offset_position(home, 25.0, 0.0)
        await until(
            drone.telemetry.position(),
            lambda p: abs(distance_m(p, lat, lon) - 6.0) < 1.5 and p.latitude_deg < lat,
            "6 m behind the target at the end",
            60,
        )
        last_target = await drone.follow_me.get_last_location()
        assert last_target.latitude_deg == pytest.approx(lat, abs=1e-6)
        target_task.cancel()
        await drone.follow_me.stop()
        await _until_mode(drone, FlightMode.HOLD)
        await land(drone)


def test_manual_control_flies_position_and_altitude() -> None:
    asyncio.run(_fly_manually())


async def _fly_manually() -> None:
    async with asyncio.timeout(TIMEOUT_S), connected_drone() as drone:
        sticks = [0.0, 0.0, 0.5, 0.0]

        async def send_sticks() -> None:
            while True:
                await drone.manual_control.set_manual_control_input(*sticks)
                await asyncio.sleep(0.03)

        pilot_task = asyncio.ensure_future(send_sticks())
        await asyncio.sleep(0.3)
        await take_off(drone, 5.0)
        await drone.manual_control.start_position_control()
        await _until_mode(drone, FlightMode.POSCTL)
        sticks[:] = [0.6, 0.0, 0.5, 0.0]
        ned = drone.telemetry.position_velocity_ned
        await until(ned(), lambda n: n.velocity.north_m_s > 1.5, "forward flight by stick")
        sticks[:] = [0.0, 0.0, 0.5, 0.0]
        await until(ned(), lambda n: abs(n.velocity.north_m_s) < 0.4, "a stop after the stick is released")
        await drone.manual_control.start_altitude_control()
        await _until_mode(drone, FlightMode.ALTCTL)
        sticks[:] = [0.0, 0.0, 1.0, 0.0]
        await until(ned(), lambda n: n.velocity.down_m_s < -1.5, "a climb by throttle")
        sticks[:] = [0.0, 0.0, 0.5, 0.0]
        await until(ned(), lambda n: abs(n.velocity.down_m_s) < 0.3, "constant altitude")
        await land(drone)
        pilot_task.cancel()


def test_failures_are_injected_only_if_failure_injection_is_enabled() -> None:
    asyncio.run(_inject_failures())


async def _inject_failures() -> None:
    async with asyncio.timeout(TIMEOUT_S), connected_drone() as drone:
        # Enabled in simulation, disabled on a real vehicle.
        assert await drone.param.get_param_int("SYS_FAILURE_EN") == 1
        await drone.param.set_param_int("SYS_FAILURE_EN", 0)
        with pytest.raises(FailureError) as refused:
            await drone.failure.inject(FailureUnit.SENSOR_GPS, FailureType.OFF, 0)
        assert refused.value._result.result in (
            FailureResult.Result.DENIED, FailureResult.Result.DISABLED,
        )  # fmt: skip
        await drone.param.set_param_int("SYS_FAILURE_EN", 1)
        await take_off(drone, 6.0)
        with pytest.raises(FailureError):
            # As in PX4's own simulation, sensor failures are injected by parameters, not by the command.
            await drone.failure.inject(FailureUnit.SENSOR_GPS, FailureType.OFF, 0)
        assert (await next_value(drone.telemetry.gps_info())).num_satellites == 10
        await drone.param.set_param_int("SIM_GPS_USED", 0)
        await until(
            drone.telemetry.gps_info(), lambda gps: gps.num_satellites == 0, "a receiver without a fix"
        )
        await until(drone.telemetry.health(), lambda h: not h.is_global_position_ok, "no global position")
        # Without a position and without stick input PX4 descends level.
        await until(drone.telemetry.armed(), lambda armed: not armed, "a descent without commands")
