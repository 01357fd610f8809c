"""Plans are uploaded to a vehicle that stores, returns and rejects them as a real PX4 does."""

from types import SimpleNamespace

import pytest

from gcs_server.errors import Rejected
from gcs_server.vehicle.services.mission_on_vehicle import PlanReference
from missions.formats import mavlink_items
from missions.items import Jump, Land, Takeoff, Waypoint
from missions.plan import Plan
from missions.values import Altitude, FenceCircle, FencePolygon, HomePosition, Point, RallyPoint
from tests.protocol.memory_testbed import MemoryTestbed
from tests.protocol.px4_plan_store import Px4PlanStore

HOME = HomePosition(lat_deg=47.397742, lon_deg=8.545594, alt_amsl_m=489.0)
REFERENCE = PlanReference("abc", 1, "Tower")
EVENT = 410


def at(item_class, north_e7, height_m=20.0, **fields):
    altitude = Altitude(value_m=height_m, reference="home")
    lat_deg = HOME.lat_deg + north_e7 / 1e7
    return item_class(lat_deg=lat_deg, lon_deg=HOME.lon_deg, altitude=altitude, **fields)


def corner(north_e7, east_e7):
    return Point(lat_deg=HOME.lat_deg + north_e7 / 1e7, lon_deg=HOME.lon_deg + east_e7 / 1e7)


SQUARE = tuple(corner(n * 30_000, e * 30_000) for n, e in ((1, 1), (1, -1), (-1, -1), (-1, 1)))
FENCED_PLAN = Plan(
    planned_home=HOME,
    items=(
        at(Takeoff, 0, yaw_ned_deg=-90.0),
        at(Waypoint, 3_000, yaw_ned_deg=-45.5, pass_radius_m=3.0),
        at(Waypoint, 6_000, yaw_ned_deg=450.0),
        Jump(target_index=1, repeat=-1),
        at(Land, 0, 0.0, abort_altitude_m=5.0),
    ),
    fence=(
        FencePolygon(inclusion=True, polygon=SQUARE),
        FenceCircle(inclusion=False, center=corner(20_000, 20_000), radius_m=15.25),
    ),
    rally_points=(
        RallyPoint(lat_deg=47.3978, lon_deg=8.5456, altitude=Altitude(value_m=30.0, reference="home")),
    ),
)
LANDING = Plan(planned_home=HOME, items=(at(Land, 100, 0.0), at(Waypoint, 500)))


def items_of(plan):
    return {
        "mission": mavlink_items.mission_items(plan),
        "fence": mavlink_items.fence_items(plan),
        "rally": mavlink_items.rally_items(plan),
    }


def run_with_px4(run_simulated, scenario, *, loss=0.0, seed=0):
    async def run():
        testbed = MemoryTestbed()
        link = testbed.link()
        px4 = link.autopilots["peer"] = Px4PlanStore(link, seed=seed)
        try:
            vehicle = await testbed.wait_for_vehicle()
            px4.send_event(26266355, 102)  # so that the server knows the sequence of the events
            await testbed.clock.sleep(0.1)
            px4.loss = loss
            await scenario(SimpleNamespace(vehicle=vehicle, mission=vehicle.mission, px4=px4))
        finally:
            px4.alive = False
            await testbed.close()

    run_simulated(run)


@pytest.mark.parametrize(("loss", "seed"), [(0.0, 0), (0.2, 1)])
def test_a_plan_with_fence_yaw_jump_and_rally_points_is_uploaded_and_held(run_simulated, loss, seed):
    async def scenario(rig):
        uploaded = await rig.mission.upload(items_of(FENCED_PLAN), REFERENCE)
        assert rig.mission.plan_on_vehicle() == "plan"
        assert [(each.seq, each.field, each.planned) for each in uploaded.not_kept] == [
            (1, "param3", 3.0),
            (4, "param1", 5.0),
        ]
        downloaded = await rig.mission.download()
        assert downloaded.plan == REFERENCE
        assert downloaded.items["mission"][0].param4 == pytest.approx(270.0)

    run_with_px4(run_simulated, scenario, loss=loss, seed=seed)


@pytest.mark.parametrize(("loss", "seed"), [(0.0, 0), (0.2, 1), (0.2, 2)])
def test_a_mission_that_px4_rejects_after_the_upload_has_not_been_uploaded(run_simulated, loss, seed):
    async def scenario(rig):
        for _ in range(2):  # PX4 does not check an identical mission again
            with pytest.raises(Rejected) as caught:
                await rig.mission.upload(items_of(LANDING), REFERENCE)
            assert "will not fly its mission: it starts with a landing" in str(caught.value)
            assert rig.mission.items_on_vehicle.rejections == caught.value.reasons
        await rig.mission.upload(items_of(FENCED_PLAN), REFERENCE)
        assert rig.mission.items_on_vehicle.rejections == ()

    run_with_px4(run_simulated, scenario, loss=loss, seed=seed)


def test_the_reason_is_known_although_its_event_was_lost(run_simulated):
    async def scenario(rig):
        send_raw, lost = rig.px4.send_raw, []

        def lose_first_event(raw):
            if not lost and int.from_bytes(raw[7:10], "little") == EVENT:
                lost.append(raw)
            else:
                send_raw(raw)

        rig.px4.send_raw = lose_first_event
        with pytest.raises(Rejected, match="starts with a landing"):
            await rig.mission.upload(items_of(LANDING), REFERENCE)
        assert lost

    run_with_px4(run_simulated, scenario)
