"""A program's offboard block ends by an error, by Ctrl-C, by cancellation, or by a killed server."""

from __future__ import annotations

import asyncio
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gcs_server.client import Gcs, SyncGcs, Unreachable
from tests.e2e.fast_station import FAST_OPTIONS, take_off_to_hold
from tests.station import (
    end_process,
    free_port,
    running_process,
    running_server,
    running_vehicles,
    wait_until,
)

pytestmark = pytest.mark.realtime

ENABLE_CTRL_C = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
"""Python ignores Ctrl-C in a background job, in which the tests may run."""
PROGRAM = """
import sys, time
from gcs_server.client import SyncGcs
with SyncGcs(sys.argv[1], client="sync") as gcs:
    drone = gcs.vehicle("101")
    {before}
    with drone.offboard(velocity_ned_m_s=(1, 0, 0), valid_for_s=60) as stream:
        print("flying", flush=True)
        {inside}
"""


@pytest.fixture(scope="module")
def url_and_drone() -> Iterator[Any]:
    """URL of the server and a vehicle in flight, for all tests of this file, at three times real time."""
    port = free_port()
    with (
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, _),
        running_vehicles(port, arguments=FAST_OPTIONS),
        SyncGcs(url, client="e2e") as gcs,
    ):
        drone = gcs.wait_for_vehicle("101", ready=True, timeout_s=120)
        take_off_to_hold(drone)
        yield url, drone


def check_ends_in_hold(drone: Any) -> None:
    """Waits for the end of the stream; checks that the vehicle reports Hold."""
    wait_until(lambda: drone.request("GET", "/offboard")["state"] == "idle", "the stream's end")
    assert drone.status()["mode"] == "hold"


def start_program(source: str, url: str, *, inside: str, before: str = "pass") -> Any:
    code = ENABLE_CTRL_C + source.format(inside=inside, before=before)
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return running_process([sys.executable, "-c", code, url], **options)


@pytest.mark.parametrize("inside", ["time.sleep(60)", "while True: stream.velocity_ned(1, 0, 0)"])
def test_ctrl_c_ends_a_sync_program_and_puts_the_vehicle_into_hold(url_and_drone: Any, inside: str) -> None:
    url, drone = url_and_drone
    with start_program(PROGRAM, url, inside=inside) as program:
        assert program.stdout.readline() == b"flying\n"
        time.sleep(0.3)
        program.send_signal(signal.SIGINT)
        _, stderr = program.communicate(timeout=60)
    assert b"KeyboardInterrupt" in stderr
    check_ends_in_hold(drone)


@pytest.mark.parametrize(
    "delay_s", [0.1, *(pytest.param(each, marks=pytest.mark.story) for each in (0.01, 0.3))]
)
def test_ctrl_c_during_the_start_ends_a_sync_program_and_puts_the_vehicle_into_hold(
    url_and_drone: Any, delay_s: float
) -> None:
    url, drone = url_and_drone
    before = 'print("starting", flush=True)'
    with start_program(PROGRAM, url, before=before, inside="time.sleep(60)") as program:
        assert program.stdout.readline() == b"starting\n"
        time.sleep(delay_s)
        program.send_signal(signal.SIGINT)
        _, stderr = program.communicate(timeout=30)
    assert b"KeyboardInterrupt" in stderr
    check_ends_in_hold(drone)


def test_an_error_in_the_block_is_raised_and_the_vehicle_ends_in_hold(url_and_drone: Any) -> None:
    _, drone = url_and_drone
    with pytest.raises(ZeroDivisionError), drone.offboard(velocity_ned_m_s=(1, 0, 0), valid_for_s=60):
        print(1 / 0)
    check_ends_in_hold(drone)


@pytest.mark.parametrize("ending", ["cancel", "timeout", "cancel twice"])
def test_cancellation_of_an_asynchronous_program_puts_the_vehicle_into_hold(
    url_and_drone: Any, ending: str
) -> None:
    url, drone = url_and_drone

    async def fly() -> None:
        async with (
            Gcs(url, client="async") as gcs,
            gcs.vehicle("101").offboard(velocity_ned_m_s=(1, 0, 0), valid_for_s=60),
        ):
            await asyncio.sleep(60)

    async def scenario() -> None:
        if ending == "timeout":
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(4):
                    await fly()
            return
        task = asyncio.ensure_future(fly())
        await asyncio.sleep(4)
        task.cancel()
        if ending == "cancel twice":
            await asyncio.sleep(0.05)
            task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task

    asyncio.run(scenario())
    check_ends_in_hold(drone)


def test_the_start_of_a_client_that_closes_its_connection_is_ended(
    url_and_drone: Any,
) -> None:
    url, drone = url_and_drone
    drone.control.release()
    host, port = url.removeprefix("http://").split(":")
    body = b'{"setpoint": {"type": "velocity", "velocity_ned_m_s": [1, 0, 0]}, "valid_for_s": 0.5}'
    with socket.create_connection((host, int(port))) as client:
        head = f"POST /api/v1/vehicles/101/offboard/start HTTP/1.1\r\nHost: {host}\r\nX-Client: gone\r\n"
        head += f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n\r\n"
        client.sendall(head.encode() + body)
        wait_until(lambda: drone.request("GET", "/offboard")["state"] == "starting", "the start")
    wait_until(lambda: drone.request("GET", "/offboard")["state"] == "idle", "the end of the start")
    assert "closed its connection" in drone.request("GET", "/offboard")["ended"]
    assert drone.status()["mode"] == "hold"


def test_a_failed_stop_is_reported_in_addition_to_the_blocks_error() -> None:
    """The server is killed inside the block, so the client cannot put the vehicle into Hold; a note of the
    error says this."""
    port = free_port()
    with (
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, process),
        running_vehicles(port, arguments=FAST_OPTIONS),
        SyncGcs(url) as gcs,
    ):
        drone = gcs.wait_for_vehicle("101", ready=True, timeout_s=120)
        with (
            pytest.raises(RuntimeError, match="the block's error") as raised,
            drone.offboard(position_ned_m=(0, 0, 0), valid_for_s=60),
        ):
            end_process(process, signal.SIGKILL)
            raise RuntimeError("the block's error")
        assert any("Hold" in note for note in raised.value.__notes__)
        with pytest.raises(Unreachable):
            drone.status()


def test_sigterm_puts_the_vehicle_into_hold_before_the_server_ends(tmp_path: Path) -> None:
    port = free_port()
    log = tmp_path / "server.log"
    with running_vehicles(port, arguments=FAST_OPTIONS):
        with running_server([f"udpin://127.0.0.1:{port}"], log=log) as (url, process):
            with SyncGcs(url) as gcs:
                drone = gcs.wait_for_vehicle("101", ready=True, timeout_s=120)
                take_off_to_hold(drone, 6)
                started = drone.request(
                    "POST",
                    "/offboard/start",
                    {"setpoint": {"type": "velocity", "velocity_ned_m_s": [1, 0, 0]}, "valid_for_s": 600},
                )
                assert started["streaming"]
            process.send_signal(signal.SIGTERM)
            process.wait(10)
        with running_server([f"udpin://127.0.0.1:{port}"]) as (url, _), SyncGcs(url) as gcs:
            drone = gcs.wait_for_vehicle("101", timeout_s=60)
            status = drone.status()
            assert (status["mode"], status["armed"]) == ("hold", True)
    assert b"put into Hold" in log.read_bytes()
