"""N simulated PX4 vehicles. This module uses no sockets and no wall clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.autopilot.steady import SteadyTicks
from vehicle_sim.autopilot.tick_arrays import TickArrays
from vehicle_sim.logger.logger import FleetLogs, Logger
from vehicle_sim.logger.recorder import Recorders
from vehicle_sim.mavlink.link import Link
from vehicle_sim.mavlink.node import Node
from vehicle_sim.parameters import Parameters, ParameterValue
from vehicle_sim.payload.camera import Camera
from vehicle_sim.px4_version import DEFAULT, Px4Version
from vehicle_sim.ros2.bridge import Bridge, Port
from vehicle_sim.script import Script, ScriptRunner
from vehicle_sim.shell.commands import Shell
from vehicle_sim.simulation import AUTOPILOT_EVERY_STEPS, STEP_S, ControlLevel, Simulation, SimulationOrigin
from vehicle_sim.storage.files import VehicleFiles
from vehicle_sim.storage.metadata import built_in
from vehicle_sim.topics.states import States
from vehicle_sim.vehicle_view import VehicleView
from vehicle_sim.world.contact import Collision
from vehicle_sim.world.world import World

STEP_US = round(STEP_S * 1e6)
DEFAULT_BOOT_TIME_UNIX_S = 1_790_000_000.0
"""Default UTC at boot; constant, so that runs are reproducible."""


class SimulatedFleet:
    """A fleet of vehicles; only `step` advances its time.

    Args:
        count: number of vehicles.
        first_instance: PX4's instance number of the first vehicle; system id is instance + 1.
        px4: the version of PX4 that all vehicles simulate.
        parameters: parameter values of all vehicles, as if set before boot.
        stores: parameter stores, one for each vehicle, used instead of `px4` and `parameters`.
        files: the files of each vehicle; default: files in temporary folders.
        links: (name, profile) of the links that each vehicle has from the start.
        seed: seed of sensor noise and gusts.
        noise_numbers: numbers of the vehicles in the seeds of noise and gusts; default: their instance
            numbers, so that a vehicle flies the same in any shard of a fleet.
        origin: global position of local NED (0, 0, 0), where the first vehicle starts.
        boot_time_unix_s: UTC at boot.
        sensor_noise: False: no sensor noise.
        start_ned_m: (N, 3) start position of each vehicle; default: a row to the east, 3 m apart.
        start_yaw_ned_rad: (N,) start headings; default: north.
        world: ground, obstacles and lidars; default: flat and empty, as in PX4's own simulation.
        script: fault script.
        camera: whether each vehicle has a camera; the recorded PX4 had no camera.
        log: whether the vehicles write onboard logs as SDLOG_MODE requires.
    """

    def __init__(
        self,
        count: int = 1,
        *,
        first_instance: int = 0,
        px4: Px4Version = DEFAULT,
        parameters: Mapping[str, ParameterValue] | None = None,
        stores: Sequence[Parameters] | None = None,
        files: Sequence[VehicleFiles] | None = None,
        links: Sequence[tuple[str, str]] = (("gcs", "gcs"), ("api", "api")),
        seed: int = 0,
        noise_numbers: Sequence[int] | None = None,
        origin: SimulationOrigin | None = None,
        boot_time_unix_s: float = DEFAULT_BOOT_TIME_UNIX_S,
        sensor_noise: bool = True,
        start_ned_m: NDArray[np.float64] | None = None,
        start_yaw_ned_rad: NDArray[np.float64] | None = None,
        world: World | None = None,
        script: Script | None = None,
        camera: bool = False,
        log: bool = False,
    ) -> None:
        if stores is None:
            stores = [Parameters(parameters, px4=px4) for _ in range(count)]
        self.simulation = Simulation(
            count, parameters=stores, seed=seed, origin=origin, sensor_noise=sensor_noise,
            start_ned_m=start_ned_m, yaw_ned_rad=start_yaw_ned_rad, world=world,
            noise_numbers=noise_numbers or range(first_instance, first_instance + count),
        )  # fmt: skip
        arrays = TickArrays.for_count(count)
        self.autopilots = [
            Autopilot(VehicleView(self.simulation, row, boot_time_unix_s), arrays) for row in range(count)
        ]
        self._ticks = SteadyTicks(self.simulation, arrays)
        self.files = list(files or [VehicleFiles(None, built_in(store.px4)) for store in stores])
        recorders = Recorders(self.simulation) if log else None
        self.loggers: list[Logger] = []
        self._states: list[States] = []
        self._bridges: dict[int, Bridge] = {}
        """ROS 2 bridges of the vehicles that have a ROS 2 port, by row."""
        self.nodes: list[Node] = []
        for row in range(count):
            self._add_node(row, first_instance + row + 1, recorders, camera=camera)
        self._logs = FleetLogs(recorders, self.loggers) if recorders is not None else None
        self._links: list[dict[str, Link]] = [{} for _ in range(count)]
        self._has_node_input = camera
        """Whether any vehicle has had a link, a ROS 2 port or a camera; without them, nodes only run delayed
        actions."""
        for row in range(count):
            for name, profile in links:
                self.add_link(row, name, profile)
        self._interrupted_links: set[tuple[int, str]] = set()
        """(row, link) of the links that are interrupted."""
        self._script = ScriptRunner(script, self) if script is not None else None
        self._remainder_s = 0.0
        self._active_autopilots, self._active_nodes = list(self.autopilots), list(self.nodes)

    def _add_node(self, row: int, system_id: int, recorders: Recorders | None, *, camera: bool) -> None:
        """Adds what connects a vehicle's autopilot to the outside: log, MAVLink node, shell, camera."""
        autopilot, files = self.autopilots[row], self.files[row]
        autopilot.view.parameters.set("MAV_SYS_ID", system_id)  # as PX4's start script (rcS) at every boot
        parameter_file = autopilot.view.parameters.file
        files.add_changing({"parameters.bson": parameter_file, "parameters_backup.bson": parameter_file})
        states = States(autopilot, system_id)
        logger = Logger(autopilot, states, files, recorders)
        node = Node(autopilot, system_id, files, logger)
        shell = Shell(node.context, lambda: node.params.unsaved, node.failures.inject, logger, states)
        node.open_console(shell.console)
        if camera:
            node.add_camera(Camera(autopilot.view, autopilot.gimbal, autopilot.home, files))
        self._states.append(states)
        self.loggers.append(logger)
        self.nodes.append(node)

    @property
    def time_s(self) -> float:
        """Simulated seconds since boot."""
        return self.simulation.time_s

    def add_link(self, row: int, name: str, profile: str) -> Link:
        """Opens a link and starts its streams; replaces a link of the same name."""
        self.remove_link(row, name)
        px4 = self.simulation.parameters[row].px4
        link = Link(name, profile, self.nodes[row].system_id, streams_integrity=px4.gnss_integrity)
        self._links[row][name] = link
        self._has_node_input = True
        self.nodes[row].add_link(link)
        return link

    def open_ros2(self, row: int, port: Port, report: Callable[[str], None]) -> None:
        """Connects a vehicle to ROS 2, as PX4's onboard client does.

        Args:
            row: the vehicle, from 0.
            port: carries the vehicle's messages.
            report: called once for each topic with an invalid message.
        """
        node = self.nodes[row]
        self._has_node_input = True
        self._bridges[row] = Bridge(
            node.context, self._states[row], node.commands, node.mavlink_commands, port, report
        )

    def remove_link(self, row: int, name: str) -> None:
        """Closes a link."""
        link = self._links[row].pop(name, None)
        if link is not None:
            self.nodes[row].remove_link(link)

    def feed(self, row: int, link: str, data: bytes) -> None:
        """Passes bytes received on a link to vehicle `row` (from 0)."""
        if (row, link) not in self._interrupted_links:
            self.nodes[row].receive(self._links[row][link], data)

    def drain(self, row: int, link: str) -> bytes:
        """Bytes that the vehicle has sent on a link since the last call."""
        return b"".join(self.frames(row, link))

    def frames(self, row: int, link: str) -> list[bytes]:
        """Frames that the vehicle has sent on a link since the last call."""
        frames = self._links[row][link].drain()
        return [] if (row, link) in self._interrupted_links else frames

    def set_link_up(self, row: int, link: str, up: bool) -> None:
        """Interrupts a link in both directions, or restores the link; "all" means all links."""
        names = ("gcs", "api", "tcp", *self._links[row]) if link == "all" else (link,)
        for name in names:
            if up:
                self._interrupted_links.discard((row, name))
            else:
                self._interrupted_links.add((row, name))

    def set_parameter(self, row: int, name: str, value: ParameterValue) -> None:
        """Changes a parameter directly, without MAVLink."""
        self.simulation.parameters[row].set(name, value)
        self.simulation.reload_parameters(row)

    def send_time(self, row: int, link: str) -> None:
        """Sends SYSTEM_TIME on a link now, as lockstep requires."""
        view = self.autopilots[row].view
        if link in self._links[row]:
            self._links[row][link].send(
                "SYSTEM_TIME", time_unix_usec=view.time_unix_us(), time_boot_ms=view.time_boot_ms()
            )

    def step(self, dt_s: float) -> None:
        """Advances the simulation by `dt_s`; a remainder shorter than a step is added to the next call."""
        self._remainder_s += dt_s
        step_s = self.simulation.dt_s
        while self._remainder_s >= step_s * 0.999:  # tolerates rounding errors
            self._remainder_s -= step_s
            self._step_once()

    def _step_once(self) -> None:
        self.simulation.step()
        for collision in self.simulation.take_collisions():
            self._handle_collision(collision)
        tick_due = self.simulation.steps % AUTOPILOT_EVERY_STEPS == 0
        if tick_due:
            self._ticks.update(self._active_autopilots)
            if self._script is not None:
                self._script.step()
        if self._has_node_input:
            for node in self._active_nodes:
                if tick_due or node.needs_every_step:
                    node.step()
        elif tick_due:
            for node in self._active_nodes:
                if node.has_pending:
                    node.step()
        for bridge in self._bridges.values():
            bridge.step()
        if self._logs is not None:
            self._logs.step(self.simulation.steps * STEP_US)

    def deactivate(self, row: int) -> None:
        """Stops autopilot, MAVLink and ROS 2 of a vehicle permanently; called after its flight."""
        self._active_autopilots = [
            each for each in self._active_autopilots if each is not self.autopilots[row]
        ]
        self._active_nodes = [each for each in self._active_nodes if each is not self.nodes[row]]
        self._bridges.pop(row, None)
        setpoints = self.simulation.setpoints
        setpoints.clear(row)
        setpoints.level[row], setpoints.armed[row] = ControlLevel.DISARMED, False

    def _handle_collision(self, collision: Collision) -> None:
        """Stops the motors of a vehicle that hit an obstacle, and reports the collision.

        PX4 itself reports no collisions.
        """
        autopilot = self.autopilots[collision.row]
        autopilot.announcer.text(2, f"Collision with {collision.obstacle}: motors stopped")
        autopilot.commander.disarm(force=True)

    def close(self) -> None:
        """Ends all logs, as a shutdown does."""
        if self._logs is not None:
            self._logs.close()
