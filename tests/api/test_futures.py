"""Futures over HTTP: bad requests are refused, one process flies at a time, and a client's newer request
replaces its older one."""

import asyncio

import pytest

from gcs_server.errors import Refused, ServerBusy
from gcs_server.flights import futures
from gcs_server.flights.futures import FuturesWork
from gcs_server.flights.futures_task import FuturesTask, Surroundings
from gcs_server.operations.process import WorkerFailed
from gcs_server.operations.turns import CALLER, Caller
from missions.geodesy import LocalOrigin
from missions.what_if.futures.commands import Hold
from missions.what_if.futures.start import Delay, Start
from tests.support.api_client import api_client

GOTO = {"lat_deg": 47.3982, "lon_deg": 8.5462, "alt_home_m": 15}
HOLD = FuturesTask(
    vehicle="1",
    start=Start((0.0, 0.0, -9.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.3, 0.3, None,
                True, None, None, {}, "1.17"),
    origin=None, mode=Hold(), stream=None, delay=Delay(0.1, 0.2),
    surroundings=Surroundings(LocalOrigin(47.0, 8.0, 0.0), (0.0, 0.0, 0.0), b"[]", 0.0, 0.0, b"[]", ()),
    state_unix_s=0.0, text="hold", battery_known=False, flights=20, horizon_s=2.0, seed=0, assumed=(),
)  # fmt: skip


@pytest.mark.parametrize(
    "body",
    [
        {},
        {"mode": "hold", "goto": GOTO},
        {"mode": "kill"},
        {"mode": "hold", "horizon_s": 61},
        {"mode": "hold", "horizon_s": 0},
        {"mode": "hold", "flights": 10_000},
        {"mode": "hold", "seed": -1},
        {"goto": {**GOTO, "lat_deg": 91}},
        {"setpoint": {"type": "velocity", "velocity_ned_m_s": [1, 0, 1e9]}},
        {"setpoint": {"type": "position"}},
        {"mode": "hold", "obstacles": [{"polygon": [], "top": {"value_m": 1, "reference": "home"}}]},
    ],
)
def test_bad_bodies_are_refused(body, tmp_path):
    with api_client(tmp_path, path="/api/v1/") as client:
        assert client.post("vehicles/1/futures", json=body).status_code == 422


def test_an_unknown_vehicle_and_numbers_that_are_none_are_refused(tmp_path):
    with api_client(tmp_path, path="/api/v1/") as client:
        assert client.post("vehicles/9/futures", json={"mode": "hold"}).json()["code"] == "unknown_vehicle"
        for text in ('{"mode": "hold", "horizon_s": NaN}', '{"mode": "hold", "horizon_s": 1e999}'):
            answer = client.post(
                "vehicles/1/futures", content=text, headers={"Content-Type": "application/json"}
            )
            assert answer.status_code in (400, 422), answer.text


class Processes:
    """Stands for the process: its tasks run until they are released."""

    def __init__(self):
        self.running, self.ended, self.go = 0, 0, asyncio.Event()

    async def run(self, _request):
        self.running += 1
        try:
            await self.go.wait()
            return b"+{}"
        finally:
            self.running -= 1
            self.ended += 1


def work_with(processes):
    work = FuturesWork()
    work._processes = processes
    return work


async def ask(work, client):
    CALLER.set(Caller(client, client))
    return await work.fly(HOLD, client)


async def settle(condition):
    for _ in range(1000):
        if condition():
            return
        await asyncio.sleep(0.001)
    raise AssertionError("nothing happened")


def test_a_newer_request_of_a_client_replaces_its_older_one():
    async def scenario():
        processes = Processes()
        work = work_with(processes)
        older = asyncio.ensure_future(ask(work, "anna"))
        await settle(lambda: processes.running == 1)
        newer = asyncio.ensure_future(ask(work, "anna"))
        with pytest.raises(Refused, match="newer request"):
            await older
        await settle(lambda: processes.running == 1)
        processes.go.set()
        assert await newer == b"{}"
        assert work._newest == {}

    asyncio.run(scenario())


def test_one_process_flies_at_a_time_and_others_wait_up_to_a_limit():
    async def scenario():
        processes = Processes()
        work = work_with(processes)
        asked = [asyncio.ensure_future(ask(work, f"client {n}")) for n in range(futures.LIMITS.total)]
        await settle(lambda: len(work._newest) == futures.LIMITS.total and processes.running == 1)
        with pytest.raises(ServerBusy):
            await ask(work, "one more")
        assert processes.running == 1
        processes.go.set()
        assert await asyncio.gather(*asked) == [b"{}"] * futures.LIMITS.total

    asyncio.run(scenario())


def test_a_caller_that_leaves_ends_its_futures_also_while_they_wait():
    async def scenario():
        processes = Processes()
        work = work_with(processes)
        first, waiting = (asyncio.ensure_future(ask(work, name)) for name in ("anna", "bob"))
        await settle(lambda: processes.running == 1 and len(work._newest) == 2)
        for each in (waiting, first):
            each.cancel()
            with pytest.raises(asyncio.CancelledError):
                await each
        assert (processes.running, processes.ended, work._newest) == (0, 1, {})

    asyncio.run(scenario())


def test_a_failed_process_is_said_in_words():
    class Failing:
        async def run(self, _request):
            raise WorkerFailed("its process ended without a result.")

    class Problem:
        async def run(self, _request):
            return b"-parameters: SIH_T_MAX is 0.0."

    for processes, words in ((Failing(), "without a result"), (Problem(), "SIH_T_MAX")):
        with pytest.raises(Refused, match=words):
            asyncio.run(ask(work_with(processes), "anna"))


def test_the_process_flies_them():
    async def scenario():
        work = FuturesWork()
        try:
            return await ask(work, "anna")
        finally:
            work.close()

    assert b'"vehicle_id":"1"' in asyncio.run(scenario())
