"""Programs on a guarded link in real time: the one of the document, and one that hangs."""

from __future__ import annotations

import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs_server.client import SyncGcs, SyncVehicle
from tests.station import free_port, running_process, running_server, vehicle_command, wait_until

ROOT = Path(__file__).resolve().parents[2]
DOCUMENT = ROOT / "docs" / "how-to-guard-a-program.md"
VEHICLE = 101


@pytest.fixture
def guarded() -> Iterator[tuple[SyncVehicle, int]]:
    """A vehicle that can be armed, and the port of its guarded link."""
    udp_port, guard_port = free_port(), free_port()
    guard = f"udpin://127.0.0.1:{guard_port}?guard=free&client=program"
    with (
        running_server([f"udpin://127.0.0.1:{udp_port}", guard]) as (url, _),
        running_process(vehicle_command(udp_port)),
        SyncGcs(url, client="observer") as gcs,
    ):
        yield gcs.wait_for_vehicle(str(VEHICLE), ready=True), guard_port


def north_m(drone: SyncVehicle) -> float:
    return drone.request("GET", "")["topics"]["local_position"]["value"]["position_ned_m"][0]


def mode(drone: SyncVehicle) -> str:
    return drone.status()["mode"]


def test_a_program_that_hangs_is_held_and_flies_on_when_it_asks_again(
    guarded: tuple[SyncVehicle, int],
) -> None:
    drone, port = guarded
    drone.takeoff(6)
    wait_until(lambda: mode(drone) == "hold", "the end of the take-off")
    drone.control.release()
    command = [sys.executable, "-m", "tests.support.streaming_program", str(port)]
    with running_process([*command, str(VEHICLE)], cwd=ROOT) as program:
        wait_until(lambda: mode(drone) == "offboard" and north_m(drone) > 4.0, "a flight to the north")
        program.send_signal(signal.SIGSTOP)
        time.sleep(4.0)  # half a second until it expires, and the way to stop
        stopped_m = north_m(drone)
        time.sleep(3.0)
        assert abs(north_m(drone) - stopped_m) < 0.5
        wait_until(lambda: mode(drone) == "hold", "Hold")
        program.send_signal(signal.SIGCONT)
        wait_until(lambda: mode(drone) == "offboard", "Offboard, which it asks for itself")
        drone.hold()
        time.sleep(7.0)  # it asks again
        assert mode(drone) == "hold"


def test_the_program_of_the_document_runs_word_for_word(
    guarded: tuple[SyncVehicle, int], tmp_path: Path
) -> None:
    drone, port = guarded
    (program,) = re.findall(
        r"^```python\n(.*?)^```", DOCUMENT.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )
    path = tmp_path / "program.py"
    own_port = free_port(socket.SOCK_STREAM)  # of the server that MAVSDK starts
    changed = program.replace("14640", str(port)).replace("System()", f"System(port={own_port})")
    assert changed.count(str(port)) == 1
    path.write_text(changed, encoding="utf-8")
    result = subprocess.run(
        [sys.executable, "-W", "ignore", str(path)], capture_output=True, text=True, timeout=150, check=False
    )
    assert result.returncode == 0, result.stderr[-2000:]
    drone.until_disarmed(timeout_s=60)
    history = drone.request("GET", "/history?topics=status,local_position&since_unix_s=0")["samples"]
    modes = [sample["value"]["mode"] for sample in history if sample["topic"] == "status"]
    assert [m for m in ("takeoff", "offboard", "land") if m in modes] == ["takeoff", "offboard", "land"]
