"""Signed links: a vehicle with the key can be flown; the server does not handle, record or forward the frames
of an intruder.

The vehicle signs and checks with pymavlink, which shares no code with the server's signing.
"""

import asyncio

import pytest

from gcs_server.errors import InvalidRequest
from gcs_server.links.base import SigningOptions
from gcs_server.mavlink.codec import encode_frame
from gcs_server.mavlink.key_store import KeyStore
from gcs_server.mavlink.signing import (
    EPOCH_UNIX_S,
    TICKS_PER_S,
    FrameSigner,
    SecretKey,
    SigningClock,
    is_signed,
)
from gcs_server.replay.records import read_tlog
from gcs_server.scenarios.memory_link import MemoryLink
from tests.protocol.fake_autopilot import FakeAutopilot
from tests.protocol.memory_testbed import MemoryTestbed

KEY = bytes(range(100, 132))
OTHER_KEY = bytes(range(32))
HEARTBEAT_PAYLOAD = b"\0\0\0\0\x02\x0c\x51\x04\x03"


class SignedTestbed(MemoryTestbed):
    def __init__(self, tmp_path, **settings):
        keys = KeyStore(tmp_path / "signing")
        if not keys.names():
            keys.add("field", SecretKey(KEY))
        super().__init__(signing_dir=tmp_path / "signing", **settings)
        self.autopilots, self.sent_packets = {}, []

    def signed_link(self, name="radio", *, required=True, forward=False):
        def outgoing(data, peer):
            self.sent_packets.append((data, peer.name))
            if peer.name in self.autopilots:
                self.autopilots[peer.name].receive(data)

        link = MemoryLink(name, outgoing=outgoing, forward=forward)
        link.signing = SigningOptions("field", required=required)
        self.router.add(link)
        return link

    def timestamp_now(self):
        return int((self.clock.unix_s() - EPOCH_UNIX_S) * TICKS_PER_S)

    def signed_autopilot(self, link, *, key=KEY, timestamp=None, **options):
        autopilot = FakeAutopilot(link, **options)
        autopilot.mav.signing = autopilot.parser.signing
        signing = autopilot.parser.signing
        signing.secret_key, signing.link_id, signing.sign_outgoing = key, 2, True
        signing.timestamp = self.timestamp_now() if timestamp is None else timestamp
        self.autopilots[autopilot.peer] = autopilot
        return autopilot

    def info(self, name="radio"):
        return self.router.connection(name).info()


def run_with_signed_links(run_simulated, scenario, tmp_path, **settings):
    async def run():
        testbed = SignedTestbed(tmp_path, **settings)
        try:
            await scenario(testbed)
        finally:
            await testbed.close()

    run_simulated(run)


@pytest.mark.parametrize("required", [True, False])
def test_a_vehicle_with_the_key_is_connected_and_accepts_every_frame(run_simulated, tmp_path, required):
    async def scenario(testbed):
        autopilot = testbed.signed_autopilot(testbed.signed_link(required=required))
        vehicle = await testbed.wait_for_vehicle()
        await vehicle.command.arm()
        assert autopilot.armed
        assert len(testbed.sent_packets) > 5
        assert all(is_signed(data) for data, _ in testbed.sent_packets)
        signing = autopilot.parser.signing
        assert signing.goodsig_count == len(testbed.sent_packets)
        assert (signing.badsig_count, signing.unsigned_count, signing.reject_count) == (0, 0, 0)
        info = testbed.info()
        assert (info.frames_refused, info.signing.key, info.signing.link_id) == (0, "field", 0)
        assert info.frames_received > 20

    run_with_signed_links(run_simulated, scenario, tmp_path)


def test_a_vehicle_without_a_clock_gets_the_time_from_the_received_frames(run_simulated, tmp_path):
    async def scenario(testbed):
        testbed.signed_autopilot(testbed.signed_link(), timestamp=0)
        await testbed.wait_for_vehicle()
        signing = testbed.info().signing
        assert signing.too_old > 0
        assert signing.wrong_signature == signing.unsigned == signing.replayed == 0

    run_with_signed_links(run_simulated, scenario, tmp_path)


def intruder_frames(testbed):
    """Frames with the vehicle's id that an attacker without the key can build: unsigned, and forged."""
    unsigned = encode_frame(0, HEARTBEAT_PAYLOAD, 0, 1, 1)
    signer = FrameSigner(SecretKey(OTHER_KEY), 2, SigningClock(testbed.clock.unix_s))
    forged = encode_frame(0, HEARTBEAT_PAYLOAD, 0, 1, 1, signer)
    return unsigned, forged


def test_frames_without_the_key_are_not_handled_forwarded_or_recorded(run_simulated, tmp_path):
    async def scenario(testbed):
        link = testbed.signed_link()
        autopilot = testbed.signed_autopilot(link)
        station = testbed.link("station", forward=True)
        station.inject(encode_frame(0, HEARTBEAT_PAYLOAD, 0, 254, 1), "qgc")
        received = []
        inject = autopilot.link.inject

        def record_and_inject(data, peer):
            received.append(data)
            inject(data, peer)

        autopilot.link.inject = record_and_inject
        vehicle = await testbed.wait_for_vehicle()
        recorded_frame = received[-1]
        for _ in range(20):
            for raw in (*intruder_frames(testbed), recorded_frame):
                link.inject(raw, "intruder")
            await asyncio.sleep(0.05)
        assert [v.id for v in testbed.fleet.all()] == ["1"]
        assert {e.peer.name for e in vehicle.endpoints} == {"peer"}
        assert vehicle.identity.warnings == ()
        signing = testbed.info().signing
        assert (signing.unsigned, signing.wrong_signature) == (20, 20)
        assert signing.replayed >= 20
        assert {data for data, _ in station.sent_packets} <= set(received)
        texts = [
            text for kind, name, text in testbed.router.warnings() if (kind, name) == ("signing", "radio")
        ]
        assert len(texts) == 3
        assert "signing=allowed" in texts[0]
        await vehicle.command.arm()
        testbed.router._recorder.flush()

    folder = tmp_path / "recordings"
    run_with_signed_links(run_simulated, scenario, tmp_path, recording_dir=folder)
    (recording,) = folder.glob("*radio*.tlog")
    frames = [raw for _, raw in read_tlog(recording)]
    assert len(frames) > 20
    assert all(is_signed(raw) for raw in frames)
    assert len(set(frames)) == len(frames)
    for file in (*folder.rglob("*"), tmp_path / "signing" / "timestamp"):
        assert KEY not in file.read_bytes()
        assert KEY.hex().encode() not in file.read_bytes()


def test_a_vehicle_with_another_key_is_not_flown_and_a_warning_names_it(run_simulated, tmp_path):
    async def scenario(testbed):
        link = testbed.signed_link()
        autopilot = testbed.signed_autopilot(link, key=OTHER_KEY, system=6)
        autopilot.receive = lambda _data: None
        await asyncio.sleep(3)
        assert testbed.fleet.all() == []
        (warning,) = [text for kind, _, text in testbed.router.warnings() if kind == "signing"]
        assert warning.startswith("System 6 sends frames with a wrong signature")

    run_with_signed_links(run_simulated, scenario, tmp_path)


def test_a_link_whose_key_is_missing_is_not_opened_unsigned(run_simulated, tmp_path):
    async def scenario(testbed):
        with pytest.raises(InvalidRequest, match="There is no signing key 'none'; known: field") as error:
            testbed.router.add_link("udpin://127.0.0.1:0?key=none", "radio")
        assert error.value.field == "url"
        assert testbed.router.links() == []

    run_with_signed_links(run_simulated, scenario, tmp_path)


def test_a_link_without_a_key_accepts_signed_frames_and_counts_them(run_simulated, tmp_path):
    async def scenario(testbed):
        link = testbed.link("plain")
        autopilot = testbed.signed_autopilot(link)
        autopilot.mav.signing.secret_key = OTHER_KEY
        await asyncio.sleep(3)
        assert [v.id for v in testbed.fleet.all()] == ["1"]
        assert testbed.info("plain").frames_unverified > 10
        assert testbed.info("plain").signing is None

    run_with_signed_links(run_simulated, scenario, tmp_path)
