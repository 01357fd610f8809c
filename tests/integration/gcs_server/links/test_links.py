"""Links on real loopback sockets and pseudo-terminals."""

import errno
import gzip
import os
import pty
import socket
import struct
import threading
import time

import pytest

from gcs_server.errors import InvalidRequest, LinkError
from gcs_server.links.send_queue import Packet
from gcs_server.links.serial import SerialLink
from gcs_server.links.tcp import TcpLink, TcpServerLink
from gcs_server.links.udp import UdpLink
from gcs_server.links.url import make_link
from gcs_server.replay.link import TlogLink, replay_link
from gcs_server.replay.records import read_tlog
from tests.station import free_port
from tests.support.link_recorder import LinkRecorder, run_in_real_time

TLOG = {"tlog": replay_link}


def test_a_udpin_link_receives_and_sends_also_from_another_thread():
    async def scenario():
        recorder = LinkRecorder(make_link("udpin://127.0.0.1:0")).start()
        await recorder.until(lambda: recorder.link.info().state == "open")
        vehicle = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        vehicle.settimeout(2)
        for n in range(50):
            vehicle.sendto(bytes([n]), ("127.0.0.1", recorder.link.local_port))
        await recorder.until(lambda: len(recorder.data) == 50)
        assert recorder.data == [bytes([n]) for n in range(50)]
        peer = recorder.peers[0]
        assert peer.name == f"127.0.0.1:{vehicle.getsockname()[1]}"
        sender = threading.Thread(target=lambda: recorder.link.send(b"from a thread", peer))
        sender.start()
        sender.join()
        assert vehicle.recv(100) == b"from a thread"
        info = recorder.link.info()
        assert (info.bytes_received, info.bytes_sent) == (50, len(b"from a thread"))
        assert info.peers == (peer.name,)
        vehicle.close()
        await recorder.link.close()
        assert recorder.lost_peers == [peer.name]
        assert recorder.link.info().state == "closed"
        assert not recorder.link.send(b"x", peer)

    run_in_real_time(scenario)


def test_a_udpout_link_can_send_before_it_receives():
    async def scenario():
        vehicle = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        vehicle.bind(("127.0.0.1", 0))
        vehicle.settimeout(2)
        recorder = LinkRecorder(make_link(f"udpout://localhost:{vehicle.getsockname()[1]}")).start()
        await recorder.until(lambda: recorder.link.info().state == "open")
        (peer,) = recorder.link.peers()
        assert recorder.link.send(b"hello", peer)
        data, address = vehicle.recvfrom(100)
        vehicle.sendto(b"reply", address)
        await recorder.until(lambda: recorder.data == [b"reply"])
        assert data == b"hello"
        vehicle.close()
        await recorder.link.close()

    run_in_real_time(scenario)


@pytest.mark.parametrize("error_number", [errno.EAGAIN, errno.ENOBUFS])
def test_after_a_full_udp_buffer_urgent_packets_are_first_and_expired_packets_are_dropped(error_number):
    class FullSocket:
        failures_left = 3

        def sendto(self, data, address):
            if self.failures_left:
                self.failures_left -= 1
                raise OSError(error_number, "buffer full")
            return real_socket.sendto(data, address)

        def __getattr__(self, name):
            return getattr(real_socket, name)

    async def scenario():
        nonlocal real_socket
        vehicle = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        vehicle.bind(("127.0.0.1", 0))
        vehicle.settimeout(2)
        recorder = LinkRecorder(make_link(f"udpout://127.0.0.1:{vehicle.getsockname()[1]}")).start()
        (peer,) = recorder.link.peers()
        link, full_socket = recorder.link, FullSocket()
        real_socket = link._socket
        write = link._write
        link._write = lambda _sock, data, address: write(full_socket, data, address)
        for data, priority, valid_for_s in ((b"rest", 4, 9.0), (b"late", 3, 0.001), (b"stop", 0, 9.0)):
            assert link.submit(
                Packet(
                    peer, 4, lambda data=data: data, priority=priority, expires_s=link.now_s() + valid_for_s
                )
            )
        assert link.info().frames_waiting == 3
        await recorder.until(lambda: not link.info().frames_waiting)
        assert [vehicle.recv(10), vehicle.recv(10)] == [b"stop", b"rest"]
        assert (link.info().frames_sent, link.info().frames_expired) == (2, 1)
        await link.close()
        vehicle.close()

    real_socket = None
    run_in_real_time(scenario)


def test_a_port_in_use_is_reported_and_the_link_opens_when_the_port_is_free():
    async def scenario():
        other_socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        other_socket.bind(("127.0.0.1", 0))
        port = other_socket.getsockname()[1]
        recorder = LinkRecorder(UdpLink("gcs", "udpin", "127.0.0.1", port, outgoing=False)).start()
        info = recorder.link.info()
        assert info.state == "waiting"
        assert f"UDP port {port}" in info.detail
        assert "taken" in info.detail
        other_socket.close()
        await recorder.until(lambda: recorder.link.info().state == "open")
        assert recorder.link.info().detail == ""
        await recorder.link.close()

    run_in_real_time(scenario)


def test_a_tcp_client_connects_and_reconnects_to_a_tcp_server_link():
    async def scenario():
        port = free_port(socket.SOCK_STREAM)
        client = LinkRecorder(TcpLink("c", "tcp", "127.0.0.1", port)).start()
        await client.until(lambda: client.link.info().state == "waiting")
        assert f"127.0.0.1:{port}" in client.link.info().detail
        server = LinkRecorder(TcpServerLink("s", "tcpin", "127.0.0.1", port)).start()
        await client.until(lambda: client.link.info().state == "open")
        (server_peer,) = client.link.peers()
        # More than a socket accepts at once, so the rest waits in the send queue.
        large_data = os.urandom(400_000)
        assert client.link.send(large_data, server_peer)
        await server.until(lambda: sum(map(len, server.data)) == len(large_data))
        assert b"".join(server.data) == large_data
        (client_peer,) = server.link.peers()
        server.link.send(b"back", client_peer)
        await client.until(lambda: client.data == [b"back"])
        await server.link.close()
        await client.until(lambda: client.link.info().state == "waiting")
        assert client.lost_peers == [server_peer.name]
        restarted_server = LinkRecorder(TcpServerLink("s", "tcpin", "127.0.0.1", port)).start()
        await client.until(lambda: client.link.info().state == "open")
        other_server = LinkRecorder(TcpServerLink("t", "tcpin", "127.0.0.1", port)).start()
        assert f"TCP port {port}" in other_server.link.info().detail
        for link in (client.link, restarted_server.link, other_server.link):
            await link.close()

    run_in_real_time(scenario)


def test_a_full_send_queue_drops_whole_frames():
    async def scenario():
        listener = socket.socket()
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        client = LinkRecorder(TcpLink("c", "tcp", "127.0.0.1", listener.getsockname()[1])).start()
        await client.until(lambda: client.link.info().state == "open")
        (peer,) = client.link.peers()
        accepted = [client.link.send(bytes([n % 251]) * 50_000, peer) for n in range(400)]
        assert accepted[0]
        assert not accepted[-1]
        assert client.link.info().bytes_dropped == 50_000 * accepted.count(False)
        listener.close()
        await client.link.close()

    run_in_real_time(scenario)


def test_a_serial_link_carries_bytes_and_waits_after_the_device_is_unplugged():
    async def scenario():
        master, slave = pty.openpty()
        device = os.ttyname(slave)
        recorder = LinkRecorder(SerialLink("radio", "serial", device, 57600)).start()
        assert recorder.link.info().state == "open", recorder.link.info().detail
        os.write(master, b"\xfd\x00\xffabc\n")
        await recorder.until(lambda: b"".join(recorder.data) == b"\xfd\x00\xffabc\n")
        (peer,) = recorder.link.peers()
        assert recorder.link.send(b"\x00\xfe\r\n", peer)
        assert os.read(master, 100) == b"\x00\xfe\r\n"
        os.close(master)
        os.close(slave)
        await recorder.until(lambda: recorder.link.info().state == "waiting")
        assert device in recorder.link.info().detail
        await recorder.link.close()

    run_in_real_time(scenario)


def test_the_errors_of_a_serial_port_are_explained():
    async def scenario():
        recorder = LinkRecorder(SerialLink("radio", "serial", "/dev/ttyNOTHING", 57600)).start()
        info = recorder.link.info()
        assert info.state == "waiting"
        assert "no serial port /dev/ttyNOTHING" in info.detail
        assert "sudo usermod -aG dialout $USER" in recorder.link._explain(OSError(errno.EACCES, "no"))
        assert "in use" in recorder.link._explain(OSError(errno.EBUSY, "busy"))
        await recorder.link.close()

    run_in_real_time(scenario)


def test_a_missing_permission_for_a_serial_port_is_reported_with_the_command_to_run(monkeypatch):
    real_open = os.open

    def open_without_permission(path, flags, *arguments, **options):
        if path == "/dev/ttyFORBIDDEN":
            raise PermissionError(errno.EACCES, "Permission denied", path)
        return real_open(path, flags, *arguments, **options)

    async def scenario():
        recorder = LinkRecorder(make_link("serial:///dev/ttyFORBIDDEN:921600")).start()
        info = recorder.link.info()
        assert info.state == "waiting"
        assert "No permission to open /dev/ttyFORBIDDEN" in info.detail
        assert "sudo usermod -aG dialout $USER" in info.detail
        await recorder.link.close()

    monkeypatch.setattr(os, "open", open_without_permission)
    run_in_real_time(scenario)


@pytest.mark.parametrize(
    ("url", "device", "baud"),
    [
        ("serial:///dev/ttyUSB0", "/dev/ttyUSB0", 57600),
        ("serial:///dev/ttyUSB0?baud=921600", "/dev/ttyUSB0", 921600),
        ("serial:/dev/ttyUSB0:115200", "/dev/ttyUSB0", 115200),
        ("serial:///dev/serial/by-path/pci-0:1:1.0-port0", "/dev/serial/by-path/pci-0:1:1.0-port0", 57600),
    ],
)
def test_the_baud_rate_in_a_serial_url_is_an_option_or_follows_a_colon(url, device, baud):
    link = make_link(url)
    device_name = device.rpartition("/")[2].replace(":", "-")
    assert (link._device, link._baud, link.name) == (device, baud, f"serial-{device_name}")


@pytest.mark.parametrize("compressed", [False, True])
def test_a_recording_plays_at_the_requested_speed_and_ends(tmp_path, compressed):
    frames = [
        b"\xfd\x01\x00\x00" + bytes([n]) + b"\x01\x01\x00\x00\x00" + b"\x05" + b"\x00\x00" for n in range(20)
    ]
    data = b"".join(struct.pack(">Q", 1_700_000_000_000_000 + n * 10_000) + f for n, f in enumerate(frames))
    path = tmp_path / ("a.tlog.gz" if compressed else "a.tlog")
    data += b"torn"  # an incomplete last record
    path.write_bytes(gzip.compress(data) if compressed else data)

    async def scenario():
        recorder = LinkRecorder(make_link(f"tlog://{path}?speed=2", None, TLOG)).start()
        began_s = time.monotonic()
        await recorder.until(lambda: recorder.link.info().state == "ended")
        assert recorder.data == frames
        assert time.monotonic() - began_s >= 0.09  # 19 intervals of 10 ms at twice the speed
        assert recorder.link.replay
        assert not recorder.link.send(b"x", recorder.peers[0])
        await recorder.link.close()
        fast_recorder = LinkRecorder(make_link(f"tlog://{path}?speed=0", None, TLOG)).start()
        await fast_recorder.until(lambda: fast_recorder.link.info().state == "ended")
        assert fast_recorder.data == frames
        await fast_recorder.link.close()

    run_in_real_time(scenario)


def test_damage_in_a_recording_is_skipped_and_a_recording_without_mavlink_is_reported(tmp_path):
    record = (
        struct.pack(">Q", 1_700_000_000_000_000) + b"\xfd\x01\x00\x00\x07\x01\x01\x00\x00\x00\x05\x00\x00"
    )
    path = tmp_path / "a.tlog"
    path.write_bytes(record + b"\x99" * 31 + record * 2)
    assert [raw for _, raw in read_tlog(path)] == [record[8:]] * 3
    without_mavlink = tmp_path / "b.tlog"
    without_mavlink.write_bytes(b"not a log at all, but long enough to look")

    async def scenario():
        recorder = LinkRecorder(TlogLink("b", "tlog", without_mavlink)).start()
        await recorder.until(lambda: recorder.link.info().state == "ended")
        assert "No MAVLink" in recorder.link.info().detail

    run_in_real_time(scenario)


@pytest.mark.parametrize(
    "url",
    [
        "",
        "14550",
        "http://127.0.0.1:1",
        "udpin://127.0.0.1",
        "udpin://127.0.0.1:99999",
        "udpin://127.0.0.1:x",
        "udpout://:14550",
        "udpout://1.2.3.4:0",
        "tcp://1.2.3.4:5/path",
        "udpin://:1?forward=yes",
        "udpin://:1?speed=2",
        "serial://ttyUSB0",
        "serial:///dev/x?baud=fast",
        "serial:///dev/x?baud=-1",
        "tcp://[::1:5",
    ],
)
def test_an_invalid_url_is_refused(url):
    with pytest.raises(InvalidRequest) as caught:
        make_link(url)
    assert caught.value.field == "url"


def test_a_url_determines_name_host_and_options_of_its_link(tmp_path):
    (tmp_path / "x.tlog").write_bytes(b"")
    assert make_link("udpin://:14550")._host == "127.0.0.1"
    assert make_link("udpin://0.0.0.0:14550").name == "udpin-0.0.0.0-14550"
    assert make_link("udpout://127.0.0.1:14445?forward=1").forward
    assert make_link("serial:///dev/ttyACM0").name == "serial-ttyACM0"
    assert make_link("tcpin://:5790", "mine").name == "mine"
    with pytest.raises(LinkError, match="no recording"):
        make_link(f"tlog://{tmp_path}/y.tlog", None, TLOG)
    with pytest.raises(InvalidRequest):
        make_link(f"tlog://{tmp_path}/x.tlog?speed=-1", None, TLOG)
