"""`python -m vehicle_sim`: simulated PX4 vehicles on PX4's own ports, in real time or faster."""

from __future__ import annotations

import argparse
import math
import signal
import sys
import time
from pathlib import Path

from vehicle_sim.fleet import VehicleSim
from vehicle_sim.mavlink.transports import TcpServer
from vehicle_sim.parameters import Parameters, ParameterValue, UnknownParameterError
from vehicle_sim.server import Ports, SimServer
from vehicle_sim.simulation import Home
from vehicle_sim.storage.files import VehicleFiles
from vehicle_sim.storage.metadata import BUILT_IN

EPILOG = """\
Each vehicle N (from 0) has MAVLink system id N+1 and talks MAVLink 2 on
  UDP 18570+N  to a ground station at port 14550 (all vehicles share that port)
  UDP 14580+N  to an onboard computer or MAVSDK at port 14540+N
  TCP 5760+N   to one client that connects
All on loopback unless --bind says otherwise. The first who writes to a UDP port is answered there.
Nothing is needed beside it: no PX4, no Gazebo. Stop it with Ctrl+C.

examples:
  python -m vehicle_sim
  python -m vehicle_sim --instances 3 --home 47.3977,8.5456,488
  python -m vehicle_sim --param COM_OBL_RC_ACT=5 --param SIM_BAT_DRAIN=600
"""


def _home(text: str) -> Home:
    parts = text.split(",")
    try:
        lat_deg, lon_deg, alt_amsl_m = (float(part) for part in parts)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not lat,lon,alt; give three numbers such as 47.3977,8.5456,488"
        ) from None
    if not (abs(lat_deg) < 89.0 and abs(lon_deg) <= 180.0 and math.isfinite(alt_amsl_m)):
        raise argparse.ArgumentTypeError(
            f"{text!r}: latitude must lie within ±89, longitude within ±180 degrees, altitude be a number"
        )
    return Home(lat_deg, lon_deg, alt_amsl_m)


def _parameter(text: str) -> tuple[str, ParameterValue]:
    name, equals, value = text.partition("=")
    try:
        number = float(value)
        Parameters({name: number})
    except UnknownParameterError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=NUMBER") from None
    del equals
    return name, int(number) if number.is_integer() else number


def _count(text: str) -> int:
    number = int(text)
    if not 1 <= number <= 250:
        raise argparse.ArgumentTypeError(f"{number} vehicles: give 1 to 250")
    return number


def _speed(text: str) -> float:
    number = float(text)
    if not 0.05 <= number <= 100.0:
        raise argparse.ArgumentTypeError(f"speed {number}: give 0.05 to 100 (1 is real time)")
    return number


def _port(text: str) -> int:
    number = int(text)
    if not 0 <= number <= 65535:
        raise argparse.ArgumentTypeError(f"port {number}: give 0 to 65535")
    return number


def build_parser() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="python -m vehicle_sim",
        description="Simulated PX4 v1.16 quadrotors with gimbal that behave on MAVLink as the real one does.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--instances", type=_count, default=1, metavar="N", help="how many vehicles (default 1)")
    add("--first-instance", type=int, default=0, metavar="I", help="number of the first (default 0)")
    add("--speed", type=_speed, default=1.0, metavar="X", help="simulated over real time (default 1)")
    add("--home", type=_home, default=None, metavar="LAT,LON,ALT", help="where the first vehicle stands")
    add("--seed", type=int, default=0, metavar="S", help="of the sensor noise: same seed, same flight")
    add("--param", type=_parameter, action="append", default=[], metavar="NAME=VALUE",
        help="set a PX4 parameter before boot; may be repeated")  # fmt: skip
    add("--data-dir", type=Path, default=None, metavar="DIR",
        help="keep changed parameters and files here over restarts (default: forgotten)")  # fmt: skip
    add("--no-log", action="store_true",
        help="no onboard logs (default: as SDLOG_MODE says; 0.4 GB an hour and vehicle)")  # fmt: skip
    ports = parser.add_argument_group("ports", "of instance 0; the next instance uses the next port")
    default = Ports()
    ports.add_argument("--bind", default="127.0.0.1", metavar="ADDR", help="address to listen on")
    ports.add_argument("--gcs-host", default="127.0.0.1", metavar="ADDR", help="where UDP is sent to")
    for name, help_text in (
        ("gcs-local-port", "UDP port of the ground-station link; 0: any free one"),
        ("gcs-remote-port", "where the ground station listens; 0: no such link"),
        ("api-local-port", "UDP port of the onboard link; 0: any free one"),
        ("api-remote-port", "where the onboard computer listens; 0: no such link"),
        ("tcp-port", "TCP server; 0: none"),
    ):
        value = getattr(default, name.replace("-port", "").replace("-", "_"))
        ports.add_argument(f"--{name}", type=_port, default=value, metavar="P", help=f"{help_text} ({value})")
    ports.add_argument("--no-api", action="store_true", help="no onboard link")
    return parser


def _stores(arguments: argparse.Namespace) -> list[Parameters]:
    overrides = dict(arguments.param)
    directory: Path | None = arguments.data_dir
    if directory is not None:
        directory.mkdir(parents=True, exist_ok=True)
    return [
        Parameters(
            overrides,
            storage=None
            if directory is None
            else directory / f"parameters-{arguments.first_instance + n}.json",
        )
        for n in range(arguments.instances)
    ]


def _files(arguments: argparse.Namespace) -> list[VehicleFiles]:
    directory: Path | None = arguments.data_dir
    if directory is None:
        return [VehicleFiles(None, BUILT_IN) for _ in range(arguments.instances)]
    first = arguments.first_instance
    return [VehicleFiles(directory / f"files-{first + n}", BUILT_IN) for n in range(arguments.instances)]


def _announce(server: SimServer, first_instance: int) -> bool:
    any_port = False
    for row, vehicle in enumerate(server.vehicles):
        instance = first_instance + row
        for problem in vehicle.problems:
            print(f"vehicle {instance + 1}: {problem}; carrying on without it", file=sys.stderr, flush=True)
        parts = [
            f"{name} {'TCP' if isinstance(transport, TcpServer) else 'UDP'} {transport.port}"
            for name, transport in vehicle.transports.items()
        ]
        any_port = any_port or bool(parts)
        if parts:
            print(f"vehicle {instance + 1} ready (instance {instance}): {', '.join(parts)}", flush=True)
    return any_port


def main(argv: list[str] | None = None) -> int:
    """Run until told to stop; 1 if no port at all could be had."""
    parser = build_parser()
    arguments = parser.parse_args(argv)
    if not 0 <= arguments.first_instance <= 254 - arguments.instances:
        parser.error(f"--first-instance {arguments.first_instance}: system ids must stay within 1 to 254")
    try:
        stores = _stores(arguments)
    except (ValueError, OSError) as error:
        parser.error(str(error))
    unix_s = time.clock_gettime(time.CLOCK_REALTIME)
    fleet = VehicleSim(
        arguments.instances, first_instance=arguments.first_instance, stores=stores, files=_files(arguments),
        links=(), seed=arguments.seed, home=arguments.home, boot_time_unix_s=unix_s,
        log=not arguments.no_log,
    )  # fmt: skip
    ports = Ports(
        gcs_local=arguments.gcs_local_port,
        gcs_remote=arguments.gcs_remote_port,
        api_local=arguments.api_local_port,
        api_remote=0 if arguments.no_api else arguments.api_remote_port,
        tcp=arguments.tcp_port,
    )
    server = SimServer(
        fleet, first_instance=arguments.first_instance, ports=ports, bind=arguments.bind,
        gcs_host=arguments.gcs_host,
    )  # fmt: skip
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda _number, _frame: server.stop())
    try:
        if not _announce(server, arguments.first_instance):
            print("no port could be opened; is another simulator running?", file=sys.stderr, flush=True)
            return 1
        server.run(arguments.speed)
    finally:
        server.close()
        fleet.close()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
