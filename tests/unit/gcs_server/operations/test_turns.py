"""The fair order of clients' tasks."""

import asyncio
import random

import pytest

from gcs_server.errors import ClientHasTooMany, ServerBusy
from gcs_server.operations.turns import CALLER, Caller, TurnLimits, Turns
from gcs_server.scenarios.simulated_time import run_on_simulated_time

LIMITS = TurnLimits(running=2, running_without_control=1, per_client=4, total=8)
PILOT = "pilot"


class Tasks:
    """Tasks of a second each, and the order in which they began."""

    def __init__(self):
        self.turns = Turns(lambda key: key == PILOT, LIMITS)
        self.began = []
        self.tasks = []

    async def _run(self, key, address):
        CALLER.set(Caller(key, address))
        async with self.turns.turn():
            self.began.append((key, asyncio.get_running_loop().time()))
            await asyncio.sleep(1.0)

    async def start(self, key, count=1, address="here"):
        for _ in range(count):
            task = asyncio.ensure_future(self._run(key, address))
            self.tasks.append(task)
            await asyncio.sleep(0)
        return self.tasks[-count:]

    async def end(self):
        return await asyncio.gather(*self.tasks, return_exceptions=True)


def run(scenario):
    async def with_tasks():
        await scenario(Tasks())

    run_on_simulated_time(with_tasks)


def test_one_clients_tasks_wait_behind_those_of_others():
    async def scenario(tasks):
        await tasks.start("hostile", 4)
        await tasks.start("anna", 2)
        await tasks.start("bob", address="there")
        await tasks.end()
        assert [key for key, _ in tasks.began] == [
            "hostile",
            "hostile",
            "bob",
            "anna",
            "hostile",
            "anna",
            "hostile",
        ]

    run(scenario)


def test_a_client_in_control_never_waits_for_others():
    async def scenario(tasks):
        for n in range(2):
            await tasks.start(f"hostile {n}", 4)
        begin_s = asyncio.get_running_loop().time()
        await tasks.start(PILOT, 2)
        await tasks.end()
        assert [each for each in tasks.began if each[0] == PILOT] == [
            (PILOT, begin_s),
            (PILOT, begin_s + 1.0),
        ]

    run(scenario)


def test_the_tasks_of_a_client_and_of_all_clients_are_limited_but_a_client_in_control_is_served():
    async def scenario(tasks):
        *_, fifth = await tasks.start("hostile", 5)
        await tasks.start("other", 4)
        (ninth,) = await tasks.start("third")
        await tasks.start(PILOT)
        results = await tasks.end()
        assert isinstance(fifth.exception(), ClientHasTooMany)
        assert isinstance(ninth.exception(), ServerBusy)
        assert len([each for each in results if each is None]) == 9
        (later,) = await tasks.start("hostile")
        await tasks.end()
        assert later.exception() is None

    run(scenario)


@pytest.mark.parametrize("seed", range(20))
def test_cancelled_tasks_leave_no_turn_taken(seed):
    rng = random.Random(seed)

    async def scenario(tasks):
        for _ in range(40):
            await tasks.start(rng.choice(("a", "b", "c", PILOT)))
            if rng.random() < 0.5:
                rng.choice(tasks.tasks).cancel()
            await asyncio.sleep(rng.choice((0.0, 0.3, 1.0)))
        await tasks.end()
        assert (tasks.turns._running, tasks.turns._running_without_control) == (0, 0)
        assert not tasks.turns._pending
        begin_s = asyncio.get_running_loop().time()
        await tasks.start("z")
        assert tasks.began[-1] == ("z", begin_s)
        await tasks.end()

    run(scenario)
