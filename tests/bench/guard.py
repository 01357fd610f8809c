"""Time that a guarded link adds: parameter reads beside the vehicle's own link, and from a program's setpoint
to its datagram to the vehicle, with the gaps between these; the same over ROS 2 (`guard_ros2.py`).

Requests and setpoints come 50 times a second: a link that is busier is read in batches (`links/channel.py`).

The program is a process of its own (`python -m tests.bench.guard PORT`), because the relay in the process of
the bench would delay it.
"""

from __future__ import annotations

import json
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator

from pymavlink.dialects.v20 import common as mavlink

from gcs_server.client import SyncGcs
from tests.station import free_port, running_server, running_vehicles

from .guard_ros2 import rows
from .latency import vehicle_round_trips_s
from .process import gaps_s, row
from .relay import Relay

VEHICLE = 101
SETPOINTS = 1000
PERIOD_S = 0.02
POSITION_ONLY = 0b110111111000
OFFBOARD = (mavlink.MAV_CMD_DO_SET_MODE, 0, 1, 6, 0, 0, 0, 0, 0)


def send_setpoints(port: int) -> list[tuple[float, float]]:
    """Flies Offboard over a guarded link; returns north [m] and time of sending [s, monotonic] of each
    setpoint after the start."""
    mav = mavlink.MAVLink(None, srcSystem=245, srcComponent=190)
    sent: list[tuple[float, float]] = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as program:
        program.connect(("127.0.0.1", port))
        program.setblocking(False)
        for index in range(1, 200 + SETPOINTS):
            began_s = time.monotonic()
            north_m = struct.unpack("<f", struct.pack("<f", index / 1000.0))[0]  # as a 32-bit float
            setpoint = mav.set_position_target_local_ned_encode(
                0, VEHICLE, 1, 1, POSITION_ONLY, north_m, 0, -5, *(0,) * 8
            )
            program.send(setpoint.pack(mav))
            if index == 50:
                request = mav.command_long_encode(VEHICLE, 1, *OFFBOARD)
                program.send(request.pack(mav))
            if index >= 200:
                sent.append((north_m, began_s))
            try:
                while program.recv(65536):
                    pass
            except BlockingIOError:
                pass
            time.sleep(max(0.0, began_s + PERIOD_S - time.monotonic()))
    return sent


def table() -> Iterator[str]:
    """Rows of Markdown."""
    yield "| what | load average | samples | ms: p50 / p99 / max |"
    yield "|---|---|---|---|"
    link_port, guard_udp = free_port(), free_port()
    direct_port, guard_tcp = free_port(socket.SOCK_STREAM), free_port(socket.SOCK_STREAM)
    guards = [f"tcpin://127.0.0.1:{guard_tcp}?guard=read", f"udpin://127.0.0.1:{guard_udp}?guard=free"]
    with (
        Relay(link_port) as relay,
        running_server([f"udpin://127.0.0.1:{link_port}", *guards]) as (url, _),
        running_vehicles(relay.vehicle_port, tcp_port=direct_port),
        SyncGcs(url, client="bench") as gcs,
    ):
        gcs.wait_for_vehicle(str(VEHICLE), ready=True)
        yield row(
            "parameter read, the vehicle's own link", vehicle_round_trips_s(direct_port, VEHICLE, PERIOD_S)
        )
        yield row("parameter read, a guarded link", vehicle_round_trips_s(guard_tcp, VEHICLE, PERIOD_S))
        command = [sys.executable, "-m", "tests.bench.guard", str(guard_udp)]
        sent = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
        time.sleep(1.0)
        arrivals = [(relay.sent_at_s(north_m), sent_s) for north_m, sent_s in sent]
        yield row(
            "setpoint to its datagram", [to_s - from_s for to_s, from_s in arrivals if to_s is not None]
        )
        first_s, last_s = sent[0][1], sent[-1][1]
        to_vehicle_s = [s for s in relay.arrivals_s()[VEHICLE] if first_s <= s <= last_s]
        yield row("gap between setpoints to the vehicle", gaps_s(to_vehicle_s))
        yield row("gap between the program's own", gaps_s([sent_s for _, sent_s in sent]))
    yield from rows()


if __name__ == "__main__":
    print(json.dumps(send_setpoints(int(sys.argv[1]))))
