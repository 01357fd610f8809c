"""A 3D scene with its own HTTP server, for tests with real connections."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager

import msgspec
import uvicorn
import viser
from fastapi import APIRouter, FastAPI
from fastapi.responses import JSONResponse
from websockets.asyncio.client import connect
from zstandard import ZstdDecompressor

from gcs_server.clock import SystemClock
from gcs_server.errors import Refused
from gcs_server.scene.clicks import ClickRequest, SceneClick
from gcs_server.scene.gizmo import GROUND_HANDLE, SceneGizmo
from gcs_server.scene.host import ViserHost
from gcs_server.scene.messages import ViewRequest, ViserAddress
from gcs_server.scene.proxy import Bridges, ShownView, scene_router
from gcs_server.scene.scene import Scene
from gcs_server.supervise import Supervisor
from tests.unit.gcs_server.scene.scene_fakes import FakeFleet, flying_vehicle


class SceneServer:
    """A scene with its own HTTP server on a free port. The scene is drawn in the test's process."""

    def __init__(self) -> None:
        self.fleet = FakeFleet([flying_vehicle("1"), flying_vehicle("2")])
        self.clicks: list[SceneClick] = []
        self.gizmos: list[SceneGizmo] = []
        self.bridges = Bridges(SystemClock())
        self.scene = Scene(
            self.fleet,
            SystemClock(),
            on_gizmo=self.gizmos.append,
            stalled=lambda bridge: self.bridges.is_stalled(bridge),
        )
        self.address: ViserAddress | None = None
        self.port = 0

    def router(self) -> APIRouter:
        return scene_router(lambda: self.address, self._set_view, self._click, self.scene.drag, self.bridges)

    async def draw(self) -> None:
        while True:
            self.scene.draw()
            await asyncio.sleep(1 / 30)

    async def _set_view(self, token: str, request: ViewRequest) -> ShownView:
        view = self.scene.set_view(token, request)
        return view.mode, view.vehicle, view.theme

    async def _click(self, token: str, request: ClickRequest) -> SceneClick | None:
        click = self.scene.click(token, request)
        self.clicks += [] if click is None else [click]
        return click

    @property
    def host(self) -> ViserHost:
        return self.scene._host

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}/scene/"

    @property
    def stream_url(self) -> str:
        return f"ws://127.0.0.1:{self.port}/scene/"


@asynccontextmanager
async def running_scene_server(scene_server: SceneServer):
    clock = SystemClock()
    supervisor = Supervisor(clock)
    app = FastAPI()
    app.include_router(scene_server.router())
    app.exception_handler(Refused)(lambda _r, e: JSONResponse({"detail": str(e)}, 409))
    server = uvicorn.Server(
        uvicorn.Config(app, host="127.0.0.1", port=0, log_level="error", timeout_graceful_shutdown=1)
    )
    server.install_signal_handlers = lambda: None
    task = supervisor.spawn("http", server.serve())
    scene_server.address = await scene_server.scene.start()
    supervisor.start("scene", scene_server.draw)
    while not server.started:  # noqa: ASYNC110 uvicorn has no event for its start
        await asyncio.sleep(0.01)
    scene_server.port = server.servers[0].sockets[0].getsockname()[1]
    try:
        yield scene_server
    finally:
        server.should_exit = True
        await task
        await supervisor.close()
        await scene_server.scene.stop()


async def wait_until(condition, seconds: float = 20.0):
    async with asyncio.timeout(seconds):
        while not condition():  # noqa: ASYNC110 the condition has no event
            await asyncio.sleep(0.02)


PROTOCOL = f"viser-v{viser.__version__}"

CLICK_NORTH: dict[str, object] = {
    "eye_enu_m": [0, 0, 10],
    "ray_enu": [0, 1, -1],
    "view_x": 0.5,
    "view_y": 0.6,
}
"""Body of a click request whose ray meets the ground 10 m north of the origin."""
DRAG_MESSAGE = {
    "type": "TransformControlsUpdateMessage",
    "name": GROUND_HANDLE,
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (3.0, 4.0, 5.0),
    "owner": "client:1",
}
"""viser's message while the ground handle is dragged."""


def message_types(data: bytes) -> list[str]:
    """Types of viser's messages in one frame: two lengths, then the compressed messages, then buffers."""
    size, compressed = int.from_bytes(data[:8], "little"), int.from_bytes(data[8:16], "little")
    inner = ZstdDecompressor().decompress(data[16 : 16 + compressed], max_output_size=size)
    return [m["type"] for m in msgspec.msgpack.decode(inner)["messages"]]


def open_stream(scene_server: SceneServer, query: str = "", **options):
    options.setdefault("max_size", None)
    return connect(scene_server.stream_url + query, subprotocols=[PROTOCOL], **options)
