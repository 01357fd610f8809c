"""Arguments of `python -m vehicle_sim`: the errors for invalid arguments, and the help."""

import pytest

from vehicle_sim.__main__ import main
from vehicle_sim.options import build_parser


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--home", "1,2"], "lat,lon,alt"),
        (["--home", "95,2,3"], "latitude"),
        (["--param", "NOPE=1"], "NOPE"),
        (["--px4", "1.15"], "give 1.16 or 1.17"),
        (["--px4", "1.17", "--param", "MPC_HOLD_DZ=0.2"], "MPC_HOLD_DZ"),
        (["--px4", "1.16", "--param", "MAN_DEADZONE=0.2"], "MAN_DEADZONE"),
        (["--param", "MPC_XY_CRUISE"], "NAME=NUMBER"),
        (["--instances", "0"], "1 to 250"),
        (["--speed", "-1"], "0.05 to 100"),
        (["--speed", "fast"], "speed 'fast' is not a number"),
        (["--wind", "3"], "give NORTH,EAST"),
        (["--wind", "3,x"], "wind 'x' is not a number"),
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
def test_invalid_arguments_are_explained(
    arguments: list[str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as raised:
        main(arguments)
    assert raised.value.code == 2
    assert expected in capsys.readouterr().err


def test_help_names_the_ports_and_the_parameter_option() -> None:
    text = build_parser().format_help()
    for word in ("18570", "14550", "14540", "5760", "--param"):
        assert word in text
