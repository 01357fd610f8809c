"""Fixtures for the tests of the 3D view."""

import asyncio
import threading

import pytest

from tests.integration.gcs_server.scene.scene_server import SceneServer, running_scene_server


@pytest.fixture(scope="module")
def scene_server():
    """One server for the module, in a thread with its own event loop."""
    server, ready, done = SceneServer(), threading.Event(), threading.Event()

    async def run() -> None:
        async with running_scene_server(server):
            ready.set()
            await asyncio.to_thread(done.wait)

    thread = threading.Thread(target=lambda: asyncio.run(run()))
    thread.start()
    assert ready.wait(15)
    yield server
    done.set()
    thread.join(15)
    assert not thread.is_alive()
