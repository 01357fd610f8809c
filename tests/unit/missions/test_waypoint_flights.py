"""The waypoint monitor compares a flight with the planned path: progress, deviation, corridor and states. The
tests replace the vehicle by readings."""

import json
import math

import pytest

from missions import plan as plan_document
from missions.estimates import estimate
from missions.geodesy import LocalOrigin
from missions.runner.corridor import Corridor
from missions.runner.reading import Reading
from missions.values import HomePosition
from missions.vehicle import VehicleModel
from missions.waypoints.monitor import WaypointMonitor
from missions.waypoints.planned import estimate_passes, planned_by_dry_run

ORIGIN = LocalOrigin(47.0, 8.0, 500.0)
HOME = HomePosition(lat_deg=47.0, lon_deg=8.0, alt_amsl_m=500.0)
VEHICLE = VehicleModel()


def item_at(kind, north_m, east_m, alt_m, **fields):
    lat, lon, _ = ORIGIN.to_geodetic((north_m, east_m, 0.0))
    altitude = {"value_m": alt_m, "reference": "home"}
    return {"kind": kind, "lat_deg": lat, "lon_deg": lon, "altitude": altitude, **fields}


TAKE_OFF = item_at("takeoff", 0, 0, 10)
LAND = item_at("land", 40, 40, 0)
SQUARE = [TAKE_OFF, item_at("waypoint", 40, 0, 10), item_at("waypoint", 40, 40, 10, hold_s=5), LAND]
LOOP = [
    TAKE_OFF,
    item_at("waypoint", 40, 0, 10),
    item_at("waypoint", 40, 40, 10),
    {"kind": "jump", "target_index": 1, "repeat": 1},
    LAND,
]


def plan_of(items):
    return plan_document.read(json.dumps({"items": items}))


def planned_passes(items):
    path = estimate_passes(plan_of(items), VEHICLE, HOME, ORIGIN)
    assert path is not None
    return path


class MonitoredFlight:
    """A waypoint monitor at 10 Hz; `codes` has the codes of its notices."""

    def __init__(self, items=SQUARE, **changes):
        options = {"planned": planned_passes(items), "from_start": True, **changes}
        self.monitor = WaypointMonitor(plan_of(items), options.pop("planned"), **options)
        self.now_s = 0.0
        self.codes = []

    def observe(
        self, item, position_ned_m, seconds=1.0, *, mode="mission", source=None, reached=None, armed=True
    ):
        reading = Reading(
            mode=mode, mode_source=source, mode_text="The RC pilot", armed=armed, landed="in_air",
            position_ned_m=position_ned_m,
        )  # fmt: skip
        for _ in range(round(seconds * 10)):
            notices = self.monitor.update(self.now_s, reading, item, reached)
            self.codes += [each.code for each in notices]
            self.now_s += 0.1
        return self.monitor


def test_the_plan_gives_the_path_and_the_time_of_each_item():
    path = planned_passes(SQUARE)
    assert [each.leg.place for each in path.passes] == ["item 1", "item 2", "item 3", "item 4"]
    plan_with_home = plan_of(SQUARE).model_copy(update={"planned_home": HOME})
    assert path.duration_s == pytest.approx(estimate(plan_with_home, VEHICLE).time_s)
    third_leg = path.passes[2].leg
    assert third_leg.points[-1][0] - third_leg.points[-2][0] == 5.0, "no hold at the waypoint"
    assert third_leg.points[-1][1:] == pytest.approx((40.0, 40.0, -10.0), abs=0.01)
    landing = path.passes[3].leg.points
    assert [point[3] for point in landing] == pytest.approx([-10.0, -10.0, 0.0], abs=0.01)
    assert path.planned_flight().length_m == pytest.approx(10 + 40 + 40 + 10, abs=0.1)


def test_each_execution_of_a_repeated_item_has_its_own_path():
    distant = item_at("waypoint", 40, 80, 10)
    repeated = [
        TAKE_OFF,
        SQUARE[1],
        distant,
        {"kind": "jump", "target_index": 1, "repeat": 1},
        item_at("land", 40, 80, 0),
    ]
    plan_with_home = plan_of(repeated).model_copy(update={"planned_home": HOME})
    assert estimate(plan_with_home, VEHICLE).length_m == pytest.approx(10 + 40 + 80 + 80 + 80 + 10, abs=0.2)
    path = planned_passes(repeated)
    assert path.planned_flight().length_m == pytest.approx(300, abs=0.2)
    assert path.passes[3].leg.duration_s > path.passes[1].leg.duration_s + 5


def test_an_endless_plan_has_no_duration_and_a_return_is_not_compared():
    endless = [TAKE_OFF, item_at("waypoint", 40, 0, 10), {"kind": "jump", "target_index": 1, "repeat": -1}]
    assert planned_passes(endless).duration_s is None
    with_return = planned_passes([TAKE_OFF, item_at("waypoint", 40, 0, 10), {"kind": "return_home"}])
    assert [each.compared for each in with_return.passes] == [True, True, False]
    assert with_return.passes[2].leg.points[1][3] == pytest.approx(-VEHICLE.return_alt_m, abs=0.01)


def test_the_deviation_is_split_into_horizontal_and_vertical_and_the_time_left_decreases():
    monitored = MonitoredFlight()
    before_s = monitored.observe(0, (0.0, 0.0, -5.0)).remaining_s
    monitor = monitored.observe(1, (10.0, 3.0, -11.0))
    assert (monitor.horizontal_m, monitor.vertical_m) == (pytest.approx(3.0), pytest.approx(1.0))
    assert (monitor.place, monitor.title, monitor.reason_not_compared) == ("item 2", "Waypoint", None)
    state = monitor.planned_state(Reading(armed=True))
    assert (state.planned_ned_m, state.is_counted) == (pytest.approx((10.0, 0.0, -10.0), abs=0.01), True)
    assert monitor.remaining_s < before_s
    later = monitored.observe(1, (39.0, 0.0, -10.0)).remaining_s
    assert later < monitor.planned_flight().duration_s - 8


def test_the_first_seconds_towards_the_next_item_are_no_deviation_before_px4_reports_that_item():
    monitored = MonitoredFlight()
    monitored.observe(1, (38.0, 0.0, -10.0))
    assert monitored.observe(1, (40.0, 6.0, -10.0)).horizontal_m == pytest.approx(0.0, abs=0.01)
    # The tolerance covers only the first seconds of the next item.
    assert monitored.observe(1, (40.0, 30.0, -10.0)).horizontal_m > 15
    assert monitored.observe(2, (40.0, 30.0, -10.0)).horizontal_m == pytest.approx(0.0, abs=0.01)


def test_the_remaining_time_decreases_during_a_hold_at_a_waypoint():
    monitored = MonitoredFlight()
    monitored.observe(1, (40.0, 0.0, -10.0))
    arrived_s = monitored.observe(2, (40.0, 40.0, -10.0), 0.1).remaining_s
    assert monitored.observe(2, (40.0, 40.0, -10.0), 4.0).remaining_s == pytest.approx(
        arrived_s - 4.0, abs=0.3
    )


def test_repeated_items_are_distinguished_by_their_order():
    monitored = MonitoredFlight(LOOP)
    first_s = monitored.observe(1, (20.0, 0.0, -10.0)).remaining_s
    monitored.observe(2, (40.0, 20.0, -10.0))
    second_s = monitored.observe(1, (40.0, 10.0, -10.0)).remaining_s
    assert second_s < first_s - 10
    monitored.observe(2, (40.0, 20.0, -10.0))
    assert monitored.observe(4, (40.0, 40.0, -8.0)).remaining_s < second_s - 10


def test_a_flight_that_was_not_monitored_from_its_start_has_no_remaining_time_if_items_repeat():
    assert MonitoredFlight(LOOP, from_start=False).observe(2, (40.0, 20.0, -10.0)).remaining_s is None
    assert MonitoredFlight(SQUARE, from_start=False).observe(2, (40.0, 20.0, -10.0)).remaining_s is not None


def test_a_start_at_a_later_item_is_compared_with_the_rest_of_the_plan_once_the_path_is_reached():
    monitored = MonitoredFlight()
    monitor = monitored.observe(2, (10.0, 10.0, -10.0))
    assert (monitor.horizontal_m, monitor.reason_not_compared) == (
        None,
        "The vehicle is flying to the planned path.",
    )
    assert monitored.observe(2, (40.0, 21.0, -10.0)).horizontal_m == pytest.approx(0.0, abs=0.01)
    remaining_flight, full_flight = monitor.planned_flight(), planned_passes(SQUARE).planned_flight()
    assert [leg.place for leg in remaining_flight.legs] == ["item 3", "item 4"]
    assert (remaining_flight.length_m, full_flight.duration_s - remaining_flight.duration_s) == (
        pytest.approx(50.0, abs=0.1),
        pytest.approx(remaining_flight.legs[0].start_s),
    )


def test_a_flight_is_compared_again_after_a_skipped_item_once_the_path_is_reached():
    monitored = MonitoredFlight()
    monitored.observe(1, (5.0, 0.0, -10.0))
    assert monitored.observe(2, (10.0, 2.0, -10.0)).horizontal_m is None
    assert monitored.observe(2, (40.0, 30.0, -10.0)).horizontal_m is not None


def test_hold_mode_pauses_the_monitor_and_mission_mode_resumes_it_on_the_path():
    monitored = MonitoredFlight()
    monitored.observe(1, (20.0, 0.0, -10.0))
    paused = monitored.observe(1, (21.0, 9.0, -10.0), mode="hold", source="pilot")
    assert (paused.state, paused.horizontal_m, paused.reason_not_compared) == ("paused", None, None)
    assert paused.reason == "The vehicle has left Mission mode: The RC pilot."
    resumed = monitored.observe(1, (21.0, 8.0, -10.0))
    assert (resumed.state, resumed.reason, resumed.horizontal_m) == ("flying", None, None)
    assert monitored.observe(1, (22.0, 1.0, -10.0)).horizontal_m == pytest.approx(1.0)
    assert monitored.codes == ["monitoring_paused", "monitoring_resumed"]


CORRIDOR = Corridor(((0.0, 0.0, -10.0), (40.0, 0.0, -10.0)), (1.0, 1.0), (1.0, 1.0), (1.0, 1.0))


def test_leaving_the_corridor_and_returning_to_it_are_each_reported_once():
    monitored = MonitoredFlight(corridor=CORRIDOR)
    assert monitored.observe(1, (5.0, 1.0, -10.0)).outside_corridor_m == 0.0
    assert monitored.observe(1, (10.0, 4.5, -10.0), 3.0).outside_corridor_m == pytest.approx(3.0)
    monitored.observe(1, (15.0, 0.0, -10.0))
    assert monitored.codes == ["corridor_left", "corridor_back"]


def test_the_corridor_is_not_monitored_before_the_vehicle_is_back_on_its_path():
    monitored = MonitoredFlight(corridor=CORRIDOR)
    monitored.observe(1, (5.0, 0.0, -10.0))
    assert (
        monitored.observe(1, (5.0, 30.0, -10.0), 3.0, mode="position", source="pilot").outside_corridor_m
        is None
    )
    assert monitored.observe(1, (5.0, 30.0, -10.0), 3.0).outside_corridor_m is None
    assert "corridor_left" not in monitored.codes


def test_a_flight_is_done_only_after_landing_and_disarming_at_the_last_item():
    monitored = MonitoredFlight()
    monitored.observe(1, (20.0, 0.0, -10.0))
    monitored.observe(2, (40.0, 20.0, -10.0))
    monitored.observe(3, (40.0, 40.0, 0.0))
    assert monitored.observe(3, (40.0, 40.0, 0.0), armed=False).state == "done"
    landed_early = MonitoredFlight()
    landed_early.observe(1, (20.0, 0.0, -10.0))
    ended = landed_early.observe(1, (20.0, 0.0, 0.0), armed=False)
    assert (ended.state, ended.reason) == ("stopped", "The vehicle was disarmed at item 2.")
    piloted = MonitoredFlight()
    piloted.observe(3, (40.0, 40.0, -2.0))
    piloted.observe(3, (40.0, 40.0, -2.0), mode="position", source="pilot")
    assert piloted.observe(3, (40.0, 40.0, 0.0), armed=False, mode="position").state == "stopped"


def test_a_return_item_is_a_part_of_the_mission_but_a_failsafes_return_is_not():
    items = [TAKE_OFF, item_at("waypoint", 40, 0, 10), {"kind": "return_home"}]
    monitored = MonitoredFlight(items)
    monitored.observe(1, (40.0, 0.0, -10.0))
    monitor = monitored.observe(2, (30.0, 0.0, -30.0), mode="rtl", source="unknown")
    assert (monitor.state, monitor.reason_not_compared) == (
        "flying",
        "PX4 chooses the path of this item itself.",
    )
    assert monitor.remaining_s > 0
    assert monitored.observe(2, (20.0, 0.0, -30.0), mode="rtl", source="failsafe").state == "paused"


def test_a_mission_that_ends_in_the_air_is_done_when_px4_holds():
    items = [TAKE_OFF, item_at("waypoint", 40, 0, 10)]
    monitored = MonitoredFlight(items)
    monitored.observe(1, (39.0, 0.0, -10.0))
    assert (
        monitored.observe(1, (40.0, 0.0, -10.0), mode="hold", source="vehicle", reached=0).state == "paused"
    )
    monitored.observe(1, (40.0, 0.0, -10.0))
    assert monitored.observe(1, (40.0, 0.0, -10.0), mode="hold", source="vehicle", reached=1).state == "done"


def test_a_monitor_without_a_planned_path_reports_the_reason_and_the_end_of_the_flight():
    monitored = MonitoredFlight(planned=None, reason_not_compared="It was already flying.", from_start=False)
    monitor = monitored.observe(3, (40.0, 40.0, -5.0))
    assert (monitor.reason_not_compared, monitor.remaining_s, monitor.horizontal_m) == (
        "It was already flying.",
        None,
        None,
    )
    assert monitor.planned_flight().legs == ()
    assert monitored.observe(3, (40.0, 40.0, 0.0), armed=False).state == "done"


def test_an_unknown_position_is_not_a_deviation():
    monitored = MonitoredFlight()
    monitored.observe(1, (20.0, 0.0, -10.0))
    monitor = monitored.observe(1, None)
    assert (monitor.horizontal_m, monitor.reason_not_compared) == (
        None,
        "The vehicle has no valid position estimate.",
    )


def dry_run_result(seconds=20.0):
    times = [k / 10 for k in range(int(seconds * 10) + 1)]
    path = [[2.0 * t, math.sin(t), -5.0] for t in times]
    steps = [
        {"place": "item 1", "title": "Takeoff", "row": 0, "start_s": 0.0, "end_s": 5.0},
        {"place": "item 2", "title": "Complex", "row": 1, "start_s": 5.0, "end_s": seconds},
    ]
    return {
        "path": {"t_s": times, "position_ned_m": path}, "steps": steps, "duration_s": seconds, "landed": True
    }  # fmt: skip


def test_a_dry_run_gives_the_curved_path_and_all_items_of_a_pattern_are_one_pass():
    pattern = {"kind": "complex", "complex_type": "survey", "original": "{}", "items": SQUARE[1:3]}
    plan = plan_of([TAKE_OFF, pattern])
    path = planned_by_dry_run(dry_run_result(), (0, 1, 1), (100.0, 0.0, 1.0))
    assert [sorted(each.items) for each in path.passes] == [[0], [1, 2]]
    first, second = (each.leg for each in path.passes)
    assert first.points[-1][1:] == pytest.approx(second.points[0][1:], abs=0.01)
    assert second.points[0][1:] == pytest.approx((110.0, math.sin(5.0), -4.0), abs=0.01)
    monitor = WaypointMonitor(plan, path, from_start=True)
    reading = Reading(
        mode="mission", armed=True, landed="in_air", position_ned_m=(120.0, math.sin(10.0), -6.0)
    )
    monitor.update(0.0, reading, 2, None)
    monitor.update(0.1, reading, 2, None)
    assert monitor.remaining_s is not None
