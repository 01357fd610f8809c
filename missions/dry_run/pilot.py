"""The pilot of one simulated vehicle in a dry run; each kind of plan has its own implementation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

from missions.dry_run.fleet import Vehicle
from vehicle_sim.autopilot.modes import MODES

READY_WITHIN_S = 30.0
"""Time after boot by which the vehicle must be ready to arm; otherwise the flight does not start [s]."""
SETTLED_S = 2.0
"""Time for which the vehicle must hold its position before a flight ends in the air [s]."""


CODES: dict[str, tuple[Literal["error", "warning"], str]] = {
    "item_refused": ("error", "the vehicle refuses an item of the plan"),
    "start_refused": ("error", "the vehicle cannot be armed, or does not start the mission"),
    "fence_touched": ("error", "the flight leaves the geofence"),
    "obstacle_hit": ("error", "the flight ends at an obstacle or at steep ground"),
    "ground_touched": ("error", "the flight touches rising ground"),
    "failsafe": ("error", "a failsafe of the vehicle takes over"),
    "mission_left": ("error", "the vehicle leaves the mission before its end"),
    "not_finished": ("error", "the flight did not finish within the allowed time"),
    "battery_empty": ("error", "the battery is empty before the end"),
    "battery_reserve": ("warning", "less than the battery's reserve is left at the end"),
    "battery_unknown": ("warning", "the battery's discharge rate is unknown"),
    "obstacle_near": ("warning", "the flight comes closer than 2 m to an obstacle"),
    "obstacle_avoided": ("warning", "the vehicle leaves its path to avoid an obstacle"),
    "avoidance_stopped": ("error", "obstacle avoidance finds no way, and the vehicle waits"),
    "separation": ("error", "two vehicles of the mission come too near to each other"),
    "ends_in_air": ("warning", "the flight ends in the air; the vehicle holds its position"),
}
"""Severity and meaning of each code."""


@dataclass(frozen=True, slots=True)
class DryRunFinding:
    """One problem of the simulated flight."""

    code: str
    message: str
    """Message for the pilot."""
    step: str | None = None
    """"item 3" of a plan, "step 4.2" of an offboard mission."""
    t_s: float | None = None
    """Time since the start."""
    position_ned_m: tuple[float, float, float] | None = None
    """Position of the vehicle."""

    @property
    def severity(self) -> Literal["error", "warning"]:
        """error: do not fly this plan; warning: the flight may differ from what the pilot expects."""
        return CODES[self.code][0]


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
