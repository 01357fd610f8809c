"""The Python client requests, grants, denies, takes and releases control; the server is a real process."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator

import pytest

from gcs_server.client import Gcs, NotInControl, Refused, SyncGcs
from tests.station import free_port, running_server, running_vehicles


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    """A server with a connected vehicle."""
    port = free_port()
    with running_server([f"udpin://127.0.0.1:{port}"]) as (url, _), running_vehicles(port):
        with SyncGcs(url) as gcs:
            gcs.wait_for_vehicle("101", timeout_s=60)
        yield url


def test_control_is_requested_and_granted_denied_or_taken_by_force(url: str) -> None:
    with (
        SyncGcs(url, client="anna", client_id="a") as anna_gcs,
        SyncGcs(url, client="bob", client_id="b") as bob_gcs,
    ):
        anna, bob = anna_gcs.vehicle("101").control, bob_gcs.vehicle("101").control
        with anna.held(on_expiry="hold") as status:
            assert (status["holder"], status["yours"], status["on_expiry"]) == ("anna", True, "hold")
            with pytest.raises(NotInControl, match="anna has control") as refused:
                bob_gcs.vehicle("101").set_mode("position")
            assert refused.value.holder == "anna"
            assert bob.request("I see it better")["requests"][0]["reason"] == "I see it better"
            assert anna.grant("bob")["holder"] == "bob"
            assert bob.show()["yours"]
            bob.release()
            anna.take()
            bob.request()
            anna.deny("bob", "landing first")
            assert bob.take(force=True)["yours"]
            with pytest.raises(Refused):
                anna.grant("bob")
        assert bob.show()["holder"] == "bob", "the end of anna's block released control although bob had it"


def test_a_program_that_waits_for_control_gets_it_if_granted_and_an_error_if_denied(url: str) -> None:
    async def scenario() -> None:
        async with (
            Gcs(url, client="anna", client_id="a2") as anna_gcs,
            Gcs(url, client="bob", client_id="b2") as bob_gcs,
        ):
            anna, bob = anna_gcs.vehicle("101").control, bob_gcs.vehicle("101").control
            await anna.take()

            async def reply_to_request(grant: bool) -> None:
                for _ in range(200):
                    if (await anna.show())["requests"]:
                        break
                    await asyncio.sleep(0.05)
                await (anna.grant("bob") if grant else anna.deny("bob"))

            async with asyncio.TaskGroup() as group:
                group.create_task(reply_to_request(False))
                with pytest.raises(NotInControl):
                    await bob.request(wait_s=10)
            async with asyncio.TaskGroup() as group:
                group.create_task(reply_to_request(True))
                assert (await bob.request(wait_s=10))["yours"]

    asyncio.run(scenario())


def test_the_end_of_a_program_releases_control_for_the_next_program(url: str) -> None:
    for client in ("first", "second"):
        with SyncGcs(url, client=client, client_id=client) as gcs:
            gcs.vehicle("101").set_mode("hold")
            assert gcs.vehicle("101").control.show()["holder"] == client


def test_an_error_in_the_block_is_raised_and_control_is_released(url: str) -> None:
    with SyncGcs(url, client="anna", client_id="a3") as gcs:
        with pytest.raises(ZeroDivisionError), gcs.vehicle("101").control.held():
            _ = 1 / 0
        assert gcs.vehicle("101").control.show()["holder"] is None
