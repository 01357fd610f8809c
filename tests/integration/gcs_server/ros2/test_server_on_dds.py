"""The server on real DDS reports vehicles without valid messages; they do not affect other vehicles."""

from __future__ import annotations

import json
import os
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("cyclonedds")

from fastapi.testclient import TestClient

from gcs_server.app import create_app
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import encode_frame, encode_payload
from gcs_server.ros2.dds import open_domain
from gcs_server.ros2.message_types import MESSAGES
from gcs_server.ros2.topics import COMMAND
from gcs_server.settings import Settings
from tests.station import free_port
from tests.support.dds_publisher import VEHICLE_STATUS, Publisher, status_bytes
from tests.support.dds_samples import recorded_samples
from tests.support.dds_vehicle import (
    MESSAGES_OF_TOPICS,
    VEHICLE_ATTITUDE,
    AcknowledgingVehicle,
    PeriodicThread,
)

DOMAIN = 100 + os.getpid() % 100
"""The link reads every vehicle of its domain: no other test may use the same domain."""


@pytest.fixture
def periodic_thread() -> Iterator[PeriodicThread]:
    domain, thread = open_domain(DOMAIN, None), PeriodicThread()
    yield thread
    thread.close()
    assert domain  # this reference keeps the domain open


@pytest.fixture
def client(tmp_path: Path) -> Iterator[TestClient]:
    settings = Settings(port=0, links=(f"ros2://{DOMAIN}",), sim=0, data=tmp_path, scene=False, record=False)
    headers = {"X-Client": "test"}
    with TestClient(create_app(settings), base_url="http://localhost/api/v1/", headers=headers) as client:
        yield client


def until(condition: Callable[[], object], within_s: float = 20.0) -> None:
    end_s = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.05)


def is_connected(client: TestClient, vehicle_id: str) -> bool:
    response = client.get(f"vehicles/{vehicle_id}")
    return response.status_code == 200 and not response.json()["status"]["link_lost"]


def attitude_unix_s(client: TestClient, vehicle: str) -> float:
    sample = client.get(f"vehicles/{vehicle}").json()["topics"].get("attitude")
    return 0.0 if sample is None else sample["received_unix_s"]


def warning_texts(client: TestClient) -> str:
    return " ".join(each["text"] for each in client.get("warnings").json()["warnings"])


def send_invalid_values(publisher: Publisher) -> None:
    publisher.send(VEHICLE_STATUS, status_bytes(system_id=0))


def send_wrong_type(publisher: Publisher) -> None:
    publisher.send(VEHICLE_STATUS, bytes(100), "HomePosition")


def send_unknown_layout(publisher: Publisher) -> None:
    publisher.hashes["vehicle_status"] = 0x0BADF00D
    publisher.send("/fmu/out/vehicle_status_v7", status_bytes())


def send_nothing(publisher: Publisher) -> None:
    publisher.prepare(VEHICLE_STATUS)
    publisher.answer()


def send_flood(publisher: Publisher) -> None:
    for _ in range(200):
        publisher.send(VEHICLE_STATUS, status_bytes(system_id=7))
        publisher.send(VEHICLE_ATTITUDE, recorded_samples()[VEHICLE_ATTITUDE], "VehicleAttitude")


@pytest.mark.parametrize(
    ("fault", "text"),
    [
        pytest.param(
            send_invalid_values,
            "A message on /bad/fmu/out/vehicle_status_v1 cannot be used",
            marks=pytest.mark.broad,
        ),
        pytest.param(
            send_wrong_type,
            "has the type HomePosition instead of VehicleStatus",
            marks=pytest.mark.broad,
        ),
        pytest.param(
            send_unknown_layout,
            "vehicle_status_v7 has a layout that this server does not know: PX4 names it 0badf00d",
            marks=pytest.mark.broad,
        ),
        (send_nothing, "bad has confirmed the layout of /fmu/out/vehicle_status, but sends no message"),
        pytest.param(send_flood, None, marks=pytest.mark.broad),
    ],
)
def test_a_faulty_vehicle_is_reported_and_another_vehicle_can_be_commanded(
    fault: Callable[[Publisher], None],
    text: str | None,
    periodic_thread: PeriodicThread,
    client: TestClient,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("gcs_server.ros2.link.FIRST_REPORT_S", 1.0)
    good_vehicle, bad_publisher = AcknowledgingVehicle(DOMAIN, "good", 1), Publisher(DOMAIN, "bad")
    periodic_thread.callbacks += [lambda: fault(bad_publisher), good_vehicle.step]
    until(lambda: is_connected(client, "1"))
    until(lambda: text is None or text in warning_texts(client))
    arm_response = client.post("vehicles/1/arm", json={})
    assert arm_response.status_code == 200, arm_response.text
    assert client.get("vehicles/1").json()["status"]["armed"]
    previous_unix_s = attitude_unix_s(client, "1")
    until(lambda: attitude_unix_s(client, "1") > previous_unix_s, 2.0)


def test_topics_are_sent_on_request_and_to_a_telemetry_subscriber(
    periodic_thread: PeriodicThread, client: TestClient
) -> None:
    good_vehicle = AcknowledgingVehicle(DOMAIN, "good", 1)
    periodic_thread.callbacks.append(good_vehicle.step)
    until(lambda: is_connected(client, "1"))
    response = client.get("vehicles/1/ros2/topics").json()
    assert (response["state"], response["domain_id"], response["namespace"]) == ("open", DOMAIN, "good")
    assert {f"/good{topic}" for topic in (VEHICLE_STATUS, COMMAND, *MESSAGES_OF_TOPICS)} <= {
        topic["name"] for topic in response["topics"]
    }
    with client.websocket_connect("ws://localhost/api/v1/telemetry") as telemetry:
        subscription = {"type": "subscribe", "vehicles": ["1"], "topics": ["ros2_topics"], "rate_hz": 5}
        telemetry.send_text(json.dumps(subscription))
        value: dict[str, Any] = {}
        while not any(topic["rate_hz"] for topic in value.get("topics", ())):
            for sample in json.loads(telemetry.receive_text()).get("samples", ()):
                assert (sample["vehicle"], sample["topic"]) == ("1", "ros2_topics")
                value = sample["value"]
    topics = {topic["name"]: topic for topic in value["topics"]}
    attitude = topics[f"/good{VEHICLE_ATTITUDE}"]
    expected = MESSAGES["VehicleAttitude"].decode(recorded_samples()[VEHICLE_ATTITUDE])
    assert attitude["value"]["q"] == pytest.approx(list(expected["q"]))
    assert 1.0 < attitude["rate_hz"] < 40.0, "the rate is not about 20 Hz (less on a busy machine)"
    assert topics[f"/good{COMMAND}"]["publishers"] == 1


def test_a_vehicle_without_a_ros_2_link_has_no_topics_to_show(client: TestClient) -> None:
    port = free_port()
    client.post("links", json={"url": f"udpin://127.0.0.1:{port}"}).raise_for_status()
    heartbeat = d.MAVLink_heartbeat_message(d.MAV_TYPE_QUADROTOR, d.MAV_AUTOPILOT_PX4, 0, 0, 3, 3)
    frame = encode_frame(d.MAVLINK_MSG_ID_HEARTBEAT, encode_payload(heartbeat), 0, 9, 1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:

        def heartbeat_connects_vehicle() -> bool:
            sender.sendto(frame, ("127.0.0.1", port))
            return is_connected(client, "9")

        until(heartbeat_connects_vehicle)
        response = client.get("vehicles/9/ros2/topics")
    assert (response.status_code, response.json()["code"]) == (409, "refused")
    assert response.json()["detail"] == "Vehicle 9 has no ROS 2 link, so it has no topics to show."
