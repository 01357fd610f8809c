"""MAVLink FTP with the simulated vehicle at packet loss; refusals have a reason; the vehicle executes a
repeated request once."""

import asyncio
import struct

import pytest

from gcs_server.errors import Disconnected, NoReply
from gcs_server.vehicle.services.ftp import FtpService
from gcs_server.vehicle.services.ftp_codec import FtpError, FtpFailed
from tests.protocol.memory_testbed import MemoryTestbed
from tests.protocol.simulated_autopilot import SimulatedAutopilot
from vehicle_sim.storage.metadata import BUILT_IN, PARAMETERS, crc32

FTP_ID = 110
_header = struct.Struct("<HBBBBBBI")


def run_ftp(run_simulated, work, *, loss=0.0, seed=0):
    async def run():
        testbed = MemoryTestbed()
        autopilot = SimulatedAutopilot(testbed.link())
        try:
            vehicle = await testbed.ready()
            autopilot.loss = loss
            autopilot.random.seed(seed)
            await work(testbed, FtpService(vehicle), autopilot, vehicle)
        finally:
            autopilot.alive = False
            await testbed.close()

    run_simulated(run)


@pytest.mark.parametrize(("loss", "seed"), [(0.0, 1), (0.05, 2), (0.2, 3)])
def test_a_file_is_read_completely_at_any_packet_loss(run_simulated, loss, seed):
    async def work(testbed, ftp, autopilot, _):
        reports = []
        content = await ftp.read(PARAMETERS, progress=lambda *p: reports.append(p))
        assert crc32(content) == crc32(BUILT_IN[PARAMETERS]())
        assert reports[-1] == (len(content), len(content))
        assert [e.name for e in await ftp.list("etc/extras")] == sorted(p.split("/")[-1] for p in BUILT_IN)
        assert await ftp.crc32(PARAMETERS) == crc32(content)
        if not loss:  # in bursts of 40 kB, not piece by piece
            assert autopilot.count(FTP_ID) < 12

    run_ftp(run_simulated, work, loss=loss, seed=seed)


def test_each_refusal_has_its_reason_and_leaves_no_session_open(run_simulated):
    async def work(testbed, ftp, autopilot, _):
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
        assert await ftp.read(PARAMETERS) == BUILT_IN[PARAMETERS]()

    run_ftp(run_simulated, work)


def test_a_session_left_open_by_an_earlier_run_is_closed_first(run_simulated):
    async def work(testbed, ftp, autopilot, vehicle):
        before = FtpService(vehicle)
        reading = asyncio.ensure_future(before._open(PARAMETERS))
        await reading  # the earlier server was killed after this request
        assert len(await ftp.read(PARAMETERS)) == len(BUILT_IN[PARAMETERS]())

    run_ftp(run_simulated, work)


def test_a_repeated_request_has_the_same_number(run_simulated):
    """By the number, the vehicle detects a repeated request, and repeats its reply instead of the action."""

    async def work(testbed, ftp, autopilot, _):
        await ftp.read(PARAMETERS)
        sent = [
            _header.unpack_from(f[13:-2].ljust(12, b"\0"))
            for f in autopilot.received
            if f[7] == FTP_ID and not f[8]
        ]
        requests = {}
        for sequence, _, opcode, _, _, _, _, offset in sent:
            assert requests.setdefault(sequence, (opcode, offset)) == (opcode, offset)
        assert len(requests) < len(sent)  # some were repeated

    run_ftp(run_simulated, work, loss=0.2, seed=8)


def test_two_reads_run_one_after_the_other_and_a_lost_link_ends_both(run_simulated):
    async def work(testbed, ftp, autopilot, vehicle):
        requests = asyncio.gather(ftp.read(PARAMETERS), ftp.list("etc/extras"))
        await asyncio.sleep(0.1)
        assert not requests.done()
        content, entries = await requests
        assert content
        assert entries
        autopilot.loss = 1.0
        began = testbed.loop.time()
        reading = asyncio.ensure_future(ftp.read(PARAMETERS))
        with pytest.raises(Disconnected):
            await reading
        assert testbed.loop.time() - began < 6

    run_ftp(run_simulated, work)


def test_a_vehicle_that_does_not_reply_is_reported_at_the_deadline(run_simulated):
    async def run():
        testbed = MemoryTestbed()
        testbed.autopilot(testbed.link())  # a vehicle without FTP
        try:
            vehicle = await testbed.ready()
            with pytest.raises(NoReply, match="did not answer: listing"):
                await FtpService(vehicle).list("/")
        finally:
            await testbed.close()

    run_simulated(run)
