"""The server's API in the process of the test, without links and simulator."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fastapi.testclient import TestClient

from gcs_server.app import create_app
from gcs_server.settings import Settings


def settings_for(data: Path, *, scene: bool = False, record: bool = False) -> Settings:
    """Settings of a server with this data folder."""
    return Settings(port=0, links=(), sim=0, data=data, scene=scene, record=record)


@contextmanager
def api_client(
    data: Path,
    *,
    path: str = "",
    record: bool = False,
    raise_server_exceptions: bool = True,
    static: Path | None = None,
) -> Iterator[TestClient]:
    """A client of a new server with this data folder.

    Args:
        data: the server's data folder.
        path: prefix of the paths that the client calls.
        record: whether the server records its links.
        raises: whether the client raises unexpected errors of the server; otherwise it gets status 500.
        static: folder of the built page; None: no page.
    """
    app = create_app(settings_for(data, record=record), static=static or data / "none")
    with TestClient(
        app, base_url=f"http://localhost{path}", raise_server_exceptions=raise_server_exceptions
    ) as client:
        yield client
