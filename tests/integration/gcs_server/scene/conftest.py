"""Fixtures for the tests of the 3D view."""

import asyncio
import threading

import pytest

from tests.integration.gcs_server.scene.scene_running import Running, serving


@pytest.fixture(scope="module")
def running():
    """One server for the module, in a thread with its own event loop."""
    it, ready, done = Running(), threading.Event(), threading.Event()

    async def live() -> None:
        async with serving(it):
            ready.set()
            await asyncio.to_thread(done.wait)

    thread = threading.Thread(target=lambda: asyncio.run(live()))
    thread.start()
    assert ready.wait(15)
    yield it
    done.set()
    thread.join(15)
    assert not thread.is_alive()
