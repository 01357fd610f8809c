"""The Python client flies a group with real processes. The vehicles are in Hold after the end of the
group's block, and after an error in it."""

from __future__ import annotations

import asyncio
import contextlib
import time

import pytest

from gcs_server.client import Gcs, Invalid, NotInControl, Refused, SyncGcs, setpoints
from tests.e2e.fast_station import FAST_OPTIONS, move_aside
from tests.station import free_port, running_server, running_vehicles, wait_until

pytestmark = pytest.mark.realtime
VEHICLE_IDS = ("101", "102")


def test_a_group_flies_changes_its_setpoints_and_is_in_hold_after_its_block_or_an_error() -> None:
    port = free_port()
    with (
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, _),
        running_vehicles(port, instances=2, arguments=FAST_OPTIONS),
        SyncGcs(url, client="pair") as gcs,
    ):
        drones = [gcs.wait_for_vehicle(v, ready=True, timeout_s=120) for v in VEHICLE_IDS]
        for drone in drones:
            drone.takeoff(8)
        for drone in drones:
            drone.until(lambda v: v["status"]["mode"] == "hold", what="the end of the take-off")
        # On a busy machine 3 m are too near for the minimum separation and its margin.
        move_aside(drones[1], 8.0)
        northward = dict.fromkeys(VEHICLE_IDS, setpoints.velocity_ned(1, 0, 0))
        with gcs.group(northward, minimum_separation_m=1, valid_for_s=20) as group:
            assert group.started["state"] == "waiting"
            assert group.started["start_unix_s"] > time.time_ns() / 1e9 - 1
            wait_until(lambda: group.status()["state"] == "flying", "the start")
            with pytest.raises(Invalid, match="vehicle 9 is not in group") as invalid:
                group.send({"9": setpoints.velocity_ned(1, 0, 0)})
            assert invalid.value.field == "setpoints.0.vehicle"
            with pytest.raises(Refused, match="would come within"):
                group.send(
                    {"101": setpoints.position_body(0, 40, 0), "102": setpoints.position_body(0, 0, 0)}
                )
            group.send({"101": setpoints.velocity_ned(0.5, 0, 0), "102": setpoints.velocity_ned(0.5, 0, 0)})
            time.sleep(1.5)
            assert group.renew()["valid_left_s"] > 19.5
            with (
                SyncGcs(url, client="other", client_id="another") as other,
                pytest.raises(NotInControl, match="pair has control of vehicle 101"),
            ):
                other.request("POST", f"/groups/{group.id}/setpoints", {"setpoints": []})
        assert {drone.status()["mode"] for drone in drones} == {"hold"}
        assert group.status()["ended"] == "pair commanded Hold."
        gcs.request("POST", "/me/leave")

        async def raise_in_block() -> None:
            async with Gcs(url, client="pair") as program, program.group(northward, minimum_separation_m=1):
                raise RuntimeError("the program's own error")

        with contextlib.suppress(RuntimeError):
            asyncio.run(raise_in_block())
        assert {drone.status()["mode"] for drone in drones} == {"hold"}
        groups = gcs.request("GET", "/groups")["groups"]
        assert [(g["state"], g["findings"]) for g in groups] == [("ended", []), ("ended", [])]
