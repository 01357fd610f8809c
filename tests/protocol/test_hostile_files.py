"""Reads of a vehicle's files with false, slow or endless replies end with an error that gives the reason."""

import pytest

from gcs_server.errors import NoReply
from gcs_server.vehicle.services.ftp import EXTRA_TIME_S, LIST_TIMEOUT_S, MIN_BYTES_S, FtpService
from gcs_server.vehicle.services.ftp_codec import FtpFailed
from tests.protocol.hostile_files import BURST, READ, HostileFtpServer
from tests.protocol.one_vehicle import run_scenario

SIZE = 20_000
PIECE_BYTES = 239
"""Data bytes of one FTP message."""
MAX_PIECES_PER_ITERATION = 64
TOLERANCE_S = 10


def read_until_error(run_simulated, text, *, size=SIZE, error=FtpFailed, within_s=None, **behaviour):
    requests = {}

    async def scenario(testbed, vehicle, autopilot):
        files = HostileFtpServer(autopilot, size, **behaviour)
        began_s = testbed.loop.time()
        with pytest.raises(error, match=text):
            await FtpService(vehicle).read("etc/file")
        requests.update(files.request_counts)
        limit_s = EXTRA_TIME_S + size / MIN_BYTES_S if within_s is None else within_s
        assert testbed.loop.time() - began_s <= limit_s + TOLERANCE_S

    run_scenario(run_simulated, scenario)
    return requests


def test_a_read_of_a_file_in_one_byte_pieces_is_cancelled(run_simulated):
    requests = read_until_error(run_simulated, "too many pieces", read=lambda offset, size: [(offset, b"x")])
    assert requests[READ] < SIZE / 8


def test_a_burst_of_one_byte_pieces_is_cancelled(run_simulated):
    requests = read_until_error(
        run_simulated,
        "too many pieces",
        burst=lambda offset, size: [(offset + 2 * i, b"x") for i in range(2000)],
        read=lambda offset, size: [(offset, b"x")],
    )
    assert requests[BURST] < 20


def test_a_piece_at_another_offset_than_requested_is_refused(run_simulated):
    requests = read_until_error(
        run_simulated,
        "answered with byte 1,000 instead of 0",
        read=lambda offset, size: [(1000, b"x" * size)],
        within_s=10,
    )
    assert requests[READ] == 1


def test_an_endless_burst_without_data_is_cancelled(run_simulated):
    read_until_error(
        run_simulated,
        "too many pieces|not finished within",
        burst=lambda offset, size: [(offset, b"")] * 100_000,
        reply_interval_s=0.3,
    )


@pytest.mark.story
def test_a_read_that_exceeds_the_time_limit_of_its_size_is_cancelled(run_simulated):
    def pieces(offset, size):
        return [(offset + PIECE_BYTES * i, b"x" * PIECE_BYTES) for i in range(2000)]

    read_until_error(run_simulated, "not finished within", size=400_000, burst=pieces, reply_interval_s=0.58)


def test_a_file_that_claims_to_be_larger_than_allowed_is_not_read(run_simulated):
    requests = read_until_error(
        run_simulated, "4,000,000,000 bytes; more than", size=4_000_000_000, within_s=10
    )
    assert READ not in requests
    assert BURST not in requests


def test_a_read_from_a_vehicle_that_replies_only_to_the_open_request_is_an_error(run_simulated):
    read_until_error(run_simulated, "did not answer", error=NoReply, read=lambda offset, size: [])


def test_an_endless_directory_list_is_cancelled(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        HostileFtpServer(autopilot, SIZE, reply_interval_s=0.2)
        began_s = testbed.loop.time()
        with pytest.raises(FtpFailed, match="not finished within"):
            await FtpService(vehicle).list("etc")
        assert testbed.loop.time() - began_s < LIST_TIMEOUT_S + 1

    run_scenario(run_simulated, scenario)


def test_the_event_loop_runs_between_the_pieces_of_a_burst(run_simulated):
    """All pieces of a burst are already queued when the reader runs."""

    async def scenario(testbed, vehicle, autopilot):
        HostileFtpServer(
            autopilot,
            PIECE_BYTES * 1000,
            burst=lambda offset, size: [(offset + PIECE_BYTES * i, b"x" * PIECE_BYTES) for i in range(1000)],
        )
        pieces_in_iteration, max_pieces, last_received = [0], [0], [0]

        def progress(received, _):
            pieces_in_iteration[0] += (received - last_received[0]) // PIECE_BYTES
            last_received[0] = received
            max_pieces[0] = max(max_pieces[0], pieces_in_iteration[0])

        run_once = testbed.loop._run_once

        def run_iteration():
            pieces_in_iteration[0] = 0
            run_once()

        testbed.loop._run_once = run_iteration
        content = await FtpService(vehicle).read("etc/file", progress=progress)
        assert len(content) == PIECE_BYTES * 1000
        assert max_pieces[0] <= MAX_PIECES_PER_ITERATION

    run_scenario(run_simulated, scenario)
