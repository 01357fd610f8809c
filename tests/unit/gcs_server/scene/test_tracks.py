"""Trails in the 3D view: they are built only while a view is open, and are complete when it opens."""

from __future__ import annotations

import pytest

from gcs_server.clock import SystemClock
from gcs_server.scene.host import ViserHost
from gcs_server.scene.scene import Scene
from gcs_server.scene.tracks import Track, Tracks
from gcs_server.vehicle.samples import Sample
from tests.unit.gcs_server.scene.scene_fakes import (
    FakeFleet,
    FakeVehicle,
    StillClock,
    flying_vehicle,
    global_position,
    local_position,
)


def trail_points(track: Track) -> list[tuple[float, float, float]]:
    return [*track.trail.sealed, *track.trail.recent[1 if track.trail.sealed else 0 :]]


def add_flight_north(vehicle: FakeVehicle, clock: StillClock, seconds: int) -> None:
    """Adds a history: 1 m/s to the north, ending at the origin now, 10 m high."""
    for ago_s in range(seconds, 0, -1):
        unix_s, position = clock.unix_s() - ago_s, local_position(-float(ago_s), 0.0, -10.0)
        vehicle.stored_samples.append(
            Sample("local_position", None, unix_s, clock.monotonic_s() - ago_s, position)
        )


def test_without_a_view_no_vehicle_is_read(monkeypatch):
    monkeypatch.setattr(ViserHost, "clients", lambda _: {})
    vehicle = flying_vehicle()
    scene = Scene(FakeFleet([vehicle]), StillClock())
    for i in range(100):
        scene._step(i * 0.25, 0.25)
    assert (vehicle.topic_reads, vehicle.history_requests) == (0, 0)


def test_the_trail_is_complete_when_a_view_opens():
    clock = StillClock()
    vehicle = flying_vehicle()
    vehicle.clock = clock
    add_flight_north(vehicle, clock, 100)
    tracks = Tracks(FakeFleet([vehicle]), None, SystemClock())
    (track,) = tracks.update(clock.monotonic_s(), 0.03).values()
    assert trail_points(track) == [pytest.approx((0.0, -float(ago_s), 10.0)) for ago_s in range(100, 0, -1)]
    tracks.update(clock.monotonic_s() + 0.03, 0.03)
    assert trail_points(track)[-1] == pytest.approx((0.0, 0.0, 10.0))
    assert vehicle.history_requests == 1


def test_a_gap_of_a_trail_is_filled_without_duplicates():
    clock = StillClock()
    vehicle = flying_vehicle()
    vehicle.clock = clock
    tracks = Tracks(FakeFleet([vehicle]), None, SystemClock())
    vehicle.values["local_position"] = local_position(-60.0, 0.0, -10.0)
    vehicle.values["global_position"] = None
    for _ in range(2):
        (track,) = tracks.update(clock.monotonic_s(), 0.03).values()
    clock.now_s += 30.0
    add_flight_north(vehicle, clock, 29)
    vehicle.values["local_position"] = local_position(0.0, 0.0, -10.0)
    for _ in range(2):
        (same_track,) = tracks.update(clock.monotonic_s(), 0.03).values()
    assert same_track is track
    assert [p[1] for p in trail_points(track)] == pytest.approx([-60.0, *range(-29, 1)])


def test_the_trail_restarts_after_a_long_gap():
    clock = StillClock()
    vehicle = flying_vehicle()
    vehicle.clock = clock
    tracks = Tracks(FakeFleet([vehicle]), None, SystemClock())
    for _ in range(2):
        (first_track,) = tracks.update(clock.monotonic_s(), 0.03).values()
    clock.now_s += 1000.0
    (track,) = tracks.update(clock.monotonic_s(), 0.03).values()
    assert first_track.trail.recent
    assert trail_points(track) == []


def test_one_trail_per_update_is_built_and_the_followed_vehicle_is_first():
    clock = StillClock()
    vehicles = [flying_vehicle(str(i)) for i in range(1, 6)]
    tracks = Tracks(FakeFleet(vehicles), None, SystemClock())
    tracks.update(clock.monotonic_s(), 0.03, {"4"})
    assert [v.history_requests for v in vehicles] == [0, 0, 0, 1, 0]
    for _ in range(6):
        tracks.update(clock.monotonic_s(), 0.03, {"4"})
    assert [v.history_requests for v in vehicles] == [1, 1, 1, 1, 1]


def test_every_third_update_covers_vehicles_that_no_view_follows():
    vehicles = [flying_vehicle(str(i)) for i in range(1, 8)]
    tracks = Tracks(FakeFleet(vehicles), None, SystemClock())
    tracks.update(0.0, 0.03, {"4"})  # the first update covers all vehicles
    poses = {v: track.smoother.pose for v, track in tracks.update(0.03, 0.03, {"4"}).items()}
    for vehicle in vehicles:
        vehicle.values["local_position"] = local_position(1.0, 0.0, -10.0)
    changed_ids = []
    for index in range(2, 5):
        new_poses = {v: track.smoother.pose for v, track in tracks.update(index * 0.03, 0.03, {"4"}).items()}
        changed_ids.append({v for v in new_poses if new_poses[v] is not poses[v]})
        poses = new_poses
    assert [len(ids) for ids in changed_ids] == [3, 3, 3]
    assert all("4" in ids for ids in changed_ids)
    assert set.union(*changed_ids) == {v.id for v in vehicles}
    north_m = {v: pose.position_enu_m[1] for v, pose in poses.items()}
    last_changed_ids = changed_ids[-1]
    # A vehicle that is updated after three periods has moved as far as the followed vehicle.
    assert [north_m[v] for v in last_changed_ids] == pytest.approx([north_m["4"]] * len(last_changed_ids))


def test_if_there_are_few_vehicles_each_update_covers_all_of_them():
    vehicles = [flying_vehicle(str(i)) for i in range(1, 4)]
    tracks = Tracks(FakeFleet(vehicles), None, SystemClock())
    for index in range(3):
        poses_before = {v: track.smoother.pose for v, track in tracks.update(index * 0.03, 0.03).items()}
        for vehicle in vehicles:
            vehicle.values["local_position"] = local_position(float(index), 0.0, -10.0)
    poses_after = {v: track.smoother.pose for v, track in tracks.update(0.2, 0.03).items()}
    assert all(poses_after[v] is not poses_before[v] for v in ("1", "2", "3"))


def test_another_vehicle_with_the_same_id_has_no_trail_of_the_first_vehicle():
    clock, fleet = StillClock(), FakeFleet([flying_vehicle("1")])
    tracks = Tracks(fleet, None, SystemClock())
    for _ in range(2):
        tracks.update(clock.monotonic_s(), 0.03)
    other_vehicle = flying_vehicle("1")
    other_vehicle.values = {"global_position": global_position(-33.0, 151.0, 50.0)}
    fleet.vehicles = [other_vehicle]
    (track,) = tracks.update(clock.monotonic_s() + 5, 0.03).values()
    assert trail_points(track) == []
    # There is only one vehicle, so its position is the origin of the scene.
    assert track.smoother.pose.position_enu_m == pytest.approx((0.0, 0.0, 0.0))


def test_global_positions_are_used_for_the_trail_if_there_are_no_local_positions():
    clock = StillClock()
    vehicle = FakeVehicle(clock=clock, values={"global_position": global_position(47.0, 8.0, 500.0)})
    vehicle.stored_samples = [
        Sample(
            "global_position",
            None,
            clock.unix_s() - ago_s,
            0.0,
            global_position(47.0 - ago_s * 1e-5, 8.0, 500.0),
        )
        for ago_s in (3, 2, 1)
    ]
    (track,) = Tracks(FakeFleet([vehicle]), None, SystemClock()).update(clock.monotonic_s(), 0.03).values()
    assert [p[1] for p in trail_points(track)] == pytest.approx([-3.335, -2.223, -1.112], abs=0.01)


def test_a_replayed_vehicles_trail_uses_the_recordings_time():
    replay_clock, vehicle = StillClock(5.0), flying_vehicle()
    vehicle.clock = replay_clock
    add_flight_north(vehicle, replay_clock, 4)
    tracks = Tracks(FakeFleet([vehicle]), None, SystemClock())
    (track,) = tracks.update(9e5, 0.03).values()  # the server's time differs from the recording's
    assert [p[1] for p in trail_points(track)] == pytest.approx([-4, -3, -2, -1])
    replay_clock.now_s += 2.0  # played at half speed, without a view
    vehicle.stored_samples.append(
        Sample(
            "local_position",
            None,
            replay_clock.unix_s() - 1,
            replay_clock.now_s - 1,
            local_position(1.0, 0.0, -10.0),
        )
    )
    tracks.update(9e5 + 4.0, 0.03)
    assert [p[1] for p in trail_points(track)] == pytest.approx([-4, -3, -2, -1, 1])


def test_a_vehicle_with_an_invalid_position_is_not_drawn_and_the_other_vehicles_are() -> None:
    broken_vehicle, intact_vehicle = flying_vehicle("1"), flying_vehicle("2")
    tracks = Tracks(FakeFleet([broken_vehicle, intact_vehicle]), None, SystemClock())
    broken_vehicle.values["local_position"] = local_position("north", 0.0, -10.0)  # not a number
    assert list(tracks.update(1.0, 0.03)) == ["2"]
    assert intact_vehicle.history_requests == 1, "the trail of the other vehicle was not built"
    (fault,) = tracks.isolation.faults
    assert "vehicle 1" in fault
    broken_vehicle.values["local_position"] = local_position(0.0, 0.0, -10.0)
    assert list(tracks.update(1.1, 0.03)) == ["1", "2"]
    assert tracks.isolation.faults == []
