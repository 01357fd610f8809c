"""A waypoint plan in a dry run: uploaded, then flown by the simulated PX4 in Mission mode."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

from missions.dry_run.document import DryRunFinding
from missions.dry_run.fleet import Vehicle
from missions.dry_run.pilot import READY_WITHIN_S, SETTLED_S, FailsafeWatch, Step, finding_now
from missions.errors import PlanError
from missions.formats.mavlink_items import WireItem, fence_items, mission_items, rally_items
from missions.items import LoiterUnlimited
from missions.plan import Plan
from vehicle_sim.autopilot.mission.items import Item
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.autopilot.plans import FENCE, MISSION, RALLY
from vehicle_sim.mavlink.services.stored_items import CAPACITY, store

CHECKED_AFTER_S = 3.0
"""Time since boot after which a vehicle with a home has checked its mission [s]."""
ARRIVED_M = 1.5
STILL_M_S = 0.4
"""Distance and speed below which the vehicle has arrived at an item that never ends."""


@dataclasses.dataclass(frozen=True, slots=True)
class StoredPlan:
    """The items of a plan as the vehicle stores them."""

    parts: tuple[tuple[int, tuple[Item, ...]], ...]
    """Mission type (mission, fence or rally points) and items of this type."""
    steps: tuple[Step, ...]
    """One step for each mission item."""
    endless: frozenset[int]
    """Sequence numbers of the mission items that never end by themselves."""

    @classmethod
    def from_plan(cls, plan: Plan) -> StoredPlan:
        """Converts a plan to the items that the vehicle stores.

        Raises:
            PlanError: PX4 refuses an item, or cannot store that many items.
        """
        parts = (
            (FENCE, _stored_items(FENCE, fence_items(plan), "fence")),
            (RALLY, _stored_items(RALLY, rally_items(plan), "rally point")),
            (MISSION, _stored_items(MISSION, mission_items(plan), "item")),
        )
        if not parts[-1][1]:
            raise PlanError("the plan", "it has no items", "Add items: there is nothing to fly.")
        items = [(row, item) for row, item in plan.simple_items()]
        steps = tuple(
            Step(f"item {row + 1}", item.kind.replace("_", " ").capitalize(), row) for row, item in items
        )
        endless = frozenset(
            seq
            for seq, (_, item) in enumerate(items)
            if isinstance(item, LoiterUnlimited) or not item.autocontinue
        )
        return cls(parts, steps, endless)


def _stored_items(mission_type: int, items: Sequence[WireItem], name: str) -> tuple[Item, ...]:
    if len(items) > CAPACITY[mission_type]:
        reason = f"it has {len(items)} {name}s, PX4 has room for {CAPACITY[mission_type]}"
        raise PlanError("the plan", reason, "Remove some.")
    stored: list[Item] = []
    for item in items:
        _, stored_item = store(mission_type, dataclasses.asdict(item), as_int=True)
        if stored_item is None:
            reason = f"PX4 does not accept command {item.command} in frame {item.frame}"
            raise PlanError(f"{name} {item.seq + 1}", reason, "Remove it, or change its altitude.")
        stored.append(stored_item.item)
    return tuple(stored)


class WaypointPilot:
    """Uploads the plan, starts the mission, and monitors it."""

    def __init__(self, vehicle: Vehicle, stored_plan: StoredPlan) -> None:
        self._vehicle = vehicle
        self._stored_plan = stored_plan
        self._failsafe = FailsafeWatch(vehicle)
        self._in_air_since_s: float | None = None
        self.started_s: float | None = None
        self.ended = self.finished = False
        self.step: Step | None = None
        self.findings: list[DryRunFinding] = []
        for mission_type, items in stored_plan.parts:
            vehicle.autopilot.plans.store(mission_type, items)

    def tick(self, now_s: float) -> None:
        """Starts the mission when the vehicle is ready, then monitors its progress."""
        if self.ended:
            return
        if self.started_s is None:
            self._start(now_s)
        elif self._vehicle.autopilot.ran_full_tick or self._in_air_since_s is not None:
            self._monitor(now_s, now_s - self.started_s)

    def _start(self, now_s: float) -> None:
        autopilot = self._vehicle.autopilot
        commander = autopilot.commander
        ready = commander.checks.has_mission and commander.report.armable(NavState.MISSION)
        mission_rejected = (
            now_s > CHECKED_AFTER_S and autopilot.home.valid and not commander.checks.has_mission
        )
        if not ready and not mission_rejected and now_s < READY_WITHIN_S:
            return
        if ready and commander.start_mission(0.0):
            self.started_s = now_s
            self.step = self._stored_plan.steps[0]
            return
        message = f"The vehicle does not start the mission: {self._vehicle.last_warning}."
        self.findings.append(finding_now("start_refused", message, None, 0.0, self._vehicle))
        self.ended = True

    def _monitor(self, now_s: float, t_s: float) -> None:
        commander = self._vehicle.autopilot.commander
        mission = self._vehicle.autopilot.navigator.mission
        if not self._failsafe.acted and commander.active in (NavState.MISSION, NavState.RTL):
            self.step = self._stored_plan.steps[mission.current]
        finding = self._failsafe.check(self.step, t_s)
        if finding is not None:
            self.findings.append(finding)
        if not commander.armed:
            self.ended = True
            self.finished = mission.finished or (not self._failsafe.acted and self._ended_with_return())
            return
        if self._ends_in_air(commander.active) and self._in_air_since_s is None:
            self._in_air_since_s = now_s
        if self._in_air_since_s is not None and now_s - self._in_air_since_s >= SETTLED_S:
            self.ended = self.finished = True
            message = f"The mission ends in the air after {self.step.place if self.step else 'the start'}."
            self.findings.append(finding_now("ends_in_air", message, self.step, t_s, self._vehicle))

    def _ended_with_return(self) -> bool:
        """Whether the last item was a return: PX4 lands in Return mode and never reports the mission as
        finished."""
        mission = self._vehicle.autopilot.navigator.mission
        return mission.current == mission.count - 1

    def _ends_in_air(self, active: NavState) -> bool:
        mission = self._vehicle.autopilot.navigator.mission
        if active is NavState.HOLD and mission.finished:
            return True
        if active is not NavState.MISSION or mission.current not in self._stored_plan.endless:
            return False
        estimate = self._vehicle.autopilot.view.estimate
        north, east, down = self._vehicle.autopilot.navigator.path.target_ned_m
        if north is None or east is None or down is None:
            return False
        distance_m = math.dist(estimate.position_ned_m, (north, east, down))
        return distance_m < ARRIVED_M and math.hypot(*estimate.velocity_ned_m_s) < STILL_M_S
