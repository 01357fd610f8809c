"""The options of the simulator's command line, and their checks."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from vehicle_sim.parameters import Parameters, ParameterValue, UnknownParameterError
from vehicle_sim.px4_version import DEFAULT, VERSIONS, Px4Version
from vehicle_sim.script import Script, load_script
from vehicle_sim.server import Ports
from vehicle_sim.simulation import SimulationOrigin
from vehicle_sim.world.files import built_in_worlds, load_world
from vehicle_sim.world.world import World
from vehicle_sim.yaml_fields import FileProblem

MAX_DOMAIN = 101
"""Ports of higher domains are in the operating system's range of ephemeral ports."""
EPILOG = """\
Each vehicle N (from 0) has MAVLink system id N+1 and uses MAVLink 2 on
  UDP 18570+N  to a ground station at port 14550 (all vehicles share that port)
  UDP 14580+N  to an onboard computer or MAVSDK at port 14540+N (14549 for N > 9, as PX4)
  TCP 5760+N   to one client that connects
With --ros2 each vehicle also has PX4's ROS 2 topics (/fmu/in/…, /fmu/out/…) on DDS, under /px4_N for N > 0.
MAVLink and DDS use only loopback unless --bind or --ros2-interface selects another interface.
Each UDP port sends to the address above until it receives a datagram, then to the first sender.
Neither PX4 nor Gazebo is needed. Stop the simulator with Ctrl+C.

examples:
  python -m vehicle_sim
  python -m vehicle_sim --instances 3 --home 47.3977,8.5456,488
  python -m vehicle_sim --param COM_OBL_RC_ACT=5 --param SIM_BAT_DRAIN=600
  python -m vehicle_sim --world obstacle-box --wind 0,5,1.5 --battery 60
  python -m vehicle_sim --ros2 7 --ros2-namespace drone7
  python -m vehicle_sim --script faults.yaml --speed max --duration 300
"""


def _home(text: str) -> SimulationOrigin:
    parts = text.split(",")
    try:
        lat_deg, lon_deg, alt_amsl_m = (float(part) for part in parts)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not lat,lon,alt; give three numbers such as 47.3977,8.5456,488"
        ) from None
    if not (abs(lat_deg) < 89.0 and abs(lon_deg) <= 180.0 and math.isfinite(alt_amsl_m)):
        raise argparse.ArgumentTypeError(
            f"{text!r}: latitude must be within ±89 degrees, longitude within ±180 degrees, altitude a number"
        )
    return SimulationOrigin(lat_deg, lon_deg, alt_amsl_m)


def _parameter(text: str) -> tuple[str, ParameterValue]:
    name, _, value = text.partition("=")
    try:
        number = float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=NUMBER") from None
    return name, int(number) if number.is_integer() else number


def _px4_version(text: str) -> Px4Version:
    try:
        return VERSIONS[text.removeprefix("v")]
    except KeyError:
        raise argparse.ArgumentTypeError(f"PX4 {text!r}: give {' or '.join(VERSIONS)}") from None


def _count(noun: str) -> Callable[[str], int]:
    def count(text: str) -> int:
        number = int(text)
        if not 1 <= number <= 250:
            raise argparse.ArgumentTypeError(f"{number} {noun}: give 1 to 250")
        return number

    return count


def _speed(text: str) -> float:
    if text == "max":
        return math.inf
    number = _number(text, "speed")
    if number == 0.0:
        return math.inf
    if not 0.05 <= number <= 100.0:
        raise argparse.ArgumentTypeError(
            f"speed {text}: give 0.05 to 100 (1 is real time), or max for the highest possible speed"
        )
    return number


def _number(text: str, quantity: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{quantity} {text!r} is not a number") from None


@dataclass(frozen=True, slots=True)
class WindOption:
    """Steady wind, blowing towards north and east, and standard deviation of the gusts."""

    north_m_s: float
    east_m_s: float
    gusts_m_s: float


def _wind(text: str) -> WindOption:
    parts = text.split(",")
    numbers = [_number(part, "wind") for part in parts]
    if len(numbers) not in (2, 3) or not all(abs(number) <= 50.0 for number in numbers):
        raise argparse.ArgumentTypeError(
            f"wind {text!r}: give NORTH,EAST in m/s (blowing to), optionally the gusts' sigma: 0,5,1.5"
        )
    if len(numbers) == 3 and numbers[2] < 0.0:
        raise argparse.ArgumentTypeError(f"gusts {numbers[2]:g}: give 0 or more m/s")
    return WindOption(numbers[0], numbers[1], numbers[2] if len(numbers) == 3 else 0.0)


def _percent(text: str) -> float:
    number = _number(text, "battery")
    if not 0.0 <= number <= 100.0:
        raise argparse.ArgumentTypeError(f"battery {text}: give the charge in percent, 0 to 100")
    return number


def _seconds(text: str) -> float:
    number = _number(text, "duration")
    if not 0.0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"duration {text}: give simulated seconds above 0")
    return number


def _world(text: str) -> World:
    try:
        return load_world(text)
    except FileProblem as problem:
        raise argparse.ArgumentTypeError(str(problem)) from None


def _script(text: str) -> Script:
    try:
        return load_script(text)
    except FileProblem as problem:
        raise argparse.ArgumentTypeError(str(problem)) from None


def _port(text: str) -> int:
    number = int(text)
    if not 0 <= number <= 65535:
        raise argparse.ArgumentTypeError(f"port {number}: give 0 to 65535")
    return number


def _domain(text: str) -> int:
    if not (text.isdecimal() and int(text) <= MAX_DOMAIN):
        raise argparse.ArgumentTypeError(f"ROS 2 domain {text!r}: give 0 to {MAX_DOMAIN}")
    return int(text)


def _namespace(text: str) -> str:
    name = text.strip("/")
    if not re.fullmatch(r"[A-Za-z_]\w*(/[A-Za-z_]\w*)*", name, re.ASCII):
        raise argparse.ArgumentTypeError(
            f"ROS 2 namespace {text!r}: give letters, digits and _, such as drone7"
        )
    return name


def build_parser() -> argparse.ArgumentParser:
    """The parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m vehicle_sim",
        description="Simulated PX4 quadrotors with a gimbal; on MAVLink they behave like a real PX4.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--instances", type=_count("vehicles"), default=1, metavar="N", help="number of vehicles (default 1)")
    add("--px4", type=_px4_version, default=DEFAULT, metavar="VERSION",
        help=f"version of PX4: {' or '.join(VERSIONS)} (default {DEFAULT.name})")  # fmt: skip
    add("--first-instance", type=int, default=0, metavar="I", help="the first instance (default 0)")
    add("--processes", type=_count("processes"), default=0, metavar="P",
        help="number of processes (default: one for every 40 vehicles, at most one per core)")  # fmt: skip
    add("--speed", type=_speed, default=1.0, metavar="X",
        help="simulated time per real time (default 1); max or 0: the highest possible speed")  # fmt: skip
    add("--home", type=_home, default=None, metavar="LAT,LON,ALT",
        help="position of the first vehicle: degrees, degrees, metres AMSL")  # fmt: skip
    add("--seed", type=int, default=0, metavar="S", help="seed of the sensor noise: same seed, same flight")
    add("--param", type=_parameter, action="append", default=[], metavar="NAME=VALUE",
        help="set a PX4 parameter before boot; may be repeated")  # fmt: skip
    add("--data-dir", type=Path, default=None, metavar="DIR",
        help="keep changed parameters and files here over restarts (default: not kept)")  # fmt: skip
    add("--no-log", action="store_true",
        help="no onboard logs (default: by SDLOG_MODE; 0.4 GB per hour and vehicle)")  # fmt: skip
    add("--world", type=_world, default=None, metavar="FILE",
        help=f"terrain, obstacles, lidars: a YAML file or one of {', '.join(built_in_worlds())}")  # fmt: skip
    add("--wind", type=_wind, default=None, metavar="N,E[,GUSTS]",
        help="wind that blows towards north and east, and standard deviation of the gusts [m/s]")  # fmt: skip
    add("--camera", action="store_true",
        help="a camera on the gimbal (component 100); pictures are downloaded by MAVLink FTP")  # fmt: skip
    add("--battery", type=_percent, default=None, metavar="PERCENT",
        help="battery charge at the start (default 100)")  # fmt: skip
    add("--script", type=_script, default=None, metavar="FILE",
        help="fault script: a YAML file of faults and their times")  # fmt: skip
    add("--duration", type=_seconds, default=math.inf, metavar="S",
        help="end after this many simulated seconds")  # fmt: skip
    add("--lockstep", action="store_true",
        help="time advances only up to the time_boot_ms of a client's SYSTEM_TIME")  # fmt: skip
    _add_ports(parser)
    _add_ros2(parser)
    return parser


def _add_ports(parser: argparse.ArgumentParser) -> None:
    ports = parser.add_argument_group("ports", "of instance 0; the next instance uses the next port")
    default_ports = Ports()
    ports.add_argument("--bind", default="127.0.0.1", metavar="ADDR", help="address to listen on")
    ports.add_argument("--gcs-host", default="127.0.0.1", metavar="ADDR", help="address to which UDP is sent")
    for name, help_text in (
        ("gcs-local-port", "UDP port of the ground-station link; 0: any free one"),
        ("gcs-remote-port", "UDP port of the ground station; 0: no ground-station link"),
        ("api-local-port", "UDP port of the onboard link; 0: any free one"),
        ("api-remote-port", "UDP port of the onboard computer; 0: no onboard link"),
        ("tcp-port", "port of the TCP server; 0: no TCP server"),
    ):
        port = getattr(default_ports, name.replace("-port", "").replace("-", "_"))
        ports.add_argument(f"--{name}", type=_port, default=port, metavar="P", help=f"{help_text} ({port})")
    ports.add_argument("--no-api", action="store_true", help="no onboard link")


def _add_ros2(parser: argparse.ArgumentParser) -> None:
    ros2 = parser.add_argument_group("ROS 2", "PX4's topics over DDS; needs the extra: pip install '.[ros2]'")
    ros2.add_argument("--ros2", type=_domain, nargs="?", const=0, default=None, metavar="DOMAIN",
        help="publish and subscribe PX4's topics in this DDS domain (without a number: 0)")  # fmt: skip
    ros2.add_argument("--ros2-namespace", type=_namespace, default=None, metavar="NAME",
        help="namespace before /fmu (default: none for instance 0, px4_N for instance N)")  # fmt: skip
    ros2.add_argument("--ros2-interface", default=None, metavar="NAME",
        help="network interface to use, with multicast (default: loopback, no multicast)")  # fmt: skip


def parse(argv: Sequence[str]) -> argparse.Namespace:
    """Parses a command line; invalid arguments end the program with an error message."""
    parser = build_parser()
    arguments = parser.parse_args(argv)
    if not 0 <= arguments.first_instance <= 254 - arguments.instances:
        parser.error(f"--first-instance {arguments.first_instance}: system ids must stay within 1 to 254")
    try:
        Parameters(dict(arguments.param), px4=arguments.px4)  # raises if a name or a value is invalid
    except (UnknownParameterError, ValueError) as error:
        parser.error(f"--param: {error}")
    if arguments.ros2 is None and (arguments.ros2_namespace or arguments.ros2_interface):
        parser.error("--ros2-namespace and --ros2-interface need --ros2")
    if arguments.ros2_namespace and arguments.instances > 1:
        parser.error(
            "--ros2-namespace is for one vehicle; without this option several vehicles use px4_1, px4_2 …"
        )
    single_process_option = "--lockstep" if arguments.lockstep else "--script" if arguments.script else None
    if single_process_option and arguments.processes > 1:
        parser.error(
            f"--processes {arguments.processes}: with {single_process_option} all vehicles fly in one process"
        )
    if single_process_option or math.isinf(arguments.speed):
        # Lockstep, a fault script and maximum speed work only within one process.
        arguments.processes = arguments.processes or 1
    return arguments
