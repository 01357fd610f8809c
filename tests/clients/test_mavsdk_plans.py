"""Missions, fences and rally points with MAVSDK: uploaded, downloaded, flown, cleared."""

from __future__ import annotations

import asyncio
import json
import math

import pytest
from mavsdk.action import ActionError, ActionResult
from mavsdk.geofence import Circle, FenceType, GeofenceData, Point, Polygon
from mavsdk.mission import MissionItem, MissionPlan
from mavsdk.mission_raw import MissionItem as RawItem
from mavsdk.telemetry import FlightMode

from tests.clients.mavsdk_drone import TIMEOUT_S, connected_drone, next_value, until

LAT, LON = 47.3977432, 8.54559422
METRES_PER_DEGREE = 111_195.0
WAYPOINT, LAND, TAKEOFF, FENCE_VERTEX, RALLY_POINT = 16, 21, 22, 5001, 5100

pytestmark = pytest.mark.timeout(TIMEOUT_S + 20.0)


def mission_item(north_m: float, *, up_m: float = 10.0, fly_through: bool = True) -> MissionItem:
    return MissionItem(
        LAT + north_m / METRES_PER_DEGREE, LON, up_m, 5.0, fly_through, math.nan, math.nan,
        MissionItem.CameraAction.NONE, math.nan, math.nan, math.nan, math.nan, math.nan,
        MissionItem.VehicleAction.NONE,
    )  # fmt: skip


def raw_item(
    seq: int, command: int, *, frame: int = 6, mission_type: int = 0, param1: float = 0.0,
    north_m: float = 0.0, up_m: float = 0.0,
) -> RawItem:  # fmt: skip
    lat = round((LAT + north_m / METRES_PER_DEGREE) * 1e7)
    current = int(seq == 0 and mission_type == 0)
    return RawItem(
        seq, frame, command, current, 1, param1, 0.0, 0.0, math.nan if mission_type == 0 else 0.0, lat,
        round(LON * 1e7), up_m, mission_type,
    )  # fmt: skip


def test_a_mission_is_flown_paused_resumed_and_ended_by_return() -> None:
    asyncio.run(_fly_mission())


async def _fly_mission() -> None:
    async with asyncio.timeout(TIMEOUT_S), connected_drone() as drone:
        mission = drone.mission
        # Without a mission the mode can be selected, but the vehicle cannot be armed in it.
        await mission.start_mission()
        with pytest.raises(ActionError) as refused:
            await drone.action.arm()
        assert refused.value._result.result is ActionResult.Result.COMMAND_DENIED
        await mission.set_return_to_launch_after_mission(True)
        assert await mission.get_return_to_launch_after_mission()
        plan = MissionPlan(
            [mission_item(0.0, fly_through=False), mission_item(25.0), mission_item(40.0, fly_through=False)]
        )
        async for progress in mission.upload_mission_with_progress(plan):
            assert 0.0 <= progress.progress <= 1.0
        downloaded = await mission.download_mission()
        assert [round(each.latitude_deg, 6) for each in downloaded.mission_items] == [
            round(each.latitude_deg, 6) for each in plan.mission_items
        ]
        await drone.action.arm()
        await mission.start_mission()
        await until(drone.telemetry.flight_mode(), lambda mode: mode is FlightMode.MISSION, "Mission")
        await until(mission.mission_progress(), lambda p: p.current >= 1 and p.total == 3, "the first item")
        await mission.pause_mission()
        await until(drone.telemetry.flight_mode(), lambda mode: mode is FlightMode.HOLD, "Hold by a pause")
        await mission.start_mission()
        await until(drone.telemetry.flight_mode(), lambda mode: mode is FlightMode.MISSION, "Mission again")
        await mission.set_current_mission_item(2)
        await until(mission.mission_progress(), lambda p: p.current == 3, "the end of the mission")
        assert await mission.is_mission_finished()
        await until(
            drone.telemetry.flight_mode(), lambda mode: mode is FlightMode.RETURN_TO_LAUNCH, "the return"
        )
        await until(drone.telemetry.armed(), lambda armed: not armed, "home and disarmed")
        await mission.clear_mission()
        assert (await mission.download_mission()).mission_items == []


def test_raw_plans_of_all_three_types_are_downloaded_as_uploaded() -> None:
    asyncio.run(_exchange_raw_plans())


async def _exchange_raw_plans() -> None:
    async with asyncio.timeout(TIMEOUT_S), connected_drone() as drone:
        plans = drone.mission_raw
        change_task = asyncio.ensure_future(next_value(plans.mission_changed(), 40))
        await asyncio.sleep(0.2)
        items = [
            raw_item(0, TAKEOFF, up_m=10.0),
            raw_item(1, WAYPOINT, north_m=20.0, up_m=10.0),
            raw_item(2, LAND),
        ]
        await plans.upload_mission(items)
        downloaded = await plans.download_mission()
        assert [(each.seq, each.command, each.x, each.z) for each in downloaded] == [
            (each.seq, each.command, each.x, each.z) for each in items
        ]
        assert await change_task
        # The stream contains only changes, so the subscription begins before the change.
        progress_task = asyncio.ensure_future(
            until(
                plans.mission_progress(),
                lambda p: p.current == 1 and p.total == 3,
                "item 1 of 3 as the current",
                20,
            )
        )
        await asyncio.sleep(0.5)
        await plans.set_current_mission_item(1)
        await progress_task
        corners = [(-50.0, 0), (50.0, 1), (60.0, 2)]
        fence = [
            raw_item(k, FENCE_VERTEX, frame=5, mission_type=1, param1=3.0, north_m=n) for n, k in corners
        ]
        await plans.upload_geofence(fence)
        assert [each.x for each in await plans.download_geofence()] == [each.x for each in fence]
        rally = [raw_item(0, RALLY_POINT, frame=3, mission_type=2, north_m=15.0, up_m=12.0)]
        await plans.upload_rally_points(rally)
        assert [each.x for each in await plans.download_rallypoints()] == [rally[0].x]

        await plans.clear_mission()
        assert await plans.download_mission() == []


QGC_PLAN = {
    "fileType": "Plan", "version": 1, "groundStation": "QGroundControl",
    "geoFence": {"circles": [], "polygons": [], "version": 2},
    "rallyPoints": {"points": [[LAT, LON, 20.0]], "version": 2},
    "mission": {
        "cruiseSpeed": 15, "hoverSpeed": 5, "firmwareType": 12, "vehicleType": 2, "version": 2,
        "globalPlanAltitudeMode": 1, "plannedHomePosition": [LAT, LON, 489.0],
        "items": [
            {"type": "SimpleItem", "autoContinue": True, "command": 22, "doJumpId": 1, "frame": 3,
             "params": [0, 0, 0, None, LAT, LON, 8.0]},
            {"type": "SimpleItem", "autoContinue": True, "command": 16, "doJumpId": 2, "frame": 3,
             "params": [0, 0, 0, None, LAT + 1.5e-4, LON, 8.0]},
            {"type": "SimpleItem", "autoContinue": True, "command": 21, "doJumpId": 3, "frame": 3,
             "params": [0, 0, 0, None, LAT + 1.5e-4, LON, 0.0]},
        ],
    },
}  # fmt: skip


def test_a_qgroundcontrol_plan_is_imported_uploaded_and_flown_to_its_landing() -> None:
    asyncio.run(_fly_imported_plan())


async def _fly_imported_plan() -> None:
    async with asyncio.timeout(TIMEOUT_S), connected_drone() as drone:
        plans = drone.mission_raw
        imported = await plans.import_qgroundcontrol_mission_from_string(json.dumps(QGC_PLAN))
        assert (len(imported.mission_items), len(imported.rally_items)) == (3, 1)
        await plans.upload_mission(imported.mission_items)
        await plans.upload_rally_points(imported.rally_items)
        await drone.action.arm()
        await plans.start_mission()
        await until(drone.telemetry.in_air(), lambda in_air: in_air, "the take-off")
        await until(drone.telemetry.armed(), lambda armed: not armed, "the landing at the end")
        landed_at = await next_value(drone.telemetry.position())
        assert landed_at.latitude_deg == pytest.approx(LAT + 1.5e-4, abs=1.5e-5)


def test_a_fence_of_polygon_and_circle_is_stored_and_cleared() -> None:
    asyncio.run(_exchange_fence())


async def _exchange_fence() -> None:
    async with asyncio.timeout(TIMEOUT_S), connected_drone() as drone:
        square = [
            Point(LAT + n, LON + e) for n, e in ((1e-3, 1e-3), (1e-3, -1e-3), (-1e-3, -1e-3), (-1e-3, 1e-3))
        ]
        sent = GeofenceData(
            [Polygon(square, FenceType.INCLUSION)],
            [Circle(Point(LAT + 5e-4, LON), 15.0, FenceType.EXCLUSION)],
        )
        await drone.geofence.upload_geofence(sent)
        stored = await drone.geofence.download_geofence()
        assert [len(polygon.points) for polygon in stored.polygons] == [4]
        assert stored.polygons[0].fence_type is FenceType.INCLUSION
        assert stored.circles[0].radius == pytest.approx(15.0)
        assert stored.circles[0].fence_type is FenceType.EXCLUSION
        await drone.geofence.clear_geofence()
        empty = await drone.geofence.download_geofence()
        assert (empty.polygons, empty.circles) == ([], [])
