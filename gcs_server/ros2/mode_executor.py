"""The executor of one external mode: the commands that it sends to PX4 while it is in charge.

PX4 puts an executor in charge when its mode is selected. The executor remains in charge in the
modes that it commands, until another program or a failsafe changes the mode; PX4 then rejects its commands.
While an executor is in charge, PX4 does not switch to Hold after a take-off, and after a landing PX4 selects
the executor's own mode again. As in PX4's interface library, an executor commands only an armed vehicle. The
times and ids come from recordings of PX4 and from that library. No I/O and no clock: the caller passes the
time and sends the messages.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from gcs_server.ros2.message_types import MESSAGES, Values

COMMAND: Final = "/fmu/in/vehicle_command_mode_executor"
MODE_COMPLETED: Final = "/fmu/out/mode_completed"
FIRST_COMPONENT: Final = 1000
"""The component id of an executor is this plus its id."""
ARMED: Final = 2
"""VehicleStatus.ARMING_STATE_ARMED."""
ATTEMPTS, ATTEMPT_EVERY_S = 3, 0.3
ACCEPTED, IN_PROGRESS = 0, 5
"""Results in VehicleCommandAck."""
Outcome = Literal["pending", "accepted", "rejected", "no_answer"]
Message = tuple[str, bytes]
"""Topic and message."""


@dataclass(frozen=True, slots=True)
class ExecutorCommand:
    """A command of an executor."""

    number: int
    """Identifies the command; chosen by the caller, greater than 0."""
    command: int
    """VehicleCommand.command."""
    params: tuple[float, float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class ExecutorState:
    """State of an executor."""

    in_charge: bool = False
    """Whether PX4 has put the executor in charge."""
    completed_nav_state: int | None = None
    """The current mode, if PX4 has reported that it is complete."""
    command: int = 0
    """Number of the newest command; 0: no command yet."""
    outcome: Outcome = "pending"
    """Outcome of that command."""


class ModeExecutor:
    """One registered executor.

    Args:
        executor_id: the executor's id in PX4, from 1.
    """

    def __init__(self, executor_id: int) -> None:
        self.id = executor_id
        self._in_charge = self._armed = False
        self._nav_state: int | None = None
        self._completed_nav_state: int | None = None
        self._command: ExecutorCommand | None = None
        self._outcome: Outcome = "pending"
        self._attempts, self.due_s = 0, float("inf")

    @property
    def state(self) -> ExecutorState:
        """The executor's state."""
        number = 0 if self._command is None else self._command.number
        return ExecutorState(self._in_charge, self._completed_nav_state, number, self._outcome)

    def execute(self, command: ExecutorCommand, now_s: float) -> list[Message]:
        """Starts a command, which replaces a pending command, and returns the messages to send. The outcome
        is `rejected` if the executor is not in charge or the vehicle is disarmed."""
        self._command, self._outcome = command, "pending"
        self._attempts, self.due_s = 0, now_s
        return self.step(now_s)

    def step(self, now_s: float) -> list[Message]:
        """The messages that are due now; call this at `due_s`."""
        if self._command is None or self._outcome != "pending" or now_s < self.due_s:
            return []
        if not (self._in_charge and self._armed):
            self._finish("rejected")
            return []
        if self._attempts >= ATTEMPTS:
            self._finish("no_answer")
            return []
        self._attempts += 1
        self.due_s = now_s + ATTEMPT_EVERY_S
        fields = {
            "command": self._command.command,
            "source_component": FIRST_COMPONENT + self.id,
            **{f"param{n}": value for n, value in enumerate(self._command.params, 1)},
        }
        return [(COMMAND, MESSAGES["VehicleCommand"].encode(fields))]

    def on_ack(self, values: Values) -> None:
        """Handles a VehicleCommandAck; ignores acknowledgements to other programs and of other commands."""
        command = self._command
        if (
            command is None
            or self._outcome != "pending"
            or values["target_component"] != FIRST_COMPONENT + self.id
            or values["command"] != command.command
            or values["result"] == IN_PROGRESS
        ):
            return
        self._finish("accepted" if values["result"] == ACCEPTED else "rejected")

    def on_status(self, values: Values) -> None:
        """Handles a VehicleStatus."""
        self._in_charge = values["executor_in_charge"] == self.id
        self._armed = values["arming_state"] == ARMED
        if values["nav_state"] != self._nav_state:
            self._nav_state, self._completed_nav_state = values["nav_state"], None
        if not (self._in_charge and self._armed) and self._outcome == "pending" and self._command is not None:
            self._finish("rejected")

    def on_completed(self, values: Values) -> None:
        """Handles a ModeCompleted of one of PX4's own modes."""
        if values["result"] == 0 and values["nav_state"] == self._nav_state:
            self._completed_nav_state = self._nav_state

    def _finish(self, outcome: Outcome) -> None:
        self._outcome, self.due_s = outcome, float("inf")
