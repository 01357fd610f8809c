"""The real stream process, and a vehicle that receives its frames on a real socket."""

import asyncio
import contextlib
import functools
import inspect
import os
import socket
import struct
import threading
import time
from types import SimpleNamespace

from gcs_server.clock import SystemClock
from gcs_server.links.base import Peer
from gcs_server.streamer.process.streams import Streams
from gcs_server.streamer.values.snapshot import Snapshot
from gcs_server.streamer.values.stream_request import StreamRequest
from missions.setpoints import Position

HOVER = Position(position_ned_m=(0.0, 0.0, -5.0), yaw_ned_rad=0.0)
OWN_IDS = (255, 191)
MSG_SET_POSITION_TARGET_LOCAL_NED = 84
VELOCITY_ONLY = 2503
"""The type_mask of a velocity with a yaw and without a yaw rate."""


class StreamedVehicle:
    """A vehicle's UDP socket, and stand-ins for the server's objects of its link.

    `received_frames` has the datagrams that the stream process sent to the vehicle, `recorded_frames` the
    frames that it reported for the recording, and `relayed_setpoints` the setpoints that the server must send
    itself.
    """

    def __init__(self):
        self.receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.receiver.bind(("127.0.0.1", 0))
        self.received_frames, self.recorded_frames, self.relayed_setpoints = [], [], []
        self.link_socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.has_datagram_socket = True
        link = SimpleNamespace(datagram_socket=lambda: self.link_socket if self.has_datagram_socket else None)
        self.path = SimpleNamespace(
            connection=SimpleNamespace(link=link, count_sent_elsewhere=self._record, signing=None),
            peer=Peer("peer", self.receiver.getsockname()),
        )
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self):
        with contextlib.suppress(OSError):
            while True:
                self.received_frames.append((time.monotonic(), self.receiver.recv(300)))

    def _record(self, time_us, raw):
        self.recorded_frames.append((time_us, raw))

    def send_payload(self, msg_id, payload, *, created_s=None):
        self.created_s = created_s
        self.relayed_setpoints.append((time.monotonic(), msg_id, payload))
        return True

    def send_path(self):
        return self.path

    async def receive_pending(self):
        """Waits until `received_frames` has all datagrams sent before this call, and an empty datagram."""
        self.link_socket.sendto(b"", self.receiver.getsockname())
        await until(lambda: self.received_frames and not self.received_frames[-1][1])

    def close(self):
        self.receiver.close()
        self.link_socket.close()


def with_stream_process(scenario):
    """Runs a test in a new event loop, with a stream process and one vehicle."""

    @functools.wraps(scenario, assigned=("__name__", "__doc__"))
    def test(**parameters):
        async def run():
            process, vehicle = (
                Streams(SystemClock(), OWN_IDS, server_silent_limit_s=0.5),
                StreamedVehicle(),
            )
            process.start()
            try:
                await scenario(process, vehicle, **parameters)
            finally:
                process.close()
                vehicle.close()

        asyncio.run(run())

    pytest_parameters = list(inspect.signature(scenario).parameters.values())[2:]
    test.__signature__ = inspect.Signature(pytest_parameters)
    del test.__wrapped__
    return test


def snapshot():
    return Snapshot(time.monotonic(), "offboard", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0)


async def start_stream(streams, name, vehicle, rate_hz=50.0, request=None, attach=True):
    """Starts a stream to the vehicle and engages it; returns the number of the stream."""
    if attach:
        streams.attach(name, vehicle, (7, 1))
    number = await streams.begin(name, request or StreamRequest(HOVER, 60.0), rate_hz, snapshot())
    assert number
    assert await streams.engage(name, snapshot(), number)
    return number


def has_ended(pid):
    with contextlib.suppress(OSError):
        os.kill(pid, 0)
        return False
    return True


def type_mask(raw):
    """The type_mask in a frame of SET_POSITION_TARGET_LOCAL_NED, after a header of 10 bytes."""
    return struct.unpack_from("<H", raw, 10 + 48)[0]


def block_event_loop(seconds):
    """Blocks the event loop of the test."""
    time.sleep(seconds)


async def until(condition, within_s=3.0):
    deadline_s = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < deadline_s
        await asyncio.sleep(0.005)


def is_port_free(address):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(address)
        except OSError:
            return False
        return True
