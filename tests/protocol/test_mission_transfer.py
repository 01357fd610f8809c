"""Upload and download of plans over a link that loses packets, with the simulated PX4's mission service."""

import asyncio
import random
from types import SimpleNamespace

import pytest

from gcs_server.errors import GcsError, NoReply, Refused, Rejected
from gcs_server.mavlink import dialect as d
from gcs_server.vehicle.services.mission_dialogue import PARTS
from gcs_server.vehicle.services.mission_on_vehicle import PlanReference
from missions.formats.mavlink_items import WireItem
from missions.formats.px4_storage import stored_items
from tests.protocol.mission_autopilot import MissionAutopilot, UploadingStation
from tests.protocol.offboard_testbed import OffboardTestbed, sleep

PLAN = PlanReference("abc", 3, "Tower")
LOSS = [(0.0, 1), (0.05, 2), (0.3, 3)]
"""The share of packets lost in each direction, and the seed of the losses."""
NAN = float("nan")
LAT_E7, LON_E7 = 473_977_420, 85_455_940
WAYPOINT, TAKEOFF, CHANGE_SPEED, UNSUPPORTED, FENCE_VERTEX, RALLY_POINT = 16, 22, 178, 212, 5001, 5100
"""Commands of mission items."""


def run_with_rig(run_simulated, scenario, *, loss=0.0, seed=0):
    async def run():
        testbed = OffboardTestbed()
        link = testbed.link()
        autopilot = link.autopilots["peer"] = MissionAutopilot(link, seed=seed)
        try:
            vehicle = await testbed.wait_for_vehicle()
            await sleep(1.5)
            autopilot.loss = loss
            rig = SimpleNamespace(
                testbed=testbed, vehicle=vehicle, autopilot=autopilot, link=link, mission=vehicle.mission
            )
            await scenario(rig)
        finally:
            autopilot.alive = False
            await testbed.close()

    run_simulated(run)


def waypoint(seq, rng=None, command=WAYPOINT):
    rng = rng or random.Random(seq)
    params = (float(rng.randrange(0, 60)), 0.0, 0.0, rng.choice([NAN, 90.0, -45.5]))
    x, y = LAT_E7 + rng.randrange(-50_000, 50_000), LON_E7 + rng.randrange(-50_000, 50_000)
    return WireItem(seq, rng.choice([5, 6]), command, *params, x, y, float(rng.randrange(10, 100)))


def mission(count, seed=0):
    rng = random.Random(seed)
    take_off = WireItem(0, 6, TAKEOFF, 0.0, 0.0, 0.0, NAN, LAT_E7, LON_E7, 20.0)
    change_speed = WireItem(1, 2, CHANGE_SPEED, 1.0, 4.5, -1.0, 0.0, 0, 0, 0.0)
    return (take_off, change_speed, *(waypoint(seq, rng) for seq in range(2, count)))[:count]


def square(half_e7=20_000):
    """Fence vertices; `half_e7`: half of the side [1e-7 degrees]."""
    corners = [(-half_e7, -half_e7), (-half_e7, half_e7), (half_e7, half_e7), (half_e7, -half_e7)]
    return tuple(
        WireItem(n, 6, FENCE_VERTEX, 4.0, 0.0, 0.0, 0.0, LAT_E7 + x, LON_E7 + y, 0.0)
        for n, (x, y) in enumerate(corners)
    )


def rally(count=2):
    return tuple(
        WireItem(n, 3, RALLY_POINT, 0.0, 0.0, 0.0, 0.0, LAT_E7 + 100 * n, LON_E7, 25.0) for n in range(count)
    )


def plan(count=5, seed=0):
    return {"mission": mission(count, seed), "fence": square(), "rally": rally()}


def bytes_of(part, items):
    """The payload of MISSION_ITEM_INT as PX4 stores it, with `current` 0, which the vehicle changes, and the
    yaw without the rounding of PX4's angle."""
    return [
        d.MAVLink_mission_item_int_message(
            0, 0, item.seq, item.frame, item.command, 0, int(item.autocontinue),
            item.param1, item.param2, item.param3, round(item.param4, 3), item.x, item.y, item.z, 0,
        ).pack(d.MAVLink(None))[10:-2]
        for item in stored_items(part, items)
    ]  # fmt: skip


@pytest.mark.parametrize(("loss", "seed"), [*LOSS[:2], pytest.param(*LOSS[2], marks=pytest.mark.broad)])
def test_a_thousand_items_are_downloaded_unchanged_at_any_packet_loss(run_simulated, loss, seed):
    planned = plan(1000, seed)

    async def scenario(rig):
        shares = []
        uploaded = await rig.mission.upload(planned, PLAN, progress=lambda _, share: shares.append(share))
        assert rig.mission.plan_on_vehicle() == "plan"
        assert uploaded.not_kept == []
        assert shares == sorted(shares)
        assert shares[-1] > 0.99
        for part in PARTS:
            assert bytes_of(part, uploaded.items_on_vehicle.items[part]) == bytes_of(part, planned[part])

    run_with_rig(run_simulated, scenario, loss=loss, seed=seed)


@pytest.mark.parametrize(("loss", "seed"), [*LOSS, (0.3, 4), (0.3, 5), (0.3, 6), (0.3, 7)])
def test_small_plans_replace_each_other_and_empty_parts_are_cleared(run_simulated, loss, seed):
    async def scenario(rig):
        await rig.mission.upload(plan(4), PLAN)
        other = {"mission": mission(7, seed=9), "fence": (), "rally": ()}
        await rig.mission.upload(other, PlanReference("def", 1, "Barn"))
        assert (rig.mission.plan_on_vehicle(), rig.mission.items_on_vehicle.plan.id) == ("plan", "def")
        downloaded = await rig.mission.download()
        assert [len(downloaded.items[part]) for part in ("mission", "fence", "rally")] == [7, 0, 0]
        assert downloaded.plan.id == "def", "the downloaded plan is not the uploaded plan"
        await rig.mission.clear()
        await sleep(3)
        assert rig.vehicle.topic("mission").value.count == 0
        assert rig.mission.items_on_vehicle.plan is None

    run_with_rig(run_simulated, scenario, loss=loss, seed=seed)


def test_empty_parts_are_acknowledged_so_that_the_vehicle_does_not_wait_for_more(run_simulated):
    # Seen on v1.17.0: an unacknowledged download of an empty part ended in "Operation timeout" 5 s later.
    async def scenario(rig):
        await rig.mission.upload({"mission": mission(3), "fence": (), "rally": ()}, PLAN)
        await rig.mission.clear()
        await rig.mission.download()
        await sleep(6)
        assert not [text for text in rig.autopilot.texts if "timeout" in text]

    run_with_rig(run_simulated, scenario)


def test_an_item_that_the_vehicle_refuses_is_named_and_the_old_plan_remains(run_simulated):
    async def scenario(rig):
        await rig.mission.upload(plan(4), PLAN)
        for index in (0, 3, 6):
            items = list(mission(7, seed=2))
            items[index] = waypoint(index, command=UNSUPPORTED)
            with pytest.raises(Rejected, match=f"refused item {index + 1} of the mission") as raised:
                await rig.mission.upload({**plan(), "mission": tuple(items)}, PlanReference("bad", 1, "Bad"))
            assert "not supported in a mission" in str(raised.value)
            assert "still has its previous items" in str(raised.value)
            assert (rig.mission.plan_on_vehicle(), rig.mission.items_on_vehicle.plan) == ("plan", PLAN)
        downloaded = await rig.mission.download()
        assert bytes_of("mission", downloaded.items["mission"]) == bytes_of("mission", plan(4)["mission"])

    run_with_rig(run_simulated, scenario)


def test_parts_that_were_stored_before_the_refusal_are_listed(run_simulated):
    async def scenario(rig):
        await rig.mission.upload(plan(4), PLAN)
        refused_plan = {**plan(), "mission": (waypoint(0, command=UNSUPPORTED),), "fence": square(9_000)}
        with pytest.raises(Rejected, match=r"now has a new geofence\. Its rally points and mission are as"):
            await rig.mission.upload(refused_plan, PlanReference("bad", 1, "Bad"))
        await sleep(1.5)
        assert rig.mission.plan_on_vehicle() == "another"

    run_with_rig(run_simulated, scenario)


@pytest.mark.parametrize("loss", [0.0, 0.3])
@pytest.mark.parametrize("cancel_after_s", [0.0, 0.01, 0.05, 0.1, 0.3, 0.6, 1.0, 2.0, 3.0])
def test_a_cancel_at_any_moment_leaves_the_old_or_the_new_plan_and_reports_which(
    run_simulated, cancel_after_s, loss
):
    async def scenario(rig):
        old, new = plan(5), plan(60, seed=4)
        await rig.mission.upload(old, PLAN)
        uploading = asyncio.ensure_future(rig.mission.upload(new, PlanReference("new", 1, "New")))
        await sleep(cancel_after_s)
        uploading.cancel()  # at 3 s without loss the upload is already finished
        await asyncio.wait([uploading])
        assert rig.mission.running_transfer is None
        completed = not uploading.cancelled()
        rig.autopilot.loss = 0.0
        downloaded = await rig.mission.download()
        assert bytes_of("mission", downloaded.items["mission"]) in (
            bytes_of("mission", old["mission"]),
            bytes_of("mission", new["mission"]),
        )
        has_old_plan = all(
            bytes_of(part, downloaded.items[part]) == bytes_of(part, old[part]) for part in PARTS
        )
        assert not (completed and has_old_plan)
        expected_state = "plan" if has_old_plan or completed else "not_known"
        assert (rig.mission.plan_on_vehicle(), rig.mission.items_on_vehicle.plan is not None) == (
            expected_state,
            expected_state == "plan",
        )

    run_with_rig(run_simulated, scenario, loss=loss, seed=int(cancel_after_s * 100) + 1)


def test_a_later_upload_by_another_station_is_detected_as_another_plan(run_simulated):
    async def scenario(rig):
        await rig.mission.upload(plan(4), PLAN)
        await UploadingStation(rig.autopilot).upload([waypoint(n) for n in range(3)])
        await sleep(2)
        assert rig.mission.plan_on_vehicle() == "another"
        downloaded = await rig.mission.download()
        assert (len(downloaded.items["mission"]), downloaded.plan, rig.mission.plan_on_vehicle()) == (
            3,
            None,
            "not_known",
        )
        await rig.mission.upload(plan(4), PLAN)
        assert rig.mission.plan_on_vehicle() == "plan"

    run_with_rig(run_simulated, scenario)


@pytest.mark.parametrize("other_after_s", [0.02, 0.1, 0.2, 0.4, 0.8, 1.2])
def test_messages_to_another_station_are_ignored_in_a_transfer(run_simulated, other_after_s):
    """PX4 accepts items from any station: the other station's items may replace those of the upload. Then the
    server reports another plan."""

    async def scenario(rig):
        uploaded, other_items = plan(12, seed=5), [waypoint(n) for n in range(8)]
        uploading = asyncio.ensure_future(rig.mission.upload(uploaded, PLAN))
        await sleep(other_after_s)
        await UploadingStation(rig.autopilot).upload(other_items)
        result = (await asyncio.gather(uploading, return_exceptions=True))[0]
        assert isinstance(result, GcsError) or result.items_on_vehicle.plan == PLAN
        await sleep(2)
        server_knows_plan = rig.mission.plan_on_vehicle() == "plan"
        downloaded = await rig.mission.download()
        has_uploaded_plan = bytes_of("mission", downloaded.items["mission"]) == bytes_of(
            "mission", uploaded["mission"]
        )
        assert server_knows_plan == has_uploaded_plan

    run_with_rig(run_simulated, scenario)


def test_an_upload_waits_for_a_busy_vehicle_and_fails_if_the_vehicle_stays_busy(run_simulated):
    async def scenario(rig):
        short_upload = asyncio.ensure_future(
            UploadingStation(rig.autopilot).upload([waypoint(n) for n in range(40)])
        )
        await sleep(0.3)
        await rig.mission.upload(plan(3), PLAN)
        await short_upload
        assert rig.mission.plan_on_vehicle() == "plan"
        long_upload = asyncio.ensure_future(
            UploadingStation(rig.autopilot).upload([waypoint(n) for n in range(60)], 0.5)
        )
        await sleep(1.1)
        with pytest.raises(Rejected, match="busy with another transfer"):
            await rig.mission.upload({**plan(3), "fence": square(5_000)}, PLAN)
        long_upload.cancel()

    run_with_rig(run_simulated, scenario)


def test_a_transfer_is_refused_until_another_transfer_has_ended(run_simulated):
    async def scenario(rig):
        first = asyncio.ensure_future(rig.mission.upload(plan(30), PLAN))
        await sleep(0.05)
        for second in (rig.mission.download(), rig.mission.clear(), rig.mission.upload(plan(2), PLAN)):
            with pytest.raises(Refused, match="is busy with"):
                await second
        await first
        await rig.mission.download()

    run_with_rig(run_simulated, scenario)


def test_a_vehicle_that_sends_no_mission_replies_is_reported(run_simulated):
    async def scenario(rig):
        rig.autopilot.receive = lambda _: None
        with pytest.raises(NoReply, match="did not answer for 8 s"):
            await rig.mission.download()
        with pytest.raises(NoReply, match="still has its previous items"):
            await rig.mission.upload(plan(3), PLAN)
        with pytest.raises(NoReply, match="clear the geofence"):
            await rig.mission.clear()

    run_with_rig(run_simulated, scenario)
