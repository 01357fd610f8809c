"""Runs each curl call and each Python program of the documents."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs_server.client import SyncGcs
from tests.station import free_port, running_process, running_server, wait_until

ROOT = Path(__file__).resolve().parents[2]
SPEED = 3
PRELUDE = """
set -u
sleep() {{ command sleep $(( ($1 + {speed} - 1) / {speed} )); }}
curl() {{
  command curl --fail-with-body --max-time 40 "$@" || echo "status $? of: curl $*" >> {failures}
}}
"""
"""Shell functions before the calls: `sleep` divided by the simulation's speed, and `curl` that reports
failures."""


def code_blocks(document: str, language: str, containing: str) -> list[str]:
    """Fenced blocks of this language that contain a text, in the order of the document."""
    text = (ROOT / document).read_text(encoding="utf-8")
    blocks = re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    return [block for block in blocks if containing in block]


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """`host:port` of a server with the simulated vehicles 1 (ready) and 2, as after `make run`."""
    port = free_port()
    command = [
        sys.executable,
        "-m",
        "vehicle_sim",
        "--instances",
        "2",
        "--no-api",
        "--gcs-local-port",
        "0",
        "--tcp-port",
        "0",
    ]
    command += ["--gcs-remote-port", str(port), "--speed", str(SPEED)]
    with running_server([f"udpin://127.0.0.1:{port}"]) as (url, _), running_process(command):
        with SyncGcs(url, client="docs") as gcs:
            gcs.wait_for_vehicle("1", ready=True, timeout_s=120)
        yield url.removeprefix("http://")


@pytest.mark.parametrize("document", ["docs/api.md", "docs/tutorial.md", "README.md"])
def test_each_curl_call_of_the_document_works_in_order(document: str, address: str, tmp_path: Path) -> None:
    failures = tmp_path / "failed"
    snippets = code_blocks(document, "sh", "curl ")
    assert snippets
    script = PRELUDE.format(failures=failures, speed=SPEED) + "\n".join(snippets).replace(
        "localhost:8080", address
    )
    result = subprocess.run(["bash", "-c", script], capture_output=True, text=True, timeout=240)
    assert not failures.exists(), f"{failures.read_text()}\n{result.stdout[-3000:]}"
    assert result.returncode == 0, result.stderr
    with SyncGcs(f"http://{address}", client="docs") as gcs:
        gcs.vehicle("1").until_disarmed(timeout_s=120)


@pytest.mark.parametrize(
    "document",
    ["docs/api.md", "docs/offboard.md", "docs/tutorial.md", "docs/how-to-fly-from-python.md", "README.md"],
)
def test_each_python_program_of_the_document_runs(document: str, address: str, tmp_path: Path) -> None:
    with SyncGcs(f"http://{address}", client="docs") as gcs:  # waits for the flight of another test
        control = gcs.vehicle("1").control
        wait_until(lambda: control.show()["holder"] is None, "control to be free", 40)
    printed = ""
    for number, program in enumerate(code_blocks(document, "python", "localhost:8080")):
        file = tmp_path / f"program{number}.py"
        file.write_text(program.replace("localhost:8080", address), encoding="utf-8")
        result = subprocess.run([sys.executable, str(file)], capture_output=True, text=True, timeout=240)
        assert result.returncode == 0, result.stderr
        printed += result.stdout
    if document == "docs/api.md":
        assert "1 attitude" in printed
