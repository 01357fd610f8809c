"""Delay of the stop motors command on a serial link at 57,600 baud with a 50 Hz stream and a parameter load.

It also measures the age of setpoints when their last byte is sent. The serial line is simulated at its real
speed, behind a pseudo-terminal.
"""

from __future__ import annotations

import asyncio
import fcntl
import os
import pty
import random
import struct
import termios
import threading
import time
import tty
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from gcs_server.clock import SystemClock
from gcs_server.links import serial
from gcs_server.links.base import LinkInfo
from gcs_server.mavlink.connection import Connection
from gcs_server.mavlink.router import Router, RouterSettings
from gcs_server.supervise import Supervisor
from tests.serial_line import SimulatedSerialLine

from .process import load_average, quantiles_ms

BAUD = 57_600
RATE_HZ = 50.0
STOP_COMMANDS = 60
STALL_S, STALLS = 5.0, 3
QUEUED_FRAMES = 40
"""Parameter requests are sent so that this many frames are always queued."""
MSG_PARAM_REQUEST_READ, MSG_COMMAND_LONG, MSG_SETPOINT = 20, 76, 84
MAV_CMD_COMPONENT_ARM_DISARM, FORCE = 400, 21196.0


class SlowPort:
    """A pseudo-terminal whose bytes go immediately into the driver of the simulated line."""

    def __init__(self) -> None:
        self._master_fd, self._slave_fd = pty.openpty()
        tty.setraw(self._master_fd)
        self.device = os.ttyname(self._slave_fd)
        self._lock = threading.Lock()
        self._line = SimulatedSerialLine(time.monotonic, BAUD)
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        try:
            while data := os.read(self._master_fd, 4096):
                with self._lock:
                    self._line.write(data)
        except OSError:
            return

    def bytes_in_driver(self, _fileno: int) -> int:
        """Unsent bytes, as a serial driver reports them; a pseudo-terminal always reports 0."""
        with self._lock:
            unread: int = struct.unpack("i", fcntl.ioctl(self._master_fd, termios.FIONREAD, b"\0" * 4))[0]
            return unread + self._line.buffered_bytes()

    def stall(self, for_s: float) -> None:
        with self._lock:
            self._line.stall(for_s)

    def sent_frames(self, msg_id: int) -> list[tuple[float, Any]]:
        with self._lock:
            return [(at_s, frame) for at_s, frame in self._line.sent_frames if frame.msg_id == msg_id]

    def lost_frames(self) -> int:
        with self._lock:
            return sum(self._line.parser.lost.values())

    def close(self) -> None:
        os.close(self._slave_fd)
        os.close(self._master_fd)


@contextmanager
def _stream(connection: Connection, began_s: float) -> Generator[None]:
    """Sends setpoints from a thread, like those of the stream process; each contains its time of creation."""
    (peer,), stop_event = connection.link.peers(), threading.Event()

    def send() -> None:
        next_s = time.monotonic()
        while not stop_event.wait(max(0.0, next_s - time.monotonic())):
            created_s = time.monotonic()
            # The measurement reads only the time.
            payload = struct.pack(
                "<I11fHBBB", round((created_s - began_s) * 1e6), *range(1, 12), 2552, 1, 1, 1
            )
            connection.sender.send(MSG_SETPOINT, payload, peer, created_s=created_s)
            next_s = max(next_s + 1 / RATE_HZ, created_s)

    thread = threading.Thread(target=send)
    thread.start()
    try:
        yield
    finally:
        stop_event.set()
        thread.join()


async def _load_parameters(connection: Connection) -> None:
    (peer,), number = connection.link.peers(), 0
    while True:
        while connection.link.info().frames_waiting < QUEUED_FRAMES:
            number = (number + 1) % 30_000
            payload = struct.pack("<hBB16s", number, 1, 1, b"")
            connection.sender.send(MSG_PARAM_REQUEST_READ, payload, peer)
        await asyncio.sleep(0.02)


@dataclass(frozen=True, slots=True)
class Result:
    """Delays of stop motors, ages of setpoints, and counts of frames."""

    stop_after_s: list[float]
    stop_after_stall_s: list[float]
    ages_s: list[float]
    seconds: float
    parameter_requests: int
    lost_frames: int
    info: LinkInfo


async def _measure(port: SlowPort) -> Result:
    clock, rng = SystemClock(), random.Random(1)
    supervisor = Supervisor(clock)
    router = Router(clock, supervisor, RouterSettings())
    router.add_link(f"serial://{port.device}?baud={BAUD}", "radio")
    connection = router.connection("radio")
    (peer,) = connection.link.peers()
    stop_payload = struct.pack("<7fHBBB", 0, FORCE, 0, 0, 0, 0, 0, MAV_CMD_COMPONENT_ARM_DISARM, 1, 1, 0)
    began_s = time.monotonic()
    load_task = supervisor.spawn("parameters", _load_parameters(connection))
    stop_after_s: list[float] = []
    stop_after_stall_s: list[float] = []
    with _stream(connection, began_s):
        await asyncio.sleep(1.0)
        for number in range(STOP_COMMANDS):
            requested_s = time.monotonic()
            connection.sender.send(MSG_COMMAND_LONG, stop_payload, peer)
            await asyncio.sleep(rng.uniform(0.1, 0.25))
            stop_after_s.append(port.sent_frames(MSG_COMMAND_LONG)[number][0] - requested_s)
        for number in range(STALLS):
            ends_s = time.monotonic() + STALL_S
            port.stall(STALL_S)
            await asyncio.sleep(STALL_S - rng.uniform(0.1, 0.8))
            connection.sender.send(MSG_COMMAND_LONG, stop_payload, peer)
            await asyncio.sleep(ends_s + 1.0 - time.monotonic())
            stop_after_stall_s.append(port.sent_frames(MSG_COMMAND_LONG)[STOP_COMMANDS + number][0] - ends_s)
    load_task.cancel()
    seconds, info = time.monotonic() - began_s - STALLS * STALL_S, router.links()[0]
    ages_s = [
        at_s - began_s - struct.unpack_from("<I", frame.payload)[0] / 1e6
        for at_s, frame in port.sent_frames(MSG_SETPOINT)
    ]
    parameter_requests = len(port.sent_frames(MSG_PARAM_REQUEST_READ))
    await router.close()
    await supervisor.close()
    return Result(
        stop_after_s, stop_after_stall_s, ages_s, seconds, parameter_requests, port.lost_frames(), info
    )


def table() -> Iterator[str]:
    yield f"load average before: {load_average()}"
    port, original = SlowPort(), serial.bytes_in_output_queue
    serial.bytes_in_output_queue = port.bytes_in_driver
    try:
        result = asyncio.run(_measure(port))
    finally:
        serial.bytes_in_output_queue = original
        port.close()
    # The others were already in the driver's buffer when the line stalled.
    in_time = [age_s for age_s in result.ages_s if age_s < STALL_S / 2]
    stalled = len(result.ages_s) - len(in_time)
    info = result.info
    stop_delays = quantiles_ms(result.stop_after_s)
    yield ""
    yield "| what | figure |"
    yield "|---|---|"
    yield f"| delay of stop motors, {STOP_COMMANDS} commands: p50 / p99 / max | {stop_delays} ms (goal: 50) |"
    stall_delays = ", ".join(f"{delay_s * 1e3:.1f}" for delay_s in result.stop_after_stall_s)
    yield f"| … after the end of a stall of {STALL_S:g} s, {STALLS} times | {stall_delays} ms |"
    yield f"| setpoints sent per second | {len(result.ages_s) / result.seconds:.1f} of {RATE_HZ:g} |"
    yield f"| age of a setpoint at its last byte: p50 / p99 / max | {quantiles_ms(in_time)} ms (goal: 100) |"
    yield f"| setpoints in the driver's buffer when the line stalled | {stalled} in {STALLS} stalls |"
    yield f"| parameter requests sent per second | {result.parameter_requests / result.seconds:.0f} |"
    yield f"| frames lost (by sequence number) | {result.lost_frames} |"
    yield (
        f"| replaced / expired / dropped, with the stalls | {info.frames_replaced} / {info.frames_expired} / "
        f"{info.frames_dropped} |"
    )
