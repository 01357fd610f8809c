"""MAVProxy connected to a vehicle that the server also observes: MAVProxy loads parameters and waypoints,
uses FTP, arms the vehicle and commands the flight."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

from tests.clients.observed_vehicle import ObservedVehicle
from tests.station import running_process, wait_until

LAT, LON = 47.3977432, 8.54559422
NORTH_M = 15.0
METRES_PER_DEGREE = 111_195.0
WAYPOINTS = f"""QGC WPL 110
0\t1\t3\t22\t0\t0\t0\t0\t{LAT}\t{LON}\t8\t1
1\t0\t3\t16\t0\t0\t0\t0\t{LAT + NORTH_M / METRES_PER_DEGREE}\t{LON}\t8\t1
2\t0\t3\t21\t0\t0\t0\t0\t{LAT + NORTH_M / METRES_PER_DEGREE}\t{LON}\t0\t1
"""

ALL_PARAMETERS_RECEIVED = b"Received 913 parameters"

TypeCommand = Callable[[str], None]
WaitForOutput = Callable[[bytes, str], None]


@contextmanager
def mavproxy(
    observed_vehicle: ObservedVehicle, folder: Path, modules: str
) -> Generator[tuple[TypeCommand, WaitForOutput]]:
    """Runs MAVProxy on the vehicle's TCP port; yields functions to type a command and to wait for its
    output."""
    program = Path(sys.executable).parent / "mavproxy.py"
    log = folder / "mavproxy.txt"
    command = [sys.executable, "-u", str(program), f"--master=tcp:127.0.0.1:{observed_vehicle.tcp_port}"]
    command += [f"--state-basedir={folder}", f"--default-modules={modules}", "--source-system=250"]
    with (
        log.open("wb") as output,
        running_process(
            command, stdin=subprocess.PIPE, stdout=output, stderr=subprocess.STDOUT, cwd=folder
        ) as process,
    ):
        stdin = process.stdin
        assert stdin is not None

        def type_command(text: str) -> None:
            stdin.write(f"{text}\n".encode())
            stdin.flush()

        def wait_for_output(text: bytes, what: str) -> None:
            wait_until(lambda: text in log.read_bytes(), what, 40)

        yield type_command, wait_for_output


def test_mavproxy_loads_parameters_arms_and_takes_off(
    observed_vehicle: ObservedVehicle, tmp_path: Path
) -> None:
    with mavproxy(observed_vehicle, tmp_path, "param,cmdlong,arm,mode") as (type_command, wait_for_output):
        wait_for_output(ALL_PARAMETERS_RECEIVED, "the parameters")
        type_command("arm throttle")
        observed_vehicle.drone.until(lambda v: v["status"]["armed"], timeout_s=60, what="arming by MAVProxy")
        type_command("long NAV_TAKEOFF -1 0 0 nan nan nan nan")
        observed_vehicle.drone.until(
            lambda v: v["status"]["landed_state"] in ("taking_off", "in_air"), timeout_s=60, what="lift-off"
        )
        observed_vehicle.drone.until(
            lambda v: v["status"]["mode"] == "hold", timeout_s=30, what="the take-off altitude"
        )
        type_command("long NAV_LAND 0 0 0 nan nan nan nan")
        observed_vehicle.drone.until_disarmed(timeout_s=120)


FTP_ERRORS = (b"request timed out", b"no sessions available", b"Remove failed", b"Create directory failed")
"""Error messages of MAVProxy about a vehicle's FTP sessions."""


def test_mavproxy_creates_directories_and_leaves_no_ftp_session_open(
    observed_vehicle: ObservedVehicle, tmp_path: Path
) -> None:
    with mavproxy(observed_vehicle, tmp_path, "ftp,param") as (type_command, wait_for_output):
        # MAVProxy first looks for a parameter file, and requests the parameter list if the vehicle has no
        # file.
        wait_for_output(ALL_PARAMETERS_RECEIVED, "the parameters")
        for number in range(10):
            type_command(f"ftp mkdir folder{number}")
            wait_for_output(f"Creating directory folder{number}".encode(), "the command")
        type_command("ftp list /")
        wait_for_output(b"folder9", "the last directory in the list")
        output = (tmp_path / "mavproxy.txt").read_bytes()
        assert [error for error in FTP_ERRORS if error in output] == []


def test_mavproxy_uploads_waypoints_and_reads_them_back_and_the_vehicle_flies_them(
    observed_vehicle: ObservedVehicle, tmp_path: Path
) -> None:
    (tmp_path / "plan.txt").write_text(WAYPOINTS, encoding="utf-8")
    with mavproxy(observed_vehicle, tmp_path, "param,cmdlong,arm,wp") as (type_command, wait_for_output):
        wait_for_output(ALL_PARAMETERS_RECEIVED, "the parameters")
        type_command("wp load plan.txt")
        wait_for_output(b"Loaded 3 waypoints from plan.txt", "the loaded waypoints")
        wait_for_output(b"Sent all 3 waypoints", "the upload")
        type_command("wp save back.txt")
        wait_until(lambda: (tmp_path / "back.txt").exists(), "the waypoints read back", 30)
        rows = [line.split() for line in (tmp_path / "back.txt").read_text(encoding="utf-8").splitlines()[1:]]
        assert [int(row[3]) for row in rows] == [22, 16, 21]
        assert abs(float(rows[1][8]) - (LAT + NORTH_M / METRES_PER_DEGREE)) < 1e-6
        # MAVProxy's `mode` command does not support PX4's modes.
        type_command("long DO_SET_MODE 1 4 4 0 0 0 0")
        observed_vehicle.drone.until(lambda v: v["status"]["mode"] == "mission", timeout_s=60, what="Mission")
        type_command("arm throttle")
        observed_vehicle.drone.until(lambda v: v["status"]["armed"], timeout_s=60, what="arming by MAVProxy")
        observed_vehicle.drone.until_disarmed(timeout_s=180)
        north_m = [value["position_ned_m"][0] for value in observed_vehicle.history("local_position")]
        assert math.isclose(max(north_m), NORTH_M, abs_tol=1.5), (
            "the vehicle did not fly to the second waypoint"
        )
        assert max(-value["position_ned_m"][2] for value in observed_vehicle.history("local_position")) > 7.0
