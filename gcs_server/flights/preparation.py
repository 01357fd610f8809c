"""Compiles missions that begin when the vehicle is armed in their mode: before the vehicle is armed.

PX4 disarms a vehicle that has not taken off 10 s after arming (COM_DISARM_PRFLT), so nothing slow may happen
between arming and take-off. While the vehicle is disarmed, the server compiles the mission again when the
vehicle was moved or a setting has changed. Until the mission is compiled, the replies to PX4's arming checks
report that the mode cannot run, so that PX4 does not arm in the mode.
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final

from gcs_server.clock import Clock
from gcs_server.errors import GcsError
from gcs_server.flights.mission_values import MissionAsMode, Start
from gcs_server.streamer.process.streams import Streams
from gcs_server.supervise import Supervisor
from gcs_server.vehicle.vehicle import Vehicle
from missions.frames import Vector3
from missions.geodesy import LocalOrigin

COMPILE_AFTER: Final = (0.3, math.radians(5))
"""Change of position or local origin [m] and of yaw [rad] after which the mission is compiled again."""
READY_WITHIN: Final = (1.0, math.radians(20))
"""Change of position or local origin [m] and of yaw [rad] up to which the compiled mission can begin. This
change is larger than `COMPILE_AFTER`, so that the drift of the estimate on the ground does not interrupt
readiness."""
MIN_INTERVAL_S: Final = 1.0
"""Minimum time between two compilations of a mission [s]."""
RETRY_S: Final = 5.0
"""Time after which a failed compilation is repeated [s]."""
WARNING, NOTICE = 4, 5
COMPILING: Final = "The mission is being compiled for the vehicle's current position and settings."


@dataclass(frozen=True, slots=True)
class CompileInputs:
    """Position, yaw, local origin and settings with which a mission is compiled."""

    position_ned_m: Vector3
    yaw_ned_rad: float
    origin: LocalOrigin | None
    """Computed from home, which PX4 sets again by some centimetres when it is armed."""
    settings: object
    """The other data: parameters, reported values and operator's limits."""

    def within(self, other: CompileInputs, change: tuple[float, float]) -> bool:
        """Whether the vehicle or its origin has moved, and it has turned, by at most this change, and the
        settings are the same."""
        moved_m = max(math.dist(self.position_ned_m, other.position_ned_m), self._origin_moved_m(other))
        turned_rad = abs(math.remainder(self.yaw_ned_rad - other.yaw_ned_rad, math.tau))
        return moved_m <= change[0] and turned_rad <= change[1] and self.settings == other.settings

    def _origin_moved_m(self, other: CompileInputs) -> float:
        if self.origin is None or other.origin is None:
            return 0.0 if self.origin is other.origin else math.inf
        origin = other.origin
        return math.hypot(*self.origin.to_ned(origin.lat_deg, origin.lon_deg, origin.alt_amsl_m))


class Preparation:
    """The compiled mission of one mode, for a vehicle on the ground.

    Args:
        start: the mission, compiled at the registration.
        inputs: the inputs of that compilation; None: unknown.
    """

    def __init__(self, start: Start, inputs: CompileInputs | None) -> None:
        self._start: Start | None = start
        self._inputs = inputs
        self._compiling, self._next_compile_s = False, 0.0
        self.ready = self.reported = True
        """Whether the mission can begin when the vehicle is armed, and the value last sent to the stream
        process."""
        self.problem = ""
        """Why the last compilation failed; empty: it did not fail."""

    @property
    def reason(self) -> str:
        """Why the mission is not ready; empty if the mission is ready."""
        return "" if self.ready else self.problem or COMPILING

    def update(self, now_s: float, inputs: CompileInputs | None) -> bool:
        """Updates `ready`; returns True if the mission must be compiled now. The caller then compiles the
        mission and calls `succeeded` or `failed`. Call while the vehicle is disarmed.

        Args:
            now_s: current time [s, monotonic].
            inputs: the current inputs; None: the vehicle has no valid position.
        """
        self.ready = self._is_compiled_for(inputs, READY_WITHIN)
        is_current = self._is_compiled_for(inputs, COMPILE_AFTER)
        if is_current or self._compiling or now_s < self._next_compile_s:
            return False
        self._compiling = True
        return True

    def _is_compiled_for(self, inputs: CompileInputs | None, change: tuple[float, float]) -> bool:
        if self._start is None or self._inputs is None or inputs is None:
            return False
        return inputs.within(self._inputs, change)

    def succeeded(self, start: Start, inputs: CompileInputs | None, now_s: float) -> None:
        """Stores the mission that was compiled for these inputs."""
        self._start, self._inputs, self.problem = start, inputs, ""
        self._compiling, self._next_compile_s = False, now_s + MIN_INTERVAL_S

    def failed(self, problem: str, now_s: float) -> None:
        """Stores why the compilation failed, or why the mission cannot begin at the vehicle's position."""
        self._start, self.problem, self.ready = None, problem, False
        self._compiling, self._next_compile_s = False, now_s + RETRY_S

    @property
    def start(self) -> Start | None:
        """The mission to begin when the vehicle is armed; None: the mission is not ready."""
        return self._start if self.ready else None


class Preparer:
    """Compiles missions before arming, and reports to the stream process whether PX4 may arm.

    Args:
        clock: the server's clock.
        supervisor: runs the compilations.
        streams: replies to PX4's arming checks.
        prepare: compiles a mode's mission from the vehicle's current position, and checks it.
        inputs: the vehicle's position, yaw and settings with which a mission is compiled; None: no valid
            position.
    """

    def __init__(
        self,
        clock: Clock,
        supervisor: Supervisor,
        streams: Streams,
        prepare: Callable[[str, MissionAsMode], Awaitable[Start]],
        inputs: Callable[[str], CompileInputs | None],
    ) -> None:
        self._clock, self._supervisor, self._streams = clock, supervisor, streams
        self.prepare, self.inputs = prepare, inputs

    def update(self, vehicle: Vehicle, missions: Iterable[tuple[MissionAsMode, Preparation]]) -> None:
        """Compiles the missions that are not compiled for the vehicle's present position and settings; called
        periodically while the vehicle is disarmed."""
        missions = list(missions)
        inputs = self.inputs(vehicle.id) if missions else None
        for mode, preparation in missions:
            if preparation.update(self._clock.monotonic_s(), inputs):
                work = self._compile(vehicle, mode, preparation, inputs)
                self._supervisor.spawn(f"vehicle {vehicle.id}: mission mode", work)
            if preparation.ready != preparation.reported:
                preparation.reported = preparation.ready
                self._streams.set_mode_ready(vehicle.id, mode.name, preparation.ready)

    async def _compile(
        self, vehicle: Vehicle, mode: MissionAsMode, preparation: Preparation, inputs: CompileInputs | None
    ) -> None:
        previous_problem = preparation.problem
        try:
            start = await self.prepare(vehicle.id, mode)
        except GcsError as error:
            preparation.failed(with_remedy(error), self._clock.monotonic_s())
            if preparation.problem != previous_problem:
                text = (
                    f"The mission of the mode {mode.name!r} cannot begin here: {preparation.problem} "
                    "PX4 does not arm in this mode until the mission can begin."
                )
                add_event(vehicle, self._clock, mode.name, "not_ready", text, WARNING)
        else:
            preparation.succeeded(start, inputs, self._clock.monotonic_s())
            if previous_problem:
                text = f"The mission of the mode {mode.name!r} can begin here now."
                add_event(vehicle, self._clock, mode.name, "ready", text, NOTICE)


def add_event(vehicle: Vehicle, clock: Clock, name: str, code: str, text: str, severity: int) -> None:
    """Adds an event about the mode with this name to the vehicle's events."""
    data: dict[str, Any] = {"source": "mission_mode", "code": code, "name": name}
    kind = "warning" if severity == WARNING else "command"
    vehicle.events.add(kind, clock.unix_s(), text, severity=severity, data=data)


def with_remedy(error: GcsError) -> str:
    """An error and its remedy, as text."""
    return f"{error} {error.remedy}" if error.remedy else str(error)
