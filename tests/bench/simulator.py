"""Speed of the simulated PX4: its maximum, the CPU share in real time, a hundred vehicles, one step."""

from __future__ import annotations

import math
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator

from pymavlink.dialects.v20 import common as mavlink

from tests.station import free_port, running_process

from .process import cpu_share

WINDOW_S = 8.0
FLEET = 100
_ATTITUDE, _EXTENDED_SYS_STATE = 30, 245
_FLYING_STATES = (b"\x02", b"\x03")
"""MAV_LANDED_STATE_IN_AIR and _TAKEOFF."""
_TAKEOFF, _ARM_DISARM = 22, 400

_PHYSICS_STEPS = """
import sys, time
from vehicle_sim.simulation import Simulation
count, steps = int(sys.argv[1]), int(sys.argv[2])
simulation = Simulation(count)
simulation.setpoints.armed[:] = True
simulation.setpoints.level[:] = 5
simulation.setpoints.position_ned_m[:] = (0.0, 0.0, -10.0)
simulation.setpoints.yaw_ned_rad[:] = 0.0
for _ in range(200):
    simulation.step()
began = time.process_time()
for _ in range(steps):
    simulation.step()
print((time.process_time() - began) / steps)
"""

_WHOLE_SIMULATOR = """
import sys, time
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.fleet import SimulatedFleet
count, links, seconds = int(sys.argv[1]), sys.argv[2].split(","), float(sys.argv[3])
links = [(name, name) for name in links if name]
sim = SimulatedFleet(count, links=links, log=sys.argv[4] == "log")
def fly(seconds):
    for _ in range(round(seconds / 0.02)):
        sim.step(0.02)
        for row in range(count):
            for name, _ in links:
                sim.frames(row, name)
fly(12.0)
for autopilot in sim.autopilots:
    autopilot.commander.arm()
    autopilot.navigator.request_takeoff(1000.0)
    autopilot.commander.set_mode(NavState.TAKEOFF)
fly(6.0)
began = time.process_time()
fly(seconds)
print((time.process_time() - began) / seconds)
assert -sim.simulation.truth.position_ned_m[0, 2] > 1.0
sim.close()
"""


def _run_script(script: str, *arguments: object) -> float:
    """Runs a script in a separate process; returns the number that it prints: CPU seconds per unit of
    work."""
    command = [sys.executable, "-c", script, *map(str, arguments)]
    return float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def step_cost_s(vehicles: int) -> float:
    """CPU seconds for a 4 ms step of physics and control in flight."""
    steps = {1: 4000, 10: 3000, 100: 1000}.get(vehicles, 200)
    return _run_script(_PHYSICS_STEPS, vehicles, steps)


def flying_share(vehicles: int, links: str, seconds: float, *, log: bool = False) -> float:
    """CPU seconds per simulated second of the whole simulator in flight, without sockets."""
    return _run_script(_WHOLE_SIMULATOR, vehicles, links, seconds, "log" if log else "no log")


def run_in_real_time(vehicles: int, *, api: bool, flying: bool = False) -> tuple[float, float]:
    """CPU share (1: one core) of the simulator's processes with sockets, and their speed (1: real time).

    The first vehicle's clock, received on the ground-station link, gives the speed.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8_000_000)
        station.bind(("127.0.0.1", 0))
        command = [sys.executable, "-m", "vehicle_sim", "--instances", str(vehicles), "--tcp-port", "0"]
        command += ["--gcs-local-port", "0", "--gcs-remote-port", str(station.getsockname()[1]), "--no-log"]
        command += ["--api-local-port", "0", "--api-remote-port", str(free_port())] if api else ["--no-api"]
        with running_process(command) as process:
            time.sleep(4.0 + 0.1 * vehicles)
            if flying:
                _take_off(station, vehicles)
                time.sleep(6.0)
            _newest_clock_s(station)
            first_s, began_s = _newest_clock_s(station), time.monotonic()
            share = cpu_share(process.pid, WINDOW_S, with_children=True)
            last_s, ended_s = _newest_clock_s(station), time.monotonic()
    return share, (last_s - first_s) / (ended_s - began_s)


def _take_off(station: socket.socket, vehicles: int) -> None:
    """Arms all vehicles and takes off; commands go to the port from which each vehicle sends.

    Raises:
        TimeoutError: not all vehicles were flying within two minutes.
    """
    station.settimeout(20.0)
    deadline_s, in_air, requested_at_s = time.monotonic() + 120.0, set[int](), dict[int, float]()
    while len(in_air) < vehicles:
        if time.monotonic() > deadline_s:
            raise TimeoutError(f"{len(in_air)} of {vehicles} vehicles are flying after two minutes")
        data, peer = station.recvfrom(65536)
        for system, message, payload in _messages(data):
            if message == _EXTENDED_SYS_STATE and payload[1:2] in _FLYING_STATES:
                in_air.add(system)
            if system not in in_air and time.monotonic() - requested_at_s.get(system, 0.0) > 4.0:
                requested_at_s[system] = time.monotonic()
                for command, param1 in ((_ARM_DISARM, 1.0), (_TAKEOFF, -1.0)):
                    station.sendto(_command(system, command, param1), peer)


def _messages(data: bytes) -> Iterator[tuple[int, int, bytes]]:
    """System id, message id and payload of each frame."""
    start = 0
    while start + 12 <= len(data) and data[start] == 0xFD:
        end = start + 10 + data[start + 1]
        message_id = int.from_bytes(data[start + 7 : start + 10], "little")
        yield data[start + 5], message_id, data[start + 10 : end]
        start = end + 2


def _command(system: int, command: int, param1: float) -> bytes:
    nan = math.nan
    message = mavlink.MAVLink_command_long_message(system, 1, command, 0, param1, 0, 0, nan, nan, nan, nan)
    return message.pack(mavlink.MAVLink(None, 255, 190))


def _newest_clock_s(station: socket.socket) -> float:
    """Time since boot in vehicle 1's newest ATTITUDE; older datagrams in the socket are skipped."""
    station.setblocking(False)
    try:
        while True:
            station.recv(65536)
    except BlockingIOError:
        station.setblocking(True)
    station.settimeout(20.0)
    while True:
        for system, message, payload in _messages(station.recv(65536)):
            if system == 1 and message == _ATTITUDE:
                return int.from_bytes(payload[:4], "little") / 1000.0


def table() -> Iterator[str]:
    """Rows of Markdown."""
    load = f"load of the machine {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
    yield f"| the simulator ({load}) | measured | goal |"
    yield "|---|---|---|"
    without_links_s = flying_share(1, "", 20.0)
    yield f"| one vehicle, whole stack in flight without links | {1 / without_links_s:.1f} x real time | 20 |"
    with_links_s = flying_share(1, "gcs,api", 20.0)
    yield f"| the same with all streams of both links | {1 / with_links_s:.1f} x real time | |"
    with_log_s = flying_share(1, "gcs,api", 20.0, log=True)
    yield f"| the same with its onboard log | {1 / with_log_s:.1f} x real time | |"
    share, speed = run_in_real_time(1, api=True)
    yield f"| one vehicle on its sockets | {share:.1%} of a core, {speed:.1%} of real time | 15 % |"
    fleet_s = flying_share(FLEET, "gcs", 3.0)
    yield f"| {FLEET} in flight with the 14550 streams, one process | {1 / fleet_s:.2f} x real time | 1 |"
    for state in ("on the ground", "in flight"):
        share, speed = run_in_real_time(FLEET, api=False, flying=state == "in flight")
        yield f"| {FLEET} {state}, on sockets | {share:.0%} of a core, {speed:.1%} | 100 % of real time |"
    yield ""
    yield "| vehicles | physics and control in flight, µs a step | µs a vehicle | maximum, x real time |"
    yield "|---|---|---|---|"
    for vehicles in (1, 10, 100, 1000):
        cost_s = step_cost_s(vehicles)
        yield f"| {vehicles} | {cost_s * 1e6:.0f} | {cost_s * 1e6 / vehicles:.1f} | {0.004 / cost_s:.1f} |"
