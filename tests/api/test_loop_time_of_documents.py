"""How long the event loop is busy with the largest documents: a small part of the time to read them."""

import asyncio
import gc
import json
import time

import httpx
import pytest

from gcs_server.app import create_app
from gcs_server.plans import tasks
from gcs_server.plans.tasks import Answer
from missions import documents
from tests.support.api_client import settings_for

SHARE = 0.2
"""Maximum part of the time that it takes to read the document; measured: 0.02 to 0.05."""


def largest_plan():
    item = {"kind": "waypoint", "altitude": {"value_m": 20, "reference": "home"}}
    items = [{**item, "lat_deg": 47.4, "lon_deg": 8.5 + 1e-6 * n} for n in range(9000)]
    return {"items": items}


PLAN = largest_plan()
TEXT = json.dumps(PLAN, separators=(",", ":")).encode()
INVALID = TEXT.replace(b'"waypoint"', b'"waypoints"')
ANSWER = tasks.run("read", {"plan": b'{"items": []}', "name": None, "kind": None})


class NoWork:
    """Answers each task at once, with a body as large as a plan, or with a fault."""

    elevation_folder = None

    async def run(self, task, arguments, **_):
        assert isinstance(arguments["plan"], bytes)
        if task == "items":
            return tasks.run("items", {"plan": b'{"items": []}'})
        return Answer(ANSWER.values, TEXT)

    async def elevation_paths(self):
        return []

    def close(self):
        pass


def bodies():
    yield "plans/check", b'{"plan":' + TEXT + b"}"
    yield "plans", b'{"name":"Field","plan":' + TEXT + b"}"
    yield "plans/convert", b'{"name":"Field","plan":' + TEXT + b"}"
    yield "plans/ground", b'{"plan":' + TEXT + b"}"
    yield "dry_runs", b'{"plan":' + TEXT + b"}"
    yield "plans/check", b'{"plan":' + INVALID + b"}"
    yield "vehicles/1/mission/upload", b'{"plan":' + TEXT + b"}"


@pytest.fixture(scope="module")
def read_s():
    """Time to read the document on this machine [s]."""
    times = []
    for _ in range(3):
        begin_s = time.thread_time()
        documents.read(TEXT)
        times.append(time.thread_time() - begin_s)
    return min(times)


@pytest.mark.parametrize(
    ("path", "body"), list(bodies()), ids=lambda value: value if isinstance(value, str) else ""
)
def test_the_loop_does_not_read_documents(tmp_path, read_s, path, body):
    app = create_app(settings_for(tmp_path), static=tmp_path / "none")
    app.state.station.flights.plan_work = NoWork()
    app.state.station.flights.dry_runs.next_id = lambda: (_ for _ in ()).throw(ValueError("no dry run"))

    async def request():
        transport = httpx.ASGITransport(app, raise_app_exceptions=False)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            times = []
            for _ in range(3):
                gc.collect()
                begin_s = time.thread_time()
                response = await client.post(
                    f"/api/v1/{path}", content=body, headers={"Content-Type": "application/json"}
                )
                times.append(time.thread_time() - begin_s)
            return response, min(times)

    response, loop_s = asyncio.run(request())
    assert response.status_code in (200, 201, 404, 422, 500), response.text
    assert loop_s < SHARE * read_s, f"{loop_s * 1e3:.1f} ms of {read_s * 1e3:.1f} ms"
