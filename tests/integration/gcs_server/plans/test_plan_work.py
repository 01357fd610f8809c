"""Tasks on large plans and on imported files, each in a process of its own: results, limits, and cancellation
by the caller."""

import asyncio
import json
import math
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gcs_server.errors import ClientHasTooMany, InvalidRequest, Refused
from gcs_server.operations.turns import CALLER, Caller, TurnLimits
from gcs_server.plans import tasks, work
from gcs_server.plans.work import PlanWork

NO_VEHICLE = {
    "parameters": {},
    "unknown_parameters": [],
    "home": None,
    "origin": None,
    "reported": None,
    "operator": {},
    "power": None,
    "traffic": None,
    "vehicle": None,
    "not_known": [],
}


def plan_text(count):
    item = {"kind": "waypoint", "altitude": {"value_m": 20, "reference": "home"}}
    items = [{**item, "lat_deg": 47.4 + 1e-5 * math.sin(n), "lon_deg": 8.5 + 1e-6 * n} for n in range(count)]
    return json.dumps({"items": items}).encode()


def run(scenario):
    plan_work = PlanWork(Path("no elevation"))
    try:
        return asyncio.run(scenario(plan_work))
    finally:
        plan_work.close()


def serve_with(monkeypatch, work_function):
    """Replaces the worker by a program with this function of a request."""
    program = f"""
import os, signal, sys, time
from gcs_server.operations.fork_server import TaskLimits, serve_tasks
def work(request):
    {work_function}
serve_tasks(int(sys.argv[-1]), work, TaskLimits(1_500_000_000, 20, 60))
"""
    monkeypatch.setattr(work, "COMMAND", (sys.executable, "-c", program))


def test_process_and_thread_give_the_same_result():
    arguments = {**NO_VEHICLE, "plan": plan_text(400), "parameters": {"MPC_XY_CRUISE": 3.0}}

    async def scenario(plan_work):
        return [await plan_work.run("check", arguments, small=small) for small in (True, False)]

    in_thread, in_process = run(scenario)
    assert in_thread == in_process
    assert json.loads(in_thread.body)["estimates"]["length_m"] > 0


def test_an_unreadable_plan_is_an_invalid_request_and_not_a_failure_of_the_process():
    arguments = {"file": b"PK no archive", "filename": "x.kmz", "altitude": None, "reference": None}

    async def scenario(plan_work):
        with pytest.raises(InvalidRequest, match="KMZ") as raised:
            await plan_work.run("import", arguments, small=False, field="body")
        assert raised.value.field == "body"

    run(scenario)


@pytest.mark.parametrize(
    "work_function",
    [
        "os.kill(os.getpid(), signal.SIGXCPU)",
        "raise ValueError",
        "return b''",
        "return bytes(40_000_000)",
        "return b'no'",
    ],
)
def test_a_task_without_a_valid_result_is_refused_and_the_next_one_has_a_new_process(
    monkeypatch, work_function
):
    serve_with(monkeypatch, work_function)

    async def scenario(plan_work):
        for _ in range(2):
            with pytest.raises(Refused, match="more memory or time"):
                await plan_work.run("pattern", {"pattern": b"{}"}, small=False)

    run(scenario)


def test_tasks_of_one_client_are_limited_and_a_cancelled_task_ends_with_its_process(monkeypatch, tmp_path):
    serve_with(monkeypatch, f"open({str(tmp_path)!r} + '/' + str(os.getpid()), 'w'); time.sleep(600)")
    limits = TurnLimits()

    async def scenario(plan_work):
        CALLER.set(Caller("anna", "here"))
        pending = [
            asyncio.ensure_future(plan_work.run("pattern", {"pattern": b"{}"}, small=False))
            for _ in range(limits.per_client)
        ]
        await until(lambda: len(list(tmp_path.iterdir())) == limits.running_without_control)
        pids = [int(each.name) for each in tmp_path.iterdir()]
        with pytest.raises(ClientHasTooMany, match="still running or waiting"):
            await plan_work.run("pattern", {"pattern": b"{}"}, small=False)
        for each in pending:
            each.cancel()
        results = await asyncio.gather(*pending, return_exceptions=True)
        assert all(isinstance(each, asyncio.CancelledError) for each in results)
        await until(lambda: not any(map(is_running, pids)))
        with pytest.raises(InvalidRequest):  # the next task is executed; its plan is invalid
            await plan_work.run("check", {**NO_VEHICLE, "plan": b"[]"}, small=True)

    run(scenario)


async def until(condition):
    while not condition():  # noqa: ASYNC110 another process changes it
        await asyncio.sleep(0.02)


def is_running(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_the_fork_server_ends_with_the_server():
    program = """
import asyncio, sys
from pathlib import Path
from gcs_server.plans.work import PlanWork
work = PlanWork(Path("none"))
asyncio.run(work.run("read", {"plan": b'{"items": []}', "name": None, "kind": None}, small=False))
print(work._processes._process.pid, flush=True)
sys.stdin.read()
"""
    command = [sys.executable, "-c", program]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        pid = int(process.stdout.readline())
        assert is_running(pid)
        process.kill()
    end_s = time.monotonic() + 20
    while is_running(pid) and time.monotonic() < end_s:
        time.sleep(0.02)
    assert not is_running(pid)


def test_the_worker_knows_exactly_these_tasks():
    names = {"check", "compile", "convert", "divide", "elevation_files", "export", "follow_ground"}
    names |= {"ground_from_tiles", "ground_tile", "relief", "wmts_layers"}
    names |= {"import", "insert", "items", "known_ground", "pattern", "pattern_on_ground", "read", "table"}
    assert set(tasks.TASKS) == names
