"""The client's calls for operations, with responses like those of the server."""

import asyncio

import pytest

from gcs_server.client import NoReply, Timeout
from gcs_server.client.plans import Operations
from gcs_server.scenarios.simulated_time import run_on_simulated_time

NO_REPLY = {"status": 504, "code": "no_reply", "detail": "The vehicle did not answer."}


def operation(state, error=None, vehicle="1"):
    return {"id": "4", "vehicle": vehicle, "state": state, "text": "12 of 40", "error": error}


class FakeServer:
    """A fake server that returns the responses in order, then always the last one."""

    def __init__(self, *responses):
        self.responses = list(responses)
        self.calls = []

    async def request(self, method, path, body=None):
        self.calls.append((method, path))
        return self.responses.pop(0) if len(self.responses) > 1 else self.responses[0]


def test_wait_returns_when_the_operation_has_ended():
    server = FakeServer(operation("running"), operation("running"), operation("succeeded"))
    ended_operation = run_on_simulated_time(lambda: Operations(server).wait("4"))
    assert ended_operation["state"] == "succeeded"
    assert server.calls == [("GET", "/operations/4")] * 3


def test_a_failed_operation_raises_its_original_error():
    with pytest.raises(NoReply, match="did not answer"):
        run_on_simulated_time(lambda: Operations(FakeServer(operation("failed", NO_REPLY))).wait("4"))


def test_a_cancelled_operation_is_returned():
    ended_operation = run_on_simulated_time(lambda: Operations(FakeServer(operation("cancelled"))).wait("4"))
    assert ended_operation["state"] == "cancelled"


def test_a_timeout_reports_the_progress():
    async def scenario():
        began_s = asyncio.get_running_loop().time()
        with pytest.raises(Timeout, match=r"Operation 4 is still running after 5 s: 12 of 40"):
            await Operations(FakeServer(operation("running"))).wait("4", timeout_s=5)
        assert 5.0 <= asyncio.get_running_loop().time() - began_s < 6.0

    run_on_simulated_time(scenario)


def test_operations_are_filtered_by_vehicle():
    server = FakeServer({"operations": [operation("running"), operation("running", vehicle="2")]})
    operations = run_on_simulated_time(lambda: Operations(server).all("2"))
    assert [entry["vehicle"] for entry in operations] == ["2"]


def test_cancel_returns_the_final_state():
    server = FakeServer(operation("cancelled"))
    assert run_on_simulated_time(lambda: Operations(server).cancel("4"))["state"] == "cancelled"
    assert server.calls == [("DELETE", "/operations/4")]
