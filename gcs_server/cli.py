"""The command `gcs`."""

from __future__ import annotations

import argparse
import contextlib
import gc
import logging
import os
import socket
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from gcs_server import key_command
from gcs_server.addresses import page_urls
from gcs_server.agents import bridge
from gcs_server.clock import SystemClock
from gcs_server.errors import GcsError
from gcs_server.log_limit import LogLimit
from gcs_server.px4_sitl.programs import ImageMissing, find_px4, pull
from gcs_server.ros2 import doctor
from gcs_server.scenarios import command as test_command
from gcs_server.settings import Settings, load, split_arguments, token_of
from gcs_server.storage.folder import DataFolder
from gcs_server.version import __version__

LISTEN_BACKLOG = 1024
EXIT_CANNOT_START = 2
UNSENT_BYTES = 32_768
"""Limit of unsent data in the system's buffer of a socket, so that a slow browser gets new data instead of
megabytes of old data."""

_EPILOG = """\
examples:
  gcs                                      server, page and one simulated vehicle on http://localhost:8080
  gcs serve --sim 3                        the same with three vehicles
  gcs serve --no-sim --link udpin://0.0.0.0:14550        listen for real vehicles on all addresses
  gcs serve --no-sim --link ros2://0                     PX4's ROS 2 topics in DDS domain 0, on loopback
  gcs serve --no-sim --link 'serial:///dev/ttyUSB0?baud=57600'   a telemetry radio
  gcs serve --link udpin://127.0.0.1:14650 --sim-args='--gcs-remote-port 14650 --gcs-local-port 18670'
                                           a simulated vehicle on other ports
  gcs serve --host 0.0.0.0                 allow access from other machines; prints a link with the token
  gcs key new field; gcs serve --link 'udpin://0.0.0.0:14550?key=field'     MAVLink signing
  gcs serve --guard udpin://127.0.0.1:14640              a program flies through this server's limits
  gcs serve --agent helper=simulated       a language model may fly simulated vehicles; it starts:
  gcs mcp --agent helper                   passes its calls to the server
  gcs replay flight.tlog --speed 2         replay a recording
  gcs test scenarios/ --out report         fly scenarios, and check what must hold
  gcs sim --help                           only the simulated PX4
  gcs serve --sim px4                      a real PX4 in simulation: PX4's package or container image
  gcs serve --sim px4:3 --px4-path ~/PX4-Autopilot    three, from a build

Every setting can also come from the environment (GCS_HOST, GCS_PORT, GCS_LINKS, GCS_SIM, GCS_SIM_ARGS,
GCS_DATA, GCS_TOKEN, GCS_SYSTEM_ID, …) or a TOML file (--config FILE or GCS_CONFIG) that begins with
`schema_version = 1`. Flags override the environment, which overrides the file.
"""


def build_parser() -> argparse.ArgumentParser:
    """All commands and their flags."""
    parser = argparse.ArgumentParser(
        prog="gcs",
        description="A web ground-control station for PX4, with an offboard planner and its own simulator.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"gcs {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="{serve,sim,px4,replay,key,mcp,test}")
    serve = commands.add_parser(
        "serve",
        help="run the server (the default)",
        description="Runs the server, and by default a simulated vehicle.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _add_server_flags(serve)
    serve.add_argument(
        "--link",
        "--links",
        dest="links",
        action="append",
        metavar="URL",
        help="link to open instead of udpin://127.0.0.1:14550; may be given several times",
    )
    _add_program_flags(serve)
    _add_simulation_flags(serve)
    replay = commands.add_parser(
        "replay", help="serve a recording", description="Serves a recorded tlog; nothing can be commanded."
    )
    replay.add_argument("file", type=Path, help="the .tlog")
    replay.add_argument("--speed", type=float, default=1.0, metavar="X", help="times real time (default 1)")
    _add_server_flags(replay)
    commands.add_parser(
        "sim", help="run only the simulated PX4", description="Passes all arguments to vehicle_sim."
    )
    commands.add_parser("px4", help="run only real PX4s in simulation")
    key_command.add_flags(commands.add_parser("key", help="signing keys of MAVLink links"))
    bridge.add_flags(commands.add_parser("mcp", help="connect an agent (Model Context Protocol)"))
    doctor.add_flags(commands.add_parser("doctor", help="find out why ROS 2 topics are empty"))
    test = commands.add_parser(
        "test",
        help="fly scenarios in simulation and check what must hold",
        description="Flies scenarios in simulation, and checks what must hold in each flight.",
    )
    test_command.add_flags(test)
    return parser


def _add_server_flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--host", help="address to listen on (default 127.0.0.1: this machine only)")
    parser.add_argument("--port", type=int, help="port of the page and the API (default 8080)")
    parser.add_argument("--data", type=Path, metavar="FOLDER", help="data folder: journal, recordings")
    parser.add_argument("--config", type=Path, metavar="FILE", help="TOML file with settings")
    parser.add_argument(
        "--token-file",
        type=Path,
        metavar="FILE",
        help="file with the access token; created if missing. Default: GCS_TOKEN, or else a file in the "
        "data folder; no token is needed while only this machine can reach the server",
    )
    parser.add_argument(
        "--trusted-proxy",
        dest="trusted_proxies",
        action="append",
        metavar="ADDRESS",
        help="an https proxy whose X-Forwarded-For and X-Forwarded-Proto are trusted; may be given several "
        "times",
    )
    parser.add_argument(
        "--system-id", type=int, metavar="ID", help="MAVLink system id of this server (default 255)"
    )
    parser.add_argument("--no-record", dest="record", action="store_false", default=None)
    parser.add_argument("--no-scene", dest="scene", action="store_false", default=None)
    parser.add_argument(
        "--flights-gb",
        type=float,
        metavar="GB",
        help="size of all recordings and logs; then the oldest go (20)",
    )
    parser.add_argument("--verbose", action="store_true", help="log more")


def _add_program_flags(serve: argparse.ArgumentParser) -> None:
    serve.add_argument(
        "--guard",
        dest="guards",
        action="append",
        metavar="URL",
        help="guarded link for a program, to which the server is its vehicle: udpin://127.0.0.1:14640, "
        "ros2://3; its options guard=ask, vehicle, client, valid_for_s, on_expiry may follow",
    )
    serve.add_argument(
        "--agent",
        dest="agents",
        action="append",
        metavar="NAME=SCOPE",
        help="a language model that may call /mcp with its own token; SCOPE: read, plan, simulated or fly "
        "(docs/how-to-give-an-agent-a-simulator.md); may be given several times",
    )


def _add_simulation_flags(serve: argparse.ArgumentParser) -> None:
    simulated = serve.add_mutually_exclusive_group()
    simulated.add_argument(
        "--sim",
        metavar="N|px4[:N]",
        help="simulated vehicles to start (default 1); px4: real PX4s in simulation, if one is installed",
    )
    simulated.add_argument(
        "--no-sim", dest="sim", action="store_const", const=0, help="start no simulated vehicle"
    )
    serve.add_argument(
        "--px4-path",
        type=Path,
        metavar="PATH",
        help="with --sim px4: PX4's build folder, a source folder with a build, or its program px4",
    )
    serve.add_argument(
        "--px4",
        dest="simulated_version",
        choices=("1.16", "1.17"),
        help="version of PX4 of the simulated vehicles (default 1.17)",
    )
    serve.add_argument(
        "--sim-args",
        metavar="ARGS",
        help="further arguments of the simulator as one string, see `gcs sim --help`: "
        "--sim-args='--speed 2 --param COM_OBL_RC_ACT=5'",
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a command; returns the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    programs = {"sim": "vehicle_sim", "px4": "gcs_server.px4_sitl"}
    if arguments and arguments[0] in programs:
        os.execv(sys.executable, [sys.executable, "-m", programs[arguments[0]], *arguments[1:]])
    if not arguments or (arguments[0].startswith("-") and arguments[0] not in ("-h", "--help", "--version")):
        arguments.insert(0, "serve")
    parsed = build_parser().parse_args(arguments)
    options = vars(parsed)
    command = options.pop("command")
    if command == "key":
        return _run_and_report(lambda: key_command.run(parsed))
    if command == "mcp":
        return _run_and_report(lambda: bridge.run(parsed))
    if command == "doctor":
        return _run_and_report(lambda: doctor.run(parsed))
    if command == "test":
        return _run_and_report(lambda: test_command.run(parsed))
    config = options.pop("config")
    verbose = options.pop("verbose")
    output = logging.StreamHandler()
    output.addFilter(LogLimit(SystemClock().monotonic_s))
    logging.basicConfig(
        level=logging.DEBUG if verbose else logging.INFO,
        format="%(levelname)s %(name)s: %(message)s",
        handlers=[output],
    )
    for logger_name in ("httpx", "httpcore", "mcp", "websockets", "uvicorn.access"):
        logging.getLogger(logger_name).setLevel(logging.WARNING)
    return _run_and_report(lambda: _serve(command, options, config))


def _serve(command: str, options: dict[str, Any], config: Path | None) -> int:
    more_links: tuple[str, ...] = ()
    if command == "replay":
        more_links = (_replay_link(options.pop("file"), options.pop("speed")),)
        options |= {"sim": 0, "links": [], "record": False}
    if options.get("sim_args") is not None:
        options["sim_args"] = split_arguments(options["sim_args"], "--sim-args")
    version = options.pop("simulated_version", None)
    settings = load({k: v for k, v in options.items() if v is not None}, config=config)
    if version is not None and settings.px4:
        raise GcsError("A real PX4 has its own version.", remedy="Give --sim px4 or --px4 VERSION, not both.")
    if version is not None:
        settings = settings.model_copy(update={"sim_args": ("--px4", version, *settings.sim_args)})
    if settings.sim and settings.px4:
        _require_px4(settings)
    return serve(settings, more_links)


def _require_px4(settings: Settings) -> None:
    """Checks before the start that there is a PX4; offers to download its image, if that is what is missing.

    Raises:
        GcsError: there is no PX4.
    """
    try:
        program = find_px4(settings.px4_path)
    except ImageMissing as missing:
        if not sys.stdin.isatty():
            raise
        answer = input(f"{missing.message} Download it now (about 100 MB)? [y/N] ")
        if answer.strip().lower() not in ("y", "yes") or not pull(missing.engine):
            raise
        program = find_px4(settings.px4_path)
    logging.getLogger(__name__).info("simulating with %s", program.label)


def _run_and_report(work: Callable[[], int]) -> int:
    try:
        return work()
    except GcsError as error:
        print(f"gcs: {error.message}" + (f" {error.remedy}" if error.remedy else ""), file=sys.stderr)
        return EXIT_CANNOT_START


def _replay_link(file: Path, speed: float) -> str:
    if not file.is_file():
        raise GcsError(f"There is no recording {file}.", remedy="Give the path of a .tlog file.")
    return f"tlog:{quote(str(file.resolve()))}?speed={speed:g}"


def listen(settings: Settings) -> socket.socket:
    """Opens the server's socket.

    Raises:
        GcsError: the port is in use, or the address is not an address of this computer.
    """
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    # IPPROTO_TCP, because asyncio disables Nagle's algorithm (40 ms of delay) only with an explicit protocol.
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    if hasattr(socket, "TCP_NOTSENT_LOWAT"):  # accepted sockets inherit it
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, UNSENT_BYTES)
    try:
        listener.bind((settings.host, settings.port))
        listener.listen(LISTEN_BACKLOG)
    except OSError as error:
        listener.close()
        raise GcsError(
            f"Port {settings.port} on {settings.host} cannot be used: {error.strerror or error}.",
            remedy=(
                "Is another ground station running? End it, or choose another port with --port (GCS_PORT)."
            ),
        ) from error
    listener.setblocking(False)
    return listener


def serve(settings: Settings, more_links: tuple[str, ...] = ()) -> int:
    """Runs the server until it is stopped."""
    # Until the server is ready, hardly anything that it imports or builds is freed. Looking for garbage in it
    # takes a third of the start.
    gc.disable()
    # Imported here, so that the other commands start at once.
    from gcs_server.app import create_app
    from gcs_server.http_server.acceptor import raise_descriptor_limit
    from gcs_server.http_server.server import HttpServer

    DataFolder(settings.data).prepare()
    listener = listen(settings)
    port = listener.getsockname()[1]
    token = token_of(settings)
    if not settings.loopback_only:
        print(_exposure_warning(settings, port), file=sys.stderr, flush=True)
    clock = SystemClock()
    app = create_app(settings, clock, more_links=more_links)
    connections = app.state.connections
    connections.limits = connections.limits.reduced_to(raise_descriptor_limit())
    server = HttpServer(
        app, connections, clock, page_urls(settings.host, port, token), settings.trusted_proxies
    )
    with contextlib.suppress(KeyboardInterrupt):  # uvicorn raises the signal again after its shutdown
        server.run(sockets=[listener])
    return 0 if server.started else 1


def _exposure_warning(settings: Settings, port: int) -> str:
    if settings.token is not None:
        source = "The token was set by GCS_TOKEN or the settings' file."
    else:
        file = settings.token_file or DataFolder(settings.data).token
        source = f"The token is stored in {file}: to get a new one, delete this file and restart."
    bar = "-" * 78
    return (
        f"{bar}\nListening on {settings.host}, port {port}, not only on this machine: whoever has the token\n"
        f"in the link below can command the vehicles. {source}\n"
        f"The token is sent unencrypted (http): use only a trusted network, a VPN or an https proxy.\n{bar}"
    )
