"""Runs the vehicles of one process, as the command line describes them, and opens their ports."""

from __future__ import annotations

import argparse
import gc
import multiprocessing
import signal
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from vehicle_sim.fleet import DEFAULT_BOOT_TIME_UNIX_S, SimulatedFleet
from vehicle_sim.mavlink.transports import TcpServer
from vehicle_sim.options import WindOption, parse
from vehicle_sim.parameters import Parameters
from vehicle_sim.server import Ports, SimServer
from vehicle_sim.simulation import row_east
from vehicle_sim.storage.files import VehicleFiles
from vehicle_sim.storage.metadata import built_in
from vehicle_sim.worker_pool import Shard


def _instances(arguments: argparse.Namespace, shard: Shard) -> range:
    first_instance = arguments.first_instance + shard.first
    return range(first_instance, first_instance + shard.count)


def _parameter_stores(arguments: argparse.Namespace, shard: Shard) -> list[Parameters]:
    overrides = dict(arguments.param)
    directory: Path | None = arguments.data_dir
    if directory is not None:
        directory.mkdir(parents=True, exist_ok=True)
    return [
        Parameters(
            overrides,
            storage=None if directory is None else directory / f"parameters-{instance}.json",
            px4=arguments.px4,
        )
        for instance in _instances(arguments, shard)
    ]


def _files(arguments: argparse.Namespace, shard: Shard) -> list[VehicleFiles]:
    directory: Path | None = arguments.data_dir
    if directory is None:
        return [VehicleFiles(None, built_in(arguments.px4)) for _ in range(shard.count)]
    return [
        VehicleFiles(directory / f"files-{instance}", built_in(arguments.px4))
        for instance in _instances(arguments, shard)
    ]


def _set_wind_and_battery(
    fleet: SimulatedFleet, wind: WindOption | None, battery_percent: float | None
) -> None:
    if wind is not None:
        fleet.simulation.set_wind(np.array([wind.north_m_s, wind.east_m_s, 0.0]))
        fleet.simulation.set_gusts(wind.gusts_m_s)
    if battery_percent is not None:
        for row in range(len(fleet.nodes)):
            fleet.simulation.set_battery_remaining(row, battery_percent / 100.0)


def _open_ros2(fleet: SimulatedFleet, first_instance: int, arguments: argparse.Namespace) -> bool:
    """Connects each vehicle to DDS. If this fails, prints the reason and returns False."""
    try:
        from vehicle_sim.dds.participant import DdsDomain, DdsUnavailable
    except ImportError:
        print("--ros2 needs Cyclone DDS, which is not installed. Install it: pip install cyclonedds",
              file=sys.stderr, flush=True)  # fmt: skip
        return False
    try:
        domain = DdsDomain(arguments.ros2, arguments.ros2_interface)
        for row in range(len(fleet.nodes)):
            instance = first_instance + row
            namespace = arguments.ros2_namespace or (f"px4_{instance}" if instance else "")
            fleet.open_ros2(row, domain.open(namespace, arguments.px4), _error_printer(instance))
    except DdsUnavailable as problem:
        print(f"--ros2: {problem}", file=sys.stderr, flush=True)
        return False
    interface = arguments.ros2_interface or "loopback"
    print(f"ROS 2 topics in DDS domain {arguments.ros2} on {interface}", flush=True)
    return True


def _error_printer(instance: int) -> Callable[[str], None]:
    return lambda text: print(f"vehicle {instance + 1}: {text}", file=sys.stderr, flush=True)


def _print_ports(server: SimServer, first_instance: int) -> bool:
    """Prints the ports of each vehicle; returns whether any port is open."""
    has_port = False
    for row, vehicle in enumerate(server.vehicles):
        instance = first_instance + row
        for problem in vehicle.problems:
            print(
                f"vehicle {instance + 1}: {problem}; continuing without this port",
                file=sys.stderr,
                flush=True,
            )
        port_texts = [
            f"{name} {'TCP' if isinstance(transport, TcpServer) else 'UDP'} {transport.port}"
            for name, transport in vehicle.transports.items()
        ]
        has_port = has_port or bool(port_texts)
        if port_texts:
            print(f"vehicle {instance + 1} ready (instance {instance}): {', '.join(port_texts)}", flush=True)
    return has_port


def run_shard(argv: Sequence[str], shard: Shard) -> int:
    """Runs the vehicles of one shard until the process is terminated.

    Args:
        argv: the command line of the whole fleet.
        shard: the vehicles of this process.

    Returns:
        The exit code: 0, 1 if no port could be opened, or 2 if the data folder or ROS 2 cannot be used.
    """
    arguments = parse(argv)
    try:
        stores = _parameter_stores(arguments, shard)
    except (ValueError, OSError) as error:
        print(f"--data-dir: {error}", file=sys.stderr, flush=True)
        return 2
    first_instance = arguments.first_instance + shard.first
    # In lockstep, the results must not depend on the time of day.
    boot_time_unix_s = (
        DEFAULT_BOOT_TIME_UNIX_S if arguments.lockstep else time.clock_gettime(time.CLOCK_REALTIME)
    )
    fleet = SimulatedFleet(
        shard.count, first_instance=first_instance, stores=stores, files=_files(arguments, shard),
        links=(), seed=arguments.seed, origin=arguments.home, boot_time_unix_s=boot_time_unix_s,
        log=not arguments.no_log, world=arguments.world, script=arguments.script,
        camera=arguments.camera, start_ned_m=row_east(shard.count, shard.first),
    )  # fmt: skip
    if arguments.ros2 is not None and not _open_ros2(fleet, first_instance, arguments):
        return 2
    _set_wind_and_battery(fleet, arguments.wind, arguments.battery)
    ports = Ports(
        gcs_local=arguments.gcs_local_port,
        gcs_remote=arguments.gcs_remote_port,
        api_local=arguments.api_local_port,
        api_remote=0 if arguments.no_api else arguments.api_remote_port,
        tcp=arguments.tcp_port,
    )
    server = SimServer(
        fleet, first_instance=first_instance, ports=ports, bind=arguments.bind, gcs_host=arguments.gcs_host
    )
    for stop_signal in (signal.SIGINT, signal.SIGTERM):
        signal.signal(stop_signal, lambda _number, _frame: server.stop())
    parent = multiprocessing.parent_process()
    if parent is not None:
        server.stop_when_readable(parent.sentinel)
    # The vehicles exist as long as the process, so the garbage collector can skip them.
    gc.collect()
    gc.freeze()
    try:
        if not _print_ports(server, first_instance):
            print("no port could be opened; is another simulator running?", file=sys.stderr, flush=True)
            return 1
        if arguments.lockstep:
            server.run_in_lockstep(arguments.duration)
        else:
            server.run(arguments.speed, arguments.duration)
    finally:
        server.close()
        fleet.close()
    return 0
