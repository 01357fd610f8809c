"""A client, the server or the stream process is killed in flight: real processes, killed by signals."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from gcs_server.client import SyncGcs, Unreachable
from tests.e2e.fast_station import FAST_OPTIONS, take_off_to_hold
from tests.station import (
    FIRST_TEST_INSTANCE,
    end_process,
    free_port,
    is_up,
    running_process,
    running_vehicles,
    server_command,
    wait_until,
)

pytestmark = pytest.mark.realtime

FLY_NORTH_PROGRAM = """
import sys, time
from gcs_server.client import SyncGcs
with SyncGcs(sys.argv[1], client="victim") as gcs:
    drone = gcs.vehicle("101")
    with drone.offboard(velocity_ned_m_s=(3, 0, 0), valid_for_s=0.5, hold_for_s=2) as stream:
        print("flying", flush=True)
        while True:
            stream.velocity_ned(3, 0, 0)
            time.sleep(0.05)
"""

RETURN_SLOWLY = ["--param", "RTL_LAND_DELAY=20"]
"""So that the vehicle still returns when the next server is ready, also on a busy machine."""
LOG_BYTES = 3_000_000
START_REQUEST = {"setpoint": {"type": "position", "position_ned_m": [0, 0, -25]}, "valid_for_s": 60}


def speed_m_s(drone: Any) -> float:
    """Ground speed [m/s]."""
    north, east, _ = drone.topic("local_position")["velocity_ned_m_s"]
    return float((north**2 + east**2) ** 0.5)


def test_the_vehicle_stops_and_holds_after_its_client_is_killed(station: Any) -> None:
    take_off_to_hold(station.drone)
    with running_process(
        [sys.executable, "-c", FLY_NORTH_PROGRAM, station.url], stdout=subprocess.PIPE
    ) as client:
        assert client.stdout is not None
        assert client.stdout.readline() == b"flying\n"
        wait_until(lambda: speed_m_s(station.drone) > 2, "the flight north")
        end_process(client, signal.SIGKILL)
        killed_unix_s = time.clock_gettime(time.CLOCK_REALTIME)

        def expired_unix_s() -> float | None:
            messages = station.drone.request("GET", "/messages")["messages"]
            rows = [(m["unix_s"], m["data"].get("source"), m["data"].get("code")) for m in messages]
            times_s = [unix_s for unix_s, source, code in rows if (source, code) == ("offboard", "expired")]
            return times_s[-1] if times_s else None

        wait_until(expired_unix_s, "the setpoint's expiry")
        expired_s = expired_unix_s()
        assert expired_s is not None
        assert expired_s - killed_unix_s < 0.5 + 0.5, (
            "expired later than valid_for_s plus one heartbeat of the server"
        )
    wait_until(lambda: speed_m_s(station.drone) < 0.5, "a vehicle at rest")
    station.drone.until(lambda v: v["status"]["mode"] == "hold", timeout_s=30, what="PX4's Hold mode")


def test_after_a_killed_server_the_failsafe_acts_and_the_next_server_sends_nothing(
    tmp_path: Path,
) -> None:
    port, http_port = free_port(), free_port(socket.SOCK_STREAM)
    url = f"http://127.0.0.1:{http_port}"
    command = server_command(http_port, [f"udpin://127.0.0.1:{port}"], tmp_path)
    with running_vehicles(port, arguments=[*FAST_OPTIONS, *RETURN_SLOWLY]):
        with running_process(command) as first_server:
            wait_until(lambda: is_up(url), "the first server")
            with SyncGcs(url, client="e2e") as gcs:
                drone = gcs.wait_for_vehicle("101", ready=True, timeout_s=120)
                take_off_to_hold(drone, 60)
                with pytest.raises(Unreachable), drone.offboard(position_ned_m=(0, 0, -60)) as stream:
                    assert "returns to launch" in stream.started["if_stream_stops"]
                    end_process(first_server, signal.SIGKILL)
        with running_process(command):
            wait_until(lambda: is_up(url), "the second server")
            with SyncGcs(url, client="e2e") as gcs:
                drone = gcs.wait_for_vehicle("101", timeout_s=60)
                state = drone.until(lambda v: v["status"]["mode"] == "rtl", what="PX4's failsafe")
                assert state["status"]["armed"], "the vehicle is not armed"
                assert drone.request("GET", "/offboard")["state"] == "idle"
                drone.until_disarmed(timeout_s=120)
                assert drone.status()["landed_state"] == "on_ground"
                journal = gcs.request("GET", "/journal")["entries"]
                other_entries = [entry for entry in journal if entry["client"] != "e2e"]
                assert not other_entries, "the server sent a command by itself"


def test_after_a_killed_stream_process_the_failsafe_acts_and_a_new_stream_can_start(tmp_path: Path) -> None:
    port, http_port = free_port(), free_port(socket.SOCK_STREAM)
    url = f"http://127.0.0.1:{http_port}"
    command = server_command(http_port, [f"udpin://127.0.0.1:{port}"], tmp_path)
    with running_vehicles(port, arguments=FAST_OPTIONS), running_process(command) as server:
        wait_until(lambda: is_up(url), "the server")
        with SyncGcs(url, client="e2e") as gcs:
            drone = gcs.wait_for_vehicle("101", ready=True, timeout_s=120)
            take_off_to_hold(drone, 25)
            drone.request("POST", "/offboard/start", START_REQUEST)
            os.kill(stream_process_pid(server.pid), signal.SIGKILL)
            state_after_failsafe = drone.until(lambda v: v["status"]["mode"] == "rtl", what="PX4's failsafe")
            assert state_after_failsafe["status"]["armed"]
            stream = drone.request("GET", "/offboard")
            assert stream["state"] == "idle"
            assert stream["ended"].startswith("The setpoint streams' process ended")
            drone.hold()
            started = drone.request("POST", "/offboard/start", START_REQUEST)
            assert started["state"] == "streaming"
            drone.request("POST", "/offboard/stop")
            drone.until(lambda v: v["status"]["mode"] == "hold", timeout_s=30, what="Hold")


def stream_process_pid(server_pid: int) -> int:
    """Process id of the server's child process that sends the setpoints."""
    tasks = Path(f"/proc/{server_pid}/task").iterdir()  # a thread of the server starts the process
    children = [child for task in tasks for child in (task / "children").read_text().split()]
    commands = {int(child): Path(f"/proc/{child}/cmdline").read_text() for child in children}
    return next(child for child, line in commands.items() if "gcs_server.streamer.process.worker" in line)


def test_a_download_of_a_log_continues_after_the_server_was_killed(tmp_path: Path) -> None:
    port, http_port = free_port(), free_port(socket.SOCK_STREAM)
    url = f"http://127.0.0.1:{http_port}"
    command = server_command(http_port, [f"udpin://127.0.0.1:{port}"], tmp_path / "server")
    content = os.urandom(LOG_BYTES)
    folder = tmp_path / f"vehicle/files-{FIRST_TEST_INSTANCE}/log/2026-01-01"
    folder.mkdir(parents=True)
    (folder / "10_00_00.ulg").write_bytes(content)
    arguments = ["--no-log", "--data-dir", str(tmp_path / "vehicle")]
    with running_vehicles(port, arguments=arguments):
        with running_process(command) as first_server:
            wait_until(lambda: is_up(url), "the first server")
            with SyncGcs(url, client="e2e") as gcs:
                drone = gcs.wait_for_vehicle("101", timeout_s=60)
                (log,) = drone.request("GET", "/logs")["logs"]
                operation = drone.request("POST", f"/logs/{log['number']}/download")["id"]
                wait_until(lambda: (progress_of(gcs, operation) or 0) > 0.3, "a part of the log")
                end_process(first_server, signal.SIGKILL)
        with running_process(command):
            wait_until(lambda: is_up(url), "the second server")
            with SyncGcs(url, client="e2e") as gcs:
                drone = gcs.wait_for_vehicle("101", timeout_s=60)
                (log,) = drone.request("GET", "/logs")["logs"]
                assert 0 < log["received_bytes"] < LOG_BYTES
                operation = drone.request("POST", f"/logs/{log['number']}/download")["id"]
                result = gcs.operations().wait(operation, timeout_s=60)["result"]
                assert sum(result["received_bytes"].values()) == LOG_BYTES - log["received_bytes"]
                assert result["verified"] == "crc32"
        assert (tmp_path / "server/logs" / result["file"]).read_bytes() == content


def progress_of(gcs: SyncGcs, operation: str) -> float | None:
    """Progress of an operation, 0 to 1."""
    return gcs.request("GET", f"/operations/{operation}")["progress"]
