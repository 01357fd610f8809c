"""The command `gcs px4`: runs real PX4s in simulation, from what is installed on this computer."""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

from gcs_server.errors import GcsError
from gcs_server.px4_sitl import runner
from gcs_server.px4_sitl.programs import find_agent, find_px4
from gcs_server.storage.folder import DataFolder, default_folder

MAX_INSTANCES = 20
_PARAMETER = re.compile(r"([A-Z][A-Z0-9_]{0,15})=([-+0-9.eE]+)")


def build_parser() -> argparse.ArgumentParser:
    """The flags."""
    parser = argparse.ArgumentParser(
        prog="gcs px4",
        description="Runs real PX4s in simulation (SITL): a build that --px4-path names, PX4's Debian "
        "package, or its container image. Instance N has system id N+1 and sends from UDP port 18570+N "
        "to 14550.",
    )
    parser.add_argument(
        "--instances", type=int, default=1, metavar="N", help="number of vehicles (default 1)"
    )
    parser.add_argument("--first-instance", type=int, default=0, metavar="N", help="number of the first")
    parser.add_argument(
        "--px4-path", type=Path, metavar="PATH", help="a build folder, a source folder with a build, or `px4`"
    )
    parser.add_argument("--model", default="sihsim_quadx", help="PX4_SIM_MODEL (default sihsim_quadx)")
    parser.add_argument(
        "--param", action="append", default=[], metavar="NAME=VALUE", help="a PX4 parameter set at each start"
    )
    parser.add_argument("--no-agent", action="store_true", help="start no Micro XRCE-DDS Agent")
    parser.add_argument("--data", type=Path, metavar="FOLDER", help="data folder")
    return parser


def parameters_of(texts: list[str]) -> dict[str, str]:
    """Name and value of each `NAME=VALUE`.

    Raises:
        GcsError: one has another form.
    """
    parameters: dict[str, str] = {}
    for text in texts:
        match = _PARAMETER.fullmatch(text)
        if match is None:
            raise GcsError(f"--param {text}: expected NAME=VALUE.", remedy="As: --param COM_OBL_RC_ACT=5")
        parameters[match[1]] = match[2]
    return parameters


def main(arguments: list[str] | None = None) -> int:
    """Runs the command; returns the exit code."""
    options = build_parser().parse_args(arguments)
    try:
        if not 1 <= options.instances <= MAX_INSTANCES:
            raise GcsError(f"--instances {options.instances}: from 1 to {MAX_INSTANCES} are possible.")
        program, parameters = find_px4(options.px4_path), parameters_of(options.param)
    except GcsError as error:
        print(f"gcs px4: {error.message} {error.remedy or ''}".rstrip(), file=sys.stderr)
        return 2
    folder = DataFolder(options.data or default_folder())
    folder.prepare()
    folder.px4_sitl.mkdir(exist_ok=True)
    runner.run(
        program,
        folder.px4_sitl,
        options.instances,
        first_instance=options.first_instance,
        model=options.model,
        parameters=parameters,
        agent=None if options.no_agent else find_agent(),
    )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
