"""Starts PX4 instances and the DDS agent, starts again what crashes, and ends all together.

It is a process of its own, so that vehicles in flight survive a killed server. Its state is a file that the
server reads; what each instance prints is in its working folder.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

from gcs_server.px4_sitl.programs import Px4Program, Start
from gcs_server.storage.files import replace_file

FIRST_GCS_PORT: Final = 18570
"""UDP port of instance 0 for ground stations; PX4 sends from it to 14550."""
AGENT_PORT: Final = 8888
AGENT_LOG_FILE: Final = "agent.log"
CONSOLE_FILE: Final = "console.log"
STATE_FILE: Final = "state.json"
POLL_S: Final = 0.2
FIRST_BACK_OFF_S, MAX_BACK_OFF_S = 1.0, 30.0
HEALTHY_AFTER_S: Final = 60.0
"""An instance that has run for longer is started again with the first delay."""
SLOW_START_S: Final = 20.0
"""Time until PX4 should have opened its port for ground stations [s]."""
TERM_WAIT_S: Final = 3.0
SPACING_DEG: Final = 4e-5
"""Distance between two instances to the east: 3 m at 47° of latitude."""
HOME_DEG: Final = (47.397742, 8.545594)
"""Default home of PX4's simulators."""
TAIL_BYTES: Final = 2_000

State = Literal["starting", "running", "crashed", "ended"]


@dataclass(slots=True)
class InstanceState:
    """What the server knows of an instance."""

    instance: int
    system_id: int
    state: State = "starting"
    restarts: int = 0
    problem: str | None = None
    """Why it does not run, or that it was started again; a sentence."""


@dataclass(slots=True)
class RunnerState:
    """Content of the state file."""

    source: str
    """Where PX4 comes from."""
    agent: str
    """The DDS agent, as a clause."""
    instances: list[InstanceState] = field(default_factory=list[InstanceState])


class Instance:
    """One PX4 process.

    Args:
        number: instance number, from 0.
        folder: its working folder.
        start: how it is started.
        now_s: monotonic time [s].
        port_in_use: whether a process uses a UDP port.
    """

    def __init__(
        self,
        number: int,
        folder: Path,
        start: Start,
        now_s: Callable[[], float],
        port_in_use: Callable[[int], bool],
    ) -> None:
        self.view = InstanceState(number, number + 1)
        self._folder, self._start, self._now_s, self._port_in_use = folder, start, now_s, port_in_use
        self._process: subprocess.Popen[bytes] | None = None
        self._next_start_s: float | None = now_s()
        self._started_s = 0.0
        self._back_off_s = FIRST_BACK_OFF_S

    def step(self) -> None:
        """Starts the process if it is time, and updates the state."""
        now_s = self._now_s()
        if self._process is None:
            if self._next_start_s is not None and now_s >= self._next_start_s:
                self._spawn(now_s)
            return
        exit_code = self._process.poll()
        if exit_code is not None:
            self._process = None
            self._take_end(exit_code, now_s)
            return
        run_s = now_s - self._started_s
        if self.view.state == "starting":
            if self._port_in_use(FIRST_GCS_PORT + self.view.instance):
                self.view.state = "running"
                self.view.problem = self._restarted_text()
            elif run_s > SLOW_START_S:
                self.view.problem = (
                    f"PX4 instance {self.view.instance} has not opened its port "
                    f"{FIRST_GCS_PORT + self.view.instance} for {run_s:.0f} s. {self._last_words()}"
                )
        elif run_s > HEALTHY_AFTER_S:
            self._back_off_s, self.view.problem = FIRST_BACK_OFF_S, None

    def end(self) -> None:
        """Ends the process; waits for it."""
        if self._process is None:
            return
        self._process.terminate()
        try:
            self._process.wait(TERM_WAIT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _spawn(self, now_s: float) -> None:
        port = FIRST_GCS_PORT + self.view.instance
        if self._port_in_use(port):
            self.view.problem = (
                f"PX4 instance {self.view.instance} was not started: another program uses its UDP port "
                f"{port}, probably another PX4."
            )
            self._next_start_s = now_s + MAX_BACK_OFF_S
            return
        console = self._folder / CONSOLE_FILE
        with contextlib.suppress(FileNotFoundError):
            console.replace(console.with_name(f"{CONSOLE_FILE}.1"))
        self._next_start_s, self._started_s, self.view.state = None, now_s, "starting"
        try:
            with console.open("wb") as output:
                self._process = subprocess.Popen(
                    self._start.command,
                    cwd=self._folder,
                    env={**os.environ, **self._start.environment},
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                )
        except OSError as error:
            self.view.state, self._next_start_s = "crashed", now_s + MAX_BACK_OFF_S
            self.view.problem = (
                f"PX4 instance {self.view.instance} could not be started: {error.strerror or error}."
            )

    def _take_end(self, exit_code: int, now_s: float) -> None:
        name = f"PX4 instance {self.view.instance}"
        if exit_code == 0:  # its own `shutdown`
            self.view.state, self.view.problem = "ended", f"{name} was shut down; it is not started again."
            return
        if now_s - self._started_s > HEALTHY_AFTER_S:
            self._back_off_s = FIRST_BACK_OFF_S
        self.view.state, self.view.restarts = "crashed", self.view.restarts + 1
        self.view.problem = (
            f"{name} ended with exit code {exit_code}; it is started again in {self._back_off_s:g} s. "
            f"{self._last_words()}"
        )
        self._next_start_s = now_s + self._back_off_s
        self._back_off_s = min(2.0 * self._back_off_s, MAX_BACK_OFF_S)

    def _restarted_text(self) -> str | None:
        if not self.view.restarts:
            return None
        return (
            f"PX4 instance {self.view.instance} ended by itself and was started again: the vehicle is back "
            f"at its home; see {self._folder / CONSOLE_FILE}.1."
        )

    def _last_words(self) -> str:
        lines = console_tail(self._folder, TAIL_BYTES).strip().splitlines()
        return f"Its last line: {lines[-1][:200]}" if lines else "It has printed nothing."


def console_tail(folder: Path, max_bytes: int) -> str:
    """The last output of the instance with this working folder; empty if there is none."""
    try:
        with (folder / CONSOLE_FILE).open("rb") as file:
            file.seek(max(0, file.seek(0, os.SEEK_END) - max_bytes))
            return file.read(max_bytes).decode("utf-8", "replace")
    except OSError:
        return ""


def is_udp_port_in_use(port: int) -> bool:
    """Whether a process uses this UDP port on all or on loopback addresses."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return True
    return False


def variables(model: str, parameters: Mapping[str, str], instance: int) -> dict[str, str]:
    """PX4's environment variables for an instance; instances stand 3 m apart."""
    lat_deg, lon_deg = HOME_DEG
    own = {
        "PX4_SIM_MODEL": model,
        "PX4_HOME_LAT": f"{lat_deg:.6f}",
        "PX4_HOME_LON": f"{lon_deg + instance * SPACING_DEG:.6f}",
    }
    return {**own, **{f"PX4_PARAM_{name}": value for name, value in parameters.items()}}


class Agent:
    """The DDS agent: started unless one runs, and started again when it ends.

    Args:
        program: the program; None: none is started.
        folder: its output goes there.
        now_s: monotonic time [s].
        port_in_use: whether a process uses a UDP port.
    """

    def __init__(
        self,
        program: str | None,
        folder: Path,
        now_s: Callable[[], float],
        port_in_use: Callable[[int], bool],
    ) -> None:
        self.text = "no Micro XRCE-DDS Agent is installed: no ROS 2 topics"
        """Its state, as a clause."""
        self._program, self._folder, self._now_s, self._port_in_use = program, folder, now_s, port_in_use
        self._process: subprocess.Popen[bytes] | None = None
        self._next_start_s, self._started_s = now_s(), 0.0
        self._back_off_s = FIRST_BACK_OFF_S

    def step(self) -> None:
        """Starts the agent if it is time, and updates the state."""
        now_s = self._now_s()
        if self._process is None:
            if now_s >= self._next_start_s:
                self._start(now_s)
            return
        exit_code = self._process.poll()
        if exit_code is None:
            return
        if now_s - self._started_s > HEALTHY_AFTER_S:
            self._back_off_s = FIRST_BACK_OFF_S
        self._process, self._next_start_s = None, now_s + self._back_off_s
        self.text = (
            f"{self._program} ended with exit code {exit_code}: no ROS 2 topics until it is started again in "
            f"{self._back_off_s:g} s; see {self._folder / AGENT_LOG_FILE}"
        )
        self._back_off_s = min(2.0 * self._back_off_s, MAX_BACK_OFF_S)

    def end(self) -> None:
        """Ends the agent if it was started here."""
        if self._process is not None:
            self._process.terminate()

    def _start(self, now_s: float) -> None:
        if self._port_in_use(AGENT_PORT):
            self.text = f"UDP port {AGENT_PORT} is in use: a running agent is used"
            self._next_start_s = now_s + MAX_BACK_OFF_S
            return
        if self._program is None:
            self._next_start_s = math.inf
            return
        try:
            with (self._folder / AGENT_LOG_FILE).open("ab") as output:
                self._process = subprocess.Popen(
                    [self._program, "udp4", "-p", str(AGENT_PORT)],
                    stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT,
                )  # fmt: skip
        except OSError as error:
            self.text = f"{self._program} could not be started ({error.strerror or error}): no ROS 2 topics"
            self._next_start_s = now_s + MAX_BACK_OFF_S
            return
        self._started_s, self.text = now_s, f"{self._program} on UDP port {AGENT_PORT}"


def run(
    program: Px4Program,
    folder: Path,
    count: int,
    *,
    first_instance: int,
    model: str,
    parameters: Mapping[str, str],
    agent: str | None,
) -> None:
    """Runs the instances until SIGTERM or SIGINT, or until all have been shut down.

    Args:
        program: the PX4 to run.
        folder: working folder; each instance has its own in it.
        count: number of instances.
        first_instance: number of the first.
        model: PX4_SIM_MODEL, as `sihsim_quadx`.
        parameters: PX4 parameters set at each start.
        agent: program of the DDS agent; None: none is started.
    """

    def stop(_signal: int, _frame: object) -> None:
        raise SystemExit(0)

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, stop)
    instances: list[Instance] = []
    for number in range(first_instance, first_instance + count):
        own = folder / str(number)
        own.mkdir(parents=True, exist_ok=True)
        start = program.start(number, own, variables(model, parameters, number))
        instances.append(Instance(number, own, start, time.monotonic, is_udp_port_in_use))
    (folder / AGENT_LOG_FILE).unlink(missing_ok=True)
    dds_agent = Agent(agent, folder, time.monotonic, is_udp_port_in_use)
    dds_agent.step()
    print(f"{program.label}; {dds_agent.text}", flush=True)
    written: dict[str, Any] = {}
    try:
        while not all(each.view.state == "ended" for each in instances):
            for each in instances:
                each.step()
            dds_agent.step()
            state = asdict(RunnerState(program.label, dds_agent.text, [each.view for each in instances]))
            if state != written:
                if written and state["agent"] != written["agent"]:
                    print(dds_agent.text, file=sys.stderr, flush=True)
                replace_file(folder / STATE_FILE, json.dumps(state).encode())
                written = state
                for each in instances:
                    if each.view.problem is not None:
                        print(each.view.problem, file=sys.stderr, flush=True)
            time.sleep(POLL_S)
    finally:
        for each in instances:
            each.end()
        dds_agent.end()
        (folder / STATE_FILE).unlink(missing_ok=True)


def read_state(folder: Path) -> RunnerState | None:
    """The state that a running runner wrote; None: there is none."""
    try:
        raw = json.loads((folder / STATE_FILE).read_bytes())
        instances = [InstanceState(**each) for each in raw["instances"]]
        return RunnerState(str(raw["source"]), str(raw["agent"]), instances)
    except (OSError, ValueError, KeyError, TypeError):
        return None
