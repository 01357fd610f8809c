"""Snapshots from the server to the process of the 3D view, and the fleet that this process builds."""

from __future__ import annotations

import msgspec
import pytest

from gcs_server.clock import SystemClock
from gcs_server.errors import UnknownVehicle
from gcs_server.scene.mirror import MirrorFleet
from gcs_server.scene.ports import OffboardTarget
from gcs_server.scene.snapshots import DRAWN_TOPICS, SnapshotBuilder, SnapshotData
from gcs_server.scene.tracks import Tracks
from gcs_server.vehicle.samples import Sample
from tests.unit.gcs_server.scene.scene_fakes import FakeFleet, StillClock, flying, local, status


class BuilderAndMirror:
    """A snapshot builder and the mirror that gets its snapshots."""

    def __init__(self, *vehicles, offboard=None):
        self.fleet = FakeFleet(list(vehicles))
        self.builder = SnapshotBuilder(self.fleet, offboard, StillClock())
        self.requests: list[tuple[int, tuple[str, ...], float]] = []
        self.mirror = MirrorFleet(lambda *request: self.requests.append(request))

    def step(self, *followed: str, stalled=()) -> SnapshotData:
        data = self.builder.snapshot(set(followed), stalled)
        self.mirror.apply(data)
        return msgspec.msgpack.decode(data, type=SnapshotData)


def test_the_mirror_has_all_drawn_topics():
    one = flying("1")
    both = BuilderAndMirror(one, offboard=lambda _: ((1.0, 2.0, 3.0), None, 0.5))
    both.step(stalled=["7"])
    seen = both.mirror.get("1")
    for topic in DRAWN_TOPICS:
        expected, found = one.topic(topic), seen.topic(topic)
        assert (found and found.value) == (expected and expected.value)
    assert (seen.identity.simulated, seen.identity.replayed) == (True, False)
    assert both.mirror.target("1") == OffboardTarget((1.0, 2.0, 3.0), None, 0.5)
    assert both.mirror.stalled == {"7"}


def test_only_changed_samples_are_sent():
    vehicle = flying("1")
    both = BuilderAndMirror(vehicle)
    both.step()
    assert both.step().changed[0].samples == []
    vehicle.received_monotonic_s = 5.0
    assert {s.topic for s in both.step().changed[0].samples} == set(vehicle.values)


def test_a_topic_that_becomes_unusable_is_removed():
    vehicle = flying("1")
    both = BuilderAndMirror(vehicle)
    both.step()
    vehicle.values.pop("gimbal")
    assert both.step().changed[0].missing_topics == ["gimbal"]
    assert both.mirror.get("1").topic("gimbal") is None
    assert both.step().changed[0].missing_topics == []


def test_vehicles_that_no_view_follows_are_in_every_third_snapshot():
    both = BuilderAndMirror(*(flying(str(i)) for i in range(1, 8)))
    assert len(both.step("4").changed) == 7
    ids = [[v.id for v in both.step("4").changed] for _ in range(3)]
    assert all("4" in each for each in ids)
    assert sorted(i for each in ids for i in each if i != "4") == ["1", "2", "3", "5", "6", "7"]
    assert [v.id for v in both.mirror.all()] == [str(i) for i in range(1, 8)]


def test_a_vehicle_under_the_id_of_a_removed_one_is_another_vehicle():
    both = BuilderAndMirror(flying("1"), flying("2"))
    both.step()
    before = both.mirror.get("1")
    both.fleet.vehicles[0] = flying("1")
    both.step()
    assert both.mirror.get("1") is not before
    both.fleet.vehicles = both.fleet.vehicles[1:]
    both.step()
    with pytest.raises(UnknownVehicle):
        both.mirror.get("1")


def test_a_vehicle_that_cannot_be_read_is_reported_and_the_others_are_drawn():
    broken = flying("1")
    both = BuilderAndMirror(broken, flying("2"))
    broken.values["attitude"] = object()  # cannot be encoded
    both.step()
    assert [v.id for v in both.mirror.all()] == ["2"]
    (fault,) = both.builder.faults
    assert "vehicle 1" in fault


def test_a_vehicle_whose_snapshot_cannot_be_decoded_is_reported_and_the_others_are_drawn():
    broken = flying("1")
    both = BuilderAndMirror(broken, flying("2"))
    broken.values["attitude"] = status()
    both.step()
    assert both.mirror.get("2").topic("attitude") is not None
    (fault,) = both.mirror.faults
    assert "vehicle 1" in fault


def test_a_trail_is_built_once_the_server_has_sent_the_history():
    clock, vehicle = StillClock(), flying("1")
    vehicle.clock = clock
    for ago_s in (3, 2, 1):
        at = local(-10.0 * ago_s, 0.0, -10.0)
        vehicle.past.append(Sample("local_position", None, clock.unix_s() - ago_s, clock.now_s - ago_s, at))
    both = BuilderAndMirror(vehicle)
    both.step()
    tracks = Tracks(both.mirror, None, SystemClock())
    for i in range(3):
        (track,) = tracks.update(i * 0.03, 0.03).values()
    assert track.trail.recent == []
    (request,) = both.requests
    both.mirror.take_history(request[0], both.builder.history(*request))
    tracks.update(0.1, 0.03)
    assert [p[1] for p in track.trail.recent] == pytest.approx([-30.0, -20.0, -10.0])
    tracks.update(0.13, 0.03)
    assert len(both.requests) == 1


def test_a_history_that_comes_after_a_pause_is_not_used():
    clock, vehicle = StillClock(), flying("1")
    vehicle.clock = clock
    both = BuilderAndMirror(vehicle)
    both.step()
    seen = both.mirror.get("1")
    assert seen.history(("local_position",), 0.0) is None
    both.mirror.take_history(both.requests[0][0], both.builder.history(*both.requests[0]))
    clock.now_s += 30.0
    both.step()
    assert seen.history(("local_position",), 0.0) is None
    assert len(both.requests) == 2


def test_the_history_of_a_removed_vehicle_is_empty():
    both = BuilderAndMirror(flying("1"))
    both.step()
    both.fleet.vehicles = []
    both.step()
    assert msgspec.msgpack.decode(both.builder.history(1, ("local_position",), 0.0)) == []
    both.mirror.take_history(1, both.builder.history(1, ("local_position",), 0.0))
