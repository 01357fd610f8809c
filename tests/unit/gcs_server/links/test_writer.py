"""The writer of a slow link under load, on a fake clock: which frames it sends, when, and which it drops."""

import heapq
import itertools
import os
import pty
import struct
import threading
import time
import tty

import pytest

from gcs_server.faults import FaultLog
from gcs_server.links.base import Link, Peer
from gcs_server.links.pacing import ACKED_WITHIN_S, RECHECK_PERIOD_S, AckPacer, LinePacer
from gcs_server.links.send_queue import Packet, SendCounts
from gcs_server.links.serial import SerialLink
from gcs_server.links.writer import LinkWriter
from gcs_server.mavlink.codec import FrameParser
from gcs_server.mavlink.connection import FrameSender
from tests.serial_line import SimulatedSerialLine
from tests.support.link_recorder import LinkRecorder, run_in_real_time

PEER = Peer("vehicle")
SETPOINT, PARAM_READ, COMMAND = 84, 20, 76
"""MAVLink message ids."""
HOLD, ARM, STOP = (1.0, 4.0, 176), (1.0, 0.0, 400), (0.0, 21196.0, 400)
"""Commands: param1, param2, MAV_CMD."""


class FakeLoop:
    """A fake event loop with timers; the test advances its time."""

    def __init__(self):
        self.now_s, self._timers, self._count = 1000.0, [], itertools.count()

    def time(self):
        return self.now_s

    def call_at(self, at_s, callback):
        heapq.heappush(self._timers, (at_s, next(self._count), callback))

    def call_soon_threadsafe(self, callback, *arguments):
        callback(*arguments)

    def run(self, for_s):
        end_s = self.now_s + for_s
        while self._timers and self._timers[0][0] <= end_s:
            at_s, _, callback = heapq.heappop(self._timers)
            self.now_s = max(self.now_s, at_s)
            callback()
        self.now_s = end_s


class SlowLink(Link):
    """A link on a simulated serial line, on fake time."""

    def __init__(self, pacer=None, write=None):
        super().__init__("slow", "serial")
        self.loop = FakeLoop()
        self.now_s = self.loop.time
        self.line = SimulatedSerialLine(self.loop.time)
        self.writer = LinkWriter(
            self.loop,
            write or (lambda data, _peer: self.line.write(data)),
            self._counts,
            self.faults,
            self.loop.time,
            pacer=pacer or LinePacer(57600, self.line.buffered_bytes),
        )
        self._state = "open"
        self._peers[PEER.name] = PEER
        self.recorded = []
        self.parameter_numbers = itertools.count()
        self.sender = FrameSender(self, 255, 190, self.recorded.append)

    def _open(self):
        raise AssertionError

    def _close(self):
        raise AssertionError

    def _writer(self, peer):
        return self.writer

    def setpoint(self, system=1):
        """Sends a setpoint whose time_boot_ms is its time of creation."""
        created_ms = round((self.loop.now_s - 1000) * 1000)
        payload = struct.pack("<I11fHBBB", created_ms, *range(1, 12), 2552, system, 1, 1)
        return self.sender.send(SETPOINT, payload, PEER)

    def command(self, command, system=1, **options):
        param1, param2, command_id = command
        payload = struct.pack("<7fHBBB", param1, param2, 0, 0, 0, 0, 0, command_id, system, 1, 0)
        return self.sender.send(COMMAND, payload, PEER, **options)

    def request_parameter(self, number):
        return self.sender.send(PARAM_READ, struct.pack("<hBB16s", number, 1, 1, b""), PEER)

    def run_under_load(self, for_s):
        """Sends a setpoint every 20 ms; parameter requests keep 40 packets waiting."""
        for _ in range(round(for_s / 0.02)):
            self.setpoint()
            while self.writer.waiting < 40:
                self.request_parameter(next(self.parameter_numbers) % 30000)
            self.loop.run(0.02)

    def sent_frames_of(self, msg_id):
        return [(at_s, frame) for at_s, frame in self.line.sent_frames if frame.msg_id == msg_id]

    def setpoint_ages_s(self):
        """For each sent setpoint, the time from its creation to its transmission."""
        return [
            at_s - 1000 - struct.unpack_from("<I", frame.payload)[0] / 1000
            for at_s, frame in self.sent_frames_of(SETPOINT)
        ]


def test_under_load_stop_motors_is_sent_within_50_ms():
    link = SlowLink()
    link.run_under_load(2.0)
    delays_s = []
    for number in range(20):
        link.loop.run(0.0013 * number)  # at different moments of the current transmission
        requested_s, sent_before = link.loop.now_s, len(link.sent_frames_of(COMMAND))
        assert link.command(STOP)
        link.run_under_load(0.1)
        delays_s.append(link.sent_frames_of(COMMAND)[sent_before][0] - requested_s)
    assert max(delays_s) < 0.05
    assert max(link.setpoint_ages_s()) < 0.1
    # The load lasts more than 4 s.
    assert len(link.sent_frames_of(SETPOINT)) > 45 * 4, "the stream stopped"
    assert len(link.sent_frames_of(PARAM_READ)) > 4 * 30, "parameters were not sent"
    assert sum(link.line.parser.lost.values()) == 0, "sequence numbers have gaps"


def test_after_a_stall_of_5_s_stop_motors_is_first_and_no_setpoint_is_late():
    link = SlowLink()
    link.run_under_load(1.0)
    assert link.line.sent_frames
    stall_begin_s = link.loop.now_s
    link.line.stall(5.0)
    link.run_under_load(4.8)
    link.command(ARM)
    link.command(STOP)
    link.run_under_load(2.0)
    stop_s, stop_frame = link.sent_frames_of(COMMAND)[0]
    assert stop_s - (stall_begin_s + 5.0) < 0.05
    frames_after_stall = [frame for at_s, frame in link.line.sent_frames if at_s > stall_begin_s + 5.0]
    frames_before_stop = frames_after_stall[: frames_after_stall.index(stop_frame)]
    assert sum(f.msg_id == SETPOINT for f in frames_before_stop) <= 2
    # The writer cannot remove up to two setpoints that are in the serial driver when the stall begins.
    assert sum(age_s > 0.1 for age_s in link.setpoint_ages_s()) <= 2
    assert len(link.sent_frames_of(COMMAND)) == 1, "the waiting arm command was sent after stop motors"
    assert sum(link.line.parser.lost.values()) == 0
    info = link.info()
    assert info.frames_sent == len(link.recorded)
    assert info.frames_replaced > 200


def test_an_expired_command_is_not_sent():
    link = SlowLink()
    link.run_under_load(0.5)
    link.line.stall(3.0)
    link.run_under_load(1.0)
    link.command(HOLD)
    link.command(STOP, until_s=link.loop.now_s + 0.2)
    link.run_under_load(4.0)
    assert link.sent_frames_of(COMMAND) == []
    assert link.info().frames_expired >= 2


def test_a_setpoint_that_reaches_the_link_too_late_is_not_sent():
    link = SlowLink()
    payload = struct.pack("<I11fHBBB", 1, *range(11), 2552, 1, 1, 1)
    link.sender.send(SETPOINT, payload, PEER, created_s=link.loop.now_s - 0.11)
    link.sender.send(SETPOINT, payload, PEER, created_s=link.loop.now_s - 0.09)
    link.loop.run(0.1)
    assert len(link.sent_frames_of(SETPOINT)) == 1
    assert link.info().frames_expired == 1


def test_streams_beyond_the_line_rate_share_the_line_and_do_not_block_parameters():
    link = SlowLink()
    for _ in range(100):
        for system in (1, 2, 3, 4):
            link.setpoint(system)
        link.request_parameter(len(link.sent_frames_of(PARAM_READ)))
        link.loop.run(0.02)
    # Byte 50 of a setpoint is its target system.
    counts_by_system = [
        sum(f.payload[50] == system for _, f in link.sent_frames_of(SETPOINT)) for system in (1, 2, 3, 4)
    ]
    assert min(counts_by_system) > 0.6 * max(counts_by_system) > 10
    assert len(link.sent_frames_of(PARAM_READ)) > 10


def test_an_expired_frame_that_is_partly_sent_ends_with_a_wrong_checksum_so_that_it_is_dropped():
    free_bytes, written = [20], bytearray()

    def write(data, _peer):
        written_count = min(free_bytes[0], len(data))
        if not written_count:
            raise BlockingIOError
        free_bytes[0] -= written_count
        written.extend(data[:written_count])
        return written_count

    link = SlowLink(pacer=LinePacer(float("inf"), lambda: 0), write=write)
    link.setpoint()
    link.loop.run(1.0)
    free_bytes[0] = 10_000
    link.command(STOP)
    link.loop.run(0.1)
    parser = FrameParser()
    assert [frame.msg_id for frame in parser.feed(bytes(written), 0.0)] == [COMMAND]
    assert parser.crc_errors == 1


def test_an_unsent_frame_does_not_use_its_sequence_number():
    link_full, written = [True], []

    def write(data, _peer):
        if link_full[0]:
            raise BlockingIOError
        written.append(data)
        return len(data)

    link = SlowLink(pacer=LinePacer(float("inf"), lambda: 0), write=write)
    link.request_parameter(1)
    link.request_parameter(2)
    assert link.command(HOLD)
    assert written == []
    link_full[0] = False
    link.loop.run(2 * RECHECK_PERIOD_S)
    # Byte 4 of a MAVLink 2 frame is its sequence number, byte 7 its message id.
    assert [data[4] for data in written] == [0, 1, 2]
    assert [data[7] for data in written] == [COMMAND, PARAM_READ, PARAM_READ]
    assert link.recorded == written


def test_a_frame_that_cannot_be_packed_does_not_affect_other_frames():
    link = SlowLink()
    link.line.stall(0.1)
    link.run_under_load(0.06)

    def fail_to_pack():
        raise struct.error("no such field")

    assert link.submit(Packet(PEER, 10, fail_to_pack, priority=0))
    link.command(HOLD)
    link.loop.run(1.0)
    assert len(link.sent_frames_of(COMMAND)) == 1
    assert link.info().handler_errors == 1


@pytest.mark.parametrize("round_trip_s", [0.001, 0.6])
def test_tcp_sending_pauses_while_an_acknowledgement_is_overdue(round_trip_s):
    unacknowledged_bytes = [0]
    pacer = AckPacer(lambda: unacknowledged_bytes[0], lambda: round_trip_s)
    timeout_s = ACKED_WITHIN_S + 2 * round_trip_s
    now_s, written_count = 0.0, 0
    while pacer.wait_s(now_s) == 0:  # nothing is acknowledged
        pacer.wrote(65, now_s)
        unacknowledged_bytes[0] += 65
        written_count += 1
        now_s += 0.02
    assert now_s == pytest.approx(timeout_s, abs=0.03)
    unacknowledged_bytes[0] = 65  # all but the newest are acknowledged
    assert pacer.wait_s(now_s) == 0
    unacknowledged_bytes[0] = 0
    assert pacer.wait_s(now_s + 100) == 0


def test_a_closed_writer_accepts_and_writes_nothing():
    link = SlowLink()
    link.line.stall(1.0)
    link.run_under_load(0.2)
    link.writer.close()
    sent_before = link.info().frames_sent
    assert not link.command(STOP)
    link.loop.run(2.0)
    assert link.info().frames_sent == sent_before


def test_threads_on_one_serial_link_share_sequence_numbers_and_lose_no_stop_motors_command():
    async def scenario():
        test_end, serial_end = pty.openpty()
        tty.setraw(test_end)
        recorder = LinkRecorder(SerialLink("radio", "serial", os.ttyname(serial_end), 921600)).start()
        (peer,) = recorder.link.peers()
        sender = FrameSender(recorder.link, 255, 190, lambda _: None)
        received, parser = [], FrameParser()

        def receive_commands():
            while len([f for f in received if f.msg_id == COMMAND]) < 40:
                received.extend(parser.feed(os.read(test_end, 4096), time.monotonic()))

        def send_commands(thread_index):
            for number in range(100):
                sender.send(PARAM_READ, struct.pack("<hBB16s", number + 1000 * thread_index, 1, 1, b""), peer)
                if number % 10 == 9:
                    stop = struct.pack(
                        "<7fHBBB", 0, 21196, 0, 0, 0, 0, 0, 400, 10 * thread_index + number // 10, 1, 0
                    )
                    sender.send(COMMAND, stop, peer)

        threads = [threading.Thread(target=send_commands, args=(n,), daemon=True) for n in range(4)]
        threads.append(threading.Thread(target=receive_commands, daemon=True))
        for thread in threads:
            thread.start()
        await recorder.until(lambda: not any(thread.is_alive() for thread in threads))
        # Byte 30 of a command is its target system, which here numbers the commands.
        received_stops = {frame.payload[30] for frame in received if frame.msg_id == COMMAND}
        assert received_stops == set(range(40))
        assert sum(parser.lost.values()) == parser.crc_errors == 0
        await recorder.link.close()
        os.close(test_end)
        os.close(serial_end)

    run_in_real_time(scenario)


def test_a_writer_updates_the_counters_of_its_link():
    counts = SendCounts()
    writer = LinkWriter(None, lambda data, _: len(data), counts, FaultLog("x"), lambda: 0.0)
    assert writer.submit(Packet(PEER, 3, lambda: b"abc"))
    assert (counts.frames_sent, counts.bytes_sent, writer.waiting) == (1, 3, 0)
