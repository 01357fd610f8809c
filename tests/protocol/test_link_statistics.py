"""The response of `GET /links`: received frames, bytes outside of frames, and the recording."""

import asyncio

from gcs_server.mavlink import tlog_writer
from tests.protocol.memory_testbed import MemoryTestbed, run_test
from vehicle_sim.mavlink import generated_dialect as sim


def test_invalid_bytes_are_counted_also_for_a_lost_peer(run_simulated):
    async def scenario(testbed):
        link = testbed.link()
        testbed.autopilot(link)
        await testbed.ready()
        before = testbed.router.links()[0]
        assert (before.bytes_skipped, before.crc_errors, before.frames_lost) == (0, 0, 0)
        raw = bytearray(sim.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3).pack(testbed.autopilot(link).mav))
        raw[-1] ^= 0x55
        link.inject(bytes(raw), "stranger")
        link.inject(b"AT+RST\r\n" * 20, "stranger")
        link.inject(b"\x00" * 300, "stranger")
        info = testbed.router.links()[0]
        assert info.crc_errors == 1
        assert 460 <= info.bytes_skipped <= 460 + len(raw)
        for peer in link.peers():
            if peer.name == "stranger":
                link._forget(peer)
        after = testbed.router.links()[0]
        assert (after.crc_errors, after.bytes_skipped) == (info.crc_errors, info.bytes_skipped)
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
        assert (no_recording.file, no_recording.bytes, no_recording.started_unix_s, no_recording.stopped) == (
            None,
            0,
            None,
            None,
        )
        testbed.autopilot(link)
        await testbed.ready()
        recorder = testbed.router._recorder
        recorder.flush()
        running = testbed.router.links()[0].recording
        path = tmp_path / running.file
        assert running.bytes == path.stat().st_size > 0
        assert abs(running.started_unix_s - testbed.clock.unix_s()) < 3600
        assert running.stopped is None
        monkeypatch.setattr(recorder, "_keep_free_bytes", 1 << 62)
        await asyncio.sleep(1)
        recorder.flush()
        stopped = testbed.router.links()[0].recording
        assert "Free some space" in stopped.stopped
        assert stopped.file == running.file
        replay = testbed.link("tape", replay=True)
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
