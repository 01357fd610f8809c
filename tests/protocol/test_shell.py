"""The vehicle's console over SERIAL_CONTROL with the simulated vehicle, with packet loss."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Awaitable, Callable
from types import SimpleNamespace
from typing import Any

import pytest

from gcs_server.api import shell_routes
from gcs_server.api.shell_routes import ShellLine
from gcs_server.errors import GcsError, InvalidRequest, NoReply, NotInControl, Refused
from gcs_server.vehicle.services import shell
from gcs_server.vehicle.services.shell import PIECE_BYTES, ShellService
from tests.protocol.api_calls import ANNA, BOB, json_of, new_station
from tests.protocol.offboard_testbed import OffboardTestbed
from tests.protocol.simulated_autopilot import SimulatedAutopilot
from vehicle_sim.shell.console import Console

LONG = "param show " + "_".join(["MPC_XY_CRUISE"] * 12)
"""A line of three messages."""
SERIAL_CONTROL = 126


Scenario = Callable[[Any], Awaitable[None]]


def run_with_shell(run_simulated: Any, scenario: Scenario, *, loss: float = 0.0, seed: int = 0) -> None:
    async def run() -> None:
        testbed = OffboardTestbed()
        autopilot = SimulatedAutopilot(testbed.link(), seed=seed)
        try:
            vehicle = await testbed.wait_for_vehicle()
            await asyncio.sleep(1.0)
            autopilot.loss = loss
            service = vehicle.service(ShellService)
            await scenario(
                SimpleNamespace(testbed=testbed, autopilot=autopilot, vehicle=vehicle, shell=service)
            )
        finally:
            autopilot.alive = False
            await testbed.close()

    run_simulated(run)


@pytest.fixture
def run_lines(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The lines that consoles of simulated vehicles have run."""
    lines: list[str] = []
    process = Console._process  # pyright: ignore[reportPrivateUsage]

    def record(console: Console, line: str) -> str:
        lines.append(line)
        return process(console, line)

    monkeypatch.setattr(Console, "_process", record)
    return lines


def test_the_lines_of_a_gimbal_set_up_are_run_and_their_output_is_read(
    run_simulated: Any, run_lines: list[str]
) -> None:
    async def scenario(rig: Any) -> None:
        lines = ["gimbal start", "gimbal primary-control 1 1", "gimbal status", "nonsense", ""]
        answers = [await rig.shell.run(line) for line in lines]
        assert run_lines == lines
        assert all(complete for _, complete in answers)
        status = answers[2][0]
        assert status.startswith("gimbal status\nINFO  [gimbal] Input Selected\n")
        assert status.endswith("Primary control:   1/1\nINFO  [gimbal] Output: AUX\npxh> ")
        assert (
            answers[3][0] == "nonsense\nInvalid command: nonsense\ntype 'help' for a list of commands\npxh> "
        )
        kept = rig.shell.output()
        assert kept.text == "".join(output for output, _ in answers)
        assert rig.shell.output(kept.end - 5).text == "pxh> "
        assert rig.shell.newest() == kept
        assert rig.shell.output(kept.end).text == ""

    run_with_shell(run_simulated, scenario)


@pytest.mark.parametrize("seed", range(6))
def test_at_20_percent_loss_no_line_is_run_twice_or_without_its_beginning(
    run_simulated: Any, run_lines: list[str], seed: int
) -> None:
    async def scenario(rig: Any) -> None:
        sent = [f"{LONG} {number}" if number % 2 else f"ver hw {number}" for number in range(20)]
        refused: list[str] = []
        for line in sent:
            try:
                await rig.shell.run(line)
            except NoReply as error:
                refused.append(line)
                if "it was not run" in str(error):
                    assert line not in run_lines
        assert refused, "with this loss some echoes are missing"
        counts = Counter(run_lines)
        assert counts.keys() <= set(sent), "what was run is a whole line"
        assert max(counts.values()) == 1
        assert set(sent) - set(refused) <= counts.keys(), "a line with an answer was run"

    run_with_shell(run_simulated, scenario, loss=0.2, seed=seed)


def test_a_line_while_armed_must_say_so(run_simulated: Any, run_lines: list[str]) -> None:
    async def scenario(rig: Any) -> None:
        await asyncio.sleep(15)
        await rig.vehicle.command.arm()
        with pytest.raises(Refused, match="is armed") as refusal:
            await rig.shell.run("commander disarm -f")
        assert "while_armed" in str(refusal.value.remedy)
        assert run_lines == []
        output, _ = await rig.shell.run("ver hw", while_armed=True)
        assert output.startswith("ver hw\n")

    run_with_shell(run_simulated, scenario)


@pytest.mark.parametrize(
    ("line", "why"),
    [("param set A 1\nreboot", "printable"), ("gimbal stätus", "printable"), ("x" * 251, "at most 250")],
)
def test_a_line_that_is_no_line_is_refused(
    run_simulated: Any, run_lines: list[str], line: str, why: str
) -> None:
    async def scenario(rig: Any) -> None:
        with pytest.raises(InvalidRequest, match=why):
            await rig.shell.run(line)
        assert rig.autopilot.count(SERIAL_CONTROL) == 0
        assert run_lines == []

    run_with_shell(run_simulated, scenario)


def test_the_longest_line_of_one_message_and_one_more(run_simulated: Any, run_lines: list[str]) -> None:
    async def scenario(rig: Any) -> None:
        for length in (PIECE_BYTES - 1, PIECE_BYTES, 2 * PIECE_BYTES - 1, 2 * PIECE_BYTES, 250):
            await rig.shell.run("x" * length)
        assert [len(line) for line in run_lines] == [69, 70, 139, 140, 250]

    run_with_shell(run_simulated, scenario)


def test_an_unused_console_is_closed_and_opened_again_by_the_next_line(
    run_simulated: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shell, "IDLE_S", 8.0)

    async def scenario(rig: Any) -> None:
        sessions = rig.autopilot.sim.nodes[0]._shell._sessions
        await rig.shell.run("ver hw")
        assert len(sessions) == 1
        for _ in range(4):
            await asyncio.sleep(4.0)
            assert rig.shell.output().open, "a client still reads"
        await asyncio.sleep(11.0)
        assert len(sessions) == 0
        output, complete = await rig.shell.run("ver hw")
        assert output.startswith("ver hw\n")
        assert complete

    run_with_shell(run_simulated, scenario)


def test_a_lost_vehicle_ends_the_wait_and_the_console(run_simulated: Any) -> None:
    async def scenario(rig: Any) -> None:
        await rig.shell.run("ver hw")
        rig.autopilot.alive = False
        with pytest.raises(GcsError):
            await rig.shell.run("ver hw")
        await asyncio.sleep(10)
        assert not rig.shell.newest().open
        with pytest.raises(GcsError, match="not connected"):
            await rig.shell.run("ver hw")

    run_with_shell(run_simulated, scenario)


def test_two_clients_share_the_console_and_only_the_one_in_control_sends(
    run_simulated: Any, run_lines: list[str]
) -> None:
    async def scenario(rig: Any) -> None:
        station = new_station(rig.testbed)
        hardware, reboot = (ShellLine.model_validate({"line": each}) for each in ("ver hw", "reboot"))
        answer = json_of(await shell_routes.run("1", hardware, station, ANNA))
        assert answer["complete"]
        with pytest.raises(NotInControl):
            await shell_routes.run("1", reboot, station, BOB)
        assert run_lines == ["ver hw"]
        seen = json_of(await shell_routes.output(rig.vehicle))
        assert seen["text"] == answer["output"]
        lines = [
            (each.arguments["line"], each.result)
            for each in station.journal.tail(10)
            if each.command == "shell"
        ]
        assert lines == [("reboot", "not_in_control"), ("ver hw", "ok")]

    run_with_shell(run_simulated, scenario)
