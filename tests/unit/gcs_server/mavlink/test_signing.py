"""Message signing compared with pymavlink, an independent implementation; replayed and forged frames; secret
keys."""

import io
import logging
import pickle
import stat

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common

from gcs_server.clock import SystemClock
from gcs_server.errors import InvalidRequest
from gcs_server.links.base import SigningOptions
from gcs_server.links.names import shown_url
from gcs_server.links.url import make_link
from gcs_server.mavlink.codec import FrameParser, encode_frame
from gcs_server.mavlink.key_store import KeyStore, KeyUnusable, key_of_passphrase, parse_key, random_key
from gcs_server.mavlink.link_signing import WARNED_FOR_S, Signing
from gcs_server.mavlink.signing import (
    EPOCH_UNIX_S,
    MAX_ADOPTED_TIMESTAMP,
    MAX_STREAMS,
    MAX_TIMESTAMP,
    TICKS_PER_S,
    FrameSigner,
    KeyVerifier,
    Refusal,
    SecretKey,
    SigningClock,
)
from gcs_server.streamer.process.messages import Call, Route, RouteSigning

NOW_S = EPOCH_UNIX_S + 400_000_000.0
NOW_TICKS = int((NOW_S - EPOCH_UNIX_S) * TICKS_PER_S)
KEY = bytes(range(32))
MINUTE_TICKS = 60 * TICKS_PER_S
KEYS = st.binary(min_size=32, max_size=32)


def make_clock(at_s=NOW_S, last_used=0):
    return SigningClock(lambda: at_s, last_used)


def signed_frame(key=KEY, link_id=3, timestamp=NOW_TICKS, system_id=1, payload=bytes(9), msg_id=0):
    """A frame signed with this timestamp."""
    signer = FrameSigner(SecretKey(key), link_id, make_clock(EPOCH_UNIX_S, timestamp - 1))
    return encode_frame(msg_id, payload, 0, system_id, 1, signer)


def make_verifier(key=KEY, at_s=NOW_S):
    return KeyVerifier(SecretKey(key), make_clock(at_s))


def pymavlink_peer(key, system_id=1, timestamp=NOW_TICKS):
    """A pymavlink peer that signs with this key and accepts only frames signed with it."""
    mav = common.MAVLink(io.BytesIO(), srcSystem=system_id, srcComponent=1)
    mav.robust_parsing = False
    mav.signing.secret_key = key
    mav.signing.link_id = 7
    mav.signing.timestamp = timestamp
    mav.signing.sign_outgoing = True
    return mav


@given(KEYS, st.integers(0, 255), st.integers(1, 255), st.integers(0, 255), st.integers(0, 2**32 - 1))
def test_pymavlink_accepts_frames_signed_by_the_server(key, link_id, system_id, seq, custom_mode):
    signer = FrameSigner(SecretKey(key), link_id, make_clock())
    payload = custom_mode.to_bytes(4, "little") + bytes([6, 8, 192, 4, 3])
    peer = pymavlink_peer(key)
    for _ in range(3):
        raw = encode_frame(0, payload, seq, system_id, 190, signer)
        message = peer.decode(bytearray(raw))
        assert (message.get_signed(), message.get_link_id(), message.custom_mode) == (
            True,
            link_id,
            custom_mode,
        )
        assert raw[-12:-6] == signer.clock.now().to_bytes(6, "little")
    with pytest.raises(common.MAVError, match="signature"):
        peer.decode(bytearray(raw))
    with pytest.raises(common.MAVError, match="signature"):
        pymavlink_peer(bytes([key[0] ^ 1]) + key[1:]).decode(bytearray(raw))


@given(KEYS, st.integers(1, 255), st.integers(0, 2**32 - 1))
def test_frames_signed_by_pymavlink_are_accepted(key, system_id, custom_mode):
    peer, key_verifier = pymavlink_peer(key, system_id), make_verifier(key)
    parser = FrameParser()
    for _ in range(3):
        raw = common.MAVLink_heartbeat_message(6, 8, 192, custom_mode, 4, 3).pack(peer)
        (frame,) = parser.feed(bytes(raw), 0.0)
        assert key_verifier.refusal(frame.raw, frame.system_id, frame.component_id) is None
        assert key_verifier.refusal(frame.raw, frame.system_id, frame.component_id) is Refusal.REPLAYED
    assert parser.frames_signed == 3
    other_key = bytes([key[0] ^ 1]) + key[1:]
    assert make_verifier(other_key).refusal(frame.raw, system_id, 1) is Refusal.WRONG_SIGNATURE


@settings(max_examples=300)
@given(KEYS, st.binary(min_size=1, max_size=60), st.data())
def test_a_frame_with_any_flipped_bit_is_refused(key, payload, data):
    raw = signed_frame(key, payload=payload)
    bit = data.draw(st.integers(0, 8 * len(raw) - 1))
    forged = bytearray(raw)
    forged[bit // 8] ^= 1 << bit % 8
    key_verifier = make_verifier(key)
    assert key_verifier.refusal(bytes(forged), 1, 1) in (Refusal.WRONG_SIGNATURE, Refusal.UNSIGNED)
    # The forgery does not change the state: the valid frame is still accepted.
    assert key_verifier.refusal(raw, 1, 1) is None


@given(st.lists(st.integers(NOW_TICKS - MINUTE_TICKS, NOW_TICKS + MINUTE_TICKS), min_size=2, max_size=20))
def test_only_increasing_timestamps_of_a_stream_are_accepted(timestamps):
    key_verifier, newest = make_verifier(), -1
    for timestamp in timestamps:
        refusal = key_verifier.refusal(signed_frame(timestamp=timestamp), 1, 1)
        if newest < 0:
            assert refusal is None
        if newest >= 0:
            assert refusal is (None if timestamp > newest else Refusal.REPLAYED)
        newest = max(newest, timestamp)


def test_a_new_stream_may_be_a_minute_behind_but_not_more():
    assert make_verifier().refusal(signed_frame(timestamp=NOW_TICKS - MINUTE_TICKS), 1, 1) is None
    too_old = signed_frame(timestamp=NOW_TICKS - MINUTE_TICKS - 1)
    assert make_verifier().refusal(too_old, 1, 1) is Refusal.TOO_OLD
    assert make_verifier().refusal(signed_frame(timestamp=NOW_TICKS + 10 * MINUTE_TICKS), 1, 1) is None
    # A new stream is also refused if it is earlier than the newest time of another sender with this key.
    key_verifier = make_verifier()
    assert key_verifier.refusal(signed_frame(timestamp=NOW_TICKS + 10 * MINUTE_TICKS), 1, 1) is None
    assert key_verifier.refusal(signed_frame(timestamp=NOW_TICKS, system_id=2), 2, 1) is Refusal.TOO_OLD
    # A known stream may be behind other streams, because its frames may come over a slower link.
    assert key_verifier.refusal(signed_frame(timestamp=NOW_TICKS + 10 * MINUTE_TICKS + 1), 1, 1) is None


def test_streams_are_distinguished_by_link_id_system_and_component():
    key_verifier = make_verifier()
    for link_id, system_id in ((0, 1), (1, 1), (0, 2)):
        assert key_verifier.refusal(signed_frame(link_id=link_id, system_id=system_id), system_id, 1) is None
    assert key_verifier.refusal(signed_frame(link_id=0), 1, 1) is Refusal.REPLAYED


def test_the_number_of_streams_is_limited():
    key_verifier = make_verifier()
    for n in range(MAX_STREAMS):
        link_id, system_id = n % 256, 1 + n // 256
        assert key_verifier.refusal(signed_frame(link_id=link_id, system_id=system_id), system_id, 1) is None
    assert key_verifier.refusal(signed_frame(system_id=250), 250, 1) is Refusal.TOO_MANY_STREAMS
    assert key_verifier.refusal(signed_frame(link_id=0, timestamp=NOW_TICKS + 1), 1, 1) is None


def test_timestamps_never_go_back_if_the_system_clock_does():
    now_s = [NOW_S]
    signing_clock, previous = SigningClock(lambda: now_s[0]), 0
    for step_s in (0, 0, 1, -3600, 0, 0.00001, 7200, -1e9, 0):
        now_s[0] += step_s
        timestamp = signing_clock.next()
        assert previous < timestamp <= MAX_TIMESTAMP
        previous = timestamp


def test_a_vehicles_later_time_is_adopted_but_an_implausible_time_is_not():
    signing_clock = make_clock()
    signing_clock.adopt(NOW_TICKS - 5)
    assert signing_clock.ahead_ticks == 0
    signing_clock.adopt(NOW_TICKS + 7 * MINUTE_TICKS)
    assert signing_clock.next() == NOW_TICKS + 7 * MINUTE_TICKS
    signing_clock.adopt(MAX_TIMESTAMP)
    assert signing_clock.next() == NOW_TICKS + 7 * MINUTE_TICKS + 1
    assert signing_clock.next() < MAX_ADOPTED_TIMESTAMP


def test_two_peers_that_adopt_each_others_time_do_not_drift():
    first, second = make_clock(), make_clock()
    for _ in range(1000):
        second.adopt(first.next())
        first.adopt(second.next())
    assert first.now() - NOW_TICKS < 5000  # 50 ms


# --- links ------------------------------------------------------------------------------------------


class SettableClock(SystemClock):
    def __init__(self):
        self.now_unix_s, self.now_monotonic_s = NOW_S, 0.0

    def unix_s(self):
        return self.now_unix_s

    def monotonic_s(self):
        return self.now_monotonic_s


def make_key_store(tmp_path, **more_keys):
    key_store = KeyStore(tmp_path / "signing")
    for name, key in {"field": KEY, **more_keys}.items():
        key_store.add(name, SecretKey(key))
    return key_store


def parse_frame(raw):
    (parsed_frame,) = FrameParser().feed(raw, 0.0)
    return parsed_frame


def test_refused_frames_are_counted_by_reason_and_reported_as_text(tmp_path, caplog):
    caplog.set_level(logging.WARNING)
    clock = SettableClock()
    link = Signing(clock, make_key_store(tmp_path)).open("radio", SigningOptions("field", required=True))
    unsigned, radio_status = encode_frame(0, bytes(9), 0, 4, 1), encode_frame(109, bytes(9), 0, 51, 68)
    for _ in range(50):
        assert not link.accepts(parse_frame(unsigned))
        assert not link.accepts(parse_frame(signed_frame(bytes(32), system_id=5)))
        assert link.accepts(parse_frame(radio_status))
    assert not link.accepts(parse_frame(signed_frame(bytes(32), msg_id=109)))
    assert not link.accepts(parse_frame(b"\xfe\x09\x00\x01\x01\x00" + bytes(9) + crc_of_heartbeat_v1()))
    assert link.accepts(parse_frame(signed_frame()))
    assert not link.accepts(parse_frame(signed_frame()))
    assert not link.accepts(parse_frame(signed_frame(timestamp=NOW_TICKS - 2 * MINUTE_TICKS, system_id=9)))
    report = link.report()
    assert (report.key, report.mode, report.link_id) == ("field", "required", 0)
    assert (report.unsigned, report.wrong_signature, report.replayed, report.too_old) == (51, 51, 1, 1)
    assert link.refused() == 104
    texts = link.warnings()
    assert any(t.startswith("System 1 sends frames without a signature") for t in texts)
    assert any("wrong signature" in t for t in texts)
    assert any(t.startswith("System 9 signs with a time more than a minute behind") for t in texts)
    assert len(caplog.records) == 4
    clock.now_monotonic_s += WARNED_FOR_S + 1
    assert link.warnings() == []


def crc_of_heartbeat_v1():
    from fastcrc import crc16

    return crc16.mcrf4xx(b"\x09\x00\x01\x01\x00" + bytes(9) + b"\x32").to_bytes(2, "little")


def test_a_link_with_signing_allowed_accepts_unsigned_but_not_wrongly_signed_frames(tmp_path):
    link = Signing(SettableClock(), make_key_store(tmp_path)).open(
        "radio", SigningOptions("field", required=False)
    )
    assert link.accepts(parse_frame(encode_frame(0, bytes(9), 0, 1, 1)))
    assert link.accepts(parse_frame(signed_frame()))
    assert not link.accepts(parse_frame(signed_frame()))
    assert not link.accepts(parse_frame(signed_frame(bytes(32))))


def test_a_frame_of_one_link_is_a_replay_on_other_links_with_the_same_key(tmp_path):
    signing = Signing(SettableClock(), make_key_store(tmp_path, again=KEY, other=bytes(32)))
    first, second, other = (
        signing.open(name, SigningOptions(name, required=True)) for name in ("field", "again", "other")
    )
    assert [link.signer.link_id for link in (first, second, other)] == [0, 1, 2]
    assert first.accepts(parse_frame(signed_frame()))
    assert not second.accepts(parse_frame(signed_frame()))
    assert second.report().replayed == 1
    signing.release(second)
    reopened = signing.open("field", SigningOptions("field", required=True))
    assert reopened.signer.link_id == 1
    assert not reopened.accepts(parse_frame(signed_frame())), (
        "the link accepted a frame that it had received before"
    )
    assert other.accepts(parse_frame(signed_frame(bytes(32))))


def test_timestamps_increase_over_a_restart_with_an_earlier_clock(tmp_path):
    key_store, clock = make_key_store(tmp_path), SettableClock()
    first = Signing(clock, key_store)
    first.open("one", SigningOptions("field", required=True))
    newest_timestamp = first.clock.next()
    first.store_timestamp()
    clock.now_unix_s += 9.9  # the timestamp is not stored, as if the server was killed
    newest_timestamp = max(newest_timestamp, first.clock.next())
    clock.now_unix_s -= 86_400
    assert Signing(clock, key_store).clock.next() > newest_timestamp
    clock.now_unix_s += 2 * 86_400
    assert Signing(clock, key_store).clock.ahead_ticks == 0
    (tmp_path / "signing" / "timestamp").write_text("what?")
    assert Signing(clock, key_store).clock.ahead_ticks == 0


# --- keys -------------------------------------------------------------------------------------------


def test_a_key_is_never_printed(tmp_path):
    key = random_key()
    link = Signing(SettableClock(), make_key_store(tmp_path, mine=key.reveal())).open(
        "one", SigningOptions("mine", required=True)
    )
    hexadecimal = key.reveal().hex()
    route = Route(1, ("h", 1), RouteSigning(key.reveal(), 0, 0))
    for text in (
        repr(key),
        str(key),
        f"{key}",
        repr(link),
        repr(link.signer),
        str(link.report()),
        repr([key]),
        repr(Call(1, "WorkerMethods.set_routes", ({"1": route},), {}, None)),
    ):
        assert hexadecimal not in text
        assert repr(key.reveal())[2:-1] not in text
    with pytest.raises(TypeError):
        pickle.dumps(key)
    for invalid in (b"", b"31 bytes of a secret, too short."[:31]):
        with pytest.raises(ValueError, match="32 bytes") as error:
            SecretKey(invalid)
        assert "secret" not in str(error.value)


def test_key_files_are_private_and_key_files_that_others_can_read_are_refused(tmp_path):
    key_store = make_key_store(tmp_path)
    path = tmp_path / "signing" / "field.key"
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    assert key_store.read("field").reveal() == KEY
    path.chmod(0o640)
    with pytest.raises(KeyUnusable, match="Others can read") as error:
        key_store.read("field")
    assert "chmod 600" in (error.value.remedy or "")
    path.chmod(0o600)
    path.write_text("0011 nonsense")
    with pytest.raises(KeyUnusable, match="damaged") as error:
        key_store.read("field")
    assert "nonsense" not in str(error.value)
    with pytest.raises(InvalidRequest, match="already"):
        key_store.add("field", random_key())
    key_store.remove("field")
    with pytest.raises(KeyUnusable, match="There is no signing key 'field'"):
        key_store.read("field")
    for name in ("../token", "a/b", "", "x" * 65, KEY.hex()):
        with pytest.raises(InvalidRequest):
            key_store.read(name)


@given(KEYS)
def test_keys_are_read_as_hexadecimal_or_base64(key):
    import base64

    assert parse_key(key.hex() + "\n").reveal() == key
    assert parse_key(key.hex().upper()).reveal() == key
    assert parse_key(base64.b64encode(key).decode()).reveal() == key
    for invalid in (key.hex()[:-1], key.hex() + "0", "zz" * 32, ""):
        with pytest.raises(ValueError, match="32 bytes"):
            parse_key(invalid)


def test_a_passphrase_gives_the_same_key_as_in_mavproxy():
    expected = "c4bbcb1fbec99d65bf59d85c8cb62ee2db963f0fe106f483d9afa73bd4e39a8a"
    assert key_of_passphrase("correct horse battery staple").reveal().hex() == expected
    with pytest.raises(ValueError, match="12 characters"):
        key_of_passphrase("short")


@pytest.mark.parametrize(
    ("url", "signing"),
    [
        ("udpin://0.0.0.0:14550?key=field", SigningOptions("field", required=True)),
        ("udpin://0.0.0.0:14550?key=field&signing=required", SigningOptions("field", required=True)),
        ("tcp://127.0.0.1:5760?signing=allowed&key=field", SigningOptions("field", required=False)),
        ("serial:///dev/ttyUSB0?baud=57600&key=a.b-c", SigningOptions("a.b-c", required=True)),
        ("udpout://127.0.0.1:14550?forward=1&key=k", SigningOptions("k", required=True)),
        ("udpin://0.0.0.0:14550", None),
    ],
)
def test_a_links_url_names_its_key(url, signing):
    assert make_link(url).signing == signing


@pytest.mark.parametrize(
    "url",
    [
        "udpin://0.0.0.0:14550?signing=required",
        "udpin://0.0.0.0:14550?key=field&signing=maybe",
        "udpin://0.0.0.0:14550?key=",
        "udpin://0.0.0.0:14550?key=../token",
    ],
)
def test_signing_without_a_key_or_with_an_invalid_mode_is_refused(url):
    with pytest.raises(InvalidRequest):
        make_link(url)


@pytest.mark.parametrize("url", ["udpin://0.0.0.0:14550?key={}", "x?key={}", "tcp://h:1?forward=2&KEY={}"])
@pytest.mark.parametrize("secret", [KEY.hex(), "AAECAwQFBgcICQoLDA0ODxAREhMUFRYXGBkaGxwdHh8="])
def test_a_key_that_a_user_gives_instead_of_its_name_is_not_in_errors_or_journal(url, secret):
    with pytest.raises(InvalidRequest) as error:
        make_link(url.format(secret))
    error_text = f"{error.value} {error.value.remedy}"
    assert secret not in error_text
    assert secret not in shown_url(url.format(secret))
    assert shown_url("udpin://h:1?key=field&signing=allowed") == "udpin://h:1?key=field&signing=allowed"
