"""Work in a separate process: its progress, its errors, and its cancellation."""

import asyncio
import os
import sys
import textwrap

import pytest

from gcs_server.operations.process import WorkerFailed, run_process

IMPORTS = "import os, signal, sys, time\nfrom gcs_server.operations.process import serve\n"


def command_for(body):
    return [sys.executable, "-c", IMPORTS + textwrap.dedent(body)]


def has_ended(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False


def test_progress_and_result_are_received():
    reports = []
    body = """
    def work(report):
        for n in range(3):
            report(f"flight {n}", n / 3)
        return {"flights": 3}, b"paths" * 100_000
    serve(work)
    """
    result = asyncio.run(
        run_process(command_for(body), lambda *report: reports.append(report), max_body_bytes=500_000)
    )
    assert result == ({"flights": 3}, b"paths" * 100_000)
    assert reports == [("flight 0", 0.0), ("flight 1", 1 / 3), ("flight 2", 2 / 3)]


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("def work(report): raise ValueError('no home')\nserve(work)", "no home"),
        ("os.kill(os.getpid(), signal.SIGKILL)", "exit status -9"),
        ("print('no JSON', flush=True); time.sleep(60)", "cannot be read"),
        ("print('x' * 1_000_000, flush=True); time.sleep(60)", "cannot be read"),
        ("print('[1]', flush=True); time.sleep(60)", "cannot be read"),
        ("serve(lambda _: ({}, b'too much'))", "more than 0 bytes"),
        ('print(\'{"result": {}, "body_bytes": -1}\', flush=True); time.sleep(60)', "more than 0 bytes"),
    ],
)
def test_a_process_without_a_valid_result_raises_an_error_with_the_reason(body, reason):
    with pytest.raises(WorkerFailed, match=reason):
        asyncio.run(run_process(command_for(body), lambda *_: None))


@pytest.mark.parametrize("ignores_sigterm", [False, True])
def test_cancelling_ends_the_process_even_if_it_ignores_sigterm(ignores_sigterm):
    body = f"""
    if {ignores_sigterm}:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    def work(report):
        report(str(os.getpid()), None)
        time.sleep(600)
    serve(work)
    """

    async def cancelled_pid():
        reported_pid = asyncio.get_running_loop().create_future()
        task = asyncio.ensure_future(
            run_process(
                command_for(body), lambda text, _: reported_pid.done() or reported_pid.set_result(int(text))
            )
        )
        pid = await reported_pid
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        return pid

    assert has_ended(asyncio.run(cancelled_pid()))


def test_the_process_ends_when_its_server_ends():
    body = """
    def work(report):
        report("started", None)
        time.sleep(600)
    serve(work)
    """

    async def exit_status():
        process = await asyncio.create_subprocess_exec(
            *command_for(body), stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE
        )
        await process.stdout.readline()
        process.stdin.close()
        return await process.wait()

    assert asyncio.run(exit_status()) == 1
