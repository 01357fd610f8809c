"""Generated requests: the OpenAPI description lists the status and content type of each response."""

import asyncio
import os

import httpx
import pytest

from gcs_server.api.described import COMMON_ERRORS, PROBLEM_JSON
from gcs_server.api.schema import description
from gcs_server.app import create_app
from gcs_server.clock import LoopClock
from gcs_server.plans.work import PlanWork
from gcs_server.scenarios.memory_link import MemoryLink
from gcs_server.scenarios.simulated_time import run_on_simulated_time
from tests.api.generated_requests import RequestGenerator
from tests.e2e.map_files import png, write_mbtiles, write_pmtiles
from tests.protocol.fake_autopilot import FakeAutopilot
from tests.support.api_client import settings_for
from tests.unit.gcs_server.replay.generated_logs import flight, record

REQUESTS_PER_OPERATION = int(os.environ.get("GENERATED_REQUESTS", "2"))
"""`make nightly` sends more."""
SEED = 14
VEHICLE_STATUSES = {"502", "503", "504"}
"""Statuses that the vehicle, its link or a map service can cause; no other 5xx is allowed."""


class WorkInThread(PlanWork):
    """Does all work in threads of this process.

    While the loop waits for another process, simulated time would advance without limit.
    """

    async def run(self, task, arguments, *, small=True, **options):
        return await super().run(task, arguments, small=True, **options)


def operations():
    """Method, path and description of each operation."""
    return [(m, p, o) for p, methods in description()["paths"].items() for m, o in methods.items()]


def described_response(operation, status):
    """The operation's description of a status; None: it has none."""
    response = operation["responses"].get(status)
    if response is not None and "$ref" in response:
        return description()["components"]["responses"][response["$ref"].rpartition("/")[2]]
    return response


def missing_description(operation, received):
    """What the description of the operation lacks for a received response; None: nothing."""
    described = described_response(operation, str(received.status_code))
    if described is None:
        return f"status {received.status_code}"
    if received.status_code >= 500 and str(received.status_code) not in VEHICLE_STATUSES:
        return f"{received.status_code}: {received.text[:200]}"
    content_type = received.headers.get("content-type", "").partition(";")[0]
    if received.content and content_type not in described.get("content", {}):
        return f"{received.status_code} as {content_type!r}, not {sorted(described.get('content', {}))}"
    return None


async def run_with_vehicle(data, scenario):
    """Runs the application in memory with a scripted vehicle on simulated time, without processes and
    sockets."""
    (data / "maps").mkdir()
    write_pmtiles(data / "maps" / "world.pmtiles", png((1, 2, 3)))
    write_mbtiles(data / "maps" / "world.mbtiles", png((1, 2, 3)))
    (data / "recordings").mkdir()
    (data / "recordings" / "flight.tlog").write_bytes(b"".join(record(*message) for message in flight()))
    clock = LoopClock(asyncio.get_running_loop())
    app = create_app(settings_for(data), clock, static=data / "none")
    server = app.state.server
    server.station.flights.plan_work = WorkInThread(data / "elevation")
    server.router.start()
    server.fleet.start()
    link = MemoryLink("memory", outgoing=lambda datagram, _: autopilot.receive(datagram))
    server.router.add(link)
    autopilot = FakeAutopilot(link)
    transport = httpx.ASGITransport(app, raise_app_exceptions=False)
    try:
        async with httpx.AsyncClient(
            transport=transport, base_url="http://localhost", timeout=None
        ) as client:
            await asyncio.sleep(10.0)
            assert server.fleet.get("1").topic("home")
            await scenario(client)
    finally:
        await server.fleet.close()
        await server.supervisor.close()
        await server.router.close()


@pytest.mark.parametrize("part", range(4))
def test_each_response_to_a_generated_request_is_described_and_none_is_5xx(part, tmp_path):
    generator = RequestGenerator(description(), SEED + part)
    undescribed_responses, statuses = {}, set()

    async def scenario(client):
        for method, path, operation in operations()[part::4]:
            for request in generator.requests(method, path, operation, REQUESTS_PER_OPERATION):
                headers = {name: value.encode() for name, value in request.headers.items()}
                headers["X-Client-Id"] = b"generated"
                response = await client.request(
                    request.method, request.path, params=request.query, content=request.body, headers=headers
                )
                statuses.add(response.status_code)
                omission = missing_description(operation, response)
                if omission is not None:
                    undescribed_responses[f"{request.method} {path}: {omission}"] = request

    run_on_simulated_time(lambda: run_with_vehicle(tmp_path, scenario))
    assert undescribed_responses == {}
    assert {200, 422} <= statuses, "no request was accepted, or none was refused"


def test_responses_of_access_control_and_limits_are_described_at_every_operation():
    for method, path, operation in operations():
        for status in ("400", "401", "403", "408", "413", "414", "422", "429", "431", "503"):
            assert PROBLEM_JSON in described_response(operation, status)["content"], (method, path, status)
    assert set(COMMON_ERRORS) >= {"401", "403", "408", "413", "414", "429", "431", "503"}
