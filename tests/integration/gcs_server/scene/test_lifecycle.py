"""The 3D view starts, fails and ends; it draws vehicles for slow browsers without delaying other browsers."""

from __future__ import annotations

import asyncio
import os
import socket

import msgspec
import pytest

from gcs_server.scene.host import ViserHost
from gcs_server.scene.messages import SceneError
from gcs_server.scene.proxy import STALLED_AFTER_S, Bridges
from gcs_server.scene.scene import Scene
from gcs_server.scene.vehicle_node import VehicleNode
from tests.integration.gcs_server.scene.scene_server import open_stream, wait_until
from tests.support.viser_camera import CAMERA_MESSAGE
from tests.unit.gcs_server.scene.scene_fakes import StillClock, flying_vehicle


def test_viser_prints_nothing_and_its_folder_is_removed(capfd):
    async def run():
        host = ViserHost()
        await host.start()
        folder = host.socket_path.parent
        await host.stop()
        return folder

    folder = asyncio.run(run())
    assert not folder.exists()
    assert capfd.readouterr().out == ""


def test_folders_of_killed_servers_are_removed_and_other_folders_are_kept(monkeypatch, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    killed, running, starting = (tmp_path / f"gcs-scene-{n}" for n in ("killed", "running", "starting"))
    listeners = []
    for folder in (killed, running, starting):
        folder.mkdir()
        listener = socket.socket(socket.AF_UNIX)
        listener.bind(str(folder / "s"))
        listeners.append(listener)
        if folder is not starting:
            os.utime(folder, (1.0, 1.0))  # an old folder
    listeners[1].listen()  # only the running server listens

    async def run():
        host = ViserHost()
        await host.start()
        await host.stop()

    asyncio.run(run())
    for listener in listeners:
        listener.close()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["gcs-scene-running", "gcs-scene-starting"]


def test_a_scene_that_cannot_start_raises_an_error_with_its_reason(monkeypatch, tmp_path):
    monkeypatch.setattr("tempfile.mkdtemp", lambda **_: str(tmp_path / "gone"))
    with pytest.raises(SceneError, match="3D view could not be started"):
        asyncio.run(ViserHost().start())


def test_vehicles_are_added_one_by_one_and_the_followed_vehicle_first(scene_server, monkeypatch):
    """A new browser must not delay the pictures of other browsers."""
    more_vehicles = [flying_vehicle(name) for name in ("31", "32", "33", "34")]
    real_step, step_times_s, created_nodes = Scene._step, [], []

    def count_step(self, now_s, dt_s):
        step_times_s.append(now_s)
        real_step(self, now_s, dt_s)

    class CountedNode(VehicleNode):
        def __init__(self, client, index, *rest):
            created_nodes.append((len(step_times_s), index))
            super().__init__(client, index, *rest)

    async def run():
        for query in ("", "?vehicle=33"):  # in the second round the server knows all poses
            # A closed view is removed after a moment.
            await wait_until(lambda: scene_server.scene.viewers == 0)
            created_nodes.clear()
            async with open_stream(scene_server, query) as stream:
                await stream.send(msgspec.msgpack.encode(CAMERA_MESSAGE))
                await wait_until(lambda: len(created_nodes) == len(scene_server.fleet.vehicles))

    monkeypatch.setattr(Scene, "_step", count_step)
    monkeypatch.setattr("gcs_server.scene.browser_scene.VehicleNode", CountedNode)
    monkeypatch.setattr(scene_server.fleet, "vehicles", [*scene_server.fleet.vehicles, *more_vehicles])
    asyncio.run(run())
    indices = [index for _, index in created_nodes]
    assert indices[0] == [v.id for v in scene_server.fleet.vehicles].index("33")
    assert sorted(indices) == list(range(len(scene_server.fleet.vehicles)))
    assert len({step for step, _ in created_nodes}) == len(created_nodes), "several vehicles in one step"


def test_drawing_pauses_for_a_browser_that_does_not_read(scene_server, monkeypatch):
    vehicle = scene_server.fleet.vehicles[0]

    async def run():
        await wait_until(lambda: scene_server.scene.viewers == 0)
        async with open_stream(scene_server) as stream:
            await stream.send(msgspec.msgpack.encode(CAMERA_MESSAGE))
            await wait_until(lambda: scene_server.scene.viewers == 1 and vehicle.topic_reads > 0)
            monkeypatch.setattr(Bridges, "is_stalled", lambda self, bridge: bridge != "")
            await asyncio.sleep(0.1)
            reads_before = vehicle.topic_reads
            await asyncio.sleep(0.3)
            assert vehicle.topic_reads == reads_before
            assert scene_server.scene.viewers == 1
            monkeypatch.setattr(Bridges, "is_stalled", lambda self, bridge: False)
            await wait_until(lambda: vehicle.topic_reads > reads_before)

    asyncio.run(run())


def test_a_browser_is_stalled_after_a_message_has_waited_for_more_than_a_second():
    clock = StillClock()
    bridges = Bridges(clock)
    with bridges.open_bridge() as bridge, bridges.open_bridge() as other_bridge:
        assert bridges.names() == {bridge, other_bridge}
        assert not bridges.is_stalled(bridge)
        with bridges.sending(bridge):
            clock.now_s += STALLED_AFTER_S
            assert not bridges.is_stalled(bridge)
            clock.now_s += 0.1
            assert bridges.stalled_names() == [bridge]
            assert not bridges.is_stalled(other_bridge)
        assert not bridges.is_stalled(bridge)
    assert not bridges.names()
