"""A UDP relay between one simulated vehicle and the server that adds PX4's autotune, which the simulator does
not have: it answers the command and MC_AT_START itself, in shorter steps; the vehicle does not shake."""

from __future__ import annotations

import contextlib
import selectors
import socket
import struct
import threading
import time
from collections.abc import Generator
from typing import Any

from vehicle_sim.mavlink import generated_dialect as sim

LARGEST_DATAGRAM = 2048
STEPS: tuple[tuple[str, float, int], ...] = (
    ("roll", 6.0, 20), ("pitch", 4.0, 40), ("yaw", 4.0, 60), ("verification", 0.2, 80),
    ("complete", 2.0, 100),
)  # fmt: skip
"""Step, its duration [s] and progress [%]."""
RESULT_KEPT_S = 2.0


class RelayedAutotune:
    """The autotune of the vehicle behind the relay."""

    def __init__(self, system_id: int) -> None:
        self.mav = sim.MAVLink(None, srcSystem=system_id, srcComponent=1)
        self.port = 0
        """The port to which the vehicle sends."""
        self.starts = 0
        self.mode: int | None = None
        self._start_mode: int | None = None
        self._start_s = self._failed_s = -1e9

    def step(self) -> tuple[str, int]:
        """The present step and its progress [%]."""
        now_s = time.monotonic()
        if now_s - self._failed_s < RESULT_KEPT_S:
            return "fail", 0
        left_s = now_s - self._start_s
        for name, lasts_s, progress in STEPS if self._failed_s < self._start_s else ():
            if left_s < lasts_s:
                if self.mode != self._start_mode and name != "complete":
                    self._failed_s = now_s
                    return "fail", 0
                return name, progress
            left_s -= lasts_s
        return "idle", 0

    def answer(self, message: Any) -> bytes | None:
        """The answer to a message for autotune; None: it is for the vehicle."""
        kind = message.get_type()
        is_command = kind == "COMMAND_LONG" and message.command == sim.MAV_CMD_DO_AUTOTUNE_ENABLE
        if not is_command and not (kind == "PARAM_REQUEST_READ" and message.param_id == "MC_AT_START"):
            return None
        step, progress = self.step()
        if not is_command:
            bits = struct.unpack("<f", struct.pack("<i", step != "idle"))[0]
            value = sim.MAVLink_param_value_message(b"MC_AT_START", bits, sim.MAV_PARAM_TYPE_INT32, 900, 1)
            return value.pack(self.mav)
        if step == "idle":
            self.starts += 1
            self._start_s, self._start_mode = time.monotonic(), self.mode
        results = {"complete": sim.MAV_RESULT_ACCEPTED, "fail": sim.MAV_RESULT_FAILED}
        result = results.get(step, sim.MAV_RESULT_IN_PROGRESS)
        ack = sim.MAVLink_command_ack_message(sim.MAV_CMD_DO_AUTOTUNE_ENABLE, result, progress, 0, 255, 190)
        return ack.pack(self.mav)


@contextlib.contextmanager
def autotune_relay(server_port: int, system_id: int) -> Generator[RelayedAutotune]:
    """Runs the relay; its vehicle sends to `port`."""
    autotune, running = RelayedAutotune(system_id), True
    parsers = {side: sim.MAVLink(None) for side in ("server", "vehicle")}
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle_side,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server_side,
        selectors.DefaultSelector() as selector,
    ):
        for side in (vehicle_side, server_side):
            side.bind(("127.0.0.1", 0))
            selector.register(side, selectors.EVENT_READ)
        autotune.port = vehicle_side.getsockname()[1]

        def from_vehicle(data: bytes) -> None:
            messages: list[Any] = parsers["vehicle"].parse_buffer(data) or []
            for message in messages:
                if message.get_type() == "CURRENT_MODE":
                    autotune.mode = message.custom_mode
                    autotune.step()  # which ends it if the mode has changed
            server_side.sendto(data, ("127.0.0.1", server_port))

        def from_server(data: bytes, vehicle: Any) -> None:
            answers = [autotune.answer(m) for m in parsers["server"].parse_buffer(data) or []]
            if not any(answers) and vehicle is not None:
                vehicle_side.sendto(data, vehicle)
            for answer in filter(None, answers):
                server_side.sendto(answer, ("127.0.0.1", server_port))

        def run() -> None:
            vehicle: Any = None
            while running:
                for key, _ in selector.select(0.1):
                    with contextlib.suppress(OSError):
                        if key.fileobj is vehicle_side:
                            data, vehicle = vehicle_side.recvfrom(LARGEST_DATAGRAM)
                            from_vehicle(data)
                        else:
                            from_server(server_side.recv(LARGEST_DATAGRAM), vehicle)

        thread = threading.Thread(target=run, daemon=True)
        thread.start()
        try:
            yield autotune
        finally:
            running = False
            thread.join(2)
