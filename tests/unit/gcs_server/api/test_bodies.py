"""Limits of request bodies before parsing: size, depth, number of keys, time."""

import asyncio
import itertools
import json

import pytest

from gcs_server.api.bodies import (
    DOCUMENT_PATHS,
    LARGE_BODIES,
    MAX_SMALL_BODY_BYTES,
    BodyReader,
)
from gcs_server.api.documents import DocumentRoute
from gcs_server.api.json_limits import MAX_DEPTH, MAX_KEYS, json_fault
from gcs_server.api.problems import MAX_ERRORS, MAX_VALUE_LENGTH
from gcs_server.api.refusals import BODY_DEADLINE_S, MAX_BODY_BYTES
from gcs_server.api.request_queue import PAUSE_S_PER_BYTE, LargeSetpoints, RequestQueue
from gcs_server.api.schema import api_routes
from gcs_server.control.principal import Principal
from gcs_server.errors import ServerBusy
from gcs_server.operations.turns import CALLER, Caller
from gcs_server.scenarios.simulated_time import run_on_simulated_time
from tests.support.api_client import api_client

LONGEST_PATH = {
    "setpoint": {
        "type": "path",
        "points": [
            {
                "t_s": n / 10 + 0.012345,
                "position_ned_m": [n * 0.1234567, -n * 0.7654321, -10.123456],
                "yaw_ned_rad": 1.23,
            }
            for n in range(5000)
        ],
    }
}


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    with api_client(tmp_path_factory.mktemp("data"), raise_server_exceptions=False) as client:
        yield client


@pytest.mark.parametrize(
    "text",
    [
        json.dumps(LONGEST_PATH),
        json.dumps({"a": "[" * 500 + "{:,}" * 100}),
        json.dumps({"digits": "9" * 5000}),
        json.dumps({"quotes": '"\\"[[' * 100}),
        "[" * MAX_DEPTH + "]" * MAX_DEPTH,
        '"' + "[" * 5000,
        "{",
        "",
    ],
)
def test_bodies_within_limits_pass_the_check_before_parsing(text):
    assert len(text) <= MAX_BODY_BYTES
    assert json_fault(text.encode()) is None


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (b"[" * 100_000, "deeper"),
        (b'{"a":' * (MAX_DEPTH + 1) + b"1" + b"}" * (MAX_DEPTH + 1), "deeper"),
        (b'["\\"", ' + b"[" * 50, "deeper"),
        (b"[" + b"{}," * 100_000 + b"{}]", "values"),
        (json.dumps({f"k{n}": 1 for n in range(MAX_KEYS + 1)}).encode(), "keys"),
        (json.dumps([{"a": {f"k{n}": 1 for n in range(MAX_KEYS + 1)}}]).encode(), "keys"),
        (b"[1" + b"0" * 5000 + b"]", "digits"),
        (b'{"a": "\xff"}', "UTF-8"),
        ('{"a": 1}'.encode("utf-16"), "UTF-8"),
    ],
)
def test_bodies_beyond_a_limit_are_refused_before_parsing(text, reason):
    assert reason in json_fault(text)


def test_a_body_with_fifty_thousand_unknown_keys_causes_one_error(client):
    body = {f"k{n}": 1 for n in range(50_000)}
    response = client.post("/api/v1/vehicles/1/offboard/setpoint", json=body, headers={"X-Client": "hostile"})
    assert response.status_code == 422
    assert response.json()["field"] == "body"
    assert len(response.content) < 1000
    entries = client.get("/api/v1/journal?limit=1").json()["entries"]
    assert len(json.dumps(entries)) < 1000


@pytest.mark.parametrize(
    "body",
    [
        {"alt_home_m": 5, **{f"{'k' * 5000}{n}": 1 for n in range(90)}},
        {"setpoint": {"type": "path", "points": [{"t": n, "p": 1, "q": 2} for n in range(5000)]}},
        {"setpoint": {"type": "x" * 900_000}},
        {"type": "x" * 900_000},
        {"members": [{f"k{n}": 1 for n in range(90)}] * 10},
    ],
)
def test_the_errors_of_the_largest_bodies_are_few_and_short(client, body):
    for path in ("vehicles/1/takeoff", "vehicles/1/offboard/setpoint", "groups"):
        response = client.post(f"/api/v1/{path}", json=body)
        if path.endswith("takeoff") and len(response.request.content) > MAX_SMALL_BODY_BYTES:
            assert response.status_code == 413
            continue
        assert response.status_code == 422
        errors = response.json()["errors"]
        assert len(errors) <= MAX_ERRORS + 1
        assert all(len(e["field"]) + len(e["message"]) < 2 * MAX_VALUE_LENGTH + 10 for e in errors)
        assert len(client.get("/api/v1/journal?limit=1").content) < 30_000


def test_a_path_of_a_thousand_invalid_points_causes_errors_of_its_first_point_only(client):
    body = {"setpoint": {"type": "path", "points": [{"t": n, "p": 1} for n in range(1000)]}}
    response = client.post("/api/v1/vehicles/1/offboard/setpoint", json=body)
    assert response.status_code == 422
    fields = {error["field"] for error in response.json()["errors"]}
    assert fields == {f"setpoint.points.0.{name}" for name in ("t", "p", "t_s", "position_ned_m")}


def test_a_body_that_is_too_large_gets_status_413_with_and_without_content_length(client):
    large = b" " * (MAX_BODY_BYTES + 1)
    setpoint, plan = "/api/v1/vehicles/1/offboard/setpoint", "/api/v1/plans/check"
    refused = [client.post(path, content=large) for path in (setpoint, plan)]
    refused.append(client.post(setpoint, content=iter([large[:-1], b" "])))
    refused.append(client.post("/api/v1/vehicles/1/arm", content=large[: MAX_SMALL_BODY_BYTES + 1]))
    for response in refused:
        assert (response.status_code, response.json()["code"]) == (413, "body_too_large")
        assert response.headers["content-type"] == "application/problem+json"
        assert response.headers["connection"] == "close"
    # The bodies are accepted, but there is no vehicle 1, or spaces are not JSON.
    arm = client.post("/api/v1/vehicles/1/arm", content=large[:MAX_SMALL_BODY_BYTES])
    assert arm.status_code in (404, 422)
    assert client.post(plan, content=large[:-1]).status_code == 422


def test_the_routes_with_documents_are_those_whose_large_bodies_plan_work_checks():
    in_body = {
        route.path.replace("{v}", "1").replace("{plan}", "x")
        for route in api_routes()
        if isinstance(route, DocumentRoute) and route.body_field is not None
    }
    with_document = {path for path in in_body if DOCUMENT_PATHS.fullmatch(path)}
    assert {path.rpartition("/")[2] for path in in_body - with_document} == {
        "abort", "download", "resume", "start", "unregister"
    }  # fmt: skip
    assert len(with_document) == 15


def test_the_longest_allowed_path_is_accepted(client):
    longest_path = LONGEST_PATH["setpoint"]
    points = [{**point, "t_s": n / 10} for n, point in enumerate(longest_path["points"])]
    body = {**LONGEST_PATH, "setpoint": {**longest_path, "points": points}}
    # The path is accepted, but there is no vehicle 1.
    assert client.post("/api/v1/vehicles/1/offboard/setpoint", json=body).status_code == 404


def test_an_incomplete_body_gets_status_408_at_the_deadline():
    sent_messages = []

    async def app(scope, receive, send):
        raise AssertionError("the application must not be called")

    async def receive_nothing():
        await asyncio.Event().wait()

    async def send(message):
        sent_messages.append(message)

    async def run():
        began_s = asyncio.get_running_loop().time()
        scope = {
            "type": "http",
            "method": "POST",
            "path": "/",
            "headers": [],
            "query_string": b"",
            "client": None,
        }
        await reader_of(app, lambda _: False)(scope, receive_nothing, send)
        assert asyncio.get_running_loop().time() - began_s == pytest.approx(BODY_DEADLINE_S)

    run_on_simulated_time(run)
    assert sent_messages[0]["status"] == 408
    assert json.loads(sent_messages[1]["body"])["code"] == "too_slow"


def reader_of(app, in_control):
    return BodyReader(app, RequestQueue(in_control), LargeSetpoints(in_control))


class LargeRequests:
    """Requests through the middleware, on simulated time; the application answers after a second."""

    def __init__(self, in_control=()):
        self.reader = reader_of(self._app, lambda key: key in in_control)
        self.handled = []

    async def _app(self, scope, receive, send):
        self.handled.append((scope["gcs.principal"].name, asyncio.get_running_loop().time()))
        await asyncio.sleep(1.0)
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b""})

    async def send(self, client, path, size=MAX_BODY_BYTES):
        """Sends a request; returns its status, and whether the body was read."""
        received, statuses = [], []

        async def receive():
            received.append(size)
            return {"type": "http.request", "body": b" " * size, "more_body": False}

        async def send(message):
            statuses.append(message.get("status"))

        scope = {
            "type": "http",
            "method": "POST",
            "path": f"/api/v1/{path}",
            "headers": [(b"content-length", str(size).encode()), (b"x-client", client.encode())],
            "query_string": b"",
            "client": ("127.0.0.1", 1),
        }
        await self.reader(scope, receive, send)
        return statuses[0], bool(received)


def test_large_bodies_of_one_client_are_limited_before_they_are_read_and_others_are_served():
    requests = LargeRequests()

    async def run():
        tasks = [asyncio.ensure_future(requests.send("hostile", "plans/check")) for _ in range(64)]
        tasks.append(asyncio.ensure_future(requests.send("anna", "plans/check")))
        tasks.append(asyncio.ensure_future(requests.send("hostile", "vehicles/1/hold", 2)))
        *hostile, other, small = await asyncio.gather(*tasks)
        assert sorted(set(hostile)) == [(200, True), (429, False)]
        assert hostile.count((200, True)) == LARGE_BODIES.per_client
        assert (other, small) == ((200, True), (200, True))

    run_on_simulated_time(run)


def test_large_setpoints_of_a_client_without_control_leave_the_loop_free_most_of_the_time():
    pilot_key = Principal.from_identity("pilot", "", "127.0.0.1").key
    requests = LargeRequests({pilot_key})

    async def run():
        path = "vehicles/1/offboard/setpoint"
        tasks = [asyncio.ensure_future(requests.send("hostile", path)) for _ in range(3)]
        await asyncio.sleep(0.1)
        begin_s = asyncio.get_running_loop().time()
        await requests.send("pilot", path)
        await asyncio.gather(*tasks)
        times = [time_s for name, time_s in requests.handled if name == "hostile"]
        pause_s = MAX_BODY_BYTES * PAUSE_S_PER_BYTE
        assert [later - first for first, later in itertools.pairwise(times)] == pytest.approx(
            [1.0 + pause_s] * 2
        )
        assert [time_s for name, time_s in requests.handled if name == "pilot"] == pytest.approx([begin_s])

    run_on_simulated_time(run)


def test_a_large_setpoint_of_a_socket_is_refused_instead_of_waiting_behind_another():
    large = LargeSetpoints(lambda key: key == "pilot")

    async def read(client, size, **options):
        CALLER.set(Caller(client))
        async with large.turn(size, **options):
            await asyncio.sleep(0.02)

    async def run():
        await read("hostile", 100_000, wait=False)
        with pytest.raises(ServerBusy, match="read first"):
            await read("other", 100_000, wait=False)
        begin_s = asyncio.get_running_loop().time()
        await read("pilot", 100_000, wait=False)
        assert asyncio.get_running_loop().time() == pytest.approx(begin_s + 0.02)
        await asyncio.sleep(100_000 * PAUSE_S_PER_BYTE)
        await read("other", 100_000, wait=False)

    run_on_simulated_time(run)
