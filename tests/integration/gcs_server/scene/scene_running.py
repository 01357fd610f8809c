"""A scene behind a server of its own, for the tests that need the wire."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager

import uvicorn
import viser
from fastapi import FastAPI
from fastapi.responses import JSONResponse
from websockets.asyncio.client import connect

from gcs_server.clock import SystemClock
from gcs_server.errors import Refused, UnknownVehicle
from gcs_server.scene import SceneClick, SceneGizmo
from gcs_server.scene.host import ViserHost
from gcs_server.scene.scene import Scene
from gcs_server.supervise import Supervisor
from tests.unit.gcs_server.scene.scene_fakes import FakeFleet, flying


class Running:
    """A scene behind a server of its own, on a free port."""

    def __init__(self) -> None:
        self.fleet = FakeFleet([flying("1"), flying("2")])
        self.clicks: list[SceneClick] = []
        self.gizmos: list[SceneGizmo] = []
        self.scene = Scene(
            self.fleet, SystemClock(), on_click=self.clicks.append, on_gizmo=self.gizmos.append
        )
        self.port = 0
        self.shares: list[str] = []

    @property
    def host(self) -> ViserHost:
        return self.scene._host

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}/scene/"

    @property
    def stream(self) -> str:
        return f"ws://127.0.0.1:{self.port}/scene/"


@asynccontextmanager
async def serving(running: Running):
    clock = SystemClock()
    supervisor = Supervisor(clock)
    app = FastAPI()
    app.include_router(running.scene.router())
    app.exception_handler(UnknownVehicle)(lambda _r, e: JSONResponse({"detail": str(e)}, 404))
    app.exception_handler(Refused)(lambda _r, e: JSONResponse({"detail": str(e)}, 409))
    server = uvicorn.Server(
        uvicorn.Config(app, host="127.0.0.1", port=0, log_level="error", timeout_graceful_shutdown=1)
    )
    server.install_signal_handlers = lambda: None
    task = supervisor.spawn("http", server.serve())
    await running.scene.start()
    supervisor.start("scene", running.scene.run)
    while not server.started:  # noqa: ASYNC110 uvicorn has no event for it
        await asyncio.sleep(0.01)
    running.port = server.servers[0].sockets[0].getsockname()[1]
    try:
        yield running
    finally:
        server.should_exit = True
        await task
        await supervisor.close()
        await running.scene.stop()


async def eventually(condition, seconds: float = 20.0):
    async with asyncio.timeout(seconds):
        while not condition():  # noqa: ASYNC110 what is waited for has no event
            await asyncio.sleep(0.02)


PROTOCOL = f"viser-v{viser.__version__}"
CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (-3.0, 0.0, 1.0),
    "fov": 0.8,
    "near": 0.1,
    "far": 100.0,
    "image_height": 100,
    "image_width": 100,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}


def open_stream(running: Running, query: str = "", **options):
    options.setdefault("max_size", None)
    return connect(running.stream + query, subprotocols=[PROTOCOL], **options)
