"""Separation of the vehicles of a group: braking distances, prediction, and the decisions of the guard."""

import asyncio
import math
import re
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from gcs_server.flights import prediction
from gcs_server.flights.group import GroupChecks
from gcs_server.flights.prediction import (
    MAX_PREDICTION_S,
    PredictedMember,
    first_conflict,
    too_near_now,
)
from gcs_server.streamer.separation import GroupGuard, MemberView, motion_of
from gcs_server.streamer.values.limit_values import Bounds
from gcs_server.streamer.values.snapshot import Snapshot
from gcs_server.streamer.values.stream_request import StreamRequest
from missions.geodesy import LocalOrigin
from missions.separation import EXTRA_BRAKING_M, MovingVehicle, braking_distance_m, closest_m, margin_m
from missions.setpoints import (
    Attitude,
    Follow,
    Path,
    PathPoint,
    Position,
    PositionGlobal,
    Velocity,
    VelocityBody,
)

METRE_EAST_DEG = math.degrees(1 / (6_371_000.0 * math.cos(math.radians(47.0))))
START = (0.0, 0.0, -10.0)


def origin(east_m=0.0):
    return LocalOrigin(47.0, 8.0 + east_m * METRE_EAST_DEG, 500.0)


def snapshot(east_m=0.0, position=START, velocity=(0.0, 0.0, 0.0), yaw=0.0):
    """A snapshot with an exact estimate; the margin of two such vehicles is 0.8 m for wind and braking."""
    bounds = Bounds(origin=origin(east_m))
    return Snapshot(101.0, "offboard", position, velocity, yaw, bounds=bounds, accuracy_m=0.0)


def member(vehicle, setpoint, east_m=0.0, duration_s=30.0, **options):
    return PredictedMember(vehicle, setpoint, snapshot(east_m, **options), duration_s)


def conflict_of(*members, minimum_m=3.0):
    search = first_conflict(members, 100.0, minimum_m)
    while True:
        try:
            next(search)
        except StopIteration as stop:
            return stop.value


def vectors(*rows):
    return (np.array(row, dtype=float) for row in rows)


# --- braking --------------------------------------------------------------------------------------


def test_a_head_on_approach_counts_both_braking_distances():
    distance_m = closest_m(*vectors((0, 0, 0), (5, 0, 0), (30, 0, 0), (-5, 0, 0)))
    assert float(distance_m) == pytest.approx(30 - 2 * braking_distance_m(5.0), abs=0.02)


def test_parallel_flight_keeps_its_distance_at_any_speed():
    assert float(closest_m(*vectors((0, 0, 0), (9, 0, 0), (0, 4, 0), (9, 0, 0)))) == pytest.approx(4.0)


def test_vehicles_that_hold_their_positions_keep_their_distance():
    distance_m = closest_m(*vectors((0, 0, 0), (4, 0, 0), (-7, 0, 0), (0, 0, 0)))
    assert float(distance_m) == pytest.approx(7.0)


def test_a_fast_pass_between_two_samples_is_detected():
    distance_m = closest_m(*vectors((0, 0, 0), (12, 0, 0), (1, 0.4, 0), (-12, 0, 0)))
    assert float(distance_m) == pytest.approx(0.4, abs=0.02)


def test_the_margin_grows_with_inaccuracy_and_age():
    def vehicle(accuracy_m, age_s):
        return MovingVehicle((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), accuracy_m, age_s)

    exact_vehicle = vehicle(0.0, 0.0)
    assert margin_m(exact_vehicle, exact_vehicle) == pytest.approx(2 * EXTRA_BRAKING_M)
    assert margin_m(vehicle(0.3, 0.0), vehicle(0.4, 0.0)) == pytest.approx(2 * EXTRA_BRAKING_M + 2.0 * 0.5)
    age_margin_m = margin_m(vehicle(0.0, 0.4), exact_vehicle) - 2 * EXTRA_BRAKING_M
    assert age_margin_m == pytest.approx(1.5 * 0.4 * (0.2 + 0.8))


def test_a_vehicle_without_reported_accuracy_gets_a_default_margin():
    without_accuracy = replace(snapshot(), accuracy_m=None)
    assert motion_of(without_accuracy, 101.0, START, None).accuracy_m == 1.0
    assert motion_of(snapshot(), 101.4, START, None).age_s == pytest.approx(0.4)


def test_vehicles_with_a_low_tilt_limit_or_attitude_setpoints_are_stopped_earlier():
    def decel_m_s2(tilt_deg, setpoint):
        bounds = Bounds(origin=origin(), tilt_rad=math.radians(tilt_deg))
        return motion_of(replace(snapshot(), bounds=bounds), 101.0, START, setpoint).decel_m_s2

    velocity, attitude = Velocity((1.0, 0.0, 0.0)), Attitude((1.0, 0.0, 0.0, 0.0), 0.5)
    assert decel_m_s2(45, velocity) == 2.5
    assert decel_m_s2(10, velocity) == pytest.approx(0.78, abs=0.01)
    assert decel_m_s2(45, attitude) == pytest.approx(1.5)
    distance_m = closest_m(*vectors((0, 0, 0), (4, 0, 0), (30, 0, 0), (0, 0, 0)), decel_m_s2(10, velocity))
    assert float(distance_m) == pytest.approx(30 - 4 * 0.8 - 16 / (2 * 0.778), abs=0.05)


# --- prediction ---------------------------------------------------------------------------------


def test_positions_in_two_local_frames_are_compared_in_a_common_frame():
    target = Position((20.0, 0.0, -10.0))
    assert conflict_of(member("1", target), member("2", target, east_m=8.0)) is None
    conflict = conflict_of(member("1", target), member("2", Position((20.0, -8.0, -10.0)), east_m=8.0))
    assert conflict is not None
    assert conflict.vehicles == ("1", "2")
    assert conflict.distance_m < 0.5
    assert "vehicles 1 and 2 would come within" in conflict.text(3.0)


def test_two_vehicles_that_are_already_too_near_conflict_immediately():
    conflict = conflict_of(member("1", None), member("2", None, east_m=2.0))
    assert conflict is not None
    assert (conflict.after_s, conflict.distance_m) == (0.0, pytest.approx(2.0, abs=0.01))
    assert "are 2.0 m apart now (the minimum is 3 m, plus 0.8 m of margin)" in conflict.text(3.0)


def test_paths_are_compared_at_equal_times():
    def path_east(begin_s):
        points = [(0.0, (0.0, 0.0, -10.0)), (begin_s, (0.0, 0.0, -10.0)), (begin_s + 20, (0.0, 40.0, -10.0))]
        return Path(tuple(PathPoint(t_s, position) for t_s, position in points))

    def path_west():
        return Path((PathPoint(0.0, START), PathPoint(20.0, (0.0, -40.0, -10.0))))

    assert conflict_of(member("1", path_east(1.0)), member("2", path_west(), east_m=40.0)) is not None
    follower = member("2", path_east(1.0), east_m=-10.0)
    assert conflict_of(member("1", path_east(1.0)), follower) is None
    assert conflict_of(member("1", path_east(60.0)), member("2", path_east(1.0), east_m=-10.0)) is not None


def test_a_running_path_is_checked_from_its_current_point():
    path = Path((PathPoint(0.0, (0.0, 0.0, -10.0)), PathPoint(20.0, (40.0, 0.0, -10.0))))
    halfway_member = PredictedMember("1", path, snapshot(position=(20.0, 0.0, -10.0)), 30.0, elapsed_s=10.0)
    member_behind = member("2", None, position=(4.0, 0.0, -10.0))
    assert conflict_of(halfway_member, member_behind) is None
    member_ahead = member("2", None, position=(38.0, 0.0, -10.0))
    assert conflict_of(halfway_member, member_ahead) is not None


def test_velocities_are_predicted_until_they_expire():
    def pair(duration_s):
        approaching = member("2", Velocity((0.0, -1.0, 0.0)), east_m=30.0, duration_s=duration_s)
        return member("1", Velocity((0.0, 1.0, 0.0)), duration_s=duration_s), approaching

    assert conflict_of(*pair(5.0)) is None
    assert conflict_of(*pair(20.0)) is not None


def test_body_velocities_and_global_positions_are_predicted():
    eastward_member = member("1", VelocityBody((1.0, 0.0, 0.0)), yaw=math.pi / 2)
    assert conflict_of(eastward_member, member("2", None, east_m=20.0)) is not None
    target_global = PositionGlobal(47.0, 8.0, alt_amsl_m=510.0)
    assert conflict_of(member("1", None), member("2", target_global, east_m=20.0)) is not None
    assert (
        conflict_of(member("1", None), member("2", Attitude((1.0, 0.0, 0.0, 0.0), 0.5), east_m=20.0)) is None
    )


def test_a_followers_position_is_predicted_from_its_leaders():
    leader = member("1", Position((30.0, 0.0, -10.0)))
    follower = member("2", Follow("1", offset_ned_m=(0.0, 6.0, 0.0)), east_m=6.0)
    assert conflict_of(leader, follower) is None
    vehicle_in_the_way = member("3", None, east_m=6.0, position=(20.0, 0.0, -10.0))
    conflict = conflict_of(leader, follower, vehicle_in_the_way)
    assert conflict is not None
    assert conflict.vehicles == ("2", "3")


def test_crossing_paths_conflict_if_the_vehicles_could_not_stop_in_time():
    northward_path = Path((PathPoint(0.0, START), PathPoint(10.0, (80.0, 0.0, -10.0))))
    eastward_path = Path((PathPoint(0.0, (40.0, -34.0, -10.0)), PathPoint(12.0, (40.0, 60.0, -10.0))))
    conflict = conflict_of(
        member("1", northward_path), member("2", eastward_path, position=(40.0, -34.0, -10.0))
    )
    assert conflict is not None
    assert conflict.while_stopping or conflict.distance_m < 3.0


def test_the_prediction_has_a_time_limit():
    endless = member("1", Follow("9", offset_ned_m=(0.0, 3.0, 0.0)))
    assert conflict_of(endless, member("2", None, east_m=50.0)) is None
    assert MAX_PREDICTION_S == 600.0


def long_path(index, north_m_s):
    """A path of 600 s to the north and back, `index` times 12 m to the east."""
    north_m = 300.0 * north_m_s
    points = (PathPoint(0.0, START), PathPoint(300.0, (north_m, 0.0, -10.0)), PathPoint(600.0, START))
    return member(str(index), Path(points), east_m=12.0 * index)


@pytest.mark.parametrize(
    "members",
    [
        [long_path(index, 2.0 + index) for index in range(10)],
        [
            long_path(0, 8.0),
            *(member(str(i), Position((40.0, 0.0, -10.0)), east_m=12.0 * i) for i in range(1, 10)),
        ],
    ],
    ids=["ten_paths", "a_path_and_nine_positions"],
)
def test_a_long_prediction_yields_after_each_small_piece(monkeypatch, members):
    piece_counts, largest_counts, total_counts = Counter(), Counter(), Counter()

    def count_calls(name, work, size=lambda *_: 1):
        def run(*arguments):
            piece_counts[name] += size(*arguments)
            return work(*arguments)

        return run

    def braking_samples(position_a, velocity_a, position_b, velocity_b, decel_a_m_s2, decel_b_m_s2):
        fastest_m_s = max(np.max(np.linalg.norm(v, axis=-1)) for v in (velocity_a, velocity_b))
        return len(position_a) * (0.8 + fastest_m_s / min(decel_a_m_s2, decel_b_m_s2)) / 0.1

    track = prediction._PredictedTrack
    monkeypatch.setattr(track, "__init__", count_calls("tracks", track.__init__))
    monkeypatch.setattr(track, "step", count_calls("steps", track.step))
    monkeypatch.setattr(prediction, "margin_m", count_calls("pairs", prediction.margin_m))
    monkeypatch.setattr(
        prediction, "closest_m", count_calls("samples", prediction.closest_m, braking_samples)
    )
    search = first_conflict(members, 100.0, 3.0)
    ended = False
    while not ended:
        ended = next(search, "ended") == "ended"
        largest_counts |= piece_counts
        total_counts += piece_counts
        piece_counts.clear()
    assert total_counts["tracks"] == 10
    assert total_counts["steps"] >= 24_000
    assert total_counts["pairs"] == 45
    assert total_counts["samples"] > 12_000
    assert largest_counts["tracks"] == largest_counts["pairs"] == 1
    assert largest_counts["steps"] <= 100
    assert largest_counts["samples"] <= 12_000


def test_concurrent_predictions_take_turns_with_the_event_loop():
    log = []

    def search(name):
        for _ in range(3):
            log.append(name)
            yield

    async def other_work():
        while len(log) - log.count("-") < 6:
            log.append("-")
            await asyncio.sleep(0)

    async def run():
        checks = GroupChecks(None, None)
        async with asyncio.timeout(5.0):
            await asyncio.gather(*(checks._in_pieces(search(name)) for name in "ab"), other_work())

    asyncio.run(run())
    assert re.fullmatch(r"a-+b-+a-+b-+a-+b", "".join(log))


def test_the_current_separation_equals_the_first_step_of_the_prediction():
    near_pair = member("1", None), member("2", None, east_m=2.0)
    assert too_near_now(near_pair, 100.0, 3.0) == conflict_of(*near_pair)
    distant_pair = member("1", None), member("2", None, east_m=8.0)
    assert too_near_now(distant_pair, 100.0, 3.0) is None
    fast_pair = member("1", None, velocity=(0.0, 4.0, 0.0)), member("2", None, east_m=9.0)
    current_conflict, predicted_conflict = too_near_now(fast_pair, 100.0, 3.0), conflict_of(*fast_pair)
    assert (current_conflict.while_stopping, current_conflict.after_s) == (True, 0.0)
    assert current_conflict.distance_m == pytest.approx(9.0 - braking_distance_m(4.0), abs=0.05)
    assert predicted_conflict.vehicles == current_conflict.vehicles


# --- the guard ------------------------------------------------------------------------------------

HOVER = StreamRequest(Position(START))
FLY = StreamRequest(Velocity((1.0, 0.0, 0.0)), 30.0)


def make_guard(**more_options):
    vehicles = ("1", "2")
    options = {"minimum_m": 3.0, "start_s": 101.0, "duration_s": 30.0, **more_options}
    return GroupGuard("7", dict.fromkeys(vehicles, HOVER), dict.fromkeys(vehicles, FLY), **options)


def views(second=None, request=HOVER, phase="streaming", **options):
    first = MemberView("streaming", request, snapshot(**options), None)
    return {"1": first, "2": MemberView(phase, request, second or snapshot(20.0), None)}


def test_all_members_start_once_at_the_common_start():
    group_guard = make_guard()
    assert not group_guard.check(100.5, views()).new_requests
    assert group_guard.due_s <= 101.0
    assert set(group_guard.check(101.0, views()).new_requests) == {"1", "2"}
    assert group_guard.phase == "flying"
    assert not group_guard.check(101.1, views(request=FLY)).new_requests


def test_a_missed_common_start_starts_no_member():
    group_guard = make_guard()
    snapshots = (replace(snapshot(east_m), taken_s=102.4) for east_m in (0.0, 20.0))
    member_views = {
        v: MemberView("streaming", HOVER, each, None) for v, each in zip("12", snapshots, strict=True)
    }
    actions = group_guard.check(102.5, member_views)
    assert not actions.new_requests
    assert set(actions.hold) == {"1", "2"}
    assert group_guard.findings[0].code == "late"


def test_two_members_that_come_too_close_hold_and_the_finding_has_their_distance():
    group_guard = make_guard()
    group_guard.check(101.0, views())
    near_views = views(snapshot(8.0, velocity=(0.0, -2.0, 0.0)), FLY, velocity=(0.0, 2.0, 0.0))
    actions = group_guard.check(101.1, near_views)
    assert set(actions.hold) == {"1", "2"}
    assert actions.code == "separation"
    finding = group_guard.findings[0]
    assert (finding.code, finding.vehicles, finding.held) == ("separation", ("1", "2"), ("1", "2"))
    assert not group_guard.check(101.2, near_views).hold  # reported and executed once


def test_an_accelerating_member_is_stopped_in_time():
    attitude_request = StreamRequest(Attitude((1.0, 0.0, 0.0, 0.0), 0.5), 60.0)
    acceleration_m_s2, delay_s, decel_m_s2 = 6.0, 0.3, 1.5
    group_guard = GroupGuard(
        "7",
        dict.fromkeys("12", HOVER),
        dict.fromkeys("12", attitude_request),
        minimum_m=3.0,
        start_s=101.0,
        duration_s=60.0,
    )
    group_guard.check(101.0, views(snapshot(60.0)))
    for step in range(1, 100):
        now_s, speed_m_s = 101.0 + 0.05 * step, acceleration_m_s2 * 0.05 * step
        apart_m = 60.0 - 0.5 * acceleration_m_s2 * (0.05 * step) ** 2
        approaching = replace(snapshot(apart_m, velocity=(0.0, -speed_m_s, 0.0)), taken_s=now_s)
        hovering = MemberView("streaming", attitude_request, replace(snapshot(), taken_s=now_s), None)
        if group_guard.check(
            now_s, {"1": hovering, "2": MemberView("streaming", attitude_request, approaching, None)}
        ).hold:
            break
    else:
        pytest.fail("the accelerating member was not stopped")
    fastest_m_s = speed_m_s + acceleration_m_s2 * delay_s
    stop_m = speed_m_s * delay_s + 0.5 * acceleration_m_s2 * delay_s**2 + fastest_m_s**2 / (2.0 * decel_m_s2)
    assert apart_m - stop_m >= 3.0, (apart_m, speed_m_s)


def test_setpoints_of_all_members_that_expire_together_cause_no_finding():
    group_guard = make_guard()
    group_guard.check(101.0, views())
    group_guard._next_check_s = 0.0
    assert not group_guard.check(130.99, views(request=FLY, phase="holding")).hold
    assert not group_guard.findings
    ended_views = {v: MemberView("idle", None, snapshot(), "done") for v in "12"}
    group_guard.check(140.0, ended_views)
    assert (group_guard.phase, group_guard.due_s) == ("over", math.inf)


def test_a_member_without_position_makes_all_members_hold():
    group_guard = make_guard()
    group_guard.check(101.0, views())
    without_position = Snapshot(101.0, "offboard", None, None, 0.0, bounds=Bounds(origin=origin(20.0)))
    actions = group_guard.check(101.1, views(without_position, FLY))
    assert set(actions.hold) == {"1", "2"}
    assert group_guard.findings[0].code == "place_unknown"


def test_if_others_go_on_is_set_the_other_members_continue():
    group_guard = make_guard(others_go_on=True)
    group_guard.check(101.0, views())
    actions = group_guard.check(101.1, views(request=FLY, phase="holding"))
    assert set(actions.hold) == {"2"}
    assert group_guard.held == {"2"}
