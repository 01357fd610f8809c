"""A program reads readiness and parameters from a real server process."""

from __future__ import annotations

import json
import time
from typing import Any

import httpx
import pytest
from websockets.sync.client import connect

from tests.e2e.fast_station import Station
from tests.station import wait_until

PARAMETER_COUNT = 913


@pytest.mark.story
def test_the_api_says_why_offboard_is_not_possible_and_describes_parameters(station: Station) -> None:
    vehicle_url = f"{station.url}/api/v1/vehicles/101"
    with httpx.Client(base_url=vehicle_url, timeout=30, headers={"X-Client-Id": "e2e"}) as http:
        wait_until(lambda: http.get("/readiness").json()["known"], "the first report, without a request")
        report = http.post("/readiness/check").json()
        offboard = next(mode for mode in report["modes"] if mode["mode"] == "offboard")
        assert (offboard["can_arm"], offboard["can_run"]) == (False, False)
        (cause,) = offboard["arming"]
        assert cause["name"] == "check_modes_offboard_signal"
        assert cause["remedy"]
        assert next(mode for mode in report["modes"] if mode["mode"] == "hold")["can_arm"]
        wait_until(
            lambda: http.get("/readiness").json()["words"] == "vehicle", "the vehicle's own descriptions"
        )

        with connect(f"{station.url.replace('http', 'ws')}/api/v1/telemetry") as socket:
            subscription = {"type": "subscribe", "vehicles": ["101"], "topics": ["readiness"], "rate_hz": 20}
            socket.send(json.dumps(subscription))
            assert _newest_readiness(socket)["modes"] == http.get("/readiness").json()["modes"]

        assert http.get("/params").json()["list"]["state"] == "unknown"
        assert http.post("/params/refresh").status_code == 202
        wait_until(lambda: http.get("/params").json()["list"]["facts"], "parameters and their metadata")
        parameter_list = http.get("/params").json()
        assert (parameter_list["list"]["state"], len(parameter_list["params"])) == ("ready", PARAMETER_COUNT)
        by_name = {p["name"]: p for p in parameter_list["params"]}
        speed_limit = by_name["MPC_XY_VEL_MAX"]
        assert (speed_limit["facts"]["unit"], speed_limit["is_default"]) == ("m/s", True)

        refusal = http.put("/params/MPC_XY_VEL_MAX", json={"value": 500})
        assert refusal.status_code == 422
        assert refusal.json()["field"] == "value"
        assert "from 0 to 20 m/s" in refusal.json()["detail"]
        changed = http.put("/params/MPC_XY_CRUISE", json={"value": 4}).json()
        assert (changed["value"], changed["is_default"]) == (4.0, False)
        assert http.put("/params/COM_OBL_RC_ACT", json={"value": "x"}).json()["field"] == "value"
        reread = http.post("/params/refresh", json={"wait": True}).json()
        assert (reread["source"], reread["received"]) == ("vehicle", PARAMETER_COUNT)
        assert http.post("/params/refresh", json={"wait": True}).json()["received"] == PARAMETER_COUNT


def _newest_readiness(socket: Any) -> dict[str, Any]:
    end_s = time.monotonic() + 30
    while time.monotonic() < end_s:
        frame = json.loads(socket.recv(timeout=30))
        for sample in frame.get("samples", []):
            if sample["topic"] == "readiness":
                return sample["value"]
    raise AssertionError("no readiness was received")
