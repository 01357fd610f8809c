"""A feed of many vehicles' telemetry, encoded beforehand so that sending costs next to nothing.

`python -m tests.bench.feed PORT VEHICLES SECONDS` sends from a process of its own and prints how many frames
it sent; every consumer of a comparison is given the same one.
"""

from __future__ import annotations

import socket
import sys
import time

import fastcrc
from pymavlink.dialects.v20 import common as mavlink

MESSAGES_PER_S = 100
"""A vehicle's rate: the mix below, as a ground-station link of PX4 sends it, thinned to 100 a second."""

BURST = 2
"""PX4's 50 Hz streams come out together: of 100 messages a second, two every 20 ms."""
PERIOD_S = BURST / MESSAGES_PER_S


def _mix(mav: mavlink.MAVLink, system_id: int, index: int) -> bytes:
    """The `index`-th frame of a second of telemetry (0–99)."""
    boot_ms = 10_000 + index * 10
    if index == 0:
        message = mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4, 157, 50593792, mavlink.MAV_STATE_ACTIVE, 3
        )
    elif index == 1:
        message = mavlink.MAVLink_sys_status_message(
            0x3FFFFFFF, 0x3FFFFFFF, 0x3FFFFFFF, 200, 16200, 900, 80, 0, 0, 0, 0, 0, 0
        )
    elif index % 20 == 2:
        message = mavlink.MAVLink_gps_raw_int_message(
            boot_ms * 1000, 3, 473977420, 85455940, 489000, 80, 120, 10, 100, 14
        )
    elif index % 25 == 3:
        message = mavlink.MAVLink_vfr_hud_message(0.5, 3.2, 40, 49, 501.0, 0.1)
    elif index % 5 == 0:
        message = mavlink.MAVLink_global_position_int_message(
            boot_ms, 473977420 + system_id * 1000, 85455940 + index, 501000, 12000, 10, 20, -5, 4000
        )
    elif index % 5 == 1:
        message = mavlink.MAVLink_local_position_ned_message(boot_ms, 1.0, 2.0, -12.0, 0.1, 0.2, 0.0)
    elif index % 5 == 2:
        message = mavlink.MAVLink_servo_output_raw_message(boot_ms, 0, 1490, 1500, 1480, 1510, 0, 0, 0, 0)
    elif index % 5 == 3:
        message = mavlink.MAVLink_attitude_quaternion_message(boot_ms, 1.0, 0.01, 0.02, 0.0, 0.1, 0.0, 0.0)
    else:
        message = mavlink.MAVLink_attitude_message(boot_ms, 0.01, 0.02, 0.3, 0.1, 0.0, 0.0)
    return message.pack(mav)


def encode(system_id: int) -> list[bytes]:
    """Frames whose sequence numbers run on when the list is repeated: 64 seconds, 6,400 = 25 × 256 frames."""
    mav = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=1)
    second = [(_mix(mav, system_id, index)) for index in range(MESSAGES_PER_S)]
    return [_restamped(second[index % MESSAGES_PER_S], index % 256) for index in range(64 * MESSAGES_PER_S)]


def _restamped(frame: bytes, sequence: int) -> bytes:
    """The same MAVLink 2 frame with another sequence number (byte 4) and its checksum."""
    message_id = int.from_bytes(frame[7:10], "little")
    extra = mavlink.mavlink_map[message_id].crc_extra
    body = frame[1:4] + bytes((sequence,)) + frame[5:-2]
    checksum = fastcrc.crc16.mcrf4xx(body + bytes((extra,)))
    return frame[:1] + body + checksum.to_bytes(2, "little")


def send(port: int, vehicles: int, seconds: float) -> int:
    """Sends the feed, each vehicle from a socket of its own as vehicles do; returns how many frames."""
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(vehicles)]
    frames = [encode(1 + vehicle) for vehicle in range(vehicles)]
    print("sending", flush=True)
    start = time.monotonic()
    sent = 0
    for period in range(int(seconds / PERIOD_S)):
        for vehicle, (own, stream) in enumerate(zip(sockets, frames, strict=True)):
            wait = start + (period + vehicle / vehicles) * PERIOD_S - time.monotonic()
            if wait > 0:
                time.sleep(wait)
            for index in range(period * BURST, (period + 1) * BURST):
                own.sendto(stream[index % len(stream)], ("127.0.0.1", port))
                sent += 1
    for own in sockets:
        own.close()
    return sent


if __name__ == "__main__":
    print(send(int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])))
