"""Commands of the autopilot to itself or its payload, which PX4 also sends on every link."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

RETURN, CHANGE_SPEED, SET_HOME, PARACHUTE, TRIGGER = 20, 178, 179, 208, 2003
GIMBAL_PITCH_YAW, GIMBAL_CONFIGURE = 1000, 1001
"""MAV_CMD."""
NEUTRAL = 2.0
"""GIMBAL_MANAGER_FLAGS_NEUTRAL."""
NAN = float("nan")


@dataclass(frozen=True, slots=True)
class OwnCommand:
    """Number and seven parameters; positions in degrees."""

    number: int
    parameters: tuple[float, ...]
    repeated: bool
    """Whether PX4 repeats the command until it is acknowledged; the simulator never acknowledges it."""


class OwnCommands:
    """Passes each command to the listeners, then to the handler of the command."""

    def __init__(self) -> None:
        self._handlers: dict[int, Callable[[tuple[float, ...]], None]] = {}
        self._listeners: list[Callable[[OwnCommand], None]] = []

    def add_handlers(self, handlers: Mapping[int, Callable[[tuple[float, ...]], None]]) -> None:
        """Adds handlers by command number."""
        self._handlers |= handlers

    def add_listener(self, listener: Callable[[OwnCommand], None]) -> None:
        """Calls `listener` for each command."""
        self._listeners.append(listener)

    def send(self, number: int, *parameters: float, repeated: bool = True) -> None:
        """Sends a command; missing parameters are 0."""
        all_parameters = (*parameters, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)[:7]
        for listener in tuple(self._listeners):
            listener(OwnCommand(number, all_parameters, repeated))
        handler = self._handlers.get(number)
        if handler is not None:
            handler(all_parameters)

    def stop_triggering(self) -> None:
        """Stops camera triggers, as PX4 does when it leaves a mission."""
        self.send(TRIGGER, -1.0, 0.0, 1.0)

    def release_gimbal(self) -> None:
        """Moves the gimbal to neutral and releases control, if the autopilot has control."""
        self.send(GIMBAL_PITCH_YAW, NAN, NAN, NAN, NAN, NEUTRAL, repeated=False)
        self.send(GIMBAL_CONFIGURE, -3.0, -3.0, -1.0, -1.0, repeated=False)

    def park_gimbal(self) -> None:
        """Takes control of the gimbal, moves it to neutral and releases control; for return and landing."""
        self.send(GIMBAL_CONFIGURE, -2.0, -2.0, -1.0, -1.0)
        self.release_gimbal()
