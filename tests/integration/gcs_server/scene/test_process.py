"""The process of the 3D view: pictures and clicks, and its behaviour when it dies, hangs or cannot start."""

from __future__ import annotations

import asyncio
import os
import signal
import time
from contextlib import asynccontextmanager
from pathlib import Path

import httpx
import msgspec
import pytest
import uvicorn
from fastapi import FastAPI
from fastapi.responses import JSONResponse
from websockets.asyncio.client import connect

from gcs_server.clock import SystemClock
from gcs_server.errors import GcsError, UnknownVehicle
from gcs_server.scene import process as scene_process
from gcs_server.scene.messages import SceneError
from gcs_server.scene.process import SceneProcess
from gcs_server.supervise import Supervisor
from tests.integration.gcs_server.scene.scene_server import (
    CLICK_NORTH,
    DRAG_MESSAGE,
    PROTOCOL,
    message_types,
    wait_until,
)
from tests.support.viser_camera import CAMERA_MESSAGE
from tests.unit.gcs_server.scene.scene_fakes import FakeFleet, flying_vehicle, local_position

pack = msgspec.msgpack.encode


class SceneProcessServer:
    """A server that runs the 3D view in a separate process."""

    def __init__(self) -> None:
        self.fleet = FakeFleet([flying_vehicle("1"), flying_vehicle("2")])
        self.clicks, self.gizmos = [], []
        self.scene = SceneProcess(
            self.fleet, SystemClock(), on_click=self.clicks.append, on_gizmo=self.gizmos.append
        )
        self.address = ""

    @property
    def url(self) -> str:
        return f"http://{self.address}/scene/"

    def open_stream(self, query: str = ""):
        return connect(f"ws://{self.address}/scene/{query}", subprotocols=[PROTOCOL], max_size=None)

    async def wait_until_up(self, http: httpx.AsyncClient, previous_pid: int | None = None) -> None:
        """Waits until the 3D view is available in a process whose id is not `before`."""
        async with asyncio.timeout(60):
            # There is no event for a started view.
            while self.scene.pid == previous_pid or (await http.get(self.url)).status_code != 200:  # noqa: ASYNC110
                await asyncio.sleep(0.05)


@asynccontextmanager
async def serving():
    scene_server, supervisor, app = SceneProcessServer(), Supervisor(SystemClock()), FastAPI()
    app.include_router(scene_server.scene.router())
    app.exception_handler(GcsError)(lambda _r, e: JSONResponse({"code": e.code, "detail": str(e)}, 409))
    server = uvicorn.Server(
        uvicorn.Config(app, host="127.0.0.1", port=0, log_level="error", timeout_graceful_shutdown=1)
    )
    server.install_signal_handlers = lambda: None
    task = supervisor.spawn("http", server.serve())
    supervisor.start("scene", scene_server.scene.run)
    await wait_until(lambda: server.started)
    scene_server.address = f"127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}"
    try:
        async with httpx.AsyncClient() as http:
            yield scene_server, http
    finally:
        server.should_exit = True
        await task
        await supervisor.close()


def test_a_view_shows_the_fleet_and_handles_clicks_and_drags():
    async def run():
        async with serving() as (scene_server, http):
            assert (await http.get(scene_server.url)).status_code == 503
            assert scene_server.scene.warning() is None, "the start is reported as a failure"
            await scene_server.wait_until_up(http)
            async with scene_server.open_stream("?view=page&vehicle=2") as stream:
                await stream.send(pack(CAMERA_MESSAGE))
                received_types: set[str] = set()
                async with asyncio.timeout(30):
                    while not {"MeshMessage", "LineSegmentsMessage"} <= received_types:
                        received_types |= set(message_types(await stream.recv()))
                await wait_until(lambda: scene_server.scene.viewers == 1)
                response = await http.post(scene_server.url + "view/page/click", json=CLICK_NORTH)
                assert response.json() == {"ground": True}
                assert (scene_server.clicks[0].view, scene_server.clicks[0].vehicle) == (
                    "page",
                    "2",
                )
                preview = {"position_ned_m": [0, 0, -5], "yaw_ned_rad": 0, "handles": True}
                response = await http.post(
                    scene_server.url + "view/page", json={"mode": "free", "preview": preview}
                )
                assert response.json() == {"mode": "free", "vehicle": "2", "theme": "dark"}
                await stream.send(pack(DRAG_MESSAGE))
                await wait_until(lambda: scene_server.gizmos)
                assert scene_server.gizmos[0].vehicle == "2"
                response = await http.post(scene_server.url + "view/page", json={"vehicle": "9"})
                assert response.json()["code"] == UnknownVehicle.code
                for step in range(200):
                    scene_server.fleet.vehicles[1].values["local_position"] = local_position(
                        step * 0.2, 0.0, -10.0
                    )
                    scene_server.fleet.vehicles[1].received_monotonic_s += 0.1
                    if step > 20 and "SetPositionMessage" in message_types(await stream.recv()):
                        break
                else:
                    raise AssertionError("the vehicle does not move")
            await wait_until(lambda: scene_server.scene.viewers == 0)

    asyncio.run(run())


def test_a_killed_process_is_restarted_with_its_views_and_leaves_no_folder():
    async def run():
        async with serving() as (scene_server, http):
            await scene_server.wait_until_up(http)
            await http.post(scene_server.url + "view/page", json={"mode": "top", "vehicle": "2"})
            first_pid, folder = (
                scene_server.scene.pid,
                Path(scene_server.scene._run.address.socket_path).parent,
            )
            assert folder.exists()
            async with scene_server.open_stream("?view=page") as stream:
                await stream.send(pack(CAMERA_MESSAGE))
                os.kill(first_pid, signal.SIGKILL)
                async with asyncio.timeout(10):
                    await stream.wait_closed()
            await wait_until(lambda: scene_server.scene.warning() is not None)
            assert "Flying is not affected" in scene_server.scene.warning()
            response = await http.post(scene_server.url + "view/page", json={"theme": "light"})
            assert response.json()["code"] == SceneError.code
            await scene_server.wait_until_up(http, previous_pid=first_pid)
            assert scene_server.scene.warning() is None
            assert not folder.exists()
            response = await http.post(scene_server.url + "view/page", json={"theme": "light"})
            assert response.json() == {"mode": "top", "vehicle": "2", "theme": "light"}

    asyncio.run(run())


@pytest.mark.story
def test_a_hanging_process_does_not_block_the_event_loop_and_is_replaced(monkeypatch):
    monkeypatch.setattr(scene_process, "HUNG_AFTER_S", 1.0)
    monkeypatch.setattr("gcs_server.scene.handle.END_TIMEOUT_S", 0.2)

    async def run():
        async with serving() as (scene_server, http):
            await scene_server.wait_until_up(http)
            first_pid = scene_server.scene.pid
            async with scene_server.open_stream() as stream:
                await stream.send(pack(CAMERA_MESSAGE))
                await wait_until(lambda: scene_server.scene.viewers == 1)
                os.kill(first_pid, signal.SIGSTOP)
                longest_delay_s = 0.0
                while scene_server.scene.pid == first_pid:
                    began_s = time.monotonic()
                    await asyncio.sleep(0.01)
                    longest_delay_s = max(longest_delay_s, time.monotonic() - began_s - 0.01)
            await scene_server.wait_until_up(http, previous_pid=first_pid)
            return first_pid, longest_delay_s

    first_pid, longest_delay_s = asyncio.run(run())
    assert not Path(f"/proc/{first_pid}").exists()
    assert longest_delay_s < 0.5, "the event loop was blocked"


def test_the_process_ends_with_the_server_and_removes_its_folder():
    async def run():
        async with serving() as (scene_server, http):
            await scene_server.wait_until_up(http)
            return scene_server.scene.pid, Path(scene_server.scene._run.address.socket_path).parent

    pid, folder = asyncio.run(run())
    assert not Path(f"/proc/{pid}").exists()
    assert not folder.exists()


def test_a_process_that_cannot_start_is_reported_and_tried_again(monkeypatch):
    monkeypatch.setattr("sys.executable", "/bin/false")

    async def run():
        scene = SceneProcess(FakeFleet(), SystemClock())
        with pytest.raises(SceneError, match="3D view has ended"):
            await scene.run()
        assert scene.pid is None
        return scene.warning()

    assert "started again" in asyncio.run(run())
