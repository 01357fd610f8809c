"""`python -m vehicle_sim` as a process: ready lines, taken ports, clean ends, bad arguments."""

import socket
import subprocess
import sys

import pytest

from vehicle_sim.__main__ import main
from vehicle_sim.mavlink.framing import FrameParser
from vehicle_sim.options import build_parser


def run(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "vehicle_sim", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_it_streams_answers_the_first_sender_and_ends_on_sigterm() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", 0))
        station.settimeout(10)
        port = station.getsockname()[1]
        process = run("--gcs-local-port", "0", "--gcs-remote-port", str(port), "--no-api", "--tcp-port", "0")
        try:
            parser = FrameParser()
            names: set[str] = set()
            while "HEARTBEAT" not in names:
                names |= {m.name for m in parser.feed(station.recv(65536))}
        finally:
            process.terminate()
            out, _ = process.communicate(timeout=10)
        assert process.returncode == 0
        assert out.startswith("vehicle 1 ready (instance 0): gcs UDP ")


def test_taken_ports_are_named_and_only_all_of_them_end_it() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen(1)
        port = taken.getsockname()[1]
        process = run("--gcs-remote-port", "0", "--no-api", "--tcp-port", str(port))
        _, err = process.communicate(timeout=20)
    assert process.returncode == 1
    assert f"TCP port {port} on 127.0.0.1" in err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--home", "1,2"], "lat,lon,alt"),
        (["--home", "95,2,3"], "latitude"),
        (["--param", "NOPE=1"], "NOPE"),
        (["--param", "MPC_XY_CRUISE"], "NAME=NUMBER"),
        (["--instances", "0"], "1 to 250"),
        (["--speed", "-1"], "0.05 to 100"),
        (["--speed", "fast"], "speed 'fast' is no number"),
        (["--wind", "3"], "give NORTH,EAST"),
        (["--wind", "3,x"], "wind 'x' is no number"),
        (["--wind", "3,3,-1"], "gusts -1: give 0 or more"),
        (["--battery", "110"], "give the charge in percent"),
        (["--world", "nowhere"], "obstacle-box"),
        (["--script", "/nonexistent.yaml"], "No such file"),
        (["--duration", "0"], "simulated seconds above 0"),
        (["--first-instance", "254"], "system ids"),
        (["--processes", "0"], "0 processes: give 1 to 250"),
        (["--processes", "2", "--lockstep"], "with --lockstep all vehicles fly in one process"),
        (["--tcp-port", "70000"], "65535"),
    ],
)
def test_bad_arguments_are_explained(
    arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2
    assert says in capsys.readouterr().err


def test_help_names_the_ports() -> None:
    text = build_parser().format_help()
    for word in ("18570", "14550", "14540", "5760", "--param"):
        assert word in text
