"""MAVProxy beside us: it connects, loads the parameters, arms, and sees the vehicle fly."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.clients.conftest import Watched
from tests.station import running, wait_until


def test_mavproxy_loads_parameters_arms_and_takes_off(watched: Watched, tmp_path: Path) -> None:
    program = Path(sys.executable).parent / "mavproxy.py"
    log = tmp_path / "mavproxy.txt"
    command = [sys.executable, "-u", str(program), f"--master=tcp:127.0.0.1:{watched.tcp_port}"]
    command += [
        f"--state-basedir={tmp_path}",
        "--default-modules=param,cmdlong,arm,mode",
        "--source-system=250",
    ]
    with (
        log.open("wb") as output,
        running(
            command, stdin=subprocess.PIPE, stdout=output, stderr=subprocess.STDOUT, cwd=tmp_path
        ) as mavproxy,
    ):
        assert mavproxy.stdin is not None

        def say(text: str) -> None:
            assert mavproxy.stdin is not None
            mavproxy.stdin.write(f"{text}\n".encode())
            mavproxy.stdin.flush()

        wait_until(lambda: b"Received 929 parameters" in log.read_bytes(), "the parameters", 40)
        say("arm throttle")
        watched.drone.until(lambda v: v["status"]["armed"], timeout_s=15, what="MAVProxy to arm it")
        say("long NAV_TAKEOFF -1 0 0 nan nan nan nan")
        watched.drone.until(
            lambda v: v["status"]["landed_state"] in ("taking_off", "in_air"), timeout_s=15, what="lift-off"
        )
        watched.drone.until(lambda v: v["status"]["mode"] == "hold", timeout_s=30, what="the top")
        say("long NAV_LAND 0 0 0 nan nan nan nan")
        watched.drone.until_disarmed(timeout_s=60)
