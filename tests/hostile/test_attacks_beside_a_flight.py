"""Attacks while a vehicle flies in Offboard: its setpoints stay on time, and memory and log stay limited.

All attacks use the same server and flight: the effects of an attack may still exist during a later one.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator

import httpx
import pytest

from tests.hostile.attacked_flight import (
    AttackedFlight,
    attack,
    attacked_flight,
    wait_for_effects,
    write_recording,
)

FUZZ_FRAMES = int(os.environ.get("HOSTILE_FRAMES", "500000"))
OVERLOAD_STATUSES = {503}
"""Statuses with which the server refuses a client that sends too many requests."""


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AttackedFlight]:
    with attacked_flight(tmp_path_factory.mktemp("hostile")) as attacked:
        yield attacked


@pytest.mark.parametrize(
    ("name", "count"), [("extremes", 30), ("texts", 20_000), ("sources", 300)], ids=lambda value: str(value)
)
def test_a_vehicle_with_hostile_messages_affects_no_other_vehicle(
    flight: AttackedFlight, name: str, count: int
) -> None:
    with flight.under_attack():
        assert int(attack("vehicles", name, flight.hostile_port, 1, count)) > 100
        wait_for_effects(2)


def test_a_vehicle_with_endless_files_and_parameters_affects_no_other_vehicle(flight: AttackedFlight) -> None:
    """The test requests the readiness, the parameters and their metadata of the hostile vehicle."""
    statuses: set[int] = set()

    def request_everything() -> None:
        with httpx.Client(base_url=f"{flight.url}/api/v1/vehicles/66", timeout=60) as client:
            for path in ("", "/readiness", "/params", "/params", "/offboard", "/history?topics=attitude"):
                statuses.add(client.get(path).status_code)
            statuses.add(client.post("/params/refresh").status_code)

    with flight.under_attack():
        requester = threading.Timer(2.0, request_everything)
        requester.start()
        attack("vehicles", "files", flight.hostile_port, 1, 25)  # seed, seconds
        requester.join()
    assert not {status for status in statuses if status >= 500 and status not in (503, 504)}, statuses


@pytest.mark.parametrize(
    "name",
    [
        "large_bodies",
        "endless_headers",
        "idle_connections",
        "unread_replies",
        "control_requests",
        "invalid_http",
        "documents",
    ],
)
def test_a_hostile_client_affects_no_vehicle(flight: AttackedFlight, name: str) -> None:
    with flight.under_attack():
        statuses = {int(each) for each in attack("clients", name, flight.url.removeprefix("http://")).split()}
        wait_for_effects(3)
    assert not {status for status in statuses if status >= 500} - OVERLOAD_STATUSES


def test_viewers_of_large_and_damaged_logs_affect_no_vehicle(flight: AttackedFlight) -> None:
    with flight.under_attack():
        statuses = {int(each) for each in attack("flights", flight.url.removeprefix("http://")).split()}
        wait_for_effects(3)
    assert 200 in statuses
    assert not {status for status in statuses if status >= 500} - OVERLOAD_STATUSES


def test_a_recording_with_a_million_senders_affects_no_vehicle(flight: AttackedFlight) -> None:
    (flight.data_folder / "recordings").mkdir(exist_ok=True)
    write_recording(flight.data_folder / "recordings" / "endless.tlog", 1_000_000)
    with flight.under_attack(), httpx.Client(base_url=f"{flight.url}/api/v1", timeout=60) as client:
        index_response = client.get("/recordings/endless.tlog/index")
        open_response = client.post("/replays", json={"recording": "endless.tlog", "speed": 50})
        position = {"position_unix_s": open_response.json()["end_unix_s"] - 10}
        seek_response = client.post(f"/replays/{open_response.json()['name']}", json=position)
        wait_for_effects(3)
        close_response = client.delete(f"/replays/{open_response.json()['name']}")
    assert index_response.json()["left_out"] > 900_000
    assert [
        response.status_code for response in (index_response, open_response, seek_response, close_response)
    ] == [200, 201, 200, 204]


def test_half_a_million_invalid_frames_affect_no_vehicle(flight: AttackedFlight) -> None:
    with flight.under_attack():
        assert int(attack("vehicles", "fuzz", flight.hostile_port, 7, FUZZ_FRAMES)) >= FUZZ_FRAMES
        wait_for_effects(2)
