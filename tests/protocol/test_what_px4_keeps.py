"""Plans are uploaded to a vehicle that stores, returns and rejects them as a real PX4 does."""

import pytest
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st

from gcs_server.errors import Rejected
from gcs_server.scenarios.simulated_time import run_on_simulated_time
from missions.checks import check
from missions.items import CommandItem, Delay, Jump, Land, LoiterTime, PlacedItem, Takeoff, Waypoint
from missions.plan import TYPED_ITEMS, Plan
from missions.values import Altitude, FenceCircle, FencePolygon, Point, RallyPoint
from tests.protocol.px4_plan_store import ACCEPTED, HOME, REFERENCE, items_of, run_with_px4
from tests.support.plan_strategies import PARAMS, float32, float32_numbers

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


# --- any plan -------------------------------------------------------------------------------------------

HEIGHTS_M = float32_numbers(0.5, 110.0)
ALTITUDES = st.builds(Altitude, value_m=HEIGHTS_M, reference=st.just("home")) | st.builds(
    Altitude, value_m=HEIGHTS_M.map(lambda m: float32(m + HOME.alt_amsl_m)), reference=st.just("amsl")
)
NEAR_HOME = st.builds(corner, st.integers(-40_000, 40_000), st.integers(-40_000, 40_000))
ANY_NUMBER = st.none() | st.sampled_from([-1.0, 0.0, 0.4, 1.0, 3.0, 90.0, -90.0, 720.0]) | PARAMS
WIDE_FENCE = FenceCircle(inclusion=True, center=corner(0, 0), radius_m=900.0)
FAR_ZONES = st.builds(
    FenceCircle,
    inclusion=st.just(False),
    center=st.just(corner(70_000, 0)),
    radius_m=float32_numbers(0.5, 90),
) | st.builds(
    lambda east: FencePolygon(
        inclusion=False, polygon=(corner(60_000, 0), corner(60_000, 100 + east), corner(61_000, 0))
    ),
    st.integers(0, 5_000),
)
RALLY_POINTS = st.builds(
    lambda place, altitude: RallyPoint(lat_deg=place.lat_deg, lon_deg=place.lon_deg, altitude=altitude),
    NEAR_HOME,
    ALTITUDES,
)
RAW_ITEMS = st.builds(
    lambda command, params, place: CommandItem(
        command=command, frame=6 if command < 92 else 2,
        params=(*params, *((place.lat_deg, place.lon_deg, 20.0) if command < 92 else (0.0, 0.0, 0.0))),
    ),
    st.sampled_from([16, 17, 19, 31, 80, 84, 112, 178, 201, 206, 530, 531, 2000, 2501, 3000, 5000]),
    st.tuples(*[ANY_NUMBER] * 4),
    NEAR_HOME,
)  # fmt: skip


@st.composite
def any_items(draw):
    """An item of any type near home, with usual and unusual values."""
    item_class = draw(st.sampled_from([*TYPED_ITEMS, Waypoint, Waypoint, LoiterTime, Land]))
    fields = {"autocontinue": True}
    for number, slot in enumerate(item_class.SLOTS, start=1):
        if isinstance(slot, str) and item_class.model_fields[slot].annotation is int:
            fields[slot] = draw(st.integers(0, 3))
        elif isinstance(slot, str):
            fields[slot] = draw(st.integers(-9, 9).map(float) if number in (5, 6) else ANY_NUMBER)
    if issubclass(item_class, PlacedItem):
        place = draw(NEAR_HOME)
        fields |= {"lat_deg": place.lat_deg, "lon_deg": place.lon_deg, "altitude": draw(ALTITUDES)}
    return item_class(**fields)


FIRST_ITEMS = st.sampled_from(
    [(at(Takeoff, 0),), (at(Takeoff, 0, 2.0),), (Delay(delay_s=3.0), at(Takeoff, 0)), ()]
)
PLANS = st.builds(
    lambda first, items, zones, rally: Plan(
        planned_home=HOME, items=(*first, *items), fence=(WIDE_FENCE, *zones), rally_points=tuple(rally)
    ),
    FIRST_ITEMS,
    st.lists(any_items() | RAW_ITEMS, max_size=4),
    st.lists(FAR_ZONES, max_size=2),
    st.lists(RALLY_POINTS, max_size=2),
)


def uploaded_and_held(plan, loss, seed):
    async def scenario(rig):
        await rig.mission.upload(items_of(plan), REFERENCE)
        assert rig.mission.plan_on_vehicle() == "plan"
        assert rig.px4.results.count(ACCEPTED) == len(rig.px4.results)
        assert (await rig.mission.download()).plan == REFERENCE

    run_with_px4(run_on_simulated_time, scenario, loss=loss, seed=seed)


def errors_of(plan):
    return [each.code for each in check(plan) if each.severity == "error"]


@pytest.mark.parametrize("loss", [0.0, 0.2])
@settings(
    max_examples=15,
    phases=(Phase.explicit, Phase.generate),
    suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow],
)
@given(plan=PLANS, seed=st.integers(0, 99))
def test_any_plan_that_the_checks_pass_is_accepted_and_held(loss, plan, seed):
    assume(not errors_of(plan))
    uploaded_and_held(plan, loss, seed)


@pytest.mark.broad
@pytest.mark.parametrize("loss", [0.0, 0.2])
@settings(max_examples=100, suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow])
@given(plan=PLANS, seed=st.integers(0, 9999))
def test_many_plans_that_the_checks_pass_are_accepted_and_held(loss, plan, seed):
    assume(not errors_of(plan))
    uploaded_and_held(plan, loss, seed)


@settings(max_examples=20)
@given(item=any_items() | RAW_ITEMS)
def test_an_item_that_the_checks_refuse_is_refused_by_px4_too(item):
    """But for items that PX4 accepts although they are unsafe."""
    plan = Plan(planned_home=HOME, items=(at(Takeoff, 0), item))
    assume({"command_refused", "value_refused", "vtol_item"} & set(errors_of(plan)))

    async def scenario(rig):
        with pytest.raises(Rejected):
            await rig.mission.upload(items_of(plan), REFERENCE)

    run_with_px4(run_on_simulated_time, scenario)
