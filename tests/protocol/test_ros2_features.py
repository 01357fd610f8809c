"""Features that are available over ROS 2 alone, over MAVLink, and over both."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from typing import Any

import pytest

from gcs_server.api import mission_models, param_routes, responses
from gcs_server.api.mission_routes import download, upload
from gcs_server.control.principal import Principal
from gcs_server.errors import GcsError, Refused
from gcs_server.vehicle.reach import FEATURES, NEEDS_MAVLINK
from gcs_server.vehicle.services.camera import CameraService
from gcs_server.vehicle.services.manual_control import ManualControlService
from gcs_server.vehicle.services.raw_messages import RawMessages
from gcs_server.vehicle.services.shell import ShellService
from missions.plan import Plan, write
from tests.protocol.api_calls import json_of, new_station
from tests.protocol.ros2_testbed import Ros2Testbed
from tests.protocol.simulated_testbed import both_versions, until
from vehicle_sim.px4_version import Px4Version

ANNA = Principal.from_identity("anna", "anna's tab")
REQUESTS: dict[str, Callable[[Any], Any]] = {
    "parameters": lambda v: v.params.get("MPC_XY_VEL_MAX"),
    "mission_transfer": lambda v: v.mission.clear(),
    "files": lambda v: v.ftp.list("/"),
    "gimbal": lambda v: v.gimbal.take_control(),
    "camera": lambda v: v.service(CameraService).take_picture(),
    "arming_report": lambda v: v.health.check(),
    "shell": lambda v: v.service(ShellService).run("ver all"),
    "manual_control": lambda v: v.service(ManualControlService).begin("anna", "anna's tab", lambda: None),
    "raw_messages": lambda v: v.service(RawMessages).send("PING", {}),
}


def test_requests_has_one_request_for_each_feature() -> None:
    assert set(REQUESTS) == set(FEATURES) == set(NEEDS_MAVLINK)


def test_a_request_that_needs_mavlink_is_refused_immediately_without_mavlink(run_simulated: Any) -> None:
    async def run() -> None:
        testbed = Ros2Testbed()
        vehicle = await testbed.wait_for_vehicle_ready_to_arm()
        assert vehicle.reach.missing == FEATURES
        sent_count = len(testbed.topics[0].sent_messages)
        for feature, request in REQUESTS.items():
            began_s = testbed.loop.time()
            with pytest.raises(Refused, match=f"carries no {NEEDS_MAVLINK[feature]}") as refused:
                await request(vehicle)
            assert "needs a MAVLink link" in (refused.value.remedy or "")
            assert testbed.loop.time() == began_s
        assert len(testbed.topics[0].sent_messages) == sent_count
        await testbed.close()

    run_simulated(run)


def test_routes_that_need_mavlink_refuse_and_start_no_operation_without_mavlink(run_simulated: Any) -> None:
    async def run() -> None:
        testbed = Ros2Testbed()
        vehicle = await testbed.wait_for_vehicle_ready_to_arm()
        station = new_station(testbed)
        plan = mission_models.UploadRequest.model_validate({"plan": json.loads(write(Plan()))})
        for call in (
            lambda: upload("1", plan, station, ANNA),
            lambda: download(vehicle, station, ANNA),
            lambda: param_routes.refresh_params(vehicle, station, ANNA),
            lambda: param_routes.set_param("1", "A", param_routes.ParamRequest(value=1), station, ANNA),
            lambda: vehicle.offboard.set_failsafe("hold", None),
        ):
            with pytest.raises(Refused, match="connected over ROS 2 only"):
                await call()
        assert station.operations.all() == []
        assert json_of(responses.json_response(responses.vehicle_view(vehicle)))["reach"] == {
            "protocols": ["ROS 2"],
            "telemetry": "ROS 2",
            "commands": "ROS 2",
            "setpoints": "ROS 2",
            "missing": list(FEATURES),
        }
        await testbed.close()

    run_simulated(run)


@both_versions
def test_with_both_protocols_commands_use_mavlink_and_setpoints_ros_2(
    run_simulated: Any, px4: Px4Version
) -> None:
    async def run() -> None:
        testbed = Ros2Testbed(mavlink=True, px4=px4)
        vehicle = await testbed.wait_for_vehicle_ready_to_arm()
        await until(lambda: len(vehicle.reach.protocols) == 2, 10)
        reach = vehicle.reach
        assert (reach.telemetry, reach.commands, reach.setpoints) == ("MAVLink", "MAVLink", "ROS 2")
        assert reach.missing == ()
        await vehicle.params.get("MPC_XY_VEL_MAX")

        testbed.mavlink_on = False
        await asyncio.sleep(4.0)
        assert (vehicle.reach.protocols, vehicle.reach.commands) == (("ROS 2",), "ROS 2")
        with pytest.raises(GcsError, match="vehicle 1 sends nothing on its MAVLink link mavlink"):
            await vehicle.params.get("MPC_XY_VEL_MAX")

        testbed.mavlink_on = True
        await until(lambda: not vehicle.reach.missing, 5)
        await testbed.close()

    run_simulated(run)
