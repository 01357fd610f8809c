"""A program that flies north at about 1.5 m/s, and asks for Offboard again and again: `python -m
tests.support.streaming_program PORT SYSTEM`."""

from __future__ import annotations

import socket
import sys
import time
from contextlib import suppress

from pymavlink.dialects.v20 import common as mavlink

VELOCITY_ONLY = 0b110111000111


def fly(port: int, system: int) -> None:
    """Sends setpoints to a port of this computer until it is ended."""
    mav = mavlink.MAVLink(None, srcSystem=245, srcComponent=190)
    beaten_s = asked_s = 0.0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.connect(("127.0.0.1", port))
        link.setblocking(False)

        def send(message: mavlink.MAVLink_message) -> None:
            link.send(message.pack(mav))
            mav.seq = (mav.seq + 1) % 256

        while True:
            now_s = time.monotonic()
            if now_s - beaten_s > 1.0:
                beaten_s = now_s
                send(mav.heartbeat_encode(mavlink.MAV_TYPE_ONBOARD_CONTROLLER, 8, 0, 0, 4))
            north_m_s = 1.5 + now_s % 1.0 / 100.0
            send(
                mav.set_position_target_local_ned_encode(
                    0, system, 1, 1, VELOCITY_ONLY, 0, 0, 0, north_m_s, *(0,) * 7
                )
            )
            if now_s - asked_s > 5.0:
                asked_s = now_s
                send(mav.command_long_encode(system, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, 6, *(0,) * 5))
            with suppress(BlockingIOError):
                while link.recv(65536):
                    pass
            time.sleep(0.05)


if __name__ == "__main__":
    fly(int(sys.argv[1]), int(sys.argv[2]))
