"""Runs viser so that only this server's proxy can reach it: on a Unix socket in a private folder.

viser does not check the origin or identity of clients, and any browser could open a public tunnel. Therefore
viser has no TCP port: a web page cannot open a Unix socket, and other users cannot access the folder. Clients
must send a secret that is new in each run, the tunnel is disabled, and viser's banner is suppressed.

viser has no settings for this, so the name `websockets` inside `viser.infra._infra` is replaced while the
server starts. A test checks the pinned minor version of viser.
"""

from __future__ import annotations

import asyncio
import hmac
import http
import logging
import secrets
import shutil
import socket
import tempfile
import threading
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import rich
import viser
import websockets
import websockets.asyncio.server
from viser import _messages
from viser.infra import _infra  # pyright: ignore[reportPrivateUsage]
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from gcs_server.scene.messages import SECRET_HEADER, SceneError, ViserAddress

log = logging.getLogger(__name__)

START_TIMEOUT_S = 20.0
MIN_STALE_AGE_S = 60.0
"""Minimum age of a folder to be removed [s]; a younger folder may belong to a server that is still
starting."""
FOLDER_PREFIX = "gcs-scene-"
MAX_SOCKET_PATH = 100
"""Maximum length of the socket's path; Unix systems allow 104 to 108 bytes."""

_start_lock = threading.Lock()


class _PrivateViser(viser.ViserServer):
    """viser without its public tunnel."""

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Always refuses, so that no click can publish the view of an aircraft on the internet."""
        del verbose
        log.warning("a request for a public tunnel to the 3D view was refused")
        return None


class ViserHost:
    """One viser server and its secret."""

    def __init__(self) -> None:
        self.secret = secrets.token_urlsafe(32)
        self._folder: Path | None = None
        self._server: viser.ViserServer | None = None

    @property
    def socket_path(self) -> Path:
        """Path of viser's socket. Raises SceneError before `start`."""
        if self._folder is None:
            raise SceneError("The 3D view is not running.", remedy="Flying is not affected; try again.")
        return self._folder / "s"

    async def start(self) -> ViserAddress:
        """Starts viser; raises SceneError with the reason."""
        try:
            self._folder = await asyncio.to_thread(_create_folder)
            # The socket is bound here, so that a failure raises an exception; viser would retry forever.
            listener = _bind(self.socket_path)
            async with asyncio.timeout(START_TIMEOUT_S):
                self._server = await asyncio.to_thread(self._build, listener)
        except (OSError, TimeoutError) as error:
            self._remove_folder()
            raise SceneError(
                f"The 3D view could not be started: {error or 'viser did not start in time'}.",
                remedy="Flying is not affected. Check that the folder for temporary files is writable.",
            ) from error
        return ViserAddress(str(self.socket_path), self.secret)

    async def stop(self) -> None:
        """Ends viser's threads and removes its socket."""
        server, self._server = self._server, None
        if server is not None:
            await asyncio.to_thread(server.stop)
        self._remove_folder()

    def clients(self) -> dict[int, viser.ClientHandle]:
        """Connected browsers by viser's client id."""
        return self._server.get_clients() if self._server is not None else {}

    def query_of(self, client_id: int) -> dict[str, str]:
        """Query that the proxy passed with this client's connection."""
        if self._server is None:
            return {}
        connection = self._server._websock_server._live_connections.get(client_id)  # pyright: ignore[reportPrivateUsage]
        if connection is None or connection.request is None:
            return {}
        return {k: v[-1] for k, v in parse_qs(urlsplit(connection.request.path).query).items()}

    def _build(self, listener: socket.socket) -> viser.ViserServer:
        with _start_lock:
            rich.get_console().quiet = True  # in this process only viser prints with rich
            viser_infra: Any = _infra
            original = viser_infra.websockets
            try:
                viser_infra.websockets = self._private_websockets(listener)
                server = _PrivateViser(host="127.0.0.1", port=0, verbose=False)
            finally:
                viser_infra.websockets = original
        for message in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
            server._websock_server.unregister_handler(message)  # pyright: ignore[reportPrivateUsage]
        return server

    def _private_websockets(self, listener: socket.socket) -> types.SimpleNamespace:
        """A replacement for `websockets` while viser starts: it serves this server's socket, and requires the
        secret."""

        def serve(handler: Callable[..., Any], _host: str, _port: int, **options: Any) -> Any:
            viser_check = options.pop("process_request", None)

            def process_request(connection: Any, request: Request) -> Response | None:
                sent_secret = request.headers.get(SECRET_HEADER, "")
                if not hmac.compare_digest(sent_secret.encode(errors="replace"), self.secret.encode()):
                    return Response(http.HTTPStatus.FORBIDDEN.value, "Forbidden", Headers(), b"")
                return viser_check(connection, request) if viser_check is not None else None

            return websockets.asyncio.server.serve(
                handler, process_request=process_request, unix=True, sock=listener, **options
            )

        return types.SimpleNamespace(
            asyncio=types.SimpleNamespace(server=types.SimpleNamespace(serve=serve)),
            datastructures=websockets.datastructures,
            exceptions=websockets.exceptions,
        )

    def _remove_folder(self) -> None:
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder = None


def _bind(path: Path) -> socket.socket:
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        listener.bind(str(path))
    except OSError:
        listener.close()
        raise
    return listener


def _create_folder() -> Path:
    """Creates a private folder (mode 0700) with a path short enough for a socket."""
    folder = Path(tempfile.mkdtemp(prefix=FOLDER_PREFIX))
    if len(str(folder)) > MAX_SOCKET_PATH:
        folder.rmdir()
        folder = Path(tempfile.mkdtemp(prefix=FOLDER_PREFIX, dir="/tmp"))
    _remove_stale_folders(folder)
    return folder


def _remove_stale_folders(own_folder: Path) -> None:
    """Removes folders of killed servers: folders with a socket that no process listens on."""
    for folder in own_folder.parent.glob(f"{FOLDER_PREFIX}*"):
        if folder == own_folder:
            continue
        try:
            # A starting server has bound its socket, but listens a moment later.
            if own_folder.stat().st_mtime - folder.stat().st_mtime < MIN_STALE_AGE_S:
                continue
            with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
                probe.settimeout(0.2)
                probe.connect(str(folder / "s"))
        except (ConnectionRefusedError, FileNotFoundError):
            shutil.rmtree(folder, ignore_errors=True)
        except OSError:
            continue  # the folder belongs to another user, or is in use
