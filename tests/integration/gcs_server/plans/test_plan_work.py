"""Tasks on large plans and on imported files in a worker process: results, limits, and cancellation by the
caller."""

import asyncio
import base64
import json
import math
from pathlib import Path

import pytest

from gcs_server.errors import InvalidRequest, Refused
from gcs_server.plans import tasks, work
from gcs_server.plans.work import PlanWork


def plan_text(count):
    item = {"kind": "waypoint", "altitude": {"value_m": 20, "reference": "home"}}
    items = [{**item, "lat_deg": 47.4 + 1e-5 * math.sin(n), "lon_deg": 8.5 + 1e-6 * n} for n in range(count)]
    return json.dumps({"items": items})


def run(scenario):
    plan_work = PlanWork(Path("no elevation"))
    try:
        return asyncio.run(scenario(plan_work))
    finally:
        plan_work.close()


def test_process_and_thread_give_the_same_result():
    arguments = {
        "plan": plan_text(400),
        "parameters": {"MPC_XY_CRUISE": 3.0},
        "unknown_parameters": [],
        "home": None,
        "origin": None,
        "reported": None,
        "power": None,
        "elevation": [],
    }

    async def scenario(plan_work):
        return [await plan_work.run("check", arguments, small=small) for small in (True, False)]

    in_thread, in_process = run(scenario)
    assert in_thread == in_process
    assert in_thread["estimates"]["length_m"] > 0


def test_an_unreadable_plan_is_an_invalid_request_and_not_a_failure_of_the_process():
    arguments = {"file": base64.b64encode(b"PK no archive").decode(), "filename": "x.kmz", "altitude": None}

    async def scenario(plan_work):
        with pytest.raises(InvalidRequest, match="KMZ") as raised:
            await plan_work.run("import", arguments, small=False, field="body")
        assert raised.value.field == "body"

    run(scenario)


def test_work_beyond_the_process_limits_is_refused(monkeypatch):
    program = "import os, signal; os.kill(os.getpid(), signal.SIGXCPU)"
    monkeypatch.setattr(work, "COMMAND", (work.COMMAND[0], "-c", program))

    async def scenario(plan_work):
        with pytest.raises(Refused, match="more memory or time"):
            await plan_work.run("pattern", {"pattern": "{}"}, small=False)

    run(scenario)


def test_the_number_of_waiting_tasks_is_limited(monkeypatch):
    program = "import sys; sys.stdin.read()"
    monkeypatch.setattr(work, "COMMAND", (work.COMMAND[0], "-c", program))

    async def scenario(plan_work):
        pending = [
            asyncio.ensure_future(plan_work.run("pattern", {"pattern": "{}"}, small=False))
            for _ in range(work.MAX_PENDING)
        ]
        await asyncio.sleep(0)
        with pytest.raises(Refused, match="still waiting"):
            await plan_work.run("pattern", {"pattern": "{}"}, small=False)
        for each in pending:
            each.cancel()
        results = await asyncio.gather(*pending, return_exceptions=True)
        assert all(isinstance(each, asyncio.CancelledError) for each in results)
        with pytest.raises(InvalidRequest):  # the next task is executed; its plan is invalid
            await plan_work.run(
                "check",
                {
                    "plan": "[]",
                    "parameters": {},
                    "unknown_parameters": [],
                    "home": None,
                    "origin": None,
                    "reported": None,
                    "power": None,
                },
                small=True,
            )

    run(scenario)


def test_the_worker_knows_exactly_these_tasks():
    names = {"check", "compile", "compile_roles", "convert", "elevation_files", "export", "follow_ground"}
    assert set(tasks.TASKS) == names | {"import", "insert", "pattern", "pattern_on_ground", "table"}
