"""The pilot of one simulated vehicle in a dry run; each kind of plan has its own implementation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from missions.dry_run.document import DryRunFinding
from missions.dry_run.fleet import Vehicle
from vehicle_sim.autopilot.modes import MODES

READY_WITHIN_S = 30.0
"""Time after boot by which the vehicle must be ready to arm; otherwise the flight does not start [s]."""
SETTLED_S = 2.0
"""Time for which the vehicle must hold its position before a flight ends in the air [s]."""


@dataclass(frozen=True, slots=True)
class Step:
    """A step of the plan, with its name in messages."""

    place: str
    """"item 3" of a plan, "step 4.2" of an offboard mission."""
    title: str
    row: int | None
    """Index in the plan's items; None: the step is not an item of a waypoint plan."""


class Pilot(Protocol):
    """A simulated pilot: flies one vehicle from boot to the end of the flight."""

    started_s: float | None
    """Simulated time when the flight started; None: not yet."""
    ended: bool
    """Whether the flight has ended."""
    finished: bool
    """Whether the flight completed the plan."""
    step: Step | None
    """The current step."""
    findings: list[DryRunFinding]

    def tick(self, now_s: float) -> None:
        """Commands the vehicle; called once per tick."""
        ...


class FailsafeWatch:
    """Reports the first failsafe of the vehicle."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self.acted = False
        """Whether a failsafe has acted."""

    def check(self, step: Step | None, t_s: float) -> DryRunFinding | None:
        """The finding when a failsafe acts for the first time, otherwise None."""
        commander = self._vehicle.autopilot.commander
        if self.acted or not (commander.armed and commander.in_failsafe):
            return None
        self.acted = True
        mode = MODES[commander.active].name
        message = f"A failsafe of the vehicle switches to {mode}: {self._vehicle.last_warning}."
        return finding_now("failsafe", message, step, t_s, self._vehicle)


def finding_now(code: str, message: str, step: Step | None, t_s: float, vehicle: Vehicle) -> DryRunFinding:
    """A finding at the vehicle's current position."""
    view = vehicle.autopilot.view
    north, east, down = view.simulation.truth.position_ned_m[view.row].tolist()
    step_name = None if step is None else step.place
    return DryRunFinding(code, message, step_name, round(t_s, 2), (north, east, down))
