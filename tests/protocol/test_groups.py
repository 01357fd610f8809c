"""Several vehicles as one group: they begin together or not at all, are kept apart, and stop in one call."""

import asyncio
import itertools
import math
import random
from types import SimpleNamespace

import pytest

from gcs_server.api import group_models, group_routes, offboard_routes, vehicle_routes
from gcs_server.api import offboard_models as models
from gcs_server.control.client import Client
from gcs_server.errors import InvalidRequest, NotInControl, NotTogether, Refused, UnknownGroup, UnknownVehicle
from tests.protocol.conftest import HOLD, OFFBOARD
from tests.protocol.offboard_world import POSITION, OffboardWorld, asks, seconds
from tests.protocol.simulated_world import SimulatedWorld, until
from tests.protocol.test_authority import view
from tests.protocol.test_dangerous_calls import lines, station_of

ANNA, BOB = Client.of("anna", "anna's tab"), Client.of("bob", "bob's tab")
DEG_M = math.radians(1) * 6_371_000.0
STREAM_PERIOD_S = 0.02


def desk(jump, story, *, count=3, spacing_m=10.0):
    """Vehicles 1, 2, … in a row to the east, in the air, each at its own local origin."""

    async def run():
        world = OffboardWorld()
        pilots = {}
        for index in range(count):
            pilot = world.offboard_pilot(
                world.link(f"link{index}"), peer=f"peer{index}", system=index + 1, uid=index + 1, seed=index
            )
            pilot.home = (47.0, 8.0 + index * spacing_m / (DEG_M * math.cos(math.radians(47.0))), 489.0)
            pilot.position = list(pilot.home)
            pilot.fly()
            pilots[str(index + 1)] = pilot
        told = []
        world.streamer.groups.tell = lambda text, status, warning: told.append((text, status.state, warning))
        try:
            for vehicle_id in pilots:
                await world.ready(vehicle_id)
            await seconds(2.5)
            station = station_of(world)
            vehicles = {v: world.fleet.get(v) for v in pilots}
            await story(
                SimpleNamespace(world=world, station=station, pilots=pilots, vehicles=vehicles, told=told)
            )
        finally:
            await world.close()

    jump(run)


def place(north_m=0.0, east_m=0.0, down_m=-5.0):
    return {"type": "position", "position_ned_m": [north_m, east_m, down_m]}


def velocity(north_m_s=0.0, east_m_s=0.0):
    return {"type": "velocity", "velocity_ned_m_s": [north_m_s, east_m_s, 0.0]}


def path(*points):
    return {"type": "path", "points": [{"t_s": t, "position_ned_m": at} for t, at in points]}


def body(setpoints, **more):
    members = [{"vehicle": v, "setpoint": s} for v, s in setpoints.items()]
    return group_models.StartGroup.model_validate({"members": members, "valid_for_s": 60, **more})


def changes(setpoints, **more):
    members = [{"vehicle": v, "setpoint": s} for v, s in setpoints.items()]
    return group_models.GroupSetpoints.model_validate({"setpoints": members, "valid_for_s": 60, **more})


async def begin(at, setpoints, client=ANNA, **more):
    return view(await group_routes.start(body(setpoints, **more), at.station, client))


def first_s(pilot, north_m):
    """When a setpoint for that place was first heard."""
    return next(t for t, m in pilot.setpoints if abs(m.x - north_m) < 0.01)


def modes(at):
    return {v: pilot.mode for v, pilot in at.pilots.items()}


ALL_NORTH = {"1": place(4), "2": place(4), "3": place(4)}


# --- starting -------------------------------------------------------------------------------------


def test_all_are_brought_into_offboard_first_and_then_begin_within_one_period(jump):
    async def story(at):
        at.pilots["2"].take_offboard_after_s = 1.4
        started = await begin(at, ALL_NORTH)
        assert started["state"] == "waiting"
        assert set(modes(at).values()) == {OFFBOARD}
        assert not [m for p in at.pilots.values() for _, m in p.setpoints if m.x != 0]
        ahead_s = started["start_unix_s"] - at.world.clock.unix_s()
        assert 0.3 < ahead_s <= 0.5
        instant_s = at.world.loop.time() + ahead_s
        await seconds(2.0)
        begun = [first_s(pilot, 4.0) for pilot in at.pilots.values()]
        assert max(begun) - min(begun) < STREAM_PERIOD_S
        assert min(begun) == pytest.approx(instant_s, abs=STREAM_PERIOD_S)
        shown = view(await group_routes.show("1", at.station))
        assert (shown["state"], [m["mode"] for m in shown["members"]]) == ("flying", ["offboard"] * 3)
        assert shown["nearest"]["distance_m"] == pytest.approx(10.0, abs=0.1)
        assert 57 < shown["valid_left_s"] < 60
        assert [state for _, state, _ in at.told] == ["starting", "waiting", "flying"]
        assert lines(at.station)[-3:] == [("anna", "group/start", v, "ok") for v in "321"]

    desk(jump, story)


def test_the_instant_can_be_named(jump):
    async def story(at):
        unix_s = at.world.clock.unix_s()
        instant_s = at.world.loop.time() + 8.0
        started = await begin(at, ALL_NORTH, start_at_unix_s=unix_s + 8.0)
        assert started["start_unix_s"] == pytest.approx(unix_s + 8.0, abs=1e-3)
        await seconds(10.0)
        begun = [first_s(pilot, 4.0) for pilot in at.pilots.values()]
        assert max(begun) - min(begun) < STREAM_PERIOD_S
        assert min(begun) == pytest.approx(instant_s, abs=STREAM_PERIOD_S)

    desk(jump, story)


@pytest.mark.parametrize("ahead_s", [-5.0, 1.0, 400.0])
def test_an_instant_that_cannot_be_is_refused(jump, ahead_s):
    async def story(at):
        with pytest.raises(InvalidRequest, match="must be 3 to 300 s ahead") as refused:
            await begin(at, ALL_NORTH, start_at_unix_s=at.world.clock.unix_s() + ahead_s)
        assert refused.value.field == "start_at_unix_s"
        assert not any(asks(p, OFFBOARD) for p in at.pilots.values())

    desk(jump, story)


def test_an_instant_that_passed_before_all_were_confirmed_moves_nobody(jump):
    async def story(at):
        at.pilots["3"].take_offboard_after_s = 3.0
        with pytest.raises(InvalidRequest, match="still ahead when all are in Offboard"):
            await begin(at, ALL_NORTH, start_at_unix_s=at.world.clock.unix_s() + 3.1)
        await seconds(3)
        assert set(modes(at).values()) == {HOLD}
        nobody_moved(at)

    desk(jump, story)


def nobody_moved(at):
    assert not [m for p in at.pilots.values() for _, m in p.setpoints if abs(m.x) > 0.01]


def test_one_that_refuses_stops_all_and_is_named_with_its_reason(jump):
    async def story(at):
        at.pilots["2"].has_stream = lambda: False  # it refuses Offboard
        with pytest.raises(NotTogether, match=r"so none moves\. Vehicle 2: ") as refused:
            await begin(at, ALL_NORTH)
        assert refused.value.vehicles == ("2",)
        await seconds(3)
        assert set(modes(at).values()) == {HOLD}
        nobody_moved(at)
        assert not any(v.offboard.status().streaming for v in at.vehicles.values())
        ended = view(await group_routes.show("1", at.station))
        assert ended["state"] == "ended"
        assert "Vehicle 2" in ended["ended"]
        assert lines(at.station)[-1][1:] == ("group/start", "1", "not_together")

    desk(jump, story)


def test_one_that_never_confirms_stops_all(jump):
    async def story(at):
        at.pilots["3"].take_offboard_after_s = 30.0
        with pytest.raises(NotTogether, match="Vehicle 3: "):
            await begin(at, ALL_NORTH)
        await seconds(3)
        assert (at.pilots["1"].mode, at.pilots["2"].mode) == (HOLD, HOLD)
        nobody_moved(at)

    desk(jump, story)


def test_what_one_cannot_fly_is_refused_before_anything_is_sent(jump):
    async def story(at):
        with pytest.raises(NotTogether, match=r"Vehicle 2: The path begins 30\.0 m away"):
            far = path((0, [30, 0, -5]), (5, [35, 0, -5]))
            await begin(at, {"1": place(4), "2": far})
        at.pilots["1"].estimates = False
        await seconds(1.5)
        with pytest.raises(NotTogether, match="Vehicle 1: "):
            await begin(at, ALL_NORTH)
        at.pilots["1"].estimates = True
        at.pilots["3"].armed, at.pilots["3"].landed = False, 1
        await seconds(2.5)
        with pytest.raises(NotTogether, match="Vehicle 3 is not in the air"):
            await begin(at, ALL_NORTH)
        with pytest.raises(UnknownVehicle):
            await begin(at, {"1": place(), "9": place()})
        with pytest.raises(UnknownGroup, match="no group '7'"):
            await group_routes.show("7", at.station)
        assert not any(asks(p, OFFBOARD) for p in at.pilots.values())

    desk(jump, story)


def test_a_vehicle_that_flies_offboard_or_in_a_group_already_is_named_and_left_alone(jump):
    async def story(at):
        alone = models.StartRequest.model_validate({"setpoint": place(1), "valid_for_s": 60})
        await offboard_routes.start("3", alone, at.station, ANNA)
        with pytest.raises(NotTogether, match="Vehicle 3 is streamed to already"):
            await begin(at, ALL_NORTH)
        assert at.vehicles["3"].offboard.status().state == "streaming"
        await begin(at, {"1": place(4), "2": place(4)})
        with pytest.raises(NotTogether, match="Vehicle 2 flies in group 1 already"):
            await begin(at, {"2": place(4), "3": place(4)})
        await seconds(1)
        assert set(modes(at).values()) == {OFFBOARD}

    desk(jump, story)


def test_the_lease_of_another_refuses_all_takes_none_and_names_whom(jump):
    async def story(at):
        await vehicle_routes.hold("2", at.station, BOB)  # open to all: takes nothing
        at.station.authority.control("2").lease.take(BOB)
        with pytest.raises(NotInControl, match="bob has control of vehicle 2, not you"):
            await begin(at, ALL_NORTH)
        assert not at.station.authority.held_by(ANNA)
        assert not any(asks(p, OFFBOARD) for p in at.pilots.values())
        assert lines(at.station)[-3:] == [("anna", "group/start", v, "not_in_control") for v in "123"]
        at.station.authority.control("2").lease.release(BOB)
        await begin(at, ALL_NORTH)
        assert at.station.authority.held_by(ANNA) == ["1", "2", "3"]
        with pytest.raises(NotInControl, match="anna has control of vehicle 1"):
            await group_routes.setpoints("1", changes({"1": place(5)}), at.station, BOB)
        held = view(await group_routes.hold("1", at.station, BOB))
        assert (held["state"], held["ended"]) == ("ended", "bob commanded Hold.")
        assert set(modes(at).values()) == {HOLD}
        assert lines(at.station)[-3:] == [("bob", "hold", v, "ok") for v in "321"]

    desk(jump, story)


def test_two_that_are_too_near_or_would_come_are_refused_in_words(jump):
    async def story(at):
        with pytest.raises(NotTogether, match=r"Vehicles 1 and 2 are 10.0 m apart now") as refused:
            await begin(at, ALL_NORTH, minimum_separation_m=12)
        assert refused.value.distance_m == pytest.approx(10.0, abs=0.1)
        with pytest.raises(NotTogether, match=r"vehicles 1 and 2 would come within .* m of each other"):
            await begin(at, {"1": place(0, 9), "2": place(0, 0)})
        crossing = {  # 2 flies to where 1 will be, both in time
            "1": path((0, [0, 0, -5]), (10, [20, 10, -5])),
            "2": path((0, [0, 0, -5]), (10, [20, 0, -5])),
        }
        with pytest.raises(NotTogether, match="vehicles 1 and 2 would come within") as refused:
            await begin(at, crossing, minimum_separation_m=4)
        assert refused.value.vehicles == ("1", "2")
        assert not any(asks(p, OFFBOARD) for p in at.pilots.values())
        await begin(at, {"1": path((0, [0, 0, -5]), (10, [20, 0, -5])), "2": place(20)})

    desk(jump, story)


# --- flying ---------------------------------------------------------------------------------------


def test_setpoints_of_several_change_in_one_round_and_all_expire_together(jump):
    async def story(at):
        await begin(at, {"1": place(4), "2": path((0, [0, 0, -5]), (6, [6, 0, -5])), "3": place(4)})
        await seconds(1)
        changed = changes({"1": place(7), "3": place(7)}, valid_for_s=2.0)
        shown = view(await group_routes.setpoints("1", changed, at.station, ANNA))
        assert shown["valid_left_s"] == pytest.approx(2.0 + 5.5, abs=0.2)  # the path goes on to its end
        await seconds(0.1)
        begun = [first_s(at.pilots[v], 7.0) for v in "13"]
        assert max(begun) - min(begun) < STREAM_PERIOD_S
        with pytest.raises(NotTogether, match="would come within"):
            closer = changes({"1": place(0, 8)})
            await group_routes.setpoints("1", closer, at.station, ANNA)
        with pytest.raises(InvalidRequest, match="vehicle 9 is not in group 1"):
            await group_routes.setpoints("1", changes({"9": place()}), at.station, ANNA)
        await seconds(6.0)
        assert view(await group_routes.show("1", at.station))["state"] == "flying"
        await seconds(8.5)
        assert set(modes(at).values()) == {HOLD}
        ended = view(await group_routes.show("1", at.station))
        assert (ended["ended"], ended["findings"]) == ("Its setpoints expired.", [])
        with pytest.raises(Refused, match="is ended: it takes no setpoints"):
            await group_routes.setpoints("1", changed, at.station, ANNA)

    desk(jump, story)


def test_an_empty_list_renews_all_from_now_on(jump):
    async def story(at):
        await begin(at, ALL_NORTH, valid_for_s=3.0)
        for _ in range(3):
            await seconds(2)
            shown = view(await group_routes.setpoints("1", changes({}, valid_for_s=3.0), at.station, ANNA))
            assert shown["valid_left_s"] == pytest.approx(3.0, abs=0.1)
        assert view(await group_routes.show("1", at.station))["state"] == "flying"
        await seconds(12.0)
        ended = view(await group_routes.show("1", at.station))
        assert (ended["ended"], ended["findings"]) == ("Its setpoints expired.", [])

    desk(jump, story)


@pytest.mark.parametrize("others_go_on", [False, True])
def test_a_member_that_leaves_offboard_holds_the_others_unless_they_go_on(jump, others_go_on):
    async def story(at):
        await begin(at, ALL_NORTH, others_go_on=others_go_on)
        await seconds(1)
        at.pilots["2"].mode = at.pilots["2"].asked_mode = POSITION  # its pilot
        at.pilots["2"].current_mode()
        await seconds(7.5)  # a mode asked for lately is waited for
        others = OFFBOARD if others_go_on else HOLD
        assert modes(at) == {"1": others, "2": POSITION, "3": others}
        shown = view(await group_routes.show("1", at.station))
        assert shown["state"] == ("flying" if others_go_on else "ended")
        finding = shown["findings"][0]
        assert (finding["code"], finding["vehicles"]) == ("left", ["2"])
        assert finding["held"] == ([] if others_go_on else ["1", "3"]), "2 flies as its pilot wants"
        assert "Vehicle 2 flies the group's setpoints no more: The vehicle left Offboard" in finding["text"]
        assert [text for text, _, warning in at.told if warning]
        if others_go_on:
            with pytest.raises(Refused, match="Vehicle 2 is held and follows group 1 no more"):
                await group_routes.setpoints("1", changes({"2": place(5)}), at.station, ANNA)

    desk(jump, story)


def test_a_member_that_is_lost_holds_the_others_within_two_seconds(jump):
    async def story(at):
        await begin(at, {"1": velocity(1), "2": velocity(1), "3": velocity(1)})
        await seconds(2)
        at.pilots["3"].alive = False
        await seconds(2.0)
        shown = view(await group_routes.show("1", at.station))
        assert shown["findings"][0]["code"] == "place_unknown"
        assert "The place of vehicle 3 is not known" in shown["findings"][0]["text"]
        last = {v: at.pilots[v].setpoints[-1][1] for v in "12"}
        assert all(m.type_mask & 7 == 0 for m in last.values())  # places: they stand
        await seconds(8)
        assert (at.pilots["1"].mode, at.pilots["2"].mode) == (HOLD, HOLD)

    desk(jump, story)


def test_trouble_before_the_instant_moves_nobody(jump):
    async def story(at):
        started = asyncio.ensure_future(
            group_routes.start(
                body(ALL_NORTH, start_at_unix_s=at.world.clock.unix_s() + 6.0, others_go_on=True),
                at.station,
                ANNA,
            )
        )
        await started
        at.pilots["1"].mode = at.pilots["1"].asked_mode = POSITION
        at.pilots["1"].current_mode()
        await seconds(12)
        assert modes(at) == {"1": POSITION, "2": HOLD, "3": HOLD}
        nobody_moved(at)

    desk(jump, story)


def test_held_before_the_instant_nobody_begins(jump):
    async def story(at):
        await begin(at, ALL_NORTH, start_at_unix_s=at.world.clock.unix_s() + 6.0)
        await group_routes.hold("1", at.station, ANNA)
        await seconds(8)
        assert set(modes(at).values()) == {HOLD}
        nobody_moved(at)
        assert view(await group_routes.show("1", at.station))["findings"] == []

    desk(jump, story)


def test_a_member_steered_alone_before_the_instant_moves_nobody(jump):
    async def story(at):
        await begin(at, ALL_NORTH, start_at_unix_s=at.world.clock.unix_s() + 6.0)
        alone = models.PositionOrder.model_validate({**place(0, 0, -6), "valid_for_s": 60})
        at.vehicles["1"].offboard.setpoint(alone.to_order("anna"))
        await seconds(12)
        assert set(modes(at).values()) == {HOLD}
        nobody_moved(at)
        finding = view(await group_routes.show("1", at.station))["findings"][0]
        assert "Vehicle 1 was given another setpoint before the common start" in finding["text"]

    desk(jump, story)


def test_a_member_can_follow_another_of_the_group(jump):
    async def story(at):
        beside = {"type": "follow", "vehicle": "1", "offset_ned_m": [0, 10, 0]}
        await begin(at, {"1": place(4), "2": beside})
        await seconds(2)
        shown = view(await group_routes.show("1", at.station))
        assert [m["ordered_type"] for m in shown["members"]] == ["position", "follow"]
        assert shown["state"] == "flying"
        last = at.pilots["2"].setpoints[-1][1]
        assert (last.x, last.y) == (pytest.approx(0, abs=0.2), pytest.approx(0, abs=0.2))
        nearer = {"type": "follow", "vehicle": "1", "offset_ned_m": [0, 3, 0]}
        with pytest.raises(NotTogether, match="would come within"):
            await group_routes.setpoints("1", changes({"2": nearer}), at.station, ANNA)

    desk(jump, story, count=2)


def test_the_end_of_the_server_holds_a_group_without_findings(jump):
    async def story(at):
        await begin(at, ALL_NORTH)
        await seconds(1)
        stopped = await at.world.streamer.stop_all()
        assert [s.error for s in stopped] == [None] * 3
        assert set(modes(at).values()) == {HOLD}
        await seconds(0.3)
        shown = view(await group_routes.show("1", at.station))
        assert (shown["ended"], shown["findings"]) == ("The server ended.", [])

    desk(jump, story)


@pytest.mark.parametrize("seed", range(3))
def test_with_every_fifth_packet_lost_a_group_begins_changes_and_is_held(jump, seed):
    async def story(at):
        for index, pilot in enumerate(at.pilots.values()):
            pilot.loss, pilot.random = 0.2, random.Random(seed * 10 + index)
        await begin(at, ALL_NORTH)
        await seconds(2)
        begun = [next(t for t, m in p.setpoints if m.x > 1) for p in at.pilots.values()]
        assert max(begun) - min(begun) < 10 * STREAM_PERIOD_S  # a first one may be lost on the way
        await group_routes.setpoints("1", changes({"1": place(6)}), at.station, ANNA)
        held = view(await group_routes.hold("1", at.station, ANNA))
        assert (held["state"], held["findings"]) == ("ended", [])
        assert set(modes(at).values()) == {HOLD}
        assert sum(pilot.failsafes for pilot in at.pilots.values()) == 0

    desk(jump, story)


@pytest.mark.parametrize(("stall_s", "code"), [(0.4, None), (1.2, "place_unknown")])
def test_a_loop_that_stalls_does_not_blind_the_guard_and_after_a_second_all_hold(jump, stall_s, code):
    async def story(at):
        await begin(at, {"1": velocity(1), "2": velocity(1), "3": velocity(1)})
        await seconds(8)
        streamer = at.world.streamer
        streamer.beat_once = lambda: None
        await seconds(stall_s)
        del streamer.beat_once
        await seconds(3)
        findings = view(await group_routes.show("1", at.station))["findings"]
        assert [finding["code"] for finding in findings] == ([] if code is None else [code])
        assert set(modes(at).values()) == ({OFFBOARD} if code is None else {HOLD})

    desk(jump, story)


def test_a_killed_client_leaves_all_in_hold(jump):
    async def story(at):
        await begin(at, {"1": velocity(1), "2": velocity(1)}, valid_for_s=1.0)
        await seconds(9)
        assert (at.pilots["1"].mode, at.pilots["2"].mode) == (HOLD, HOLD)
        assert view(await group_routes.show("1", at.station))["ended"] == "Its setpoints expired."

    desk(jump, story)


# --- simulated PX4s -------------------------------------------------------------------------------


def on_earth(vehicle):
    at = vehicle.topic("global_position").value
    return (
        at.lat_deg * DEG_M,
        at.lon_deg * DEG_M * math.cos(math.radians(at.lat_deg)),
        -at.alt_amsl_m,
    )


def apart_m(vehicles):
    return min(math.dist(on_earth(a), on_earth(b)) for a, b in itertools.combinations(vehicles, 2))


def sky(jump, story, count=2):
    async def run():
        world = SimulatedWorld(count)
        try:
            ids = [str(i + 1) for i in range(count)]
            async with asyncio.TaskGroup() as tasks:
                flying = [tasks.create_task(world.in_the_air(v, 8.0)) for v in ids]
            await story(SimpleNamespace(world=world, station=station_of(world)), [f.result() for f in flying])
        finally:
            await world.close()

    jump(run)


def test_simulated_vehicles_spread_hold_in_one_call_and_are_stopped_head_on_above_the_minimum(jump):
    async def story(at, vehicles):
        await begin(at, {"1": place(0, -10, -8), "2": place(0, 10, -8)}, minimum_separation_m=2)
        await until(lambda: apart_m(vehicles) > 22, 30)
        held = view(await group_routes.hold("1", at.station, ANNA))
        assert (held["state"], held["findings"]) == ("ended", [])
        assert {v.status.mode for v in vehicles} == {"hold"}

        stay = {"type": "position_body", "offset_frd_m": [0, 0, 0]}
        await begin(at, {"1": stay, "2": stay}, minimum_separation_m=5)
        await seconds(1)
        for vehicle, towards in zip(vehicles, (5.0, -5.0), strict=True):
            # each by itself: past the group's look ahead, so that only the guard of the flight can know
            order = models.VelocityOrder.model_validate({**velocity(0, towards), "valid_for_s": 60})
            vehicle.offboard.setpoint(order.to_order("anna"))
        nearest_m, fastest_m_s = math.inf, 0.0
        for _ in range(120):
            await seconds(0.1)
            nearest_m = min(nearest_m, apart_m(vehicles))
            now = [math.hypot(*v.topic("local_position").value.velocity_ned_m_s) for v in vehicles]
            fastest_m_s = max(fastest_m_s, *now)
            if {v.status.mode for v in vehicles} == {"hold"} and max(now) < 0.2:
                break
        assert {v.status.mode for v in vehicles} == {"hold"}
        assert fastest_m_s > 2.0
        assert 5.0 < nearest_m < 15.0
        finding = view(await group_routes.show("2", at.station))["findings"][0]
        assert (finding["code"], finding["vehicles"]) == ("separation", ["1", "2"])
        assert finding["held"] == ["1", "2"]
        assert finding["distance_m"] > nearest_m
        said = [event.text for event in vehicles[0].events.since() if event.kind == "warning"]
        assert any("Vehicles 1 and 2 are" in text and "asking for Hold mode" in text for text in said)

    sky(jump, story)
