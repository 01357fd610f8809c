"""A simulated vehicle for the accelerometer calibration; it turns to the next side after each finished side.

`python -m tests.clients.turned_vehicle PORT SPEED`: the vehicle's TCP port, and its speed as a multiple of
real time."""

from __future__ import annotations

import itertools
import sys

from vehicle_sim.autopilot.announcer import Event, StatusText
from vehicle_sim.commands.sides import Side
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.frames import quaternion_from_euler
from vehicle_sim.server import Ports, SimServer

SIDES = (Side.DOWN, Side.LEFT, Side.UP, Side.RIGHT, Side.FRONT, Side.BACK, Side.DOWN)


def run(port: int, speed: float) -> None:
    """Runs the vehicle on the ground and turns it to the next side when it reports a finished side."""
    fleet = SimulatedFleet(links=())

    def turn_to_next_side(message: StatusText | Event) -> None:
        for finished, next_side in itertools.pairwise(SIDES):
            if isinstance(message, StatusText) and f"{finished.value} side done" in message.text:
                fleet.simulation.set_attitude_if_disarmed(
                    0, quaternion_from_euler(*next_side.roll_pitch_rad, 0.0)
                )

    fleet.autopilots[0].announcer.add_listener(turn_to_next_side)
    ports = Ports(gcs_remote=0, api_remote=0, tcp=port)
    SimServer(fleet, first_instance=0, ports=ports, bind="127.0.0.1", gcs_host="127.0.0.1").run(speed)


if __name__ == "__main__":
    run(int(sys.argv[1]), float(sys.argv[2]))
