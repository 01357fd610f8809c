"""MAVLink FTP: replies, errors, bursts and repeated requests, as recorded from a PX4."""

import lzma
import struct

import pytest

from tests.unit.vehicle_sim.ftp_client import FtpClient
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.mavlink.services import ftp
from vehicle_sim.storage import metadata

GENERAL = metadata.GENERAL.encode()


@pytest.fixture
def client():
    return FtpClient(SimulatedFleet())


def test_a_file_is_created_written_read_listed_renamed_and_removed(client):
    assert client.request_one(ftp.MAKE_DIRECTORY, b"d") == (ftp.ACK, b"")
    assert client.request_one(ftp.MAKE_DIRECTORY, b"d") == (ftp.NAK, bytes((ftp.FILE_EXISTS,)))
    assert client.request_one(ftp.CREATE, b"d/a.txt") == (ftp.ACK, b"\0\0\0\0")
    assert client.request_one(ftp.WRITE, b"hello world") == (ftp.ACK, b"\x0b\0\0\0")
    assert client.request_one(ftp.TERMINATE) == (ftp.ACK, b"")
    assert client.request_one(ftp.OPEN_RO, b"/d/a.txt") == (ftp.ACK, b"\x0b\0\0\0")
    assert client.request_one(ftp.READ, size=50, offset=6) == (ftp.ACK, b"world")
    assert client.request_one(ftp.READ, size=50, offset=11) == (ftp.NAK, bytes((ftp.END_OF_FILE,)))
    assert client.request_one(ftp.WRITE, b"x") == (ftp.NAK, b"\x02\x09")
    client.request_one(ftp.TERMINATE)
    assert client.request_one(ftp.LIST, b"d") == (ftp.ACK, b"S\0S\0Fa.txt\t11\0")
    assert client.request_one(ftp.RENAME, b"d/a.txt\0d/b.txt\0") == (ftp.ACK, b"")
    assert client.request_one(ftp.REMOVE_DIRECTORY, b"d") == (ftp.NAK, b"\x02'")
    assert client.request_one(ftp.TRUNCATE, b"d/b.txt", offset=5) == (ftp.ACK, b"")
    assert client.request_one(ftp.CRC32, b"d/b.txt") == (
        ftp.ACK,
        metadata.crc32(b"hello").to_bytes(4, "little"),
    )
    assert client.request_one(ftp.REMOVE, b"d/b.txt") == (ftp.ACK, b"")
    assert client.request_one(ftp.REMOVE, b"d/b.txt") == (ftp.NAK, bytes((ftp.FILE_NOT_FOUND,)))
    assert client.request_one(ftp.REMOVE_DIRECTORY, b"d") == (ftp.ACK, b"")


def test_the_vehicles_folder_has_px4s_files_folders_and_links(client):
    reply, data = client.request_one(ftp.LIST, b"/")
    entries = [entry.split("\t")[0] for entry in data.decode().split("\0")]
    assert reply == ftp.ACK
    assert sorted(entries) == sorted(
        ["S"] * 4 + ["Dlog", "Deeprom", "Fdataman", "Fparameters.bson", "Fparameters_backup.bson", ""]
    )
    assert "Fdataman\t1208528" in data.decode()


def test_the_parameter_file_holds_what_was_set():
    sim = SimulatedFleet()
    before = sim.files[0].read("parameters.bson", 0, 4096)
    sim.set_parameter(0, "MIS_TAKEOFF_ALT", 7.5)
    content = sim.files[0].read("parameters.bson", 0, 4096)
    assert len(before) < int.from_bytes(content[:4], "little") == len(content)
    assert b"\x01MIS_TAKEOFF_ALT\0" + struct.pack("<d", 7.5) in content
    assert b"\x10SYS_AUTOSTART\0" + struct.pack("<i", 10040) in content


@pytest.mark.parametrize(
    ("opcode", "data", "error"),
    [
        (ftp.LIST, b"/no/such/dir", b"\x0a"),
        (ftp.OPEN_RO, b"no_such_file.txt", b"\x0a"),
        (77, b"", b"\x07"),
        (16, b"/", b"\x07"),
        (ftp.TERMINATE, b"", b"\x04"),
        (ftp.READ, b"", b"\x04"),
        (ftp.WRITE, b"x", b"\x04"),
        (ftp.BURST, b"", b"\x04"),
        (ftp.REMOVE, GENERAL, b"\x09"),
        (ftp.CREATE, b"../../x", b"\x09"),
    ],
)
def test_invalid_requests_are_refused_with_px4s_error(client, opcode, data, error):
    assert client.request_one(opcode, data) == (ftp.NAK, error)


def test_an_open_directory_also_uses_the_only_session(client):
    assert client.request_one(ftp.OPEN_RO, b"etc") == (ftp.ACK, b"\x00\x10\x00\x00")
    assert client.request_one(ftp.OPEN_RO, GENERAL) == (ftp.NAK, bytes((ftp.NO_SESSIONS,)))
    assert client.request_one(ftp.READ, size=80) == (ftp.NAK, b"\x02\x15")
    assert client.request_one(ftp.BURST, size=80) == (ftp.NAK, b"\x02\x15")
    assert client.request_one(ftp.RESET) == (ftp.ACK, b"")
    assert client.request_one(ftp.OPEN_RO, GENERAL)[0] == ftp.ACK


@pytest.mark.parametrize("requested_session", [0, 1, 37])
def test_opening_a_file_returns_the_vehicles_session_number(client, requested_session):
    ((header, _),) = client.request(ftp.OPEN_RO, GENERAL, session=requested_session)
    assert (header[1], header[2]) == (ftp.SESSION, ftp.ACK)
    client.request_one(ftp.RESET)
    ((header, _),) = client.request(ftp.CREATE, b"new", session=requested_session)
    assert (header[1], header[2]) == (ftp.SESSION, ftp.ACK)


def test_bursts_and_writes_accept_any_session_number_but_reads_and_terminates_do_not(client):
    client.request_one(ftp.CREATE, b"a")
    assert client.request_one(ftp.WRITE, b"hello", session=9) == (ftp.ACK, b"\x05\0\0\0")
    assert client.request_one(ftp.READ, size=5, session=9) == (ftp.NAK, bytes((ftp.INVALID_SESSION,)))
    assert client.request_one(ftp.TERMINATE, session=9) == (ftp.NAK, bytes((ftp.INVALID_SESSION,)))
    ((first_header, data), (last_header, _)) = client.request(ftp.BURST, size=239, session=9)
    assert (first_header[1], data, last_header[1:3]) == (ftp.SESSION, b"hello", (ftp.SESSION, ftp.NAK))


def test_a_request_to_all_systems_gets_a_reply_and_a_request_to_another_system_does_not(client):
    assert client.request_one(ftp.LIST, b"etc/extras", system=0)[0] == ftp.ACK
    assert client.request(ftp.LIST, b"/", system=2) == []


def test_each_link_has_its_own_session():
    sim = SimulatedFleet()
    gcs_client, api_client = FtpClient(sim, "gcs"), FtpClient(sim, "api")
    assert gcs_client.request_one(ftp.OPEN_RO, GENERAL)[0] == ftp.ACK
    assert api_client.request_one(ftp.READ, size=10) == (ftp.NAK, bytes((ftp.INVALID_SESSION,)))
    assert api_client.request_one(ftp.OPEN_RO, GENERAL)[0] == ftp.ACK


def test_a_burst_sends_the_file_and_its_end(client):
    client.request_one(ftp.OPEN_RO, metadata.PARAMETERS.encode())
    replies = client.request(ftp.BURST, size=239, wait_s=0.5)
    *chunks, (last_header, error) = replies
    assert (last_header[2], error) == (ftp.NAK, bytes((ftp.END_OF_FILE,)))
    assert [header[0] for header, _ in replies] == list(
        range(replies[0][0][0], replies[0][0][0] + len(replies))
    )
    content = b"".join(data for _, data in chunks)
    assert b'"MPC_XY_VEL_MAX"' in lzma.decompress(content)


def test_a_long_burst_stops_with_the_complete_flag(client):
    client.request_one(ftp.CREATE, b"long")
    for n in range(200):
        client.request(ftp.WRITE, bytes(239), offset=239 * n, wait_s=0.004)
    client.request_one(ftp.TERMINATE)
    client.request_one(ftp.OPEN_RO, b"long")
    replies = client.request(ftp.BURST, size=239, wait_s=0.5)
    assert [header[5] for header, _ in replies] == [0] * 167 + [1]
    (*_, (last_header, _)) = client.request(ftp.BURST, size=239, offset=168 * 239)
    assert last_header[2] == ftp.NAK


def test_a_repeated_request_gets_the_same_reply_and_is_executed_once(client):
    client.request_one(ftp.CREATE, b"a", sequence=500)
    client.request_one(ftp.WRITE, b"x", sequence=502)
    repeated = client.request(ftp.WRITE, b"different", sequence=502)
    assert repeated[0][0][2] == ftp.ACK
    assert repeated[0][1] == b"\x01\0\0\0"
    client.request_one(ftp.TERMINATE, sequence=504)
    client.request_one(ftp.OPEN_RO, b"a", sequence=506)
    assert client.request_one(ftp.READ, size=50, sequence=508) == (ftp.ACK, b"x")


def test_a_terminate_with_the_sequence_number_of_a_bursts_last_reply_ends_the_session(client):
    """pymavlink's client terminates the session before it has received the end of the burst."""
    client.request_one(ftp.OPEN_RO, GENERAL)
    *_, (last_header, _) = client.request(ftp.BURST, size=239)
    assert client.request_one(ftp.TERMINATE, sequence=last_header[0] - 1) == (ftp.ACK, b"")
    assert client.request_one(ftp.OPEN_RO, GENERAL)[0] == ftp.ACK, "the only session is still in use"


def test_a_request_to_another_component_gets_no_reply(client):
    assert client.request(ftp.LIST, b"/", component=99) == []


def test_a_directory_longer_than_one_message_is_listed_by_offset(client):
    for n in range(40):
        client.request_one(ftp.MAKE_DIRECTORY, f"directory_{n:02}".encode(), wait_s=0.004)
    entries = []
    while True:
        opcode, data = client.request_one(ftp.LIST, b"/", offset=len(entries))
        if opcode == ftp.NAK:
            break
        entries += data.split(b"\0")[:-1]
    assert data == bytes((ftp.END_OF_FILE,))
    assert [entry for entry in entries if entry.startswith(b"Ddirectory")] == [
        f"Ddirectory_{n:02}".encode() for n in range(40)
    ]
