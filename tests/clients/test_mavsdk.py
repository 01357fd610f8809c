"""Programs of MAVSDK users with `python -m vehicle_sim`, while the server is connected to the same
vehicle."""

from __future__ import annotations

import asyncio
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from mavsdk import System
from mavsdk.offboard import PositionNedYaw

from tests.clients.observed_vehicle import ObservedVehicle
from tests.clients.seed_program import gimbal_program, has_reached
from tests.station import free_port


def test_the_gimbal_program_runs_to_its_end_and_the_gimbal_moves(
    reference_data: Path, observed_vehicle: ObservedVehicle, tmp_path: Path
) -> None:
    path = gimbal_program(reference_data, tmp_path, observed_vehicle.tcp_port)
    if path is None:
        pytest.skip("the document with the gimbal program is not beside this checkout")

    result = subprocess.run(
        [sys.executable, "-W", "ignore", str(path)], capture_output=True, text=True, timeout=120, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr
    lines = result.stdout.splitlines()
    assert "Vehicle ARMED." in lines
    assert "Releasing gimbal control..." in lines
    assert not [line for line in lines if "failed" in line.lower()]
    assert lines[-1] == "--- Test Complete. Disarming. ---"

    gimbal_states = observed_vehicle.history("gimbal")
    # The program requests 90°; PX4's servo outputs reach half of MNT_RANGE_ROLL and MNT_RANGE_PITCH (90°) to
    # each side.
    assert has_reached(gimbal_states, roll_deg=45, pitch_deg=0)
    assert has_reached(gimbal_states, roll_deg=0, pitch_deg=45)
    controllers = {tuple(value["primary_control"] or ()) for value in gimbal_states}
    assert controllers > {()}, "gimbal control was not requested and released"
    # The program ends after the acknowledgement of the disarm command; the next heartbeat shows the state.
    observed_vehicle.drone.until_disarmed(timeout_s=10)


def test_mavsdk_arms_takes_off_flies_offboard_and_lands(observed_vehicle: ObservedVehicle) -> None:
    asyncio.run(_fly(observed_vehicle.tcp_port))

    modes = [value["mode"] for value in observed_vehicle.history("status")]
    assert [mode for mode in ("takeoff", "offboard", "land") if mode in modes] == [
        "takeoff",
        "offboard",
        "land",
    ]
    north_m = [value["position_ned_m"][0] for value in observed_vehicle.history("local_position")]
    assert max(north_m) == pytest.approx(4, abs=1.2)
    assert observed_vehicle.drone.status()["landed_state"] == "on_ground"


async def _fly(tcp_port: int) -> None:
    drone = System(port=free_port(socket.SOCK_STREAM))
    async with asyncio.timeout(200):
        await drone.connect(system_address=f"tcpout://127.0.0.1:{tcp_port}")
        async for health in drone.telemetry.health():
            if health.is_armable and health.is_local_position_ok:
                break
        await drone.action.set_takeoff_altitude(3.0)
        await drone.action.arm()
        await drone.action.takeoff()
        async for position in drone.telemetry.position():
            if position.relative_altitude_m > 2.0:
                break
        await drone.offboard.set_position_ned(PositionNedYaw(4.0, 0.0, -4.0, 0.0))
        await drone.offboard.start()
        async for odometry in drone.telemetry.position_velocity_ned():
            if odometry.position.north_m > 3.5:
                break
        await drone.offboard.stop()
        await drone.action.land()
        async for armed in drone.telemetry.armed():
            if not armed:
                break
