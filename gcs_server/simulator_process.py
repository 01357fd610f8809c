"""Runs the simulator in a separate process, so that it continues if the server is killed, as a real vehicle
does.

A restarted server finds a running simulator by the port of PX4's first ground-station link (18570), which
only one process can bind, and by the process id in the data folder. The server then does not start a second
simulator. A clean shutdown ends the simulator if this server, or an earlier server with the same data folder,
started it. A simulator that crashes is started again, with increasing delay, and the operator is told.
"""

from __future__ import annotations

import argparse
import contextlib
import errno
import json
import logging
import os
import signal
import socket
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path

from gcs_server.clock import Clock
from gcs_server.px4_sitl.runner import RunnerState, console_tail
from gcs_server.storage.folder import DataFolder
from gcs_server.vehicle.fleet import Notice

log = logging.getLogger(__name__)

PX4_GCS_LOCAL_PORT = 18570
"""PX4 SITL instance N sends from 18570 + N."""
TERM_WAIT_S = 3.0
CONSOLE_BYTES = 16_000
"""Length of the output of an instance that is shown."""
WATCH_PERIOD_S = 0.5
RESTART_PERIOD_S = 2.0
FIRST_BACK_OFF_S, MAX_BACK_OFF_S = 1.0, 30.0
HEALTHY_AFTER_S = 60.0
"""A simulator that has run for longer is started again with the first delay, and its crash is no longer
reported."""
WRONG_ARGUMENTS = 2
"""Exit code of a command line that the simulator does not understand."""
ENDED_ON_PURPOSE = frozenset({0, WRONG_ARGUMENTS, -signal.SIGTERM, -signal.SIGINT})
"""Exit codes after which the simulator is not started again."""
TEMPORARY_ERRNOS = frozenset(
    {errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EAGAIN, errno.ENOBUFS, errno.ENOSPC}
)
"""Errors from a temporary lack of resources; the server tries again."""


def is_port_in_use(port: int) -> bool:
    """Whether a process uses this loopback UDP port.

    Raises:
        OSError: the port cannot be checked now, for example without free file descriptors.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise
            return True
    return False


def first_port(arguments: Sequence[str]) -> int:
    """UDP port of the first vehicle for these simulator arguments; 0: any free port."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False, exit_on_error=False)
    parser.add_argument("--gcs-local-port", type=int, default=PX4_GCS_LOCAL_PORT)
    parser.add_argument("--first-instance", type=int, default=0)
    try:
        ports, _ = parser.parse_known_args(list(arguments))
    except argparse.ArgumentError:
        return PX4_GCS_LOCAL_PORT  # the simulator reports the error itself
    return ports.gcs_local_port + ports.first_instance if ports.gcs_local_port else 0


def is_simulator(pid: int) -> bool | None:
    """Whether a process with this pid is running and is a simulator. The system reuses pids, so a stored pid
    may belong to another program. None: the process cannot be identified now (no free descriptors).
    """
    try:
        os.kill(pid, 0)
        command = Path(f"/proc/{pid}/cmdline").read_bytes()
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (ProcessLookupError, FileNotFoundError, PermissionError, OverflowError):
        return False  # PermissionError: the process of another user
    except OSError:
        return None
    return any(name in command for name in (b"vehicle_sim", b"px4_sitl")) and state != "Z"


class SimulatorProcess:
    """Starts, finds, watches and ends the simulator.

    Args:
        command: the simulator with its arguments: `vehicle_sim` or `px4_sitl`.
        folder: data folder for the log and the process id.
        probe_port: port that is in use while a simulator runs; default: the port of its first
            vehicle.
        count: number of vehicles; each sends from the next port.
        state: reads what `px4_sitl` reports of its instances.
    """

    def __init__(
        self,
        clock: Clock,
        command: list[str],
        folder: DataFolder,
        *,
        probe_port: int | None = None,
        count: int = 1,
        state: Callable[[], RunnerState | None] = lambda: None,
    ) -> None:
        self._clock = clock
        self._folder = folder
        self._command = command
        self.state = state
        self._probe_port = first_port(command) if probe_port is None else probe_port
        self._count = count
        self._child: subprocess.Popen[bytes] | None = None
        self._pid: int | None = None
        self._warning: str | None = None
        self._start_again = False
        """Whether `watch` must find or start a simulator again."""
        self._start_delay_s = RESTART_PERIOD_S
        self._started_s = clock.monotonic_s()
        self._back_off_s = FIRST_BACK_OFF_S
        self._crash_warning: str | None = None
        self.uses_running_simulator = False
        """Whether an already running simulator is used."""

    @property
    def pid(self) -> int | None:
        """Process id of a simulator that this server, or its previous run, started; None: no such
        simulator."""
        return self._pid

    def sends_from(self, address: tuple[str, int] | None) -> bool:
        """Whether the vehicles of this process send from this UDP address: each has a loopback port that
        only one process can have."""
        if self._pid is None or address is None or not self._probe_port:
            return False
        host, port = address
        return host == "127.0.0.1" and 0 <= port - self._probe_port < self._count

    def start(self) -> None:
        """Finds a running simulator or starts one; a failure becomes a warning."""
        try:
            self._start()
        except OSError as error:
            self._pid = None
            self._start_again = error.errno in TEMPORARY_ERRNOS
            self._start_delay_s = RESTART_PERIOD_S
            retry_text = " The server tries again." if self._start_again else ""
            self._warn(f"The simulator could not be started: {error.strerror or error}.{retry_text}")

    def _start(self) -> None:
        self._pid = self._stored_pid()
        self._start_again = False
        if self._pid is not None or (self._probe_port and is_port_in_use(self._probe_port)):
            owner = f"process {self._pid}" if self._pid else "not started by this data folder's server"
            if not self.uses_running_simulator:
                log.info(
                    "a simulator is already running (%s): the server uses it, and starts no other", owner
                )
            self.uses_running_simulator = True
            self._start_again = self._pid is None  # `watch` starts a simulator once the port is free
            self._start_delay_s = RESTART_PERIOD_S
            return
        if self.uses_running_simulator:
            log.info("the simulator that was already running has ended; this server starts its own")
        self.uses_running_simulator = False
        log_file = self._folder.simulator_log
        with contextlib.suppress(FileNotFoundError):
            log_file.replace(log_file.with_name(f"{log_file.name}.1"))
        with log_file.open("wb") as output:
            self._child = subprocess.Popen(
                self._command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        self._pid, self._warning = self._child.pid, self._crash_warning
        self._started_s = self._clock.monotonic_s()
        with contextlib.suppress(OSError):
            record = {"pid": self._pid, "command": self._command, "started_unix_s": self._clock.unix_s()}
            self._folder.simulator_pid.write_text(json.dumps(record))

    async def watch(self) -> None:
        """Monitors the simulator; its end becomes a warning, and after a crash it is started again. If a
        simulator that another program started ends, or no simulator could be started for lack of resources,
        this server starts its own.
        """
        while self._pid is not None or self._start_again:
            await self._clock.sleep(WATCH_PERIOD_S if self._pid is not None else self._start_delay_s)
            if self._pid is None:
                self.start()
            elif self._has_ended():
                self._take_end(None if self._child is None else self._child.returncode)
            elif self._crash_warning is not None and self._has_run_s() > HEALTHY_AFTER_S:
                self._crash_warning = self._warning = None

    def _has_run_s(self) -> float:
        return self._clock.monotonic_s() - self._started_s

    def _take_end(self, exit_code: int | None) -> None:
        exit_text = f" with exit code {exit_code}" if exit_code is not None else ""
        ended_text, log_file = f"The simulator stopped by itself{exit_text}", self._folder.simulator_log
        self._forget()
        if exit_code in ENDED_ON_PURPOSE:
            self._warn(f"{ended_text}; see {log_file}.")
            return
        if self._has_run_s() > HEALTHY_AFTER_S:
            self._back_off_s = FIRST_BACK_OFF_S
        self._start_again, self._start_delay_s = True, self._back_off_s
        self._back_off_s = min(2.0 * self._back_off_s, MAX_BACK_OFF_S)
        self._crash_warning = (
            f"{ended_text} and was started again: its vehicles are back at their home; see {log_file}.1."
        )
        self._warn(f"{ended_text}; it is started again in {self._start_delay_s:g} s; see {log_file}.")

    def _has_ended(self) -> bool:
        """Whether the simulator has certainly ended."""
        if self._child is not None:  # this check needs no file descriptor
            return self._child.poll() is not None
        return self._pid is None or is_simulator(self._pid) is False

    def warnings(self) -> list[Notice]:
        """Current warnings."""
        state = self.state()
        problems = [] if state is None else [each.problem for each in state.instances]
        return [Notice("simulator", text) for text in (self._warning, *problems) if text is not None]

    def consoles(self, state: RunnerState) -> list[str]:
        """The last output of each PX4 instance of a state."""
        folder = self._folder.px4_sitl
        return [console_tail(folder / str(each.instance), CONSOLE_BYTES) for each in state.instances]

    async def stop(self) -> None:
        """Ends the simulator, with SIGTERM first; does not end a simulator that another
        program started."""
        pid, self._start_again = self._pid, False
        if pid is None or self._has_ended():
            self._forget()
            return
        if self._child is None and not is_simulator(pid):
            return  # the process cannot be identified: it is left running, and its pid stays stored
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGTERM)
            for _ in range(int(TERM_WAIT_S / 0.05)):
                await self._clock.sleep(0.05)
                if self._has_ended():
                    break
            else:
                os.kill(pid, signal.SIGKILL)
                if self._child is not None:
                    self._child.wait()
        self._forget()

    def _forget(self) -> None:
        self._pid = None
        with contextlib.suppress(OSError):
            self._folder.simulator_pid.unlink(missing_ok=True)

    def _stored_pid(self) -> int | None:
        try:
            pid = json.loads(self._folder.simulator_pid.read_text())["pid"]
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return pid if isinstance(pid, int) and pid > 1 and is_simulator(pid) else None

    def _warn(self, text: str) -> None:
        if text != self._warning:
            log.warning(text)
        self._warning = text
