"""Snapshots from the server to the process of the 3D view, and the mirror of the fleet in that process."""

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
from tests.unit.gcs_server.scene.scene_fakes import (
    FakeFleet,
    StillClock,
    flying_vehicle,
    local_position,
    status,
)


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
    vehicle = flying_vehicle("1")
    setup = BuilderAndMirror(vehicle, offboard=lambda _: ((1.0, 2.0, 3.0), None, 0.5))
    setup.step(stalled=["7"])
    mirrored_vehicle = setup.mirror.get("1")
    for topic in DRAWN_TOPICS:
        sample, mirrored_sample = vehicle.topic(topic), mirrored_vehicle.topic(topic)
        assert (mirrored_sample and mirrored_sample.value) == (sample and sample.value)
    assert (mirrored_vehicle.identity.simulated, mirrored_vehicle.identity.replayed) == (True, False)
    assert setup.mirror.target("1") == OffboardTarget((1.0, 2.0, 3.0), None, 0.5)
    assert setup.mirror.stalled == {"7"}


def test_only_changed_samples_are_sent():
    vehicle = flying_vehicle("1")
    setup = BuilderAndMirror(vehicle)
    setup.step()
    assert setup.step().changed[0].samples == []
    vehicle.received_monotonic_s = 5.0
    assert {s.topic for s in setup.step().changed[0].samples} == set(vehicle.values)


def test_a_topic_without_a_value_is_removed():
    vehicle = flying_vehicle("1")
    setup = BuilderAndMirror(vehicle)
    setup.step()
    vehicle.values.pop("gimbal")
    assert setup.step().changed[0].missing_topics == ["gimbal"]
    assert setup.mirror.get("1").topic("gimbal") is None
    assert setup.step().changed[0].missing_topics == []


def test_vehicles_that_no_view_follows_are_in_every_third_snapshot():
    setup = BuilderAndMirror(*(flying_vehicle(str(i)) for i in range(1, 8)))
    assert len(setup.step("4").changed) == 7
    ids_of_snapshots = [[v.id for v in setup.step("4").changed] for _ in range(3)]
    assert all("4" in ids for ids in ids_of_snapshots)
    assert sorted(i for ids in ids_of_snapshots for i in ids if i != "4") == ["1", "2", "3", "5", "6", "7"]
    assert [v.id for v in setup.mirror.all()] == [str(i) for i in range(1, 8)]


def test_a_new_vehicle_with_the_id_of_a_removed_vehicle_is_another_vehicle():
    setup = BuilderAndMirror(flying_vehicle("1"), flying_vehicle("2"))
    setup.step()
    earlier_vehicle = setup.mirror.get("1")
    setup.fleet.vehicles[0] = flying_vehicle("1")
    setup.step()
    assert setup.mirror.get("1") is not earlier_vehicle
    setup.fleet.vehicles = setup.fleet.vehicles[1:]
    setup.step()
    with pytest.raises(UnknownVehicle):
        setup.mirror.get("1")


def test_a_vehicle_that_cannot_be_read_is_reported_and_the_other_vehicles_are_drawn():
    broken_vehicle = flying_vehicle("1")
    setup = BuilderAndMirror(broken_vehicle, flying_vehicle("2"))
    broken_vehicle.values["attitude"] = object()  # cannot be encoded
    setup.step()
    assert [v.id for v in setup.mirror.all()] == ["2"]
    (fault,) = setup.builder.faults
    assert "vehicle 1" in fault


def test_a_vehicle_whose_snapshot_cannot_be_decoded_is_reported_and_the_other_vehicles_are_drawn():
    broken_vehicle = flying_vehicle("1")
    setup = BuilderAndMirror(broken_vehicle, flying_vehicle("2"))
    broken_vehicle.values["attitude"] = status()
    setup.step()
    assert setup.mirror.get("2").topic("attitude") is not None
    (fault,) = setup.mirror.faults
    assert "vehicle 1" in fault


def test_a_trail_is_built_once_the_server_has_sent_the_history():
    clock, vehicle = StillClock(), flying_vehicle("1")
    vehicle.clock = clock
    for ago_s in (3, 2, 1):
        position = local_position(-10.0 * ago_s, 0.0, -10.0)
        vehicle.stored_samples.append(
            Sample("local_position", None, clock.unix_s() - ago_s, clock.now_s - ago_s, position)
        )
    setup = BuilderAndMirror(vehicle)
    setup.step()
    tracks = Tracks(setup.mirror, None, SystemClock())
    for i in range(3):
        (track,) = tracks.update(i * 0.03, 0.03).values()
    assert track.trail.recent == []
    (request,) = setup.requests
    setup.mirror.store_history(request[0], setup.builder.history(*request))
    tracks.update(0.1, 0.03)
    assert [p[1] for p in track.trail.recent] == pytest.approx([-30.0, -20.0, -10.0])
    tracks.update(0.13, 0.03)
    assert len(setup.requests) == 1


def test_a_history_that_is_received_after_a_pause_is_not_used():
    clock, vehicle = StillClock(), flying_vehicle("1")
    vehicle.clock = clock
    setup = BuilderAndMirror(vehicle)
    setup.step()
    mirrored_vehicle = setup.mirror.get("1")
    assert mirrored_vehicle.history(("local_position",), 0.0) is None
    setup.mirror.store_history(setup.requests[0][0], setup.builder.history(*setup.requests[0]))
    clock.now_s += 30.0
    setup.step()
    assert mirrored_vehicle.history(("local_position",), 0.0) is None
    assert len(setup.requests) == 2


def test_the_history_of_a_removed_vehicle_is_empty():
    setup = BuilderAndMirror(flying_vehicle("1"))
    setup.step()
    setup.fleet.vehicles = []
    setup.step()
    assert msgspec.msgpack.decode(setup.builder.history(1, ("local_position",), 0.0)) == []
    setup.mirror.store_history(1, setup.builder.history(1, ("local_position",), 0.0))
