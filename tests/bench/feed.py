"""A feed of many vehicles' telemetry, encoded in advance so that sending takes little CPU time.

`python -m tests.bench.feed PORT[,PORT …] VEHICLES SECONDS [moving]` sends from a separate process and
prints how many frames it sent to each port; every consumer of a comparison gets the same feed. With
`moving` each vehicle flies a circle, so that a 3D view has to draw its motion.
"""

from __future__ import annotations

import math
import socket
import sys
import time

import fastcrc
from pymavlink.dialects.v20 import common as mavlink

MESSAGES_PER_S = 100
"""Messages per second of a vehicle: a mix as on PX4's ground-station link, reduced to 100 per second."""

BURST = 2
"""PX4 sends its 50 Hz streams together: of 100 messages per second, two every 20 ms."""
PERIOD_S = BURST / MESSAGES_PER_S
RADIUS_M = 12.0
UNITS_PER_M_NORTH, UNITS_PER_M_EAST = 90, 133
"""Units of latitude and longitude [1e-7 deg] per metre."""
LOOP_S = 64
"""The feed repeats itself after this time, in which a moving vehicle flies its circle twice [s]."""


def _frame(mav: mavlink.MAVLink, system_id: int, index: int, angle_rad: float = 0.0) -> bytes:
    """The `index`-th frame of a second of telemetry (0–99), `angle_rad` along the circle."""
    boot_ms = 10_000 + index * 10
    north_m, east_m = RADIUS_M * math.sin(angle_rad), RADIUS_M * (1 - math.cos(angle_rad))
    roll_rad, pwm = 0.2 * math.sin(5 * angle_rad), round(40 * math.sin(7 * angle_rad))
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
            boot_ms,
            473977420 + system_id * 1000 + round(north_m * UNITS_PER_M_NORTH),
            85455940 + index + round(east_m * UNITS_PER_M_EAST),
            501000,
            12000,
            10,
            20,
            -5,
            4000,
        )
    elif index % 5 == 1:
        message = mavlink.MAVLink_local_position_ned_message(
            boot_ms, 1.0 + north_m, 2.0 + east_m, -12.0, 0.1, 0.2, 0.0
        )
    elif index % 5 == 2:
        message = mavlink.MAVLink_servo_output_raw_message(
            boot_ms, 0, 1490 + pwm, 1500 - pwm, 1480, 1510, 0, 0, 0, 0
        )
    elif index % 5 == 3:
        message = mavlink.MAVLink_attitude_quaternion_message(
            boot_ms, math.cos(angle_rad / 2), 0.5 * roll_rad, 0.02, math.sin(angle_rad / 2), 0.1, 0.0, 0.0
        )
    else:
        message = mavlink.MAVLink_attitude_message(boot_ms, roll_rad, 0.02, 0.3, 0.1, 0.0, 0.0)
    return message.pack(mav)


def encode(system_id: int, *, moving: bool = False) -> list[bytes]:
    """The vehicle's frames of 64 s. They are 6,400 = 25 × 256, so a repeated list has continuous sequence
    numbers."""
    mav = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=1)
    count = LOOP_S * MESSAGES_PER_S
    if moving:
        angles = (4 * math.pi * index / count for index in range(count))
        frames = [_frame(mav, system_id, i % MESSAGES_PER_S, angle) for i, angle in enumerate(angles)]
    else:
        frames = [_frame(mav, system_id, index) for index in range(MESSAGES_PER_S)] * LOOP_S
    return [_with_sequence(frame, index % 256) for index, frame in enumerate(frames)]


def _with_sequence(frame: bytes, sequence: int) -> bytes:
    """The same MAVLink 2 frame with another sequence number (byte 4) and its checksum."""
    message_id = int.from_bytes(frame[7:10], "little")
    crc_extra = mavlink.mavlink_map[message_id].crc_extra
    body = frame[1:4] + bytes((sequence,)) + frame[5:-2]
    checksum = fastcrc.crc16.mcrf4xx(body + bytes((crc_extra,)))
    return frame[:1] + body + checksum.to_bytes(2, "little")


def send(ports: list[int], vehicles: int, seconds: float, *, moving: bool = False) -> int:
    """Sends the feed; each vehicle sends from a socket of its own, as real vehicles do.

    Returns:
        Number of frames sent to each port.
    """
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(vehicles)]
    frames = [encode(1 + vehicle, moving=moving) for vehicle in range(vehicles)]
    print("sending", flush=True)
    start = time.monotonic()
    sent = 0
    for period in range(int(seconds / PERIOD_S)):
        for vehicle, (sender, stream) in enumerate(zip(sockets, frames, strict=True)):
            wait_s = start + (period + vehicle / vehicles) * PERIOD_S - time.monotonic()
            if wait_s > 0:
                time.sleep(wait_s)
            for index in range(period * BURST, (period + 1) * BURST):
                for port in ports:
                    sender.sendto(stream[index % len(stream)], ("127.0.0.1", port))
                sent += 1
    for sender in sockets:
        sender.close()
    return sent


if __name__ == "__main__":
    to_ports = [int(port) for port in sys.argv[1].split(",")]
    print(send(to_ports, int(sys.argv[2]), float(sys.argv[3]), moving="moving" in sys.argv[4:]))
