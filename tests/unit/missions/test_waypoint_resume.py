"""The item at which an interrupted flight of a plan resumes, and the settings that PX4 does not restore."""

import json

import pytest

from missions import plan as plan_document
from missions.checks import check
from missions.runner.reading import Reading
from missions.values import HomePosition
from missions.waypoints.monitor import WaypointMonitor
from missions.waypoints.resume import leg_start, remaining_plan, resume_after, resume_point

HOME = HomePosition(lat_deg=47.0, lon_deg=8.0, alt_amsl_m=500.0)
M_PER_DEG = 111_195  # of latitude


def item_at(kind, north_m, alt_m=30, **fields):
    altitude = {"value_m": alt_m, "reference": "home"}
    lat_deg = 47.0 + north_m / M_PER_DEG
    return {"kind": kind, "lat_deg": lat_deg, "lon_deg": 8.0, "altitude": altitude, **fields}


TAKE_OFF, RETURN = item_at("takeoff", 0), {"kind": "return_home"}
CRUISE_SPEED, CLIMB_SPEED = ({"kind": "change_speed", "speed_type": t, "speed_m_s": 4} for t in (1.0, 2.0))
PICTURES = {"kind": "trigger_distance", "distance_m": 10}
STOP_PICTURES = {"kind": "trigger_distance", "distance_m": 0}
LINE = [
    TAKE_OFF,
    CRUISE_SPEED,
    item_at("waypoint", 50),
    PICTURES,
    item_at("waypoint", 250),
    STOP_PICTURES,
    item_at("waypoint", 300),
    RETURN,
]


def plan_of(items, **more):
    return plan_document.read(json.dumps({"items": items, **more}))


def items_of(items):
    return [item for _, item in plan_of(items).simple_items()]


@pytest.mark.parametrize(
    ("flying_to", "resumes_at"),
    [(0, None), (1, None), (2, None), (3, 2), (4, 2), (5, 4), (6, 4), (7, 6)],
    ids=lambda value: str(value),
)
def test_an_interrupted_leg_is_flown_again_from_its_beginning(flying_to, resumes_at):
    assert leg_start(items_of(LINE), flying_to, 0) == resumes_at


def test_a_flight_that_was_started_at_an_item_does_not_resume_before_that_item():
    assert leg_start(items_of(LINE), 4, 4) == 4
    assert leg_start(items_of(LINE), 6, 4) == 4
    assert leg_start(items_of(LINE), 6, 2) == 4
    assert leg_start(items_of(LINE), 4, None) == 2


def test_a_region_of_interest_and_a_gate_do_not_begin_a_leg():
    items = [
        TAKE_OFF,
        item_at("waypoint", 50),
        item_at("roi_location", 90, 0),
        item_at("gate", 100),
        item_at("waypoint", 200),
        RETURN,
    ]
    assert leg_start(items_of(items), 4, 0) == 1


def test_the_next_waypoint_sets_the_altitude_of_the_flight_to_the_resume_point():
    items = [
        TAKE_OFF,
        item_at("waypoint", 50),
        CRUISE_SPEED,
        item_at("waypoint", 90, 55),
        item_at("waypoint", 120, 20),
    ]
    point = resume_point(plan_of(items), 2)
    assert (point.item, point.first.altitude.value_m) == (2, 55)


@pytest.mark.parametrize(
    "rest", [[RETURN], [item_at("land", 40, 0)], [CRUISE_SPEED, RETURN, item_at("waypoint", 9)], []]
)
def test_a_plan_without_a_waypoint_before_the_landing_has_no_resume_point(rest):
    items = [TAKE_OFF, item_at("waypoint", 50), *rest]
    assert resume_point(plan_of(items), 2) == "No waypoint follows."


def test_the_last_item_is_no_resume_point_because_px4_restarts_the_mission():
    assert "begins again" in resume_point(plan_of([TAKE_OFF, item_at("waypoint", 50)]), 1)


def test_an_interrupted_return_is_not_resumed():
    plan = plan_of(LINE)
    assert resume_after(plan, 6, 7) == "Only the return to home remains."
    assert resume_after(plan, 4, 6) == resume_point(plan, 4)


def settings_not_restored(*before, after=()):
    items = [TAKE_OFF, *before, item_at("waypoint", 50), item_at("waypoint", 90), *after, RETURN]
    return resume_point(plan_of(items), len(before) + 1).not_restored


def test_speed_gimbal_angles_camera_mode_and_trigger_are_restored_by_px4():
    gimbal = {"kind": "gimbal_pitch_yaw", "pitch_deg": -90}
    mode = {"kind": "camera_mode", "mode": 2}
    assert settings_not_restored(CRUISE_SPEED, gimbal, mode, PICTURES) == ()


def test_items_that_px4_does_not_repeat_are_listed():
    roi, video = item_at("roi_location", 20, 0), {"kind": "video_start"}
    (found,) = settings_not_restored(roi)
    assert found.startswith("PX4 does not repeat item 2: set the region of interest yourself")
    assert [each.split(":")[0][-6:] for each in settings_not_restored(roi, video, roi)] == [
        "item 3",
        "item 4",
    ]
    assert settings_not_restored(roi, {"kind": "roi_none"}, video, {"kind": "video_stop"}) == ()


def test_px4_repeats_only_the_last_speed_if_several_types_are_set():
    (found,) = settings_not_restored(CLIMB_SPEED, CRUISE_SPEED)
    assert found.startswith("PX4 does not repeat item 2: set the climb speed yourself")
    assert settings_not_restored(CLIMB_SPEED, CRUISE_SPEED, CLIMB_SPEED)[0].startswith(
        "PX4 does not repeat item 3: set the speed"
    )


def test_a_jump_is_listed_only_if_the_flight_resumes_inside_its_loop():
    jump = {"kind": "jump", "target_index": 1, "repeat": 3}
    (found,) = settings_not_restored(after=[jump])
    assert found.startswith("Item 4 repeats items from item 2 on.")
    assert settings_not_restored(after=[{**jump, "target_index": 2}]) == ()


def test_the_remaining_plan_is_checked_from_the_new_position_with_the_plans_item_numbers():
    corners = [(120, -1e-4), (130, -1e-4), (130, 1e-4), (120, 1e-4)]
    polygon = [{"lat_deg": 47.0 + n / M_PER_DEG, "lon_deg": 8.0 + e} for n, e in corners]
    tower = {"name": "Tower", "top": {"value_m": 90, "reference": "home"}, "polygon": polygon}
    plan = plan_of(
        [TAKE_OFF, item_at("waypoint", 50), item_at("waypoint", 90), item_at("waypoint", 100), RETURN],
        obstacles=[tower],
    )
    for north_m, messages in (
        (0, []),
        (300, ["The straight path to item 3 (waypoint) passes through Tower."]),
    ):
        start = HOME.model_copy(update={"lat_deg": 47.0 + north_m / M_PER_DEG})
        findings = [each for each in check(remaining_plan(plan, 2, start)) if each.code == "obstacle_hit"]
        assert [each.message for each in findings if "home" not in each.message] == messages


def leg_start_after(monitor, item, mode="mission"):
    monitor.update(0.0, Reading(mode=mode, armed=True, landed="in_air"), item, None)
    return monitor.leg_start


def test_a_monitored_flight_keeps_the_leg_that_it_was_flying_when_the_mode_changed():
    monitor = WaypointMonitor(plan_of(LINE), None, from_start=True)
    assert leg_start_after(monitor, 0) is None
    assert leg_start_after(monitor, 4) == 2
    assert leg_start_after(monitor, 5, mode="rtl") == 2


def test_a_flight_that_px4_restarts_at_its_first_item_resumes_from_there():
    monitor = WaypointMonitor(plan_of(LINE), None, from_start=True)
    assert leg_start_after(monitor, 7) == 7
    leg_start_after(monitor, 0)
    assert leg_start_after(monitor, 4) == 2
