"""Agents in real time: the program of the document, one that dies in a call, and what flies by neither."""

from __future__ import annotations

import dataclasses
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs_server.client import SyncGcs
from tests.station import free_port, running_vehicles, wait_until
from tests.support.agent_client import OutsideAgent, server_with_agent

ROOT = Path(__file__).resolve().parents[2]
DOCUMENT = ROOT / "docs" / "how-to-give-an-agent-a-simulator.md"
GCS = Path(sys.executable).parent / "gcs"


@pytest.fixture
def helper(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[OutsideAgent, SyncGcs]]:
    """An agent that may fly simulated vehicles, one of which is there, and a program that observes."""
    monkeypatch.setenv("GCS_CONTROL_LEASE_S", "5")
    port = free_port()
    link = f"udpin://127.0.0.1:{port}?simulated=1"
    with (
        server_with_agent(tmp_path, "helper=simulated", [link]) as url,
        running_vehicles(port, arguments=["--speed", "3"]),
        SyncGcs(url, client="observer") as gcs,
    ):
        gcs.wait_for_vehicle("101", ready=True)
        yield OutsideAgent(url, tmp_path, "helper"), gcs


def test_the_program_of_the_document_runs_word_for_word(
    helper: tuple[OutsideAgent, SyncGcs], tmp_path: Path
) -> None:
    agent, gcs = helper
    text = DOCUMENT.read_text(encoding="utf-8")
    (program,) = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    flags = f'"--agent", "helper", "--url", "{agent.url}", "--data", "{agent.folder}"'
    changed = program.replace('command="gcs"', f'command="{GCS}"').replace('"--agent", "helper"', flags)
    assert changed.count(agent.url) == 1
    path = tmp_path / "program.py"
    path.write_text(changed, encoding="utf-8")
    result = subprocess.run(
        [sys.executable, str(path)], capture_output=True, text=True, timeout=200, check=False
    )
    assert result.returncode == 0, result.stderr[-3000:]
    assert "'errors': 0" in result.stdout
    commands = [(e["client"], e["command"]) for e in gcs.request("GET", "/journal?limit=200")["entries"]]
    for command in ("plans/create", "dry_runs/start", "mission/upload", "mission/start", "control/release"):
        assert ("agent helper", command) in commands
    assert gcs.vehicle("101").status()["armed"] is False


def test_an_agent_that_dies_while_it_waits_loses_control_and_its_vehicle_holds(
    helper: tuple[OutsideAgent, SyncGcs],
) -> None:
    agent, gcs = helper
    drone = gcs.vehicle("101")
    agent.done("takeoff", vehicle="101", alt_home_m=5)
    wait_until(lambda: drone.status()["mode"] == "hold", "the end of the take-off")
    far = {"type": "velocity", "velocity_ned_m_s": [1, 0, 0]}
    agent.done("offboard_start", vehicle="101", setpoint=far, valid_for_s=120)
    dying = dataclasses.replace(agent, timeout_s=1.0)
    with pytest.raises(ExceptionGroup):
        dying.call("wait", vehicle="101", until="disarmed", at_most_s=50)
    wait_until(
        lambda: gcs.request("GET", "/vehicles/101/control")["holder"] is None, "the end of its control", 15
    )
    wait_until(lambda: drone.status()["mode"] == "hold", "Hold", 20)
    drone.land()
    drone.until_disarmed(timeout_s=60)


def test_a_recorded_vehicle_is_not_flown(helper: tuple[OutsideAgent, SyncGcs]) -> None:
    agent, gcs = helper
    (recording, *_) = gcs.request("GET", "/recordings")["recordings"]
    gcs.request("POST", "/replays", {"recording": recording["name"]})
    wait_until(lambda: len(gcs.request("GET", "/vehicles")) == 2, "the vehicle of the recording")
    (replayed,) = [each["id"] for each in agent.call("read_vehicles") if each["identity"]["replayed"]]
    assert "It is a recording" in agent.call("takeoff", vehicle=replayed, alt_home_m=5)["why"]
