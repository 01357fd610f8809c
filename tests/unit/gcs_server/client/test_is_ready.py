"""When the client says that a vehicle is ready."""

import asyncio

import pytest

from gcs_server.client.vehicle import Vehicle


class FakeGcs:
    def __init__(self, health, mode="hold", readiness=None):
        topics = {} if health is None else {"health": {"value": {"ready_to_arm": health}}}
        self._answers = {
            "/vehicles/1": {"topics": topics, "status": {"mode": mode}},
            "/vehicles/1/readiness": readiness,
        }

    async def request(self, method, path, body=None):
        return self._answers[path]

    def operations(self):
        return None


def report(*offers):
    return {"known": True, "offers": list(offers)}


NO_REPORT = {"known": False, "offers": []}
IN_HOLD = {"code": "choose_mode", "mode": "hold"}


@pytest.mark.parametrize(
    ("gcs", "is_ready"),
    [
        (FakeGcs(None), False),
        (FakeGcs(True), True),
        (FakeGcs(False, readiness=report()), False),
        (FakeGcs(False, "offboard", report(IN_HOLD)), True),
        (FakeGcs(False, "offboard", report()), False),
        (FakeGcs(False, "offboard", NO_REPORT), True),
        (FakeGcs(False, "hold", NO_REPORT), False),
    ],
)
def test_ready_means_armable_in_this_mode_or_in_another_one(gcs, is_ready):
    assert asyncio.run(Vehicle(gcs, "1").is_ready()) is is_ready
