"""Separation of a group without vehicles: braking distances, prediction, and the guard's decisions."""

import asyncio
import math
import re
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from gcs_server.streamer.groups import prediction
from gcs_server.streamer.groups.checks import GroupChecks
from gcs_server.streamer.groups.prediction import (
    MAX_PREDICTION_S,
    PredictedMember,
    first_conflict,
    too_near_now,
)
from gcs_server.streamer.separation.guard import GroupGuard, MemberView, motion_of
from gcs_server.streamer.values.bounds import Bounds
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
HERE = (0.0, 0.0, -10.0)


def origin(east_m=0.0):
    return LocalOrigin(47.0, 8.0 + east_m * METRE_EAST_DEG, 500.0)


def snapshot(east_m=0.0, position=HERE, velocity=(0.0, 0.0, 0.0), yaw=0.0):
    """A snapshot with an exact estimate, so that only wind and braking make the margin: 0.8 m for two."""
    bounds = Bounds(origin=origin(east_m))
    return Snapshot(101.0, "offboard", position, velocity, yaw, bounds=bounds, accuracy_m=0.0)


def planned(vehicle, setpoint, east_m=0.0, duration_s=30.0, **more):
    return PredictedMember(vehicle, setpoint, snapshot(east_m, **more), duration_s)


def conflict(*members, minimum_m=3.0):
    search = first_conflict(members, 100.0, minimum_m)
    while True:
        try:
            next(search)
        except StopIteration as done:
            return done.value


def vectors(*rows):
    return (np.array(row, dtype=float) for row in rows)


# --- braking --------------------------------------------------------------------------------------


def test_a_head_on_approach_counts_both_braking_distances():
    left_m = closest_m(*vectors((0, 0, 0), (5, 0, 0), (30, 0, 0), (-5, 0, 0)))
    assert float(left_m) == pytest.approx(30 - 2 * braking_distance_m(5.0), abs=0.02)


def test_parallel_flight_keeps_its_distance_at_any_speed():
    assert float(closest_m(*vectors((0, 0, 0), (9, 0, 0), (0, 4, 0), (9, 0, 0)))) == pytest.approx(4.0)


def test_vehicles_that_hold_their_positions_keep_their_distance():
    left_m = closest_m(*vectors((0, 0, 0), (4, 0, 0), (-7, 0, 0), (0, 0, 0)))
    assert float(left_m) == pytest.approx(7.0)


def test_a_fast_pass_between_two_samples_is_detected():
    left_m = closest_m(*vectors((0, 0, 0), (12, 0, 0), (1, 0.4, 0), (-12, 0, 0)))
    assert float(left_m) == pytest.approx(0.4, abs=0.02)


def test_the_margin_grows_with_inaccuracy_and_age():
    def of(accuracy_m, age_s):
        return MovingVehicle((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), accuracy_m, age_s)

    exact = of(0.0, 0.0)
    assert margin_m(exact, exact) == pytest.approx(2 * EXTRA_BRAKING_M)
    assert margin_m(of(0.3, 0.0), of(0.4, 0.0)) == pytest.approx(2 * EXTRA_BRAKING_M + 2.0 * 0.5)
    late_m = margin_m(of(0.0, 0.4), exact) - 2 * EXTRA_BRAKING_M
    assert late_m == pytest.approx(1.5 * 0.4 * (0.2 + 0.8))


def test_a_vehicle_without_reported_accuracy_gets_a_default_margin():
    silent = replace(snapshot(), accuracy_m=None)
    assert motion_of(silent, 101.0, HERE, None).accuracy_m == 1.0
    assert motion_of(snapshot(), 101.4, HERE, None).age_s == pytest.approx(0.4)


def test_vehicles_with_a_low_tilt_limit_or_attitude_setpoints_are_stopped_earlier():
    def brakes(tilt_deg, setpoint):
        bounds = Bounds(origin=origin(), tilt_rad=math.radians(tilt_deg))
        return motion_of(replace(snapshot(), bounds=bounds), 101.0, HERE, setpoint).decel_m_s2

    steered, drifting = Velocity((1.0, 0.0, 0.0)), Attitude((1.0, 0.0, 0.0, 0.0), 0.5)
    assert brakes(45, steered) == 2.5
    assert brakes(10, steered) == pytest.approx(0.78, abs=0.01)
    assert brakes(45, drifting) == pytest.approx(1.5)
    weak_m = closest_m(*vectors((0, 0, 0), (4, 0, 0), (30, 0, 0), (0, 0, 0)), brakes(10, steered))
    assert float(weak_m) == pytest.approx(30 - 4 * 0.8 - 16 / (2 * 0.778), abs=0.05)


# --- prediction ---------------------------------------------------------------------------------


def test_positions_in_two_local_frames_are_compared_in_a_common_frame():
    there = Position((20.0, 0.0, -10.0))
    assert conflict(planned("1", there), planned("2", there, east_m=8.0)) is None
    found = conflict(planned("1", there), planned("2", Position((20.0, -8.0, -10.0)), east_m=8.0))
    assert found is not None
    assert found.vehicles == ("1", "2")
    assert found.distance_m < 0.5
    assert "vehicles 1 and 2 would come within" in found.text(3.0)


def test_two_vehicles_that_are_too_near_are_found_at_once():
    found = conflict(planned("1", None), planned("2", None, east_m=2.0))
    assert found is not None
    assert (found.after_s, found.distance_m) == (0.0, pytest.approx(2.0, abs=0.01))
    assert "are 2.0 m apart now (the minimum is 3 m, plus 0.8 m of margin)" in found.text(3.0)


def test_paths_are_compared_in_time():
    def across(begin_s):
        points = [(0.0, (0.0, 0.0, -10.0)), (begin_s, (0.0, 0.0, -10.0)), (begin_s + 20, (0.0, 40.0, -10.0))]
        return Path(tuple(PathPoint(t, at) for t, at in points))

    def back():
        return Path((PathPoint(0.0, HERE), PathPoint(20.0, (0.0, -40.0, -10.0))))

    assert conflict(planned("1", across(1.0)), planned("2", back(), east_m=40.0)) is not None
    follows = planned("2", across(1.0), east_m=-10.0)
    assert conflict(planned("1", across(1.0)), follows) is None
    assert conflict(planned("1", across(60.0)), planned("2", across(1.0), east_m=-10.0)) is not None


def test_a_running_path_is_checked_from_its_current_point():
    path = Path((PathPoint(0.0, (0.0, 0.0, -10.0)), PathPoint(20.0, (40.0, 0.0, -10.0))))
    late = PredictedMember("1", path, snapshot(position=(20.0, 0.0, -10.0)), 30.0, elapsed_s=10.0)
    passed = planned("2", None, position=(4.0, 0.0, -10.0))
    assert conflict(late, passed) is None
    ahead = planned("2", None, position=(38.0, 0.0, -10.0))
    assert conflict(late, ahead) is not None


def test_velocities_are_predicted_until_they_expire():
    def pair(duration_s):
        towards = planned("2", Velocity((0.0, -1.0, 0.0)), east_m=30.0, duration_s=duration_s)
        return planned("1", Velocity((0.0, 1.0, 0.0)), duration_s=duration_s), towards

    assert conflict(*pair(5.0)) is None
    assert conflict(*pair(20.0)) is not None


def test_body_velocities_and_global_positions_are_predicted():
    east = planned("1", VelocityBody((1.0, 0.0, 0.0)), yaw=math.pi / 2)
    assert conflict(east, planned("2", None, east_m=20.0)) is not None
    place = PositionGlobal(47.0, 8.0, alt_amsl_m=510.0)
    assert conflict(planned("1", None), planned("2", place, east_m=20.0)) is not None
    assert (
        conflict(planned("1", None), planned("2", Attitude((1.0, 0.0, 0.0, 0.0), 0.5), east_m=20.0)) is None
    )


def test_a_followers_position_is_predicted_from_its_leaders():
    leader = planned("1", Position((30.0, 0.0, -10.0)))
    beside = planned("2", Follow("1", offset_ned_m=(0.0, 6.0, 0.0)), east_m=6.0)
    assert conflict(leader, beside) is None
    in_the_way = planned("3", None, east_m=6.0, position=(20.0, 0.0, -10.0))
    found = conflict(leader, beside, in_the_way)
    assert found is not None
    assert found.vehicles == ("2", "3")


def test_vehicles_too_fast_to_stop_are_refused_even_if_they_would_pass():
    def pass_by(north_m, towards):
        points = [(0.0, (0.0, north_m, -10.0)), (10.0, (80.0 * towards, north_m, -10.0))]
        return Path(tuple(PathPoint(t, (n, e, d)) for t, (n, e, d) in points))

    crossing = Path((PathPoint(0.0, (40.0, -34.0, -10.0)), PathPoint(12.0, (40.0, 60.0, -10.0))))
    first = planned("1", pass_by(0.0, 1.0))
    found = conflict(first, planned("2", crossing, position=(40.0, -34.0, -10.0)))
    assert found is not None
    assert found.while_stopping or found.distance_m < 3.0


def test_the_prediction_has_a_time_limit():
    endless = planned("1", Follow("9", offset_ned_m=(0.0, 3.0, 0.0)))
    assert conflict(endless, planned("2", None, east_m=50.0)) is None
    assert MAX_PREDICTION_S == 600.0


def far(index, north_m_s):
    """A path of 600 s to the north and back, `index` times 12 m to the east."""
    north_m = 300.0 * north_m_s
    points = (PathPoint(0.0, HERE), PathPoint(300.0, (north_m, 0.0, -10.0)), PathPoint(600.0, HERE))
    return planned(str(index), Path(points), east_m=12.0 * index)


@pytest.mark.parametrize(
    "members",
    [
        [far(index, 2.0 + index) for index in range(10)],
        [
            far(0, 8.0),
            *(planned(str(i), Position((40.0, 0.0, -10.0)), east_m=12.0 * i) for i in range(1, 10)),
        ],
    ],
    ids=["ten_paths", "a_path_and_nine_positions"],
)
def test_a_long_prediction_yields_after_each_small_piece(monkeypatch, members):
    piece, largest_piece, total = Counter(), Counter(), Counter()

    def counted(name, work, size=lambda *_: 1):
        def run(*arguments):
            piece[name] += size(*arguments)
            return work(*arguments)

        return run

    def braking_samples(place_a, velocity_a, place_b, velocity_b, brakes_a, brakes_b):
        fastest_m_s = max(np.max(np.linalg.norm(v, axis=-1)) for v in (velocity_a, velocity_b))
        return len(place_a) * (0.8 + fastest_m_s / min(brakes_a, brakes_b)) / 0.1

    track = prediction._PredictedTrack
    monkeypatch.setattr(track, "__init__", counted("tracks", track.__init__))
    monkeypatch.setattr(track, "step", counted("steps", track.step))
    monkeypatch.setattr(prediction, "margin_m", counted("pairs", prediction.margin_m))
    monkeypatch.setattr(prediction, "closest_m", counted("samples", prediction.closest_m, braking_samples))
    search = first_conflict(members, 100.0, 3.0)
    ended = False
    while not ended:
        ended = next(search, "ended") == "ended"
        largest_piece |= piece
        total += piece
        piece.clear()
    assert total["tracks"] == 10
    assert total["steps"] >= 24_000
    assert total["pairs"] == 45
    assert total["samples"] > 12_000
    assert largest_piece["tracks"] == largest_piece["pairs"] == 1
    assert largest_piece["steps"] <= 100
    assert largest_piece["samples"] <= 12_000


def test_concurrent_predictions_take_turns_with_the_event_loop():
    log = []

    def search(name):
        for _ in range(3):
            log.append(name)
            yield

    async def others():
        while len(log) - log.count("-") < 6:
            log.append("-")
            await asyncio.sleep(0)

    async def run():
        checks = GroupChecks(None, None)
        async with asyncio.timeout(5.0):
            await asyncio.gather(*(checks._in_pieces(search(name)) for name in "ab"), others())

    asyncio.run(run())
    assert re.fullmatch(r"a-+b-+a-+b-+a-+b", "".join(log))


def test_too_near_now_equals_the_first_step_of_the_prediction():
    near = planned("1", None), planned("2", None, east_m=2.0)
    assert too_near_now(near, 100.0, 3.0) == conflict(*near)
    apart = planned("1", None), planned("2", None, east_m=8.0)
    assert too_near_now(apart, 100.0, 3.0) is None
    fast = planned("1", None, velocity=(0.0, 4.0, 0.0)), planned("2", None, east_m=9.0)
    found, searched = too_near_now(fast, 100.0, 3.0), conflict(*fast)
    assert (found.while_stopping, found.after_s) == (True, 0.0)
    assert found.distance_m == pytest.approx(9.0 - braking_distance_m(4.0), abs=0.05)
    assert searched.vehicles == found.vehicles


# --- the guard ------------------------------------------------------------------------------------

WAIT, GO = StreamRequest(Position(HERE)), StreamRequest(Velocity((1.0, 0.0, 0.0)), 30.0)


def guard(**more):
    both = ("1", "2")
    options = {"minimum_m": 3.0, "start_s": 101.0, "duration_s": 30.0, **more}
    return GroupGuard("7", dict.fromkeys(both, WAIT), dict.fromkeys(both, GO), **options)


def views(second=None, request=WAIT, phase="streaming", **more):
    first = MemberView("streaming", request, snapshot(**more), None)
    return {"1": first, "2": MemberView(phase, request, second or snapshot(20.0), None)}


def test_all_members_start_once_at_the_common_start():
    watch = guard()
    assert not watch.check(100.5, views()).new_requests
    assert watch.due_s <= 101.0
    assert set(watch.check(101.0, views()).new_requests) == {"1", "2"}
    assert watch.phase == "flying"
    assert not watch.check(101.1, views(request=GO)).new_requests


def test_a_missed_common_start_starts_no_member():
    watch = guard()
    late = Snapshot(102.4, "offboard", HERE, None, 0.0, bounds=Bounds(origin=origin()))
    other = Snapshot(102.4, "offboard", HERE, None, 0.0, bounds=Bounds(origin=origin(20.0)))
    both = {"1": MemberView("streaming", WAIT, late, None), "2": MemberView("streaming", WAIT, other, None)}
    actions = watch.check(102.5, both)
    assert not actions.new_requests
    assert set(actions.hold) == {"1", "2"}
    assert watch.findings[0].code == "late"


def test_two_members_that_come_too_close_hold_and_the_finding_has_their_distance():
    watch = guard()
    watch.check(101.0, views())
    near = views(snapshot(8.0, velocity=(0.0, -2.0, 0.0)), GO, velocity=(0.0, 2.0, 0.0))
    actions = watch.check(101.1, near)
    assert set(actions.hold) == {"1", "2"}
    assert actions.code == "separation"
    finding = watch.findings[0]
    assert (finding.code, finding.vehicles, finding.held) == ("separation", ("1", "2"), ("1", "2"))
    assert not watch.check(101.2, near).hold  # reported and executed once


def test_an_accelerating_member_is_stopped_in_time():
    drift = StreamRequest(Attitude((1.0, 0.0, 0.0, 0.0), 0.5), 60.0)
    gains_m_s2, go_on_s, braking_decel_m_s2 = 6.0, 0.3, 1.5
    watch = GroupGuard(
        "7",
        dict.fromkeys("12", WAIT),
        dict.fromkeys("12", drift),
        minimum_m=3.0,
        start_s=101.0,
        duration_s=60.0,
    )
    watch.check(101.0, views(snapshot(60.0)))
    for step in range(1, 100):
        now_s, speed_m_s = 101.0 + 0.05 * step, gains_m_s2 * 0.05 * step
        apart_m = 60.0 - 0.5 * gains_m_s2 * (0.05 * step) ** 2
        coming = replace(snapshot(apart_m, velocity=(0.0, -speed_m_s, 0.0)), taken_s=now_s)
        standing = MemberView("streaming", drift, replace(snapshot(), taken_s=now_s), None)
        if watch.check(now_s, {"1": standing, "2": MemberView("streaming", drift, coming, None)}).hold:
            break
    else:
        pytest.fail("the accelerating member was not stopped")
    fastest_m_s = speed_m_s + gains_m_s2 * go_on_s
    needs_m = (
        speed_m_s * go_on_s + 0.5 * gains_m_s2 * go_on_s**2 + fastest_m_s**2 / (2.0 * braking_decel_m_s2)
    )
    assert apart_m - needs_m >= 3.0, (apart_m, speed_m_s)


def test_a_common_expiry_is_not_a_finding():
    watch = guard()
    watch.check(101.0, views())
    watch._next_check_s = 0.0
    assert not watch.check(130.99, views(request=GO, phase="holding")).hold
    assert not watch.findings
    over = {v: MemberView("idle", None, snapshot(), "done") for v in "12"}
    watch.check(140.0, over)
    assert (watch.phase, watch.due_s) == ("over", math.inf)


def test_a_member_without_position_holds_all():
    watch = guard()
    watch.check(101.0, views())
    blind = Snapshot(101.0, "offboard", None, None, 0.0, bounds=Bounds(origin=origin(20.0)))
    actions = watch.check(101.1, views(blind, GO))
    assert set(actions.hold) == {"1", "2"}
    assert watch.findings[0].code == "place_unknown"


def test_with_others_go_on_the_other_members_continue():
    watch = guard(others_go_on=True)
    watch.check(101.0, views())
    actions = watch.check(101.1, views(request=GO, phase="holding"))
    assert set(actions.hold) == {"2"}
    assert watch.held == {"2"}
