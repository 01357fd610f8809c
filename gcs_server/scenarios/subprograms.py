"""Programs of other processes that fly a simulated vehicle over MAVLink, ROS 2 or the server's API."""

from __future__ import annotations

import asyncio
import ctypes
import os
import signal
import socket
import sys
from collections.abc import Mapping
from contextlib import ExitStack, suppress

from gcs_server.scenarios.scenario import RunProgram
from gcs_server.scenarios.station import CHECK_PERIOD_S, HOST, Station
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.px4_version import VERSIONS
from vehicle_sim.server import Ports, SimServer

PLACEHOLDERS = ("port", "vehicle_port", "tcp_port", "url", "ros2_domain")
OUTPUT_LINES = 12
"""Lines of the output of a failed program in the report."""
OUTPUT_BYTES = 64_000
END_S = 3.0
"""Real time from SIGTERM to SIGKILL [s]."""
GUARD_OPTIONS = "guard=ask&vehicle=1&client=program"
PR_SET_PDEATHSIG = 1
MAX_DOMAIN = 101
"""Ports of higher ROS 2 domains are in the operating system's range of ephemeral ports."""

_running: set[int] = set()
"""Process groups of the programs that run."""


class ProgramEnded(Exception):
    """A program cannot be started, or ended with an error."""


def kill_all() -> None:
    """Kills all programs, for a process that must end at once."""
    for group in _running:
        with suppress(ProcessLookupError):
            os.killpg(group, signal.SIGKILL)


async def run_program(program: RunProgram, px4: str, station: Station) -> None:
    """Runs a program to its end; if it is cancelled, ends the program.

    Raises:
        ProgramEnded: it cannot be started, or ended with an error.
    """
    if any("{ros2_domain}" in each for each in program.arguments) and program.guard:
        raise ProgramEnded("A guarded link carries MAVLink, not ROS 2: leave out guard or {ros2_domain}.")
    with ExitStack() as stack:
        values = _open_ports(program, px4, station, stack)
        await _ready(program, station)
        arguments = [_filled(each, values) for each in program.arguments]
        try:
            process = await asyncio.create_subprocess_exec(
                *arguments,
                cwd=program.folder,
                env={**os.environ, **_environment(values)},
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=_die_with_parent,
            )
        except OSError as error:
            raise ProgramEnded(f"{arguments[0]} cannot be started: {error.strerror}.") from None
        await _wait(process)


async def _ready(program: RunProgram, station: Station) -> None:
    """Waits until the vehicles can be armed: a vehicle is there before its program, as on a field."""
    if program.uses_server:
        await station.vehicles()
        return
    while not all(
        each.view.estimate.valid_position and each.commander.report.armable(NavState.TAKEOFF)
        for each in station.sim.autopilots
    ):
        await station.clock.sleep(CHECK_PERIOD_S)


def _filled(argument: str, values: Mapping[str, object]) -> str:
    for name, value in values.items():
        argument = argument.replace(f"{{{name}}}", str(value))
    return argument


def _environment(values: Mapping[str, object]) -> dict[str, str]:
    """Values for programs without arguments, and what makes their ROS 2 stay on loopback."""
    environment = {"GCS_URL": str(values["url"]), "PYTHONUNBUFFERED": "1"}
    if "ros2_domain" in values:
        from vehicle_sim.dds.participant import configuration

        environment |= {
            "ROS_DOMAIN_ID": str(values["ros2_domain"]),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "CYCLONEDDS_URI": configuration(None),
        }
    return environment


async def _wait(process: asyncio.subprocess.Process) -> None:
    _running.add(process.pid)
    try:
        output = await _last_output(process)
        code = await process.wait()
    finally:
        await _end(process)
        _running.discard(process.pid)
    if code:
        last = "\n".join(output.decode(errors="replace").strip().splitlines()[-OUTPUT_LINES:])
        raise ProgramEnded(f"The program ended with code {code}" + (f": {last}" if last else "."))


async def _last_output(process: asyncio.subprocess.Process) -> bytes:
    """The end of what a program writes, once it writes no more."""
    assert process.stdout is not None
    output = b""
    while piece := await process.stdout.read(OUTPUT_BYTES):
        output = (output + piece)[-OUTPUT_BYTES:]
    return output


async def _end(process: asyncio.subprocess.Process) -> None:
    """Ends a program and what it has started."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        with suppress(ProcessLookupError):
            os.killpg(process.pid, number)
        if process.returncode is not None:
            continue
        with suppress(TimeoutError):
            async with asyncio.timeout(END_S):
                await process.wait()


def _die_with_parent() -> None:
    """Lets the system kill the program when this process dies (Linux)."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def _open_ports(program: RunProgram, px4: str, station: Station, stack: ExitStack) -> dict[str, object]:
    """Opens the links that the arguments name, and returns the values of the placeholders."""
    text = " ".join(program.arguments)
    used = {name for name in PLACEHOLDERS if f"{{{name}}}" in text}
    values: dict[str, object] = {"url": station.url}
    if "ros2_domain" in used:
        values["ros2_domain"] = _open_ros2(px4, station)
    values |= {name: _free_port(name) for name in ("port", "vehicle_port", "tcp_port") if name in used}
    if program.guard:
        kinds = {"port": "udpout", "vehicle_port": "udpin", "tcp_port": "tcpin"}
        for name, kind in kinds.items():
            if name in used:
                url = f"{kind}://{HOST}:{values[name]}?{GUARD_OPTIONS}"
                station.app.state.server.router.add_link(url)
    elif used & {"port", "vehicle_port", "tcp_port"}:
        _open_vehicle_ports(values, station, stack)
    return values


async def open_guard(station: Station) -> str:
    """Opens a guarded link of the first vehicle at a free port; returns host and port."""
    address = f"{HOST}:{_free_port('vehicle_port')}"
    station.app.state.server.router.add_link(f"udpin://{address}?{GUARD_OPTIONS}")
    return address


def _open_vehicle_ports(values: Mapping[str, object], station: Station, stack: ExitStack) -> None:
    """Opens the vehicles' own ports: those of vehicle N are N higher."""
    hears = int(str(values.get("vehicle_port", 0)))
    ports = Ports(
        gcs_local=0,
        gcs_remote=0,
        api_local=hears,
        api_remote=int(str(values.get("port", 0))) or (1 if hears else 0),
        tcp=int(str(values.get("tcp_port", 0))),
    )
    server = SimServer(station.sim, first_instance=0, ports=ports, bind=HOST, gcs_host=HOST)
    stack.callback(server.close)
    problems = [problem for vehicle in server.vehicles for problem in vehicle.problems]
    if problems:
        raise ProgramEnded(f"A port cannot be opened: {problems[0]}.")
    stack.callback(station.on_tick(server.exchange))


def _open_ros2(px4: str, station: Station) -> int:
    """Connects the vehicles to a ROS 2 domain of loopback, and returns its number."""
    try:
        from vehicle_sim.dds.participant import DdsDomain, DdsUnavailable
    except ImportError:
        raise ProgramEnded(
            "ROS 2 needs Cyclone DDS, which is not installed: pip install 'offboard-gcs[ros2]'."
        ) from None
    number = 1 + os.getpid() % MAX_DOMAIN
    try:
        domain = DdsDomain(number, None)
        for row in range(len(station.sim.nodes)):
            namespace = f"px4_{row}" if row else ""
            station.sim.open_ros2(row, domain.open(namespace, VERSIONS[px4]), lambda _: None)
    except DdsUnavailable as problem:
        raise ProgramEnded(f"ROS 2: {problem}") from None
    return number


def _free_port(name: str) -> int:
    kind = socket.SOCK_STREAM if name == "tcp_port" else socket.SOCK_DGRAM
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind((HOST, 0))
        return probe.getsockname()[1]
