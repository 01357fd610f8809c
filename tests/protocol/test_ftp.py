"""MAVLink FTP with the simulated vehicle: reads with packet loss, reasons of refusals, and repeated requests,
which the vehicle executes once."""

import asyncio
import struct

import pytest

from gcs_server.errors import Disconnected, NoReply
from gcs_server.vehicle.services.ftp import FtpService
from gcs_server.vehicle.services.ftp_codec import FtpError, FtpFailed
from tests.protocol.memory_testbed import MemoryTestbed
from tests.protocol.simulated_autopilot import SimulatedAutopilot
from vehicle_sim.storage.metadata import PARAMETERS, built_in, crc32

FTP_MESSAGE_ID = 110
HEADER = struct.Struct("<HBBBBBBI")
"""Sequence number, session, opcode, size, request opcode, burst complete, padding, offset."""


def run_with_ftp(run_simulated, scenario, *, loss=0.0, seed=0):
    async def run():
        testbed = MemoryTestbed()
        autopilot = SimulatedAutopilot(testbed.link())
        try:
            vehicle = await testbed.wait_for_vehicle()
            autopilot.loss = loss
            autopilot.random.seed(seed)
            await scenario(testbed, FtpService(vehicle), autopilot, vehicle)
        finally:
            autopilot.alive = False
            await testbed.close()

    run_simulated(run)


@pytest.mark.parametrize(("loss", "seed"), [(0.0, 1), (0.05, 2), (0.2, 3)])
def test_a_file_is_read_completely_at_any_packet_loss(run_simulated, loss, seed):
    async def scenario(testbed, ftp, autopilot, _):
        progress_values = []
        content = await ftp.read(PARAMETERS, progress=lambda *p: progress_values.append(p))
        assert crc32(content) == crc32(built_in()[PARAMETERS]())
        assert progress_values[-1] == (len(content), len(content))
        documents = [p.split("/")[-1] for p in built_in() if p.startswith("etc/extras/")]
        assert [e.name for e in await ftp.list("etc/extras")] == sorted(documents)
        assert await ftp.crc32(PARAMETERS) == crc32(content)
        if not loss:  # in bursts of 40 kB, not piece by piece
            assert autopilot.count(FTP_MESSAGE_ID) < 12

    run_with_ftp(run_simulated, scenario, loss=loss, seed=seed)


def test_each_refusal_has_its_reason_and_leaves_no_session_open(run_simulated):
    async def scenario(testbed, ftp, autopilot, _):
        for path, error, text in (
            ("nothing/here.txt", FtpError.FILE_NOT_FOUND, "there is no such file"),
            ("etc", FtpError.FAIL_ERRNO, "Is a directory"),
        ):
            with pytest.raises(FtpFailed, match=text) as caught:
                await ftp.read(path)
            assert (caught.value.ftp_error, caught.value.path) == (error, path)
        with pytest.raises(FtpFailed, match="no such"):
            await ftp.list("nothing")
        with pytest.raises(FtpFailed, match="are not read"):
            await ftp.read(PARAMETERS, max_bytes=1000)
        with pytest.raises(FtpFailed, match="not a valid path"):
            await ftp.read("a" * 300)
        assert await ftp.read(PARAMETERS) == built_in()[PARAMETERS]()

    run_with_ftp(run_simulated, scenario)


def test_a_session_left_open_by_an_earlier_run_is_closed_first(run_simulated):
    async def scenario(testbed, ftp, autopilot, vehicle):
        earlier_service = FtpService(vehicle)
        opening = asyncio.ensure_future(earlier_service._open(PARAMETERS))
        await opening  # the earlier server was killed after this request
        assert len(await ftp.read(PARAMETERS)) == len(built_in()[PARAMETERS]())

    run_with_ftp(run_simulated, scenario)


def test_a_repeated_request_has_the_same_sequence_number(run_simulated):
    """The vehicle detects a repeated request by its sequence number and repeats the reply, not the action."""

    async def scenario(testbed, ftp, autopilot, _):
        await ftp.read(PARAMETERS)
        # Before the FTP payload: 10 bytes of MAVLink header, 3 bytes of receiver; after it: the checksum.
        headers = [
            HEADER.unpack_from(frame[13:-2].ljust(12, b"\0"))
            for frame in autopilot.received_frames
            if frame[7] == FTP_MESSAGE_ID and not frame[8]
        ]
        request_by_sequence = {}
        for sequence, _, opcode, _, _, _, _, offset in headers:
            assert request_by_sequence.setdefault(sequence, (opcode, offset)) == (opcode, offset)
        assert len(request_by_sequence) < len(headers), "no request was repeated"

    run_with_ftp(run_simulated, scenario, loss=0.2, seed=8)


def test_a_read_and_a_simultaneous_list_both_complete_and_a_lost_link_ends_a_read(run_simulated):
    async def scenario(testbed, ftp, autopilot, vehicle):
        requests = asyncio.gather(ftp.read(PARAMETERS), ftp.list("etc/extras"))
        await asyncio.sleep(0.1)
        assert not requests.done()
        content, entries = await requests
        assert content
        assert entries
        autopilot.loss = 1.0
        began_s = testbed.loop.time()
        reading = asyncio.ensure_future(ftp.read(PARAMETERS))
        with pytest.raises(Disconnected):
            await reading
        assert testbed.loop.time() - began_s < 6

    run_with_ftp(run_simulated, scenario)


def test_a_vehicle_that_does_not_reply_is_reported_at_the_deadline(run_simulated):
    async def run():
        testbed = MemoryTestbed()
        testbed.autopilot(testbed.link())  # a vehicle without FTP
        try:
            vehicle = await testbed.wait_for_vehicle()
            with pytest.raises(NoReply, match="did not answer: listing"):
                await FtpService(vehicle).list("/")
        finally:
            await testbed.close()

    run_simulated(run)
