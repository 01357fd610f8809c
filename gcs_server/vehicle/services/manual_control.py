"""A pilot's stick positions for the vehicle (MANUAL_CONTROL), from one client at a time.

Each frame of the client makes one message, and nothing repeats it: without frames nothing is sent, whatever
of browser, server and loop has failed, and PX4 acts after COM_RC_LOSS_T. PX4 takes a moving stick as the
wish to fly (COM_RC_OVERRIDE), so the sticks act only after they were centred once, and a command that moves
or stops the vehicle makes them neutral until their pilot goes on: else the next movement would undo the Hold
of somebody else.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Final, Literal, Protocol

from gcs_server.errors import GcsError, Interrupted, Refused
from gcs_server.mavlink import dialect as d
from gcs_server.vehicle.mode_cause import PILOT_MODES
from gcs_server.vehicle.px4.stick_input import (
    DIRECT_THRUST_MODES,
    INPUT,
    INPUT_REMEDY,
    LOSS_PARAMETERS,
    StickLoss,
    input_problem,
)
from gcs_server.vehicle.services.command import AIRBORNE, CommandService
from gcs_server.vehicle.services.params import ParamService
from gcs_server.vehicle.services.port import VehiclePort

VALID_S: Final = 0.5
"""Without a frame for this time the stream ends [s]."""
CENTRED: Final = 100.0
"""Largest deflection of a stick that counts as centred, of 1000."""
MIDDLE: Final = 500.0
"""Throttle in its middle."""
ON_THE_GROUND: Final = frozenset({"arm", "disarm"})
"""Commands that leave the sticks to their pilot, as does a mode that is flown by sticks."""

Phase = Literal["off", "centre", "flying", "interrupted"]


@dataclass(frozen=True, slots=True)
class StickPositions:
    """Stick positions of MANUAL_CONTROL."""

    pitch: float
    """Forward is positive, -1000 to 1000."""
    roll: float
    """Right is positive, -1000 to 1000."""
    throttle: float
    """0 to 1000; 500 is the middle."""
    yaw: float
    """Clockwise is positive, -1000 to 1000."""


@dataclass(frozen=True, slots=True)
class ManualControlStatus:
    """Whose stick positions are sent to the vehicle."""

    by: str | None
    """The client; null: nobody's."""
    by_key: str | None
    """Distinguishes clients with the same name."""
    since_unix_s: float | None
    phase: Phase
    """`centre`: neutral until the sticks are centred once; `flying`: the sticks act; `interrupted`: neutral
    until the pilot goes on."""
    reason: str | None
    """What has interrupted the sticks, or why the last stream has ended."""


@dataclass(frozen=True, slots=True)
class StickRules:
    """What the vehicle's parameters say about stick positions."""

    problem: str | None
    """Why the vehicle does not use them; null: it does, or this is not known."""
    remedy: str | None
    """How to change that."""
    loss: StickLoss
    """What the vehicle does when they stop in flight."""


class FlownVehicle(VehiclePort, Protocol):
    """The vehicle as this service uses it."""

    command: CommandService

    @property
    def params(self) -> ParamService: ...


class StickStream:
    """The stick positions of one client, from `begin` to `end`."""

    def __init__(self, vehicle: FlownVehicle, by: str, key: str, may_send: Callable[[], str | None]) -> None:
        self._vehicle = vehicle
        self.by, self.key, self._may_send = by, key, may_send
        self.since_unix_s = vehicle.clock.unix_s()
        self.phase: Phase = "centre"
        self.reason: str | None = None
        self.sent_count = 0
        self._frame_s = vehicle.clock.monotonic_s()
        self._command = vehicle.tickets.newest_claimed

    def fly(self, sticks: StickPositions | None) -> None:
        """Sends one frame of the pilot's sticks, or a neutral one while they must not act.

        Args:
            sticks: their positions; None: the pilot's hands are off, and the sticks must be centred again.
        """
        if not self._goes_on():
            return
        self._frame_s = self._vehicle.clock.monotonic_s()
        if sticks is None and self.phase == "flying":
            self.phase = "centre"
        elif sticks is not None and self.phase == "centre" and self._is_centred(sticks):
            self.phase = "flying"
        self._send(sticks if sticks is not None and self.phase == "flying" else self._neutral())

    def resume(self) -> None:
        """The pilot goes on after a command has interrupted the sticks."""
        if self.phase == "interrupted":
            self.phase, self.reason = "centre", None

    def has_ended(self) -> bool:
        """Whether nothing is sent any more; `reason` says why."""
        return self.phase == "off"

    def end(self, reason: str, *, neutral: bool = False) -> None:
        """Ends the stream. `neutral`: the last frame has centred sticks."""
        if self.phase == "off":
            return
        if neutral and self._goes_on():
            self._send(self._neutral())
        self.phase, self.reason = "off", reason

    def _goes_on(self) -> bool:
        """Looks at everything that ends or interrupts the stream; directly before each frame."""
        if self.phase == "off":
            return False
        silent_s = self._vehicle.clock.monotonic_s() - self._frame_s
        problem = self._may_send() if silent_s <= VALID_S else f"No stick positions for {VALID_S:g} s."
        with_error: GcsError | None = None
        if problem is None:
            try:
                self._vehicle.require("manual_control")
            except GcsError as error:
                with_error = error
        if problem is not None or with_error is not None:
            self.phase, self.reason = "off", problem or str(with_error)
            return False
        newest = self._vehicle.tickets.newest_claimed
        if newest is not None and newest is not self._command and not self._leaves_sticks(newest.label):
            self.phase, self.reason = "interrupted", f"Interrupted by “{newest.label}”."
        self._command = newest
        return True

    def _leaves_sticks(self, label: str) -> bool:
        recent = self._vehicle.command.recent_command
        return label in ON_THE_GROUND or any(recent(mode) is not None for mode in PILOT_MODES)

    @property
    def _is_airborne(self) -> bool:
        return self._vehicle.flight_state.landed_state in AIRBORNE

    def _is_centred(self, sticks: StickPositions) -> bool:
        """On the ground the throttle may be anywhere: some transmitters rest at its lower end."""
        deflections = [sticks.pitch, sticks.roll, sticks.yaw]
        if self._is_airborne:
            deflections.append(sticks.throttle - MIDDLE)
        return all(abs(each) <= CENTRED for each in deflections)

    def _neutral(self) -> StickPositions:
        """Centred sticks; on the ground without thrust in modes where the throttle is the thrust."""
        starts = not self._is_airborne and self._vehicle.status.mode in DIRECT_THRUST_MODES
        return StickPositions(0.0, 0.0, 0.0 if starts else MIDDLE, 0.0)

    def _send(self, sticks: StickPositions) -> None:
        axes = (round(each) for each in (sticks.pitch, sticks.roll, sticks.throttle, sticks.yaw))
        self._vehicle.send(
            d.MAVLink_manual_control_message(self._vehicle.identity.system_id, *axes, buttons=0)
        )
        self.sent_count += 1


class ManualControlService:
    """The stick positions of one vehicle."""

    def __init__(self, vehicle: FlownVehicle) -> None:
        self._vehicle = vehicle
        self._stream: StickStream | None = None

    def status(self) -> ManualControlStatus:
        """Whose stick positions are sent now."""
        stream = self._stream
        if stream is None or stream.phase == "off":
            return ManualControlStatus(None, None, None, "off", None if stream is None else stream.reason)
        return ManualControlStatus(stream.by, stream.key, stream.since_unix_s, stream.phase, stream.reason)

    async def rules(self) -> StickRules:
        """What the vehicle's parameters say; those that it does not state are not known."""
        known: dict[str, float] = {}
        for name in (INPUT, *LOSS_PARAMETERS):
            param = self._vehicle.params.known(name)
            if param is None:
                with suppress(GcsError):
                    param = await self._vehicle.params.get(name)
            if param is not None:
                known[name] = param.value
        problem = input_problem(known[INPUT]) if INPUT in known else None
        return StickRules(problem, None if problem is None else INPUT_REMEDY, StickLoss.of(known))

    async def begin(self, by: str, key: str, may_send: Callable[[], str | None]) -> StickStream:
        """Begins a stream; sends nothing yet.

        Args:
            by: the client's name.
            key: the client's key.
            may_send: why the client may not send now, as a sentence; None: it may. Asked before each frame.

        Raises:
            Refused: another client's sticks are connected, the vehicle uses none, or its links carry none.
            NoReply: the vehicle does not say whether it uses stick positions.
            Interrupted: the client may not send any more.
        """
        vehicle = self._vehicle
        vehicle.require("manual_control")
        value = (await vehicle.params.get(INPUT)).value
        problem = input_problem(value)
        if problem is not None:
            raise Refused(f"Vehicle {vehicle.id} would ignore the sticks. {problem}", remedy=INPUT_REMEDY)
        if (reason := may_send()) is not None:
            raise Interrupted(reason)
        status = self.status()
        if status.by is not None:
            raise Refused(
                f"{status.by} already flies vehicle {vehicle.id} by stick.",
                remedy="End it there first, or wait until it has ended.",
            )
        self._stream = StickStream(vehicle, by, key, may_send)
        return self._stream
