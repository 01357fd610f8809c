"""The server starts, finds, monitors and stops the simulator's process; a stand-in program replaces the
simulator."""

import asyncio
import contextlib
import errno
import os
import socket
import sys

import pytest

from gcs_server import simulator_process
from gcs_server.clock import SystemClock
from gcs_server.simulator_process import SimulatorProcess, first_port, is_simulator
from gcs_server.storage.folder import DataFolder

STAND_IN_PROGRAM = (
    "import socket,sys,time; s=socket.socket(2,2); s.bind(('127.0.0.1',int(sys.argv[1]))); time.sleep(60)"
)


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def simulator(folder, port, code=STAND_IN_PROGRAM):
    """A `SimulatorProcess` that starts a stand-in program instead of the simulator."""
    command = [sys.executable, "-c", code, str(port), "vehicle_sim"]
    return SimulatorProcess(SystemClock(), command, folder, probe_port=port)


async def until(condition):
    async with asyncio.timeout(30):
        while not condition():  # noqa: ASYNC110 another process, so there is no event
            await asyncio.sleep(0.02)


def is_in_use(port):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return True
    return False


def test_the_simulator_survives_its_server_and_is_found_and_ended(tmp_path):
    async def scenario():
        folder, port = DataFolder(tmp_path), free_port()
        folder.prepare()
        first = simulator(folder, port)
        first.start()
        await until(lambda: is_in_use(port))
        assert os.getsid(first.pid) != os.getsid(0), (
            "the simulator is in the session of the server, so the server's signals reach the simulator"
        )
        second = simulator(folder, port)
        second.start()
        assert second.uses_running_simulator
        assert second.pid == first.pid
        await second.stop()
        await until(lambda: first._child.poll() is not None)
        assert not is_in_use(port)
        assert not folder.simulator_pid.exists()

    asyncio.run(scenario())


def test_a_simulator_that_ends_on_purpose_is_reported_as_a_warning(tmp_path):
    async def scenario():
        folder = DataFolder(tmp_path)
        folder.prepare()
        process = simulator(folder, free_port(), "import sys; sys.exit(2)")
        process.start()
        async with asyncio.timeout(30):
            await process.watch()
        (notice,) = process.warnings()
        assert "exit code 2" in notice.text
        assert "simulator.log" in notice.text

    asyncio.run(scenario())


class CountedClock(SystemClock):
    """Does not wait; notes the delays before a start, and adds them to the time."""

    def __init__(self):
        self.delays_s, self.now_s, self.limit = [], 0.0, 0

    def monotonic_s(self):
        return self.now_s

    async def sleep(self, duration_s):
        self.now_s += duration_s
        if duration_s >= simulator_process.FIRST_BACK_OFF_S:
            self.delays_s.append(duration_s)
        await asyncio.sleep(0.001)
        if len(self.delays_s) > self.limit:
            raise TimeoutError


def test_a_simulator_that_crashes_is_started_again_with_increasing_delay_and_reported(tmp_path):
    async def scenario():
        folder = DataFolder(tmp_path)
        folder.prepare()
        process = simulator(folder, 0, "import os, signal; os.kill(os.getpid(), signal.SIGKILL)")
        process._clock = clock = CountedClock()
        process._has_ended = lambda: process._child.wait() is not None
        clock.limit = 7
        process.start()
        with pytest.raises(TimeoutError):
            await process.watch()
        assert clock.delays_s == [1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0, 30.0]
        (notice,) = process.warnings()
        assert "exit code -9; it is started again in 30 s" in notice.text

        process._command[2] = STAND_IN_PROGRAM
        process._command[3] = str(port := free_port())
        process.start()
        (notice,) = process.warnings()
        assert "was started again" in notice.text
        assert "simulator.log.1" in notice.text
        clock.now_s += simulator_process.HEALTHY_AFTER_S + 1
        process._has_ended, clock.limit = lambda: process._child.poll() is not None, 99
        await until(lambda: is_in_use(port))
        watch = asyncio.ensure_future(process.watch())
        await until(lambda: process.warnings() == [])
        watch.cancel()
        await process.stop()

    asyncio.run(scenario())


def test_another_process_is_never_taken_for_the_simulator():
    assert not is_simulator(1)
    assert not is_simulator(2**22 + 1)  # greater than every process id


def test_each_start_begins_a_new_log_and_keeps_the_previous_log(tmp_path):
    async def scenario():
        folder = DataFolder(tmp_path)
        folder.prepare()
        for number in range(3):
            process = simulator(folder, free_port(), f"print('run {number}')")
            process.start()
            process._child.wait(5)
        assert folder.simulator_log.read_text() == "run 2\n"
        assert (tmp_path / "simulator.log.1").read_text() == "run 1\n"

    asyncio.run(scenario())


@pytest.mark.parametrize(
    ("arguments", "port"),
    [
        ("", 18570),
        ("--gcs-local-port 19000", 19000),
        ("--gcs-local-port=19000 --first-instance 7 --speed 3", 19007),
        ("--first-instance 100 --gcs-local-port 0", 0),
        ("--gcs-local-port nonsense", 18570),
    ],
)
def test_the_probed_port_is_taken_from_the_simulators_arguments(arguments, port):
    assert first_port(arguments.split()) == port


def test_without_a_fixed_port_the_simulator_is_found_by_its_pid_file(tmp_path):
    async def scenario():
        folder = DataFolder(tmp_path)
        folder.prepare()
        first = simulator(folder, 0)
        first.start()
        await until(lambda: is_simulator(first.pid))
        second = simulator(folder, 0)
        second.start()
        assert second.uses_running_simulator
        assert second.pid == first.pid
        await second.stop()
        third = simulator(folder, 0)
        third.start()
        assert not third.uses_running_simulator
        await third.stop()

    asyncio.run(scenario())


class FastClock(SystemClock):
    """Sleeps for a hundredth of the requested time."""

    async def sleep(self, duration_s):
        await asyncio.sleep(duration_s / 100)


@contextlib.asynccontextmanager
async def watching(process):
    process._clock = FastClock()
    watch = asyncio.ensure_future(process.watch())
    try:
        yield watch
    finally:
        watch.cancel()
        await process.stop()


def test_the_server_starts_its_own_simulator_when_another_programs_simulator_ends(tmp_path):
    async def scenario():
        folder, port = DataFolder(tmp_path), free_port()
        folder.prepare()
        process = simulator(folder, port)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other_socket:
            other_socket.bind(("127.0.0.1", port))
            process.start()
            assert (process.uses_running_simulator, process.pid) == (True, None)
            async with watching(process) as watch:
                await asyncio.sleep(0.2)
                assert process.pid is None
                assert not watch.done()
                other_socket.close()
                await until(lambda: process.pid is not None and is_in_use(port))
                assert (process.uses_running_simulator, process.warnings()) == (False, [])
        assert not is_in_use(port)

    asyncio.run(scenario())


def raise_too_many_files(*_arguments, **_options):
    raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))


def test_a_start_without_descriptors_is_reported_and_repeated(tmp_path, monkeypatch):
    async def scenario():
        folder, port = DataFolder(tmp_path), free_port()
        folder.prepare()
        process = simulator(folder, port)
        with monkeypatch.context() as patched:
            patched.setattr(simulator_process.subprocess, "Popen", raise_too_many_files)
            process.start()
            (notice,) = process.warnings()
            reason = "Too many open files"
            assert notice.text == f"The simulator could not be started: {reason}. The server tries again."
        async with watching(process):
            await until(lambda: is_in_use(port))
            assert process.warnings() == []

    asyncio.run(scenario())


@pytest.mark.parametrize("simulator_kind", ["started", "found"])
def test_missing_file_descriptors_are_not_mistaken_for_the_simulators_end(
    tmp_path, monkeypatch, simulator_kind
):
    async def scenario():
        folder, port = DataFolder(tmp_path), free_port()
        folder.prepare()
        process = first = simulator(folder, port)
        first.start()
        await until(lambda: is_in_use(port))
        if simulator_kind == "found":
            process = simulator(folder, port)
            process.start()
            assert process.uses_running_simulator
        async with watching(process) as watch:
            with monkeypatch.context() as patched:
                for name in ("read_bytes", "read_text"):
                    patched.setattr(simulator_process.Path, name, raise_too_many_files)
                await asyncio.sleep(0.2)
                assert not watch.done()
                assert process.warnings() == []
                assert folder.simulator_pid.exists()
            ended_pid = process.pid
            first._child.kill()
            first._child.wait()
            await until(lambda: process.pid not in (None, ended_pid))
            (notice,) = process.warnings()
            assert "stopped by itself" in notice.text
            assert "was started again" in notice.text

    asyncio.run(scenario())
