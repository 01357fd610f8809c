"""MAVProxy beside us: it connects, loads parameters and waypoints, arms, and sees the vehicle fly them."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.clients.watched import Watched
from tests.station import running, wait_until

LAT, LON = 47.3977432, 8.54559422
NORTH_M = 15.0
METRES_A_DEGREE = 111_195.0
WAYPOINTS = f"""QGC WPL 110
0\t1\t3\t22\t0\t0\t0\t0\t{LAT}\t{LON}\t8\t1
1\t0\t3\t16\t0\t0\t0\t0\t{LAT + NORTH_M / METRES_A_DEGREE}\t{LON}\t8\t1
2\t0\t3\t21\t0\t0\t0\t0\t{LAT + NORTH_M / METRES_A_DEGREE}\t{LON}\t0\t1
"""

Say = Callable[[str], None]
Shows = Callable[[bytes, str], None]


@contextmanager
def mavproxy(watched: Watched, folder: Path, modules: str) -> Iterator[tuple[Say, Shows]]:
    """MAVProxy on the vehicle's TCP port: how to say something to it, and how to wait for what it shows."""
    program = Path(sys.executable).parent / "mavproxy.py"
    log = folder / "mavproxy.txt"
    command = [sys.executable, "-u", str(program), f"--master=tcp:127.0.0.1:{watched.tcp_port}"]
    command += [f"--state-basedir={folder}", f"--default-modules={modules}", "--source-system=250"]
    with (
        log.open("wb") as output,
        running(
            command, stdin=subprocess.PIPE, stdout=output, stderr=subprocess.STDOUT, cwd=folder
        ) as process,
    ):
        stdin = process.stdin
        assert stdin is not None

        def say(text: str) -> None:
            stdin.write(f"{text}\n".encode())
            stdin.flush()

        def shows(words: bytes, what: str) -> None:
            wait_until(lambda: words in log.read_bytes(), what, 40)

        yield say, shows


def test_mavproxy_loads_parameters_arms_and_takes_off(watched: Watched, tmp_path: Path) -> None:
    with mavproxy(watched, tmp_path, "param,cmdlong,arm,mode") as (say, shows):
        shows(b"Received 929 parameters", "the parameters")
        say("arm throttle")
        watched.drone.until(lambda v: v["status"]["armed"], timeout_s=60, what="MAVProxy to arm it")
        say("long NAV_TAKEOFF -1 0 0 nan nan nan nan")
        watched.drone.until(
            lambda v: v["status"]["landed_state"] in ("taking_off", "in_air"), timeout_s=60, what="lift-off"
        )
        watched.drone.until(lambda v: v["status"]["mode"] == "hold", timeout_s=30, what="the top")
        say("long NAV_LAND 0 0 0 nan nan nan nan")
        watched.drone.until_disarmed(timeout_s=120)


TROUBLE = (b"request timed out", b"no sessions available", b"Remove failed", b"Create directory failed")
"""What MAVProxy says of a vehicle whose sessions it does not understand."""


def test_mavproxy_connects_and_makes_directories_without_asking_twice(
    watched: Watched, tmp_path: Path
) -> None:
    with mavproxy(watched, tmp_path, "ftp,param") as (say, shows):
        # It looks for a file of parameters first, and asks for the list when the vehicle has none.
        shows(b"Received 929 parameters", "the parameters")
        for n in range(10):
            say(f"ftp mkdir folder{n}")
            shows(f"Creating directory folder{n}".encode(), "the command")
        say("ftp list /")
        shows(b"folder9", "the last directory in the list")
        said = (tmp_path / "mavproxy.txt").read_bytes()
        assert [words for words in TROUBLE if words in said] == []


def test_mavproxy_loads_waypoints_that_are_flown_and_reads_them_back(
    watched: Watched, tmp_path: Path
) -> None:
    (tmp_path / "plan.txt").write_text(WAYPOINTS, encoding="utf-8")
    with mavproxy(watched, tmp_path, "param,cmdlong,arm,wp") as (say, shows):
        shows(b"Received 929 parameters", "the parameters")
        say("wp load plan.txt")
        shows(b"Loaded 3 waypoints from plan.txt", "the file read")
        shows(b"Sent all 3 waypoints", "the upload")
        say("wp save back.txt")
        wait_until(lambda: (tmp_path / "back.txt").exists(), "the waypoints read back", 30)
        rows = [line.split() for line in (tmp_path / "back.txt").read_text(encoding="utf-8").splitlines()[1:]]
        assert [int(row[3]) for row in rows] == [22, 16, 21]
        assert abs(float(rows[1][8]) - (LAT + NORTH_M / METRES_A_DEGREE)) < 1e-6
        # Its own `mode` command stumbles over PX4's modes.
        say("long DO_SET_MODE 1 4 4 0 0 0 0")
        watched.drone.until(lambda v: v["status"]["mode"] == "mission", timeout_s=60, what="Mission")
        say("arm throttle")
        watched.drone.until(lambda v: v["status"]["armed"], timeout_s=60, what="MAVProxy to arm it")
        watched.drone.until_disarmed(timeout_s=180)
        north_m = [value["position_ned_m"][0] for value in watched.history("local_position")]
        assert math.isclose(max(north_m), NORTH_M, abs_tol=1.5), "over the second waypoint, and landed there"
        assert max(-value["position_ned_m"][2] for value in watched.history("local_position")) > 7.0
