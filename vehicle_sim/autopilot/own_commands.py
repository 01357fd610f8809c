"""Commands the autopilot gives itself or its payload: carried out here, and told to every link as by PX4."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

RETURN, CHANGE_SPEED, SET_HOME, PARACHUTE, TRIGGER = 20, 178, 179, 208, 2003
GIMBAL_PITCH_YAW, GIMBAL_CONFIGURE = 1000, 1001
NEUTRAL = 2.0
"""GIMBAL_MANAGER_FLAGS_NEUTRAL."""
NAN = float("nan")


@dataclass(frozen=True, slots=True)
class OwnCommand:
    """Number and seven parameters; degrees for places."""

    number: int
    parameters: tuple[float, ...]
    repeated: bool
    """Sent again until somebody acknowledges it (nobody does)."""


class OwnCommands:
    """Hands each command to whoever carries it out, then to whoever tells others about it."""

    def __init__(self) -> None:
        self._doers: dict[int, Callable[[tuple[float, ...]], None]] = {}
        self._listeners: list[Callable[[OwnCommand], None]] = []

    def serve(self, doers: Mapping[int, Callable[[tuple[float, ...]], None]]) -> None:
        """Add who carries out which numbers."""
        self._doers |= doers

    def add_listener(self, listener: Callable[[OwnCommand], None]) -> None:
        """Tell `listener` about each command."""
        self._listeners.append(listener)

    def send(self, number: int, *parameters: float, repeated: bool = True) -> None:
        """Give a command; parameters left out are 0."""
        seven = (*parameters, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)[:7]
        for listener in tuple(self._listeners):
            listener(OwnCommand(number, seven, repeated))
        doer = self._doers.get(number)
        if doer is not None:
            doer(seven)

    def stop_triggering(self) -> None:
        """As PX4 does when it leaves a mission."""
        self.send(TRIGGER, -1.0, 0.0, 1.0)

    def release_gimbal(self) -> None:
        """Neutral, and out of control (without effect for who is not in control)."""
        self.send(GIMBAL_PITCH_YAW, NAN, NAN, NAN, NAN, NEUTRAL, repeated=False)
        self.send(GIMBAL_CONFIGURE, -3.0, -3.0, -1.0, -1.0, repeated=False)

    def park_gimbal(self) -> None:
        """Take control, neutral, release: on the way home and down."""
        self.send(GIMBAL_CONFIGURE, -2.0, -2.0, -1.0, -1.0)
        self.release_gimbal()
