"""Who flies one simulated vehicle in a dry run; each kind of plan has its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from missions.dry_run.findings import DryRunFinding
from missions.dry_run.fleet import Vehicle
from vehicle_sim.autopilot.modes import MODES

READY_WITHIN_S = 30.0
"""After boot; a vehicle that cannot be armed by then is refused."""
SETTLED_S = 2.0
"""So long a flight that ends in the air is flown on."""


@dataclass(frozen=True, slots=True)
class Step:
    """A step of the plan, by the name that people know."""

    place: str
    """"item 3" of a plan, "step 4.2" of an offboard mission."""
    title: str
    row: int | None
    """Index in the plan's items; None: of an offboard mission, or not an item."""


class Pilot(Protocol):
    """Flies one vehicle from boot to the end."""

    started_s: float | None
    """Simulated time when the flight began; None: not yet."""
    done: bool
    """Nothing more is to happen."""
    finished: bool
    """The whole plan was flown."""
    step: Step | None
    """What is being flown."""
    findings: list[DryRunFinding]

    def tick(self, now_s: float) -> None:
        """Command the vehicle; called once a tick."""
        ...


class FailsafeWatch:
    """Says once that the vehicle's own failsafe took over."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self.acted = False

    def look(self, step: Step | None, t_s: float) -> DryRunFinding | None:
        """The finding, the first time."""
        commander = self._vehicle.autopilot.commander
        if self.acted or not (commander.armed and commander.in_failsafe):
            return None
        self.acted = True
        mode = MODES[commander.active].name
        message = f"A failsafe of the vehicle switches to {mode}: {self._vehicle.last_warning}."
        return found("failsafe", message, step, t_s, self._vehicle)


def found(code: str, message: str, step: Step | None, t_s: float, vehicle: Vehicle) -> DryRunFinding:
    """A finding about where the vehicle is now."""
    view = vehicle.autopilot.view
    north, east, down = view.simulation.truth.position_ned_m[view.row].tolist()
    place = None if step is None else step.place
    return DryRunFinding(code, message, place, round(t_s, 2), (north, east, down))
