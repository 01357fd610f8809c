"""A user's MAVSDK programs against `python -m vehicle_sim`, over real sockets."""

import asyncio
import re
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("mavsdk", reason="MAVSDK is a test dependency of its own: pip install 'mavsdk>=3,<4'")


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def tcp_port() -> Iterator[int]:
    """A vehicle with nothing but a TCP port."""
    port = free_port()
    vehicle = subprocess.Popen(
        [sys.executable, "-m", "vehicle_sim", "--gcs-remote-port", "0", "--no-api", "--tcp-port", str(port)],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert vehicle.stdout is not None
        assert "ready" in vehicle.stdout.readline()
        yield port
    finally:
        vehicle.terminate()
        assert vehicle.wait(5) == 0, "SIGTERM ends it cleanly"


def test_the_gimbal_program_runs_to_its_end(shared: Path, tcp_port: int, tmp_path: Path) -> None:
    files = sorted((shared / "seeds").glob("000*.txt"))
    if not files:
        pytest.skip("the seed with the gimbal program is not beside this checkout")
    text = files[0].read_text(encoding="utf-8")
    program = text[text.rindex("#!/usr/bin/env python3") :]
    program, replaced = re.subn(r"tcpout://[\d.]+:5760", f"tcpout://127.0.0.1:{tcp_port}", program)
    assert replaced == 1
    path = tmp_path / "program.py"
    path.write_text(program, encoding="utf-8")
    time.sleep(3.0)  # the estimator of a vehicle just booted; the program arms without waiting for it
    run = subprocess.run(
        [sys.executable, "-W", "ignore", str(path)], capture_output=True, text=True, timeout=60, check=False
    )
    assert run.returncode == 0, run.stdout + run.stderr
    lines = run.stdout.splitlines()
    assert "Vehicle ARMED." in lines
    assert "Releasing gimbal control..." in lines
    assert not [line for line in lines if "failed" in line.lower()]
    assert lines[-1] == "--- Test Complete. Disarming. ---"


def test_mavsdk_arms_takes_off_flies_offboard_and_lands(tcp_port: int) -> None:
    asyncio.run(_fly(tcp_port, free_port()))


async def _fly(tcp_port: int, grpc_port: int) -> None:
    from mavsdk import System
    from mavsdk.offboard import PositionNedYaw

    drone = System(port=grpc_port)
    async with asyncio.timeout(75):
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
            if odometry.position.north_m > 3.0:
                break
        await drone.offboard.stop()
        await drone.action.land()
        async for in_air in drone.telemetry.in_air():
            if not in_air:
                break
        async for armed in drone.telemetry.armed():
            if not armed:
                break
