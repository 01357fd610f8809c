"""A server of map tiles on this computer."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

PNG = b"\x89PNG\r\n\x1a\n"


class TileServer:
    """A source of tiles; notes what it was asked for, and by whom.

    Args:
        answer: every tile, or a function of its path; None: a tile with its own path in it.
    """

    def __init__(self, answer: bytes | Callable[[str], bytes] | None = None) -> None:
        self.asked: list[tuple[str, str]] = []
        self.answer, self.status = answer, 200
        source = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                source.asked.append((self.path, self.headers["User-Agent"]))
                body = PNG + self.path.encode() if source.answer is None else source.answer
                if callable(body):
                    body = body(self.path)
                self.send_response(source.status)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                with contextlib.suppress(OSError):  # the server stops reading a tile that is too large
                    self.wfile.write(body)

            def log_message(self, *_: object) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        self.url = f"http://127.0.0.1:{self._server.server_address[1]}/{{z}}/{{x}}/{{y}}.png"

    def close(self) -> None:
        """Ends the server."""
        self._server.shutdown()
        self._server.server_close()
