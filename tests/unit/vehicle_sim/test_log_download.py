"""Logs over LOG_* messages: the vehicle lists them, sends and repeats their parts, and erases them."""

import random

import pytest

from tests.unit.vehicle_sim.ftp_client import FtpClient
from tests.unit.vehicle_sim.sim_station import Station
from vehicle_sim.mavlink.services import ftp

pytestmark = [pytest.mark.flight, pytest.mark.story]

TARGET = {"target_system": 1, "target_component": 1}
BOOT_UNIX_S = 1795222005


@pytest.fixture
def station():
    """A station whose vehicle has one finished log and a second log in progress."""
    station = Station(log=True, boot_time_unix_s=BOOT_UNIX_S)
    station.run(2)
    logger = station.sim.loggers[0]
    logger.stop()
    station.sim.simulation.parameters[0].set("SDLOG_MODE", 2)
    assert logger.start_manually()
    station.run(1)
    return station


def file_bytes(station, number):
    folder = station.sim.files[0].root / "log"
    return sorted(folder.rglob("*.ulg"))[number].read_bytes()


def send_request(station, name, seconds=0.5, **fields):
    since_s = station.now_s
    station.send(name, **TARGET, **fields)
    station.run(seconds)
    return [m for t, _, m in station.log if t > since_s and m.name in ("LOG_ENTRY", "LOG_DATA")]


def test_the_list_has_number_time_and_size_of_each_log(station):
    first, second = send_request(station, "LOG_REQUEST_LIST", start=0, end=0xFFFF)
    assert (first.values["id"], first.num_logs, first.last_log_num) == (0, 2, 2)
    assert first.time_utc == BOOT_UNIX_S + 2, "the end of the log"
    assert first.size == len(file_bytes(station, 0))
    assert (second.values["id"], second.time_utc) == (1, BOOT_UNIX_S + 3)
    (entry,) = send_request(station, "LOG_REQUEST_LIST", start=1, end=1)
    assert entry.values["id"] == 1


@pytest.mark.parametrize("bounds", [(5, 9), (2, 0xFFFF)])
def test_a_request_for_logs_that_do_not_exist_gets_no_reply(station, bounds):
    assert send_request(station, "LOG_REQUEST_LIST", start=bounds[0], end=bounds[1]) == []


def test_parts_have_90_bytes_and_the_last_part_has_the_rest(station):
    content = file_bytes(station, 0)
    parts = send_request(station, "LOG_REQUEST_DATA", id=0, ofs=len(content) - 100, count=1000)
    assert [(m.ofs, m.count) for m in parts] == [(len(content) - 100, 90), (len(content) - 10, 10)]
    assert bytes(parts[0].data) + bytes(parts[1].data[:10]) == content[-100:]


@pytest.mark.parametrize("fields", [{"id": 50, "ofs": 0, "count": 90}, {"id": 0, "ofs": 1 << 30, "count": 90},
                                    {"id": 0, "ofs": 0, "count": 0}])  # fmt: skip
def test_invalid_requests_get_no_reply(station, fields):
    assert send_request(station, "LOG_REQUEST_DATA", **fields) == []


def test_a_download_with_lost_parts_equals_the_file_read_by_ftp(station):
    (entry,) = [m for m in send_request(station, "LOG_REQUEST_LIST", start=0, end=0)]
    rng, parts_by_offset = random.Random(3), {}
    for _ in range(40):
        missing = [offset for offset in range(0, entry.size, 90) if offset not in parts_by_offset]
        if not missing:
            break
        gap = next((k for k in range(1, len(missing)) if missing[k] != missing[0] + 90 * k), 0)
        byte_count = 90 * (1 + gap)
        byte_count = min(entry.size - missing[0], byte_count if len(missing) < 200 else entry.size)
        for part in send_request(station, "LOG_REQUEST_DATA", 1.0, id=0, ofs=missing[0], count=byte_count):
            if rng.random() > 0.05:
                parts_by_offset[part.ofs] = bytes(part.data[: part.count])
        station.log.clear()
        if len(missing) < 200:
            for offset in missing:
                for part in send_request(station, "LOG_REQUEST_DATA", 0.02, id=0, ofs=offset, count=90):
                    parts_by_offset[part.ofs] = bytes(part.data[: part.count])
    downloaded = b"".join(parts_by_offset[offset] for offset in sorted(parts_by_offset))
    assert downloaded == file_bytes(station, 0)
    path = sorted((station.sim.files[0].root / "log").rglob("*.ulg"))[0].relative_to(
        station.sim.files[0].root
    )
    client, ftp_bytes = FtpClient(station.sim), b""
    assert client.request_one(ftp.OPEN_RO, str(path).encode())[0] == ftp.ACK
    while len(ftp_bytes) < len(downloaded):
        replies = client.request(ftp.BURST, offset=len(ftp_bytes), wait_s=0.4)
        ftp_bytes += b"".join(data for header, data in replies if header[2] == ftp.ACK)
    assert ftp_bytes == downloaded


def test_at_most_5000_parts_are_sent_per_second_until_an_end_request(station):
    parts = send_request(station, "LOG_REQUEST_DATA", 0.1, id=0, ofs=0, count=0xFFFFFFFF)
    assert 400 <= len(parts) <= 520
    station.send("LOG_REQUEST_END", **TARGET)
    station.run(0.02)
    since_s = station.now_s
    station.run(0.2)
    assert station.received("LOG_DATA", since_s=since_s + 0.001) == []


def test_erasing_removes_all_logs_and_a_new_log_can_be_started(station):
    station.send("LOG_ERASE", **TARGET)
    station.run(0.2)
    assert send_request(station, "LOG_REQUEST_LIST", start=0, end=0xFFFF) == []
    station.sim.loggers[0].stop()
    assert station.sim.loggers[0].start_manually()
    station.run(0.1)
    assert len(send_request(station, "LOG_REQUEST_LIST", start=0, end=0xFFFF)) == 1


def test_requests_to_other_systems_and_components_are_ignored(station):
    station.send("LOG_REQUEST_LIST", target_system=2, target_component=1, start=0, end=0xFFFF)
    station.send("LOG_ERASE", target_system=1, target_component=42)
    since_s = station.now_s
    station.run(0.2)
    assert station.received("LOG_ENTRY", since_s=since_s) == []
    assert file_bytes(station, 0)


def test_a_download_ends_when_its_log_is_erased(station):
    station.send("LOG_REQUEST_DATA", **TARGET, id=0, ofs=0, count=0xFFFFFFFF)
    station.run(0.05)
    station.sim.files[0].delete_tree("log")
    station.run(0.1)
    assert not station.sim.nodes[0]._logs.busy
