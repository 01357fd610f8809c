"""The response of `GET /links`: received frames, bytes outside of frames, and the recording."""

import asyncio

from gcs_server.mavlink import tlog_writer
from tests.protocol.memory_testbed import MemoryTestbed, run_test
from vehicle_sim.mavlink import generated_dialect as sim


def test_invalid_bytes_remain_counted_after_their_peer_is_removed(run_simulated):
    async def scenario(testbed):
        link = testbed.link()
        testbed.autopilot(link)
        await testbed.wait_for_vehicle()
        before = testbed.router.links()[0]
        assert (before.bytes_skipped, before.crc_errors, before.frames_lost) == (0, 0, 0)
        invalid_frame = bytearray(
            sim.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3).pack(testbed.autopilot(link).mav)
        )
        invalid_frame[-1] ^= 0x55
        link.inject(bytes(invalid_frame), "unknown")
        link.inject(b"AT+RST\r\n" * 20, "unknown")
        link.inject(b"\x00" * 300, "unknown")
        counted = testbed.router.links()[0]
        assert counted.crc_errors == 1
        # 160 bytes of text, 300 zeros, and at most the whole invalid frame.
        assert 460 <= counted.bytes_skipped <= 460 + len(invalid_frame)
        for peer in link.peers():
            if peer.name == "unknown":
                link._forget(peer)
        after = testbed.router.links()[0]
        assert (after.crc_errors, after.bytes_skipped) == (counted.crc_errors, counted.bytes_skipped)
        await asyncio.sleep(2)
        assert testbed.router.links()[0].frames_received > before.frames_received
        assert not testbed.fleet.get("1").status.link_lost

    run_test(run_simulated, scenario)


def test_the_recording_of_a_link_is_listed_with_the_reason_why_it_stopped(
    run_simulated, tmp_path, monkeypatch
):
    async def scenario(testbed):
        link = testbed.link()
        no_recording = testbed.router.links()[0].recording
        assert (no_recording.file, no_recording.bytes) == (None, 0)
        assert (no_recording.started_unix_s, no_recording.stopped) == (None, None)
        testbed.autopilot(link)
        await testbed.wait_for_vehicle()
        recorder = testbed.router._recorder
        recorder.flush()
        running_recording = testbed.router.links()[0].recording
        path = tmp_path / running_recording.file
        assert running_recording.bytes == path.stat().st_size > 0
        assert abs(running_recording.started_unix_s - testbed.clock.unix_s()) < 3600
        assert running_recording.stopped is None
        monkeypatch.setattr(recorder, "_keep_free_bytes", 1 << 62)
        await asyncio.sleep(1)
        recorder.flush()
        stopped_recording = testbed.router.links()[0].recording
        assert "Free some space" in stopped_recording.stopped
        assert stopped_recording.file == running_recording.file
        replay = testbed.link("replay", replay=True)
        assert testbed.router.connection(replay.name).info().recording is None

    monkeypatch.setattr(tlog_writer.TlogRecorder, "start", lambda self: None)
    run_test(
        run_simulated, scenario, lambda: MemoryTestbed(recording_dir=tmp_path, recording_keep_free_bytes=0)
    )


def test_without_a_recorder_the_recording_of_a_link_is_null(run_simulated):
    async def scenario(testbed):
        testbed.link()
        assert testbed.router.links()[0].recording is None

    run_test(run_simulated, scenario)
