"""The server's process with ports in use, recordings, invalid bytes and equal system ids, its simulator, and
its shutdown."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from gcs_server.client import SyncGcs
from tests.e2e.fast_station import FAST_OPTIONS
from tests.station import (
    end_process,
    free_port,
    is_up,
    running_process,
    running_vehicles,
    server_command,
    wait_until,
)


class Server:
    """A server's process and its API."""

    def __init__(self, url: str, process: subprocess.Popen[bytes]) -> None:
        self.url, self.process = url, process

    def get(self, path: str) -> Any:
        response = httpx.get(f"{self.url}/api/v1{path}", timeout=30)
        response.raise_for_status()
        return response.json()

    def link(self) -> dict[str, Any]:
        return self.get("/links")["links"][0]

    def vehicles(self) -> dict[str, dict[str, Any]]:
        return {vehicle["id"]: vehicle for vehicle in self.get("/vehicles")}

    def warning_texts(self) -> list[str]:
        return [notice["text"] for notice in self.get("/warnings")["warnings"]]


@contextlib.contextmanager
def run_server(command: list[str], **options: Any) -> Iterator[Server]:
    """Runs a server command, which must have a --port, until the block ends."""
    url = f"http://127.0.0.1:{command[command.index('--port') + 1]}"
    with running_process(command, **options) as process:
        wait_until(lambda: is_up(url), "the server's start")
        yield Server(url, process)


def command_without_scene(links: list[str], data: Path) -> list[str]:
    return [*server_command(free_port(socket.SOCK_STREAM), links, data), "--no-scene"]


@pytest.mark.story
def test_an_http_port_in_use_ends_the_server_with_an_error_that_names_port_and_option(tmp_path: Path) -> None:
    with socket.socket() as other_socket:
        other_socket.bind(("127.0.0.1", 0))
        other_socket.listen()
        port = other_socket.getsockname()[1]
        result = subprocess.run(server_command(port, [], tmp_path), capture_output=True, text=True)
    assert result.returncode == 2
    assert str(port) in result.stderr
    assert "--port" in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.story
def test_a_mavlink_port_in_use_is_named_and_is_opened_when_it_becomes_free(tmp_path: Path) -> None:
    other_socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    other_socket.bind(("127.0.0.1", 0))
    port = other_socket.getsockname()[1]
    with run_server(command_without_scene([f"udpin://127.0.0.1:{port}"], tmp_path)) as server:
        wait_until(lambda: server.link()["state"] == "waiting", "the link's error")
        assert str(port) in server.link()["detail"]
        assert any(str(port) in text for text in server.warning_texts())
        other_socket.close()
        wait_until(lambda: server.link()["state"] == "open", "the link's recovery")
        assert server.warning_texts() == []
        with running_vehicles(port):
            wait_until(lambda: "101" in server.vehicles(), "the vehicle")


@pytest.mark.story
def test_a_replay_is_shown_as_a_recording_and_refuses_commands(reference_data: Path, tmp_path: Path) -> None:
    recording = reference_data / "px4" / "tlogs" / "flight-takeoff-reposition-orbit-gimbal-rtl.tlog.gz"
    port = free_port(socket.SOCK_STREAM)
    command = [
        *server_command(port, [], tmp_path)[:3],
        "replay",
        str(recording),
        "--speed",
        "4",
        "--no-scene",
    ]
    command += ["--port", str(port), "--data", str(tmp_path)]
    with run_server(command) as server:
        wait_until(lambda: server.vehicles(), "the recorded vehicle")
        vehicle_state = next(iter(server.vehicles().values()))
        assert vehicle_state["identity"]["replayed"]
        assert server.link()["replay"]
        assert server.link()["recording"] is None
        url = f"{server.url}/api/v1/vehicles/{vehicle_state['id']}"
        for command_name in ("arm", "land", "gimbal/take", "offboard/stop"):
            response = httpx.post(f"{url}/{command_name}", timeout=30)
            if command_name == "offboard/stop":
                assert response.status_code == 200, "the stop was refused although no stream exists"
            else:
                assert response.status_code == 409
                assert "recording" in response.json()["detail"]

        def boot_s() -> float:
            return server.get(f"/vehicles/{vehicle_state['id']}")["topics"]["attitude"]["vehicle_time_boot_s"]

        wait_until(
            lambda: "attitude" in server.get(f"/vehicles/{vehicle_state['id']}")["topics"], "an attitude"
        )
        before_s = boot_s()
        wait_until(lambda: boot_s() > before_s + 4, "four more seconds of the recording")


@pytest.mark.realtime
def test_a_simulator_continues_after_its_server_is_killed_and_the_next_server_uses_it(tmp_path: Path) -> None:
    mavlink_port, local_port = free_port(), free_port()
    sim_arguments = f"--gcs-remote-port {mavlink_port} --gcs-local-port {local_port} --no-api --tcp-port 0"

    def command() -> list[str]:
        arguments = command_without_scene([f"udpin://127.0.0.1:{mavlink_port}"], tmp_path)
        return [
            *(argument for argument in arguments if argument != "--no-sim"),
            "--sim",
            "1",
            f"--sim-args={sim_arguments}",
        ]

    def time_since_boot_s(server: Server) -> float:
        wait_until(lambda: "attitude" in server.vehicles().get("1", {}).get("topics", {}), "the vehicle")
        return server.vehicles()["1"]["topics"]["attitude"]["vehicle_time_boot_s"]

    pid_file = tmp_path / "simulator.json"
    try:
        with run_server(command()) as first_server:
            before_s = time_since_boot_s(first_server)
            pid = json.loads(pid_file.read_text())["pid"]
            end_process(first_server.process, signal.SIGKILL)
        assert Path(f"/proc/{pid}").exists(), "the simulator ended with its server"
        with run_server(command()) as second_server:
            assert time_since_boot_s(second_server) > before_s, "the vehicle booted again"
            assert json.loads(pid_file.read_text())["pid"] == pid
            assert second_server.get("/version")["simulator"]
            wait_until(lambda: second_server.vehicles()["1"]["identity"]["simulated"] is True, "the identity")
            end_process(second_server.process, signal.SIGTERM)
        wait_until(lambda: not Path(f"/proc/{pid}").exists(), "the simulator's end with its server")
        assert not pid_file.exists()
    finally:
        if pid_file.exists():
            with contextlib.suppress(ProcessLookupError):
                os.kill(json.loads(pid_file.read_text())["pid"], signal.SIGKILL)


@pytest.mark.realtime
def test_invalid_bytes_on_a_link_are_counted_and_the_other_vehicle_is_unaffected(tmp_path: Path) -> None:
    port = free_port()
    with (
        run_server(command_without_scene([f"udpin://127.0.0.1:{port}"], tmp_path)) as server,
        running_vehicles(port),
    ):
        wait_until(lambda: "101" in server.vehicles(), "the vehicle")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for number in range(200):
                sender.sendto(bytes((number * 7 + n * 13) % 251 for n in range(120)), ("127.0.0.1", port))
            sender.sendto(
                b"\xfd\x09\x00\x00\x00\x01\x01\x00\x00\x00" + bytes(9) + b"\x12\x34", ("127.0.0.1", port)
            )
        wait_until(lambda: server.link()["bytes_skipped"] > 10_000, "the count of invalid bytes")
        counts = server.link()
        assert counts["crc_errors"] >= 1
        wait_until(
            lambda: server.link()["frames_received"] > counts["frames_received"] + 20, "the vehicle's frames"
        )
        link_after = server.link()
        assert list(server.vehicles()) == ["101"]
        assert not server.vehicles()["101"]["status"]["link_lost"]
        recording = link_after["recording"]
        assert recording["stopped"] is None
        assert (tmp_path / "recordings" / recording["file"]).stat().st_size >= recording["bytes"] > 0


@pytest.mark.realtime
def test_two_vehicles_with_the_same_system_id_are_both_shown_each_with_a_warning(tmp_path: Path) -> None:
    port = free_port()
    with (
        run_server(command_without_scene([f"udpin://127.0.0.1:{port}"], tmp_path)) as server,
        running_vehicles(port),
        running_vehicles(port, arguments=["--home", "47.5,8.6,500"]),
    ):
        wait_until(lambda: {"101", "101~2"} <= set(server.vehicles()), "the second vehicle")
        wait_until(lambda: len(server.warning_texts()) == 2, "the warnings")
        assert all("system id 101" in text for text in server.warning_texts())
        for key in ("101", "101~2"):
            wait_until(lambda key=key: "global_position" in server.vehicles()[key]["topics"], "positions", 40)
        vehicles = server.vehicles()
        latitudes_deg = [
            vehicles[key]["topics"]["global_position"]["value"]["lat_deg"] for key in ("101", "101~2")
        ]
        assert sorted(latitudes_deg) == pytest.approx([47.397, 47.5], abs=0.01)


@pytest.mark.realtime
def test_a_hold_command_is_reported_and_the_servers_shutdown_puts_a_streamed_vehicle_into_hold(
    tmp_path: Path,
) -> None:
    port = free_port()
    command = command_without_scene([f"udpin://127.0.0.1:{port}"], tmp_path)
    with running_vehicles(port, arguments=FAST_OPTIONS), run_server(command) as server:
        with SyncGcs(server.url, client="e2e") as gcs:
            drone = gcs.wait_for_vehicle("101", ready=True, timeout_s=120)
            drone.takeoff(5)
            drone.until(lambda v: v["status"]["mode"] == "hold", what="the end of the take-off")
            request = {"setpoint": {"type": "velocity", "velocity_ned_m_s": [0, 0, 0]}, "valid_for_s": 60}
            drone.request("POST", "/offboard/start", request)
            drone.hold()
            state = drone.until(lambda v: not v["offboard"]["streaming"], what="the stream's end")
            assert state["offboard"]["ended"] == "e2e commanded 'hold'; the setpoint stream has ended."

            def stream_events() -> list[tuple[str, int, str]]:
                messages = drone.request("GET", "/messages")["messages"]
                events = [m for m in messages if m["data"].get("source") == "offboard"]
                return [(m["kind"], m["severity"], m["data"]["code"]) for m in events]

            wait_until(stream_events, "the event of the stream's end")
            assert stream_events() == [("command", 6, "commanded")]
            drone.request("POST", "/offboard/start", request)
        end_process(server.process, signal.SIGTERM)
        assert server.process.returncode != -signal.SIGKILL, "the shutdown took too long"
        entry = json.loads((tmp_path / "journal.jsonl").read_text().splitlines()[-1])
        assert (entry["client"], entry["command"], entry["vehicle"], entry["result"]) == (
            "server",
            "offboard/stop",
            "101",
            "ok",
        )
        with run_server(command) as second_server:
            wait_until(lambda: "101" in second_server.vehicles(), "the vehicle")
            status = second_server.vehicles()["101"]["status"]
            assert (status["armed"], status["mode"]) == (True, "hold")


STAND_IN_PX4 = """#!{python}
import os, sys
assert os.environ["PX4_SIM_MODEL"] == "sihsim_quadx" and os.environ["PX4_PARAM_COM_OBL_RC_ACT"] == "5"
assert sys.argv[3:5] == ["-d", "-w"], sys.argv
print("INFO  [px4] startup", flush=True)
options = ["--first-instance", sys.argv[2], "--no-api", "--no-log", "--param", "COM_OBL_RC_ACT=5"]
os.execv(sys.executable, [sys.executable, "-m", "vehicle_sim", *options, "--gcs-remote-port", "{port}"])
"""


@pytest.mark.story
def test_a_px4_that_is_named_flies_crashes_and_is_started_again(tmp_path: Path) -> None:
    build, link_port, instance = tmp_path / "build", free_port(), 140
    (build / "bin").mkdir(parents=True)
    (build / "etc/init.d-posix").mkdir(parents=True)
    (build / "etc/init.d-posix/rcS").touch()
    (build / "bin/px4").write_text(STAND_IN_PX4.format(python=sys.executable, port=link_port))
    (build / "bin/px4").chmod(0o755)
    command = command_without_scene([f"udpin://127.0.0.1:{link_port}"], tmp_path / "data")
    command.remove("--no-sim")
    command += ["--sim", "px4", "--px4-path", str(build)]
    command += [f"--sim-args=--no-agent --first-instance {instance} --param COM_OBL_RC_ACT=5"]
    with run_server(command) as server, SyncGcs(server.url, client="e2e") as gcs:
        drone = gcs.wait_for_vehicle(str(instance + 1), ready=True, timeout_s=120)
        (px4,) = server.get("/simulator")["instances"]
        assert (px4["state"], px4["problem"]) == ("running", None)
        assert "INFO  [px4] startup" in px4["console"]
        assert drone.param("COM_OBL_RC_ACT") == 5
        before = _process_of(f"--first-instance\0{instance}\0--no-api")
        os.kill(before, signal.SIGKILL)
        wait_until(lambda: any("was started again" in t for t in server.warning_texts()), "the warning")
        gcs.wait_for_vehicle(str(instance + 1), ready=True, timeout_s=120)
    wait_until(
        lambda: _process_of(f"--first-instance\0{instance}\0--no-api") == 0, "the end of all processes"
    )


def _process_of(arguments: str) -> int:
    """Pid of the process with these arguments, each followed by a zero byte; 0: there is none."""
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            if arguments.encode() in file.read_bytes():
                return int(file.parent.name)
    return 0
