"""The simulated vehicle as a process of its own: it flies on when the server is killed, as a vehicle would.

A restarted server finds it by the port that PX4's first ground-station link holds (18570), which only one
process can bind, and by the note in the data folder that says who it is; it then starts no second one. A
server that ends cleanly ends the simulator that it started or took over; one that is killed leaves it flying.
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
import sys
from collections.abc import Sequence
from pathlib import Path

from gcs_server.clock import Clock
from gcs_server.storage.folder import DataFolder
from gcs_server.vehicle.fleet import Notice

log = logging.getLogger(__name__)

PX4_GCS_LOCAL_PORT = 18570
"""PX4 SITL instance N sends from 18570 + N."""
TERM_WAIT_S = 3.0
WATCH_PERIOD_S = 0.5
START_AGAIN_PERIOD_S = 2.0
SHORTAGES = frozenset({errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EAGAIN, errno.ENOBUFS, errno.ENOSPC})
"""What may be better a moment later; nothing is known of the simulator by it."""


def port_is_held(port: int) -> bool:
    """Whether some process has this loopback UDP port.

    Raises:
        OSError: that cannot be found out now, such as for want of descriptors.
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
    """The UDP port that the first vehicle holds, given the simulator's arguments; 0: any free one."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False, exit_on_error=False)
    parser.add_argument("--gcs-local-port", type=int, default=PX4_GCS_LOCAL_PORT)
    parser.add_argument("--first-instance", type=int, default=0)
    try:
        known, _ = parser.parse_known_args(list(arguments))
    except argparse.ArgumentError:
        return PX4_GCS_LOCAL_PORT  # the simulator itself says what is wrong
    return known.gcs_local_port + known.first_instance if known.gcs_local_port else 0


def is_simulator(pid: int) -> bool | None:
    """Whether the process lives and is one of ours: a pid may have been given to another one since.

    None: some process has the pid, and which it is cannot be found out now (no descriptors are left).
    """
    try:
        os.kill(pid, 0)
        command = Path(f"/proc/{pid}/cmdline").read_bytes()
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (ProcessLookupError, FileNotFoundError, PermissionError, OverflowError):
        return False  # PermissionError: another user's
    except OSError:
        return None
    return b"vehicle_sim" in command and state != "Z"


class SimulatorProcess:
    """Starts, finds, watches and ends it.

    Args:
        count: simulated vehicles.
        folder: for its log and the note of who it is.
        more: further arguments of `vehicle_sim`, such as its ports.
        command: what to run; the default is the simulator in this installation.
        probe_port: which port tells that a simulator runs; the simulator's own unless given.
    """

    def __init__(
        self,
        clock: Clock,
        count: int,
        folder: DataFolder,
        *,
        more: Sequence[str] = (),
        command: list[str] | None = None,
        probe_port: int | None = None,
    ) -> None:
        self._clock = clock
        self._folder = folder
        self._command = command or [sys.executable, "-m", "vehicle_sim", "--instances", str(count), *more]
        self._probe_port = first_port(more) if probe_port is None else probe_port
        self._child: subprocess.Popen[bytes] | None = None
        self._pid: int | None = None
        self._warning: str | None = None
        self._start_again = False
        """Whether `watch` is to find or start one again."""
        self.found = False
        """True where one ran already that is used."""

    @property
    def pid(self) -> int | None:
        """The process, where it is ours."""
        return self._pid

    def start(self) -> None:
        """Finds the one that runs, else starts one; what goes wrong becomes a warning, not an error."""
        try:
            self._start()
        except OSError as error:
            self._pid = None
            self._start_again = error.errno in SHORTAGES
            later = " It is tried again." if self._start_again else ""
            self._warn(f"The simulator could not be started: {error.strerror or error}.{later}")

    def _start(self) -> None:
        self._pid = self._noted_pid()
        self._start_again = False
        if port_is_held(self._probe_port) if self._probe_port else self._pid is not None:
            who = f"process {self._pid}" if self._pid else "not started by this data folder's server"
            if not self.found:
                log.info("a simulated vehicle runs already (%s); it is used, no second one is started", who)
            self.found = True
            self._start_again = self._pid is None  # once who has the port is gone
            return
        if self.found:
            log.info("the simulated vehicle that ran already is gone; this server starts its own")
        self.found = False
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
        self._pid, self._warning = self._child.pid, None
        with contextlib.suppress(OSError):
            note = {"pid": self._pid, "command": self._command, "started_unix_s": self._clock.unix_s()}
            self._folder.simulator_pid.write_text(json.dumps(note))

    async def watch(self) -> None:
        """Until the simulator dies, which becomes a warning.

        Where another program's simulator is used and ends, or nothing could be started for a shortage, this
        server's own is started.
        """
        while self._pid is not None or self._start_again:
            await self._clock.sleep(WATCH_PERIOD_S if self._pid is not None else START_AGAIN_PERIOD_S)
            if self._pid is None:
                self.start()
            elif self._ended():
                code = None if self._child is None else self._child.returncode
                ended = f" with exit code {code}" if code is not None else ""
                self._warn(f"The simulator ended by itself{ended}; see {self._folder.simulator_log}.")
                self._forget()

    def _ended(self) -> bool:
        """Whether it is certain that it lives no more."""
        if self._child is not None:  # tells without a descriptor
            return self._child.poll() is not None
        return self._pid is None or is_simulator(self._pid) is False

    def warnings(self) -> list[Notice]:
        """What stands now."""
        return [] if self._warning is None else [Notice("simulator", self._warning)]

    async def stop(self) -> None:
        """Ends it, kindly first; one that is not ours is left alone."""
        pid, self._start_again = self._pid, False
        if pid is None or self._ended():
            self._forget()
            return
        if self._child is None and not is_simulator(pid):
            return  # it cannot be told which process that is: it flies on, and the note stays
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGTERM)
            for _ in range(int(TERM_WAIT_S / 0.05)):
                await self._clock.sleep(0.05)
                if self._ended():
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

    def _noted_pid(self) -> int | None:
        try:
            pid = json.loads(self._folder.simulator_pid.read_text())["pid"]
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return pid if isinstance(pid, int) and pid > 1 and is_simulator(pid) else None

    def _warn(self, text: str) -> None:
        if text != self._warning:
            log.warning(text)
        self._warning = text
