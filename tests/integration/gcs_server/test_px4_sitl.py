"""Which PX4 is started, how, and what happens when it does not run; short programs stand in for it."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from gcs_server.errors import GcsError
from gcs_server.px4_sitl.__main__ import main, parameters_of
from gcs_server.px4_sitl.programs import IMAGE, ImageMissing, Px4Program, Start, find_agent, find_px4
from gcs_server.px4_sitl.runner import Agent, Instance, read_state, variables


def build_in(folder: Path, code: str = "") -> Path:
    """A build folder with a program `px4`; returns the program."""
    (folder / "bin").mkdir(parents=True)
    (folder / "etc/init.d-posix").mkdir(parents=True)
    (folder / "etc/init.d-posix/rcS").touch()
    binary = folder / "bin/px4"
    binary.write_text(f"#!{sys.executable}\n{code}")
    binary.chmod(0o755)
    return binary


def nothing_installed(_name: str) -> None:
    return None


@pytest.mark.parametrize("named", ["build", "source", "program"])
def test_a_named_build_is_started_with_its_folder_and_start_up_script(tmp_path: Path, named: str) -> None:
    build = tmp_path / "PX4-Autopilot/build/px4_sitl_default"
    binary = build_in(build)
    path = {"build": build, "source": tmp_path / "PX4-Autopilot", "program": binary}[named]
    program = find_px4(path, which=nothing_installed)
    start = program.start(2, Path("/data/px4/2"), {"PX4_SIM_MODEL": "sihsim_quadx"})
    assert start.command == [str(binary), "-i", "2", "-d", "-w", "/data/px4/2", str(build / "etc")]
    assert start.environment == {"PX4_SIM_MODEL": "sihsim_quadx"}


def test_a_wrong_path_is_refused_with_what_is_missing(tmp_path: Path) -> None:
    with pytest.raises(GcsError, match="no PX4 here"):
        find_px4(tmp_path)
    binary = build_in(tmp_path / "build")
    binary.chmod(0o644)
    with pytest.raises(GcsError, match="cannot be executed"):
        find_px4(tmp_path / "build")
    binary.chmod(0o755)
    (tmp_path / "build/etc/init.d-posix/rcS").unlink()
    with pytest.raises(GcsError, match="start-up script"):
        find_px4(binary)


def test_an_installed_package_comes_before_an_image_and_other_programs_named_px4_do_not(
    tmp_path: Path,
) -> None:
    binary = build_in(tmp_path / "opt/px4")
    link = tmp_path / "px4"
    link.symlink_to(binary)
    found = find_px4(None, which=lambda name: str(link) if name == "px4" else None)
    assert found.binary == binary
    stray = tmp_path / "usr/bin/px4"
    stray.parent.mkdir(parents=True)
    stray.touch()
    with pytest.raises(GcsError, match="no PX4 on this computer") as refusal:
        find_px4(None, which=lambda name: str(stray) if name == "px4" else None)
    assert "apt install" in (refusal.value.remedy or "")


def test_the_image_is_used_if_it_is_there_and_never_downloaded_unasked() -> None:
    commands: list[list[str]] = []

    def engine(images: tuple[str, ...]) -> Callable[..., bool]:
        def run(command: list[str]) -> bool:
            commands.append(command)
            return command[1] == "info" or command[-1] in images

        return run

    def podman(name: str) -> str | None:
        return "/usr/bin/podman" if name == "podman" else None

    with pytest.raises(ImageMissing) as refusal:
        find_px4(None, which=podman, run=engine(()))
    assert refusal.value.remedy == f"Download it (about 100 MB): podman pull {IMAGE}"
    assert not any("pull" in command for command in commands)
    program = find_px4(None, which=podman, run=engine((IMAGE,)))
    start = program.start(1, Path("/data"), {"PX4_PARAM_COM_OBL_RC_ACT": "5"})
    assert start.command[:2] == ["podman", "run"]
    assert "--env=PX4_PARAM_COM_OBL_RC_ACT=5" in start.command
    assert start.command[-4:] == [IMAGE, "-i", "1", "-d"]
    with pytest.raises(GcsError, match="no PX4"):  # its daemon does not run
        find_px4(None, which=podman, run=lambda _command: False)


def test_instances_stand_apart_and_get_the_parameters() -> None:
    first, second = (variables("sihsim_quadx", {"MPC_XY_CRUISE": "3"}, n) for n in (0, 1))
    assert first["PX4_PARAM_MPC_XY_CRUISE"] == "3"
    assert float(second["PX4_HOME_LON"]) - float(first["PX4_HOME_LON"]) == pytest.approx(4e-5, abs=1e-6)
    assert parameters_of(["COM_OBL_RC_ACT=5", "MPC_XY_CRUISE=-1.5e0"])["MPC_XY_CRUISE"] == "-1.5e0"
    for wrong in ("COM_OBL_RC_ACT", "A=b", "a=1", "A=1;rm"):
        with pytest.raises(GcsError, match="NAME=VALUE"):
            parameters_of([wrong])


def test_a_wrong_command_line_ends_with_the_remedy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--px4-path", str(tmp_path)]) == 2
    assert "make px4_sitl" in capsys.readouterr().err
    assert main(["--instances", "99"]) == 2
    assert "from 1 to 20" in capsys.readouterr().err


class Bench:
    """One instance whose program is a few lines of Python, and whose time the test sets."""

    def __init__(self, folder: Path, code: str) -> None:
        self.now_s, self.ports = 100.0, set[int]()
        start = Start([sys.executable, "-c", code], {"PX4_SIM_MODEL": "sihsim_quadx"})
        self.instance = Instance(0, folder, start, lambda: self.now_s, self.ports.__contains__)

    def step(self, seconds: float = 0.0) -> str:
        self.now_s += seconds
        self.instance.step()
        return self.instance.view.problem or ""

    def wait_for_end(self) -> None:
        process = self.instance._process
        assert process is not None
        process.wait(timeout=30)


def test_a_crash_is_told_with_its_last_line_and_started_again_with_increasing_delay(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "print('hello'); print('ERROR [param] no file'); raise SystemExit(3)")
    bench.step()
    for delay_s in (1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0):
        bench.wait_for_end()
        problem = bench.step()
        assert f"exit code 3; it is started again in {delay_s:g} s" in problem
        assert problem.endswith("Its last line: ERROR [param] no file")
        bench.step(delay_s - 0.1)
        assert bench.instance.view.state == "crashed"
        bench.step(0.2)
        assert bench.instance.view.state == "starting"
    bench.wait_for_end()
    assert bench.instance.view.restarts == 7
    assert "hello" in (tmp_path / "console.log.1").read_text()


def test_an_instance_runs_from_when_its_port_is_open_and_a_slow_start_is_told(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "import time; print('booting', flush=True); time.sleep(60)")
    bench.step()
    deadline_s = time.monotonic() + 30
    while not (tmp_path / "console.log").read_text() and time.monotonic() < deadline_s:
        time.sleep(0.01)
    assert bench.step(19.0) == ""
    assert "has not opened its port 18570 for 21 s. Its last line: booting" in bench.step(2.0)
    bench.ports.add(18570)
    assert bench.step(1.0) == ""
    assert bench.instance.view.state == "running"
    bench.instance.end()
    assert bench.instance._process is not None
    assert bench.instance._process.returncode is not None


def test_a_restarted_instance_says_that_the_vehicle_is_back_at_its_home_for_a_minute(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "import time; time.sleep(60)")
    bench.step()
    assert bench.instance._process is not None
    bench.instance._process.kill()
    bench.wait_for_end()
    bench.step()
    bench.step(1.0)
    bench.ports.add(18570)
    assert "was started again: the vehicle is back at its home" in bench.step()
    assert "was started again" in bench.step(30.0)
    assert bench.step(31.0) == ""
    bench.instance.end()


def test_a_port_in_use_prevents_the_start_and_is_named(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "")
    bench.ports.add(18570)
    assert "another program uses its UDP port 18570" in bench.step()
    bench.ports.clear()
    bench.step(31.0)
    bench.wait_for_end()


def test_a_px4_that_was_shut_down_is_not_started_again(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "")
    bench.step()
    bench.wait_for_end()
    assert "was shut down; it is not started again" in bench.step()
    bench.step(100.0)
    assert bench.instance.view.state == "ended"


def test_a_program_that_cannot_be_executed_is_told(tmp_path: Path) -> None:
    start = Start([str(tmp_path / "gone")], {})
    instance = Instance(0, tmp_path, start, lambda: 0.0, lambda _port: False)
    instance.step()
    assert instance.view.problem is not None
    assert "could not be started: No such file" in instance.view.problem


def test_without_an_agent_the_reason_is_told(tmp_path: Path) -> None:
    ports: set[int] = set()
    agent = Agent(None, tmp_path, lambda: 0.0, ports.__contains__)
    agent.step()
    assert agent.text == "no Micro XRCE-DDS Agent is installed: no ROS 2 topics"
    ports.add(8888)
    agent = Agent("agent", tmp_path, lambda: 0.0, ports.__contains__)
    agent.step()
    assert "a running agent is used" in agent.text
    assert find_agent(lambda name: "/snap/bin/agent" if name.startswith("micro") else None)


def test_an_agent_that_ends_is_told_and_started_again_with_increasing_delay(tmp_path: Path) -> None:
    # A real agent that was killed stayed dead, and its state was still "on UDP port 8888".
    now_s = 100.0
    program = tmp_path / "agent"
    program.write_text(
        f"#!{sys.executable}\nimport sys; print(sys.argv[1:], flush=True); raise SystemExit(3)\n"
    )
    program.chmod(0o755)
    agent = Agent(str(program), tmp_path, lambda: now_s, lambda _port: False)
    for delay_s in (1.0, 2.0, 4.0):
        agent.step()
        assert agent.text == f"{program} on UDP port 8888"
        assert agent._process is not None
        agent._process.wait(timeout=30)
        agent.step()
        assert (
            f"ended with exit code 3: no ROS 2 topics until it is started again in {delay_s:g} s"
            in agent.text
        )
        now_s += delay_s - 0.1
        agent.step()
        assert agent._process is None
        now_s += 0.2
    agent.end()
    assert (tmp_path / "agent.log").read_text().splitlines() == ["['udp4', '-p', '8888']"] * 3
    program.unlink()
    agent.step()
    assert "could not be started (No such file" in agent.text


def test_the_state_of_the_instances_is_read_while_the_runner_runs_and_all_end_with_it(tmp_path: Path) -> None:
    binary = build_in(tmp_path / "build", "import time; print('px4', flush=True); time.sleep(60)")
    command = [sys.executable, "-m", "gcs_server.px4_sitl", "--px4-path", str(binary), "--no-agent"]
    command += ["--data", str(tmp_path / "data"), "--instances", "2", "--first-instance", "700"]
    folder = tmp_path / "data/px4"
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        try:
            deadline_s = time.monotonic() + 30
            while (state := read_state(folder)) is None and time.monotonic() < deadline_s:
                time.sleep(0.02)
            assert state is not None
            assert [each.system_id for each in state.instances] == [701, 702]
            assert "PX4 build" in state.source
        finally:
            process.terminate()
            assert process.wait(timeout=30) == 0
    assert read_state(folder) is None
    assert not [
        line
        for line in Path("/proc").glob("[0-9]*/cmdline")
        if str(binary).encode() in _bytes_of(line) and b"px4_sitl" not in _bytes_of(line)
    ]


def _bytes_of(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError:
        return b""


def test_a_damaged_state_file_is_no_state(tmp_path: Path) -> None:
    for content in (b"", b"[]", b'{"instances": [{"x": 1}]}', b'{"instances": 3}'):
        (tmp_path / "state.json").write_bytes(content)
        assert read_state(tmp_path) is None


def test_the_program_of_an_image_needs_no_folder() -> None:
    assert Px4Program("image", None, "docker").start(0, Path("/x"), {}).environment == {}
