"""Compiles missions that begin when the vehicle is armed in their mode: before the vehicle is armed.

PX4 disarms a vehicle that has not taken off 10 s after arming (COM_DISARM_PRFLT), so nothing slow may happen
between arming and take-off. While the vehicle is disarmed, the server compiles the mission again when the
vehicle was moved or a setting has changed. Until the mission is compiled, the replies to PX4's arming checks
report that the mode cannot run, so that PX4 does not arm in the mode.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from gcs_server.streamer.missions.start import Start
from missions.frames import Vector3

COMPILE_AFTER: Final = (0.3, math.radians(5))
"""Change of position [m] and of yaw [rad] after which the mission is compiled again."""
READY_WITHIN: Final = (1.0, math.radians(20))
"""Change of position [m] and of yaw [rad] up to which the compiled mission can begin. This change is larger
than `COMPILE_AFTER`, so that the drift of the estimate on the ground does not interrupt readiness."""
MIN_INTERVAL_S: Final = 1.0
"""Minimum time between two compilations of a mission [s]."""
RETRY_S: Final = 5.0
"""Time after which a failed compilation is repeated [s]."""
COMPILING: Final = "The mission is being compiled for the vehicle's current position and settings."


@dataclass(frozen=True, slots=True)
class CompileInputs:
    """Position, yaw and settings with which a mission is compiled."""

    position_ned_m: Vector3
    yaw_ned_rad: float
    settings: object
    """The other data: origin, parameters, reported values and operator's limits."""

    def within(self, other: CompileInputs, change: tuple[float, float]) -> bool:
        """Whether the vehicle has moved and turned by at most this change, and the settings are the same."""
        moved_m = math.dist(self.position_ned_m, other.position_ned_m)
        turned_rad = abs(math.remainder(self.yaw_ned_rad - other.yaw_ned_rad, math.tau))
        return moved_m <= change[0] and turned_rad <= change[1] and self.settings == other.settings


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
