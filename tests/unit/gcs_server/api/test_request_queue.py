"""Simultaneous requests start in separate iterations of the event loop, in a fair order."""

import asyncio
import itertools

from gcs_server.api.request_queue import KNOWN_AFTER_S, MAX_KNOWN_CLIENTS, RequestQueue
from gcs_server.control.principal import Principal
from gcs_server.scenarios.simulated_time import run_on_simulated_time


def client(name, address="1.1.1.1"):
    return Principal.from_identity(name, name, address)


def serve_requests(callers, in_control=()):
    """(clients' names in the order of service, loop iterations between two served requests)."""
    order = []

    async def run():
        request_queue = RequestQueue(lambda key: key in {client(name).key for name in in_control})
        iteration_count = 0

        async def count_iterations():
            nonlocal iteration_count
            while True:
                iteration_count += 1
                await asyncio.sleep(0)

        async def wait_and_record(caller):
            await request_queue.wait(caller)
            order.append((str(caller), iteration_count))

        counter_task = asyncio.ensure_future(count_iterations())
        await asyncio.gather(*(wait_and_record(caller) for caller in callers))
        counter_task.cancel()

    asyncio.run(run())
    iterations_between = [after - before for (_, before), (_, after) in itertools.pairwise(order)]
    return [name for name, _ in order], iterations_between


def test_each_request_starts_in_its_own_iteration_of_the_loop():
    _, iterations_between = serve_requests([client("hostile")] * 50)
    assert min(iterations_between) >= 1


def test_a_client_with_a_hundred_requests_does_not_delay_another_client():
    names, _ = serve_requests([client("hostile")] * 100 + [client("innocent")])
    assert names.index("innocent") <= 2


def test_an_address_with_a_hundred_clients_does_not_delay_another_address():
    hostile = [client(f"hostile {n}", "6.6.6.6") for n in range(100)]
    names, _ = serve_requests([*hostile, client("innocent", "1.1.1.1")])
    assert names.index("innocent") <= 2


def test_a_client_in_control_is_served_first():
    names, _ = serve_requests(
        [client(f"hostile {n}", f"6.6.6.{n}") for n in range(50)] + [client("pilot")], ["pilot"]
    )
    assert names.index("pilot") <= 1


def test_a_cancelled_request_does_not_delay_other_requests():
    async def run():
        request_queue = RequestQueue(lambda _: False)
        await request_queue.wait(client("first"))
        waiting = [asyncio.ensure_future(request_queue.wait(client("cancelled"))) for _ in range(10)]
        await asyncio.sleep(0)
        for waiter in waiting[:9]:
            waiter.cancel()
        async with asyncio.timeout(1):
            await waiting[9]
        assert sum(waiter.cancelled() for waiter in waiting) >= 8  # the first of the ten was already served

    asyncio.run(run())


def test_a_known_client_is_served_before_a_thousand_new_clients():
    order = []

    async def wait_and_record(request_queue, caller):
        await request_queue.wait(caller)
        order.append(str(caller))

    async def run():
        request_queue = RequestQueue(lambda _: False)
        await request_queue.wait(client("innocent"))
        for n in range(1000):  # these clients must not push the first client out of the known clients
            await request_queue.wait(client(f"earlier {n}"))
        await asyncio.sleep(KNOWN_AFTER_S + 1)
        hostile = [wait_and_record(request_queue, client(f"hostile {n}")) for n in range(1000)]
        await asyncio.gather(*hostile, wait_and_record(request_queue, client("innocent")))
        assert order.index("innocent") <= 2
        assert len(request_queue._seen) <= MAX_KNOWN_CLIENTS

    run_on_simulated_time(run)
