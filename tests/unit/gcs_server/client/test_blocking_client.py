"""The blocking client has the same calls as the asynchronous client."""

import asyncio
import inspect

import pytest

from gcs_server import client
from gcs_server.client import aio, control, mission, offboard, plans, vehicle
from gcs_server.client.portal import LoopThread, iterate
from tools.build_sync_client import CLASSES, EXCLUDED_METHODS

MODULES = (aio, control, mission, offboard, plans, vehicle)


def public_methods(client_class):
    return {
        name: member
        for name, member in vars(client_class).items()
        if inspect.isfunction(member) and not name.startswith("_")
    }


@pytest.mark.parametrize("name", CLASSES)
def test_every_call_exists_in_both_clients_with_the_same_arguments(name):
    asynchronous_class = next(vars(module)[name] for module in MODULES if name in vars(module))
    blocking_class = getattr(client, f"Sync{name}")
    for method_name, method in public_methods(asynchronous_class).items():
        if method_name not in EXCLUDED_METHODS:
            blocking_parameters = inspect.signature(getattr(blocking_class, method_name)).parameters
            assert list(blocking_parameters) == list(inspect.signature(method).parameters), method_name
            assert not inspect.iscoroutinefunction(getattr(blocking_class, method_name))


async def do_nothing():
    pass


@pytest.mark.parametrize("last_value", [2, 99])
def test_a_complete_or_interrupted_iteration_is_closed_once_on_the_loop(last_value):
    closing_loops = []

    async def source():
        try:
            for number in range(5):
                await asyncio.sleep(0)
                yield number
        finally:
            closing_loops.append(asyncio.get_running_loop())

    with LoopThread(do_nothing) as thread:
        received = []
        values = iterate(thread._portal, source())
        for value in values:
            received.append(value)
            if value == last_value:
                break
        values.close()
    assert received == list(range(min(last_value + 1, 5)))
    assert len(closing_loops) == 1


def test_a_call_outside_the_with_block_raises_an_error_that_explains_the_usage():
    with pytest.raises(RuntimeError, match="with SyncGcs"):
        client.SyncGcs("http://127.0.0.1:9").vehicles()
