"""Attacks on a running server: it serves other clients, and its memory and log stay small."""

import resource
from pathlib import Path

import httpx
import pytest

from gcs_server.log_limit import LINES_PER_PERIOD
from tests.e2e.attacks import ATTACKS, HOST, Target, read_response, running_attack
from tests.station import is_up, running_server, wait_until

MAX_MEMORY_MB = 100
MAX_LOG_CHARACTERS = 20_000
MAX_LOOP_DELAY_S = 15.0
"""This limit is large, because the test machine may be busy with other tests."""

QUICK_ATTACKS = {"idle_sockets", "huge_headers", "huge_chunked_bodies", "largest_json", "unread_websocket"}


@pytest.fixture(scope="module")
def attacked_server(tmp_path_factory):
    log = tmp_path_factory.mktemp("log") / "server.log"
    with running_server(["udpin://127.0.0.1:0"], log=log) as (url, process):
        httpx.get(f"{url}/api/v1/openapi.json", timeout=60).raise_for_status()
        yield Target(int(url.rpartition(":")[2]), process.pid), log


def attack_parameters():
    for attack in ATTACKS:
        marks = (pytest.mark.realtime,) if attack.__name__ in QUICK_ATTACKS else (pytest.mark.story,)
        yield pytest.param(attack.__name__, marks=marks)


@pytest.mark.parametrize("attack", list(attack_parameters()))
def test_during_an_attack_other_clients_are_served_and_memory_and_log_stay_small(attacked_server, attack):
    target, log = attacked_server
    with running_attack(target, attack, b"X-Client-Id: innocent\r\n") as effects:
        pass
    assert effects.served_count
    assert effects.failures == []
    assert effects.longest_loop_delay_s < MAX_LOOP_DELAY_S
    assert effects.memory_mb < MAX_MEMORY_MB
    text = log.read_text()
    assert "Traceback" not in text
    assert len(text) < MAX_LOG_CHARACTERS


@pytest.mark.story
def test_a_server_without_free_file_descriptors_reports_it_once_and_accepts_clients_again_when_some_are_free(
    attacked_server,
):
    target, log = attacked_server
    soft_limit, hard_limit = resource.prlimit(target.pid, resource.RLIMIT_NOFILE)
    open_count = len(list(Path(f"/proc/{target.pid}/fd").iterdir()))
    resource.prlimit(target.pid, resource.RLIMIT_NOFILE, (open_count + 30, hard_limit))
    log_length = len(log.read_text())
    try:
        for _ in range(100):
            target.connect()
        wait_until(
            lambda: "no connection can be accepted" in log.read_text()[log_length:], "the server's message"
        )
    finally:
        target.close_connections()
        resource.prlimit(target.pid, resource.RLIMIT_NOFILE, (soft_limit, hard_limit))
    url = f"http://{HOST}:{target.port}"
    wait_until(lambda: is_up(url), "a response")
    text = log.read_text()[log_length:]
    assert text.count("no connection can be accepted") <= LINES_PER_PERIOD
    assert len(text) < MAX_LOG_CHARACTERS
    warnings = httpx.get(f"{url}/api/v1/warnings", timeout=5).json()["warnings"]
    assert any("refuses clients" in warning["text"] for warning in warnings)


@pytest.mark.story
def test_a_client_that_continues_to_send_too_large_a_body_receives_the_refusal(attacked_server):
    target, _ = attacked_server
    connection = target.connect()
    head = b"POST /api/v1/vehicles/1/arm HTTP/1.1\r\nHost: localhost\r\nContent-Length: 3000000\r\n\r\n"
    target.send(connection, head)
    target.send(connection, b"x" * 100_000, 30)
    response = read_response(connection)
    assert response.startswith(b"HTTP/1.1 413 ")
    assert b'"code":"body_too_large"' in response
    target.close_connections()
