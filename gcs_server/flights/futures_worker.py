"""`python -m gcs_server.flights.futures_worker`: flies the futures of a command
(`missions/what_if/futures`), each in a process of its own with its own limits
(`operations/fork_server.py`), which has imported the simulation before."""

from __future__ import annotations

import gc
import sys
from dataclasses import asdict, replace

import msgspec
from pydantic import TypeAdapter

from gcs_server.flights.futures_task import PROBLEM, SOLVED, FuturesTask, Stream
from gcs_server.operations.fork_server import TaskLimits, serve_tasks
from gcs_server.plans import typed_values
from gcs_server.streamer.frames import ResolvedSetpoint
from gcs_server.streamer.schedule.pipeline import SetpointPipeline
from gcs_server.streamer.values.snapshot import Snapshot
from missions.dry_run.clearance import FenceDistance
from missions.dry_run.setup import prisms_of
from missions.errors import PlanError
from missions.frames import Vector3
from missions.setpoints import DirectSetpoint, Follow, FollowDevice, Path, Setpoint
from missions.values import FenceZone, HomePosition, Obstacle
from missions.what_if.futures.commands import FlightState
from missions.what_if.futures.futures import Place, fly_futures

LIMITS = TaskLimits(memory_bytes=2_000_000_000, cpu_time_s=20, timeout_s=60)
_zones = TypeAdapter(tuple[FenceZone, ...])
_obstacles = TypeAdapter(tuple[Obstacle, ...])


def main() -> None:
    """Serves tasks until the server closes the socket whose number is the last argument."""
    gc.freeze()  # the processes of tasks share the imported objects
    serve_tasks(int(sys.argv[-1]), answer, LIMITS)


def answer(request: bytes) -> bytes:
    """Flies the futures of a request, a `FuturesTask` as bytes."""
    try:
        return SOLVED + _fly(typed_values.from_bytes(request, FuturesTask))
    except (PlanError, ValueError) as error:
        return PROBLEM + str(error).encode()


def _fly(task: FuturesTask) -> bytes:
    stream = None if task.stream is None else _StreamedSetpoint(task.stream)
    command = task.mode if stream is None else stream
    assert command is not None
    around, home = task.surroundings, task.surroundings.home
    home_position = HomePosition(lat_deg=home.lat_deg, lon_deg=home.lon_deg, alt_amsl_m=home.alt_amsl_m)
    place = Place(
        around.home_ned_m,
        FenceDistance(_zones.validate_json(around.zones), home, around.radius_m, around.height_m),
        prisms_of(_obstacles.validate_json(around.obstacles), home_position),
        around.others,
    )
    futures = fly_futures(
        task.start, command, task.delay, place, text=task.text,
        target_ned_m=None if stream is None else stream.target_ned_m,
        battery_known=task.battery_known, flights=task.flights, horizon_s=task.horizon_s, seed=task.seed,
        assumed=task.assumed,
    )  # fmt: skip
    return msgspec.json.encode(
        asdict(futures)
        | {
            "vehicle_id": task.vehicle,
            "state_unix_s": task.state_unix_s,
            "origin": None if task.origin is None else asdict(task.origin),
            "clear": futures.clear,
            "limited": [] if stream is None else list(stream.limited),
            "stopped": None if stream is None else stream.stopped,
        }
    )


class _StreamedSetpoint:
    """The setpoints that the stream would send, with its limits, for the flight without deviations."""

    def __init__(self, stream: Stream) -> None:
        self._snapshot = replace(stream.snapshot, taken_s=0.0, estimate_s=0.0, local_only=True)
        self._pipeline = SetpointPipeline(_NoTransport())
        self._pipeline.accept(0.0, stream.setpoint, self._at(0.0, self._snapshot))
        self.limited: dict[str, None] = {}
        """What the limits have reduced, in the order of time."""
        self.target_ned_m = _target(stream.setpoint, self._snapshot)
        self.stopped: str | None = None
        """Why the stream would no longer fly the setpoint, and keep the position; None: it would."""

    def __call__(self, state: FlightState) -> DirectSetpoint:
        """The setpoint that is sent in this state."""
        snapshot = replace(
            self._at(state.t_s, self._snapshot),
            position_ned_m=state.position_ned_m,
            velocity_ned_m_s=state.velocity_ned_m_s,
            yaw_ned_rad=state.yaw_ned_rad,
            q_ned_frd=state.q_ned_frd,
        )
        stopped = self._pipeline.refresh(state.t_s, snapshot, waiting=False)
        if stopped is not None and self.stopped is None:
            self.stopped = stopped
            self._pipeline.hold_position(state.t_s, snapshot)
        self.limited |= dict.fromkeys(self._pipeline.limited)
        sent = self._pipeline.sent
        assert sent is not None
        return sent

    @staticmethod
    def _at(t_s: float, snapshot: Snapshot) -> Snapshot:
        """The snapshot at a time; a followed vehicle flies on as it does now."""
        leader = snapshot.leader
        if leader is not None:
            north, east, down = (
                position + t_s * velocity
                for position, velocity in zip(leader.position_ned_m, leader.velocity_ned_m_s, strict=True)
            )
            leader = replace(leader, position_ned_m=(north, east, down), received_s=t_s)
        return replace(snapshot, taken_s=t_s, estimate_s=t_s, leader=leader)


def _target(setpoint: Setpoint, snapshot: Snapshot) -> Vector3 | None:
    """The position to which a setpoint leads; None: it leads to none, or to one that moves."""
    if isinstance(setpoint, Follow | FollowDevice):
        return None
    end_s = setpoint.duration_s if isinstance(setpoint, Path) else 0.0
    last = ResolvedSetpoint(setpoint, 0.0, snapshot, snapshot.yaw_ned_rad).at(end_s, snapshot)
    position = getattr(last, "position_ned_m", None)
    return None if position is None or None in position else position


class _NoTransport:
    """A transport that sends nothing."""

    def load(self, setpoint: DirectSetpoint) -> None:
        """Takes every setpoint."""


if __name__ == "__main__":
    main()
