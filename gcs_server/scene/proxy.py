"""The proxy on the server's port that gives browsers their only access to the 3D view (viser).

`GET /scene/` returns viser's web page, `WS /scene/` is the stream of this page. `POST /scene/view/{token}`
sets the content of one view, `POST /scene/view/{token}/click` reports a click in this view. Over the stream a
browser may send the pose of its camera, and drags of the preview's two handles (`gizmo.py`), which are not
passed to viser. All other messages are dropped, especially requests for a public tunnel.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Awaitable, Callable, Generator
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import partial
from typing import Any
from urllib.parse import urlencode

import msgspec
import websockets.asyncio.client
from fastapi import APIRouter, Request, Response, WebSocket
from starlette.websockets import WebSocketDisconnect
from websockets.exceptions import ConnectionClosed, WebSocketException
from websockets.typing import Subprotocol

from gcs_server.clock import Clock
from gcs_server.encodings import accepted_encodings
from gcs_server.errors import Refused
from gcs_server.origin import is_same_origin
from gcs_server.scene.clicks import ClickRequest, SceneClick
from gcs_server.scene.gizmo import Drag, MovedMessage, ReleasedMessage, parse_drag
from gcs_server.scene.messages import BRIDGE_KEY, SECRET_HEADER, TOKEN, ViewRequest, ViserAddress
from gcs_server.scene.page import content_policy, page

log = logging.getLogger(__name__)

MAX_FROM_BROWSER = 4096
"""Maximum size of a browser's message [bytes]; a camera message has about 300 bytes."""
MAX_TO_BROWSER = 64 * 1024 * 1024
QUERY_KEYS = ("view", "theme", "language", "mode", "vehicle")


class CameraMessage(
    msgspec.Struct, tag_field="type", tag="ViewerCameraMessage", frozen=True, forbid_unknown_fields=True
):
    """Pose of a browser's camera: viser's ViewerCameraMessage, the only message that is passed to viser."""

    wxyz: tuple[float, float, float, float]
    position: tuple[float, float, float]
    fov: float
    near: float
    far: float
    image_height: int
    image_width: int
    look_at: tuple[float, float, float]
    up_direction: tuple[float, float, float]


_decoder = msgspec.msgpack.Decoder(CameraMessage | MovedMessage | ReleasedMessage)

STALLED_AFTER_S = 1.0
TRY_AGAIN = 1013
"""Close code "try again later": the 3D view is not running now."""

ShownView = tuple[str, str | None, str]
"""Content of a view: mode, vehicle (None: the first vehicle), theme."""


class Bridges:
    """The open bridges and their state. A bridge is a connection between a browser and viser. It is stalled
    while the browser does not read; nothing is drawn for that browser."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._count = 0
        self._names: set[str] = set()
        self._sending_since_s: dict[str, float] = {}

    @contextmanager
    def open_bridge(self) -> Generator[str]:
        """The name of a new bridge, which is open during the block."""
        self._count += 1
        name = str(self._count)
        self._names.add(name)
        try:
            yield name
        finally:
            self._names.discard(name)

    def names(self) -> frozenset[str]:
        """All open bridges."""
        return frozenset(self._names)

    def stalled_names(self) -> list[str]:
        """Names of the stalled bridges."""
        return [name for name in self._sending_since_s if self.is_stalled(name)]

    def is_stalled(self, bridge: str) -> bool:
        """Whether sending one message to the browser has taken longer than `STALLED_AFTER_S`."""
        since_s = self._sending_since_s.get(bridge)
        return since_s is not None and self._clock.monotonic_s() - since_s > STALLED_AFTER_S

    @contextmanager
    def sending(self, bridge: str) -> Generator[None]:
        """Measures the sending of one message."""
        self._sending_since_s[bridge] = self._clock.monotonic_s()
        try:
            yield
        finally:
            del self._sending_since_s[bridge]


def parse_message(data: bytes) -> bytes | Drag | None:
    """Parses a browser's message: a camera message for viser (encoded again) or a drag; None for any other
    message."""
    if len(data) > MAX_FROM_BROWSER:
        return None
    try:
        message = _decoder.decode(data)
    except (msgspec.MsgspecError, UnicodeDecodeError):
        return None
    return _encode_camera(message) if isinstance(message, CameraMessage) else parse_drag(message)


def _encode_camera(message: CameraMessage) -> bytes | None:
    """Encodes a camera message for viser; None if a value is not finite or the camera has no direction,
    because viser would raise an exception later."""
    values = (*message.wxyz, *message.position, *message.look_at, *message.up_direction)
    if not all(map(math.isfinite, (*values, message.fov, message.near, message.far))):
        return None
    if message.position == message.look_at or not any(message.up_direction) or not any(message.wxyz):
        return None
    return msgspec.msgpack.encode(message)


def scene_router(
    address: Callable[[], ViserAddress | None],
    set_view: Callable[[str, ViewRequest], Awaitable[ShownView]],
    click: Callable[[str, ClickRequest], Awaitable[SceneClick | None]],
    drag: Callable[[str, Drag], None],
    bridges: Bridges,
) -> APIRouter:
    """The routes below `/scene`.

    Args:
        address: returns the address of viser; None while viser does not run.
        set_view: sets the content of the view with a token; raises UnknownVehicle.
        click: sends the clicked ground position to the page with the view's token; returns None if the click
            was not on the ground.
        drag: called with the bridge when a handle was dragged.
        bridges: the bridges to all browsers.
    """
    router = APIRouter(prefix="/scene", include_in_schema=False)

    @router.api_route("/", methods=["GET", "HEAD"])  # HEAD: whether the 3D view is running
    async def program(request: Request) -> Response:
        if address() is None:
            return Response("The 3D view is not running; flying is not affected.", status_code=503)
        document = page()
        headers = {
            "Content-Security-Policy": content_policy(
                request.headers.get("host", ""), secure=request.url.scheme == "https"
            ),
            "ETag": document.etag,
            "Cache-Control": "no-cache",
            "Vary": "Accept-Encoding",
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
        }
        if request.headers.get("if-none-match") == document.etag:
            return Response(status_code=304, headers=headers)
        body = document.plain
        if "gzip" in accepted_encodings(request.headers.get("accept-encoding", "")):
            body, headers["Content-Encoding"] = document.gzipped, "gzip"
        return Response(body, media_type="text/html; charset=utf-8", headers=headers)

    @router.post("/view/{token}")
    async def choose_view(token: str, request_body: ViewRequest, request: Request) -> dict[str, Any]:
        _require_own_page(token, request)
        mode, vehicle, theme = await set_view(token, request_body)
        return {"mode": mode, "vehicle": vehicle, "theme": theme}

    @router.post("/view/{token}/click")
    async def clicked(token: str, body: ClickRequest, request: Request) -> dict[str, Any]:
        _require_own_page(token, request)
        scene_click = await click(token, body)
        return {"ground": scene_click is not None}

    @router.websocket("/")
    async def stream(websocket: WebSocket) -> None:
        if not is_same_origin(websocket.headers):
            log.warning("3D view refused to a page of %s", websocket.headers.get("origin"))
            await websocket.close(code=1008)  # before accept: HTTP 403
            return
        viser = address()
        if viser is None:
            await websocket.close(code=TRY_AGAIN)
            return
        with bridges.open_bridge() as bridge:
            await _run_bridge(websocket, viser, bridge, bridges, drag)

    return router


def _require_own_page(token: str, request: Request) -> None:
    if not is_same_origin(request.headers):
        raise Refused("A page of another origin may not control the 3D view.")
    if not TOKEN.fullmatch(token):
        raise Refused(
            "The token of a view must have 1 to 64 letters, digits, - or _.",
            remedy="Use the token in the frame's own address, ?view=….",
        )


async def _run_bridge(
    websocket: WebSocket,
    viser: ViserAddress,
    bridge: str,
    bridges: Bridges,
    drag: Callable[[str, Drag], None],
) -> None:
    query = {k: v for k in QUERY_KEYS if (v := websocket.query_params.get(k)) and len(v) <= 64}
    subprotocols = [
        Subprotocol(p) for p in websocket.scope.get("subprotocols", []) if p.startswith("viser-v")
    ]
    try:
        upstream = await websockets.asyncio.client.unix_connect(
            viser.socket_path,
            f"ws://scene/?{urlencode({**query, BRIDGE_KEY: bridge})}",
            subprotocols=subprotocols or None,
            additional_headers={SECRET_HEADER: viser.secret},
            compression=None,
            max_size=MAX_TO_BROWSER,
            user_agent_header=None,
        )
    except (OSError, WebSocketException) as error:
        log.warning("3D view not available: %s", error)
        await websocket.close(code=TRY_AGAIN)
        return
    async with upstream:
        await websocket.accept(subprotocol=upstream.subprotocol)
        async with asyncio.TaskGroup() as tasks:
            sending = partial(bridges.sending, bridge)
            tasks.create_task(_to_browser(upstream, websocket, sending), name="scene to browser")
            tasks.create_task(
                _from_browser(websocket, upstream, partial(drag, bridge)), name="scene from browser"
            )


async def _to_browser(
    upstream: websockets.asyncio.client.ClientConnection,
    websocket: WebSocket,
    sending: Callable[[], AbstractContextManager[None]],
) -> None:
    try:
        # One message at a time, so that viser waits for a slow browser and keeps only the newest message.
        with suppress(ConnectionClosed):  # viser's process has died
            async for data in upstream:
                if isinstance(data, bytes):
                    with sending():
                        await websocket.send_bytes(data)
        code = upstream.close_code
        await websocket.close(code=TRY_AGAIN if code in (None, 1006) else code)
    except (ConnectionClosed, WebSocketDisconnect, RuntimeError, OSError):
        await upstream.close()


async def _from_browser(
    websocket: WebSocket,
    upstream: websockets.asyncio.client.ClientConnection,
    drag: Callable[[Drag], None],
) -> None:
    try:
        while True:
            data = await websocket.receive_bytes()
            message = parse_message(data)
            if isinstance(message, Drag):
                drag(message)
            elif message is not None:
                await upstream.send(message)
    except (ConnectionClosed, WebSocketDisconnect, RuntimeError, KeyError, OSError):
        await upstream.close()
