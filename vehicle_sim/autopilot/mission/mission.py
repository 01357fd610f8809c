"""Mission mode: selects the current item, executes the item, and detects when the item is finished."""

from __future__ import annotations

import math
from enum import Enum

from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.autopilot.fence_watch import FenceWatch
from vehicle_sim.autopilot.mission import feasibility
from vehicle_sim.autopilot.mission.heading import Heading
from vehicle_sim.autopilot.mission.items import (
    GATE,
    JUMP,
    LAND,
    LAND_START,
    LOITER_UNLIMITED,
    RETURN,
    TAKEOFF,
    WAYPOINT,
    Item,
    next_position,
)
from vehicle_sim.autopilot.mission.replay import Replay
from vehicle_sim.autopilot.own_commands import OwnCommands
from vehicle_sim.autopilot.path import Path
from vehicle_sim.autopilot.plans import FENCE, MISSION, Plans
from vehicle_sim.autopilot.smoothing import WaypointTriplet
from vehicle_sim.autopilot.tasks.climb import Climb
from vehicle_sim.autopilot.tick_arrays import Motion, SteadyTask
from vehicle_sim.frames import wrap_angle
from vehicle_sim.geodesy import to_local
from vehicle_sim.home import Home
from vehicle_sim.vehicle_view import Vector, VehicleView

MAX_ITEMS_PER_TICK = 20
"""Limit for loops of jumps: jumps and items without a position are executed immediately."""


class Leg:
    """One leg of one vehicle; the next waypoint determines the speed at the target."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._triplet = WaypointTriplet((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), None, 0.0)

    @property
    def triplet(self) -> WaypointTriplet:
        """Previous, target and next waypoint of the leg [m, NED]."""
        return self._triplet

    @property
    def target_ned_m(self) -> Vector:
        """The target of the leg."""
        return self._triplet.target_ned_m

    @property
    def acceptance_m(self) -> float:
        """Distance within which the target counts as reached."""
        return self._triplet.acceptance_m

    def set(self, target_ned_m: Vector, next_ned_m: Vector | None, acceptance_m: float) -> None:
        """Starts a leg from the last to a new target; the vehicle stops there if `next_ned_m` is None."""
        self._triplet = WaypointTriplet(self._triplet.target_ned_m, target_ned_m, next_ned_m, acceptance_m)
        self._path.target_ned_m = target_ned_m

    def restart(self) -> None:
        """Starts the leg at the current position of the trajectory."""
        position_ned_m = self._path.position_ned_m
        self._triplet = WaypointTriplet(position_ned_m, position_ned_m, None, self._triplet.acceptance_m)

    def steady_task(self, heading: Heading, arrived_at_s: float | None, hold_s: float) -> SteadyTask | None:
        """The motion until arrival, or after arrival until the hold time ends; None: the heading depends on
        the motion, or the trajectory does not follow the leg yet."""
        path, (target_n, target_e, _) = self._path, self.target_ned_m
        fixed_target = heading.fixed_target(self.target_ned_m, self.acceptance_m)
        if fixed_target is None or not path.follows(self._triplet):
            return None
        face_n, face_e, min_distance_m = fixed_target
        task = SteadyTask(
            Motion.LEG, path.cruise_m_s, path.climb_m_s, path.descent_m_s,
            face_north_m=face_n, face_east_m=face_e, face_min_distance_m=min_distance_m,
        )  # fmt: skip
        if arrived_at_s is not None:
            return task._replace(wait_start_s=arrived_at_s, wait_duration_s=hold_s)
        return task._replace(end_north_m=target_n, end_east_m=target_e, end_radius_m=self.acceptance_m)

    def fly(self) -> None:
        """Runs one tick along the leg."""
        self._path.fly_triplet(self._triplet)


class Phase(Enum):
    """Phase of the current item. NONE: not started; WAIT: no position to fly to, or no autocontinue."""

    NONE = "none"
    TAKEOFF = "takeoff"
    FLY = "fly"
    LAND = "land"
    WAIT = "wait"


class Mission:
    """The mission of one vehicle. In Mission mode, call `update` at each tick, and `run` in flight."""

    def __init__(
        self,
        view: VehicleView,
        announcer: Announcer,
        path: Path,
        home: Home,
        plans: Plans,
        fence: FenceWatch,
        commands: OwnCommands,
        climb: Climb,
    ) -> None:
        self._view, self._announcer, self._path, self._home = view, announcer, path, home
        self._plans, self._fence, self._commands = plans, fence, commands
        self._climb = climb
        self._leg = Leg(path)
        self.heading = Heading(view, path, home)
        self._replay = Replay(self._issue)
        self.current = 0
        self.reached: int | None = None
        self.reached_count = 0
        """Number of items reached since boot; each increase is reported."""
        self.finished = self.active = False
        self._phase = Phase.NONE
        self._arrived_at_s = math.nan
        self._jump_counts: dict[int, int] = {}
        self._revision = 0
        self._needs_takeoff = True
        self._disarmed_after_start = False
        self._is_valid = False
        self._last_changes: tuple[object, ...] = ()
        """Compared before `_feasibility_inputs`, because reading these values is fast."""
        self._feasibility_inputs: tuple[object, ...] = ()

    # --- the plan --------------------------------------------------------------------------------------

    @property
    def _items(self) -> tuple[Item, ...]:
        return self._plans.mission

    def valid(self, *, landed: bool) -> bool:
        """Whether the plan passes the feasibility check; reports the findings of a changed plan once."""
        changes = self._plans.changes, self._home.set_at_us, self._home.valid, self._view.parameter_changes
        if changes == self._last_changes:
            return self._is_valid
        self._last_changes = changes
        inputs = (
            self._plans.revision(MISSION), self._plans.revision(FENCE), self._home.set_at_us,
            self._home.valid, self._fence.limits(),
        )  # fmt: skip
        if self._feasibility_inputs != inputs:
            self._feasibility_inputs, self._is_valid = inputs, self._check_feasibility(landed)
        return self._is_valid

    def _check_feasibility(self, landed: bool) -> bool:
        if not self._items:
            return False
        findings = feasibility.check(
            self._items,
            feasibility.FeasibilityInputs(
                home_valid=self._home.valid,
                home_alt_amsl_m=self._home.alt_amsl_m,
                zones=self._fence.zones,
                cylinder=self._fence.cylinder(),
                landed=landed,
                required_items=self._view.optional_choice("MIS_TKO_LAND_REQ", 0),
                fence_active=self._view.choice("GF_ACTION") != 0,
            ),
        )
        for finding in findings:
            self._announcer.event(finding.event, finding.argument_format, *finding.arguments)
        return not any(finding.rejects for finding in findings)

    def load_plan(self, *, armed: bool) -> None:
        """Loads a changed plan; called at each tick in any mode."""
        self._disarmed_after_start = self._disarmed_after_start or not armed
        self._load_changed_plan()

    def _load_changed_plan(self) -> None:
        if self._revision != self._plans.revision(MISSION):
            self._revision = self._plans.revision(MISSION)
            start_seq = self._plans.start_seq
            self.current = max(0, min(self.current, len(self._items) - 1)) if start_seq is None else start_seq
            self.reached, self.finished = None, False
            self._jump_counts.clear()
            self._phase, self._replay.left_at_seq = Phase.NONE, None

    @property
    def count(self) -> int:
        """Number of items."""
        return len(self._items)

    @property
    def landing_start(self) -> int | None:
        """Index of the start of the landing: DO_LAND_START, otherwise LAND; None: no landing."""
        for command in (LAND_START, LAND):
            for seq, item in enumerate(self._items):
                if item.command == command:
                    return seq
        return None

    def set_current(self, seq: int) -> bool:
        """Makes an item the current item; False: no item has this index."""
        self._load_changed_plan()  # which would otherwise reset the current item later
        if not 0 <= seq < len(self._items):
            return False
        if seq != self.current:
            self._replay.left_at_seq = None
        self.current, self.finished, self._phase = seq, False, Phase.NONE
        return True

    # --- the mode --------------------------------------------------------------------------------------

    def enter(self) -> None:
        """Starts or continues the mission."""
        if self._disarmed_after_start and self.current + 1 >= len(self._items):
            self.current, self.finished, self.reached = 0, False, None
            self._jump_counts.clear()
            self._replay.left_at_seq = None
        self.active, self._disarmed_after_start = True, False
        self._phase, self._needs_takeoff = Phase.NONE, True
        self._path.cruise_m_s = math.nan
        self._leg.restart()
        self.heading.reset()
        self._announcer.announce(6, "Executing Mission", "mission_execute")
        self.current = self._replay.begin(self._items, self.current)

    def leave(self) -> None:
        """Called when another mode becomes active: stops camera triggers and releases the gimbal."""
        self.active = False
        self._phase, self._replay.left_at_seq = Phase.NONE, self.current
        self._commands.stop_triggering()
        self._commands.release_gimbal()

    def update(self, *, landed: bool) -> None:
        """Runs one tick: starts items, and continues with the next item when an item is finished."""
        if self.finished or not self.valid(landed=landed):
            return
        for _ in range(MAX_ITEMS_PER_TICK):
            item = self._items[self.current]
            if item.command == JUMP and self._phase is Phase.NONE:
                if not self._jump(item):
                    break
                continue
            if self._phase is Phase.NONE:
                self._begin(item, landed)
            if not self._is_finished(item, landed) or not self._complete(item, landed):
                break

    def _begin(self, item: Item, landed: bool) -> None:
        self._arrived_at_s = math.nan
        if not item.is_position:
            self._phase = Phase.WAIT
            if item.command not in (LAND_START, GATE) and not self._completes_return(item):
                self._issue(item)
            if item.command == GATE:
                self._fly_to(self._position_of(item), self._next_target(self.current), item)
            return
        takeoff_amsl_m = self._takeoff_amsl_m(item, landed)
        if self._needs_takeoff and self._must_climb(item, takeoff_amsl_m, landed):
            self._needs_takeoff = False
            self._phase = Phase.TAKEOFF
            self._climb.begin(takeoff_amsl_m)
            above_home_m = takeoff_amsl_m - self._home.alt_amsl_m
            text = f"Climb to {above_home_m:.1f} meters above home"
            self._announcer.announce(6, text, "mission_climb_before_start", "f", above_home_m)
            return
        self._needs_takeoff = False
        self._replay.after_climb()
        self._phase = Phase.FLY
        target = self._position_of(item)
        if item.command == LAND:
            self._commands.park_gimbal()
            target = (target[0], target[1], self._path.position_ned_m[2])
        self._fly_to(target, self._next_target(self.current), item)

    def _fly_to(self, target: Vector, next_target: Vector | None, item: Item) -> None:
        if item.hold_time_s() > 0.0 or item.command in (LAND, LOITER_UNLIMITED):
            next_target = None
        self._leg.set(target, next_target, self._acceptance_m(item))
        self.heading.item_yaw_rad = item.yaw_rad()

    def _jump(self, item: Item) -> bool:
        """Executes or skips a jump; False: the mission has ended."""
        target_seq, repeats = int(item.parameters[0]), int(item.parameters[1])
        count = self._jump_counts.get(self.current, 0)
        if 0 <= target_seq < len(self._items) and (repeats < 0 or count < repeats):
            self._jump_counts[self.current] = count + 1
            self.current = target_seq
            return True
        self._jump_counts.pop(self.current, None)
        return self._advance(landed=False)

    def _is_finished(self, item: Item, landed: bool) -> bool:
        if self._phase is Phase.TAKEOFF:
            end_amsl_m = self._climb.goal_alt_amsl_m - self._altitude_acceptance_m(item)
            if self._view.estimate.alt_amsl_m > end_amsl_m:
                self._phase = Phase.NONE
                self._leg.restart()
                self._begin(item, landed)
                return self._is_finished(item, landed)
            return False
        if self._phase is Phase.LAND:
            return landed
        if item.command == GATE:
            return self._passed_gate(item)
        if item.is_position and not self._arrived(item):
            return False
        if item.command == LAND:
            self._phase = Phase.LAND
            self._report_reached()  # at the place of the landing, before the descent
            return False
        if item.command in (LOITER_UNLIMITED, RETURN) and not self._completes_return(item):
            return False
        if math.isnan(self._arrived_at_s):
            self._arrived_at_s = self._view.time_s
            if item.command == RETURN:
                return False  # the item before it is reported first
        return self._view.time_s - self._arrived_at_s >= item.hold_time_s()

    def _arrived(self, item: Item) -> bool:
        if math.isfinite(self._arrived_at_s):
            return True
        n, e, d = self._view.estimate.position_ned_m
        tn, te, td = self._leg.target_ned_m
        if math.hypot(tn - n, te - e) > self._leg.acceptance_m:
            return False
        if item.command != LAND and abs(td - d) > self._view.parameter("NAV_MC_ALT_RAD"):
            return False
        return self._heading_reached(item)

    def _heading_reached(self, item: Item) -> bool:
        yaw = item.yaw_rad()
        timeout_s = self._view.parameter("MIS_YAW_TMT")
        if math.isnan(yaw) or timeout_s > 0.0 or self.heading.has_roi:
            return True
        error_rad = abs(wrap_angle(yaw - self._view.estimate.yaw_ned_rad))
        return error_rad < math.radians(self._view.parameter("MIS_YAW_ERR"))

    def _passed_gate(self, item: Item) -> bool:
        next_target = self._next_target(self.current)
        if next_target is None:
            return True
        gn, ge, _ = self._position_of(item)
        n, e, _ = self._view.estimate.position_ned_m
        return (next_target[0] - gn) * (n - gn) + (next_target[1] - ge) * (e - ge) >= 0.0

    def _complete(self, item: Item, landed: bool) -> bool:
        """Reports the item as reached, and continues; False: the mission waits or has ended."""
        self._report_reached()
        if self._completes_return(item):
            self._phase = Phase.NONE
            self._advance(landed)
            self._issue(item)
            return False
        if not item.autocontinue:
            self._phase = Phase.WAIT
            self._arrived_at_s = math.inf  # the hold time never ends
            return False
        self._phase = Phase.NONE
        return self._advance(landed)

    def _completes_return(self, item: Item) -> bool:
        """Whether the item is a return that is reached before it begins."""
        return item.command == RETURN and self._view.px4.completes_return_item

    def _report_reached(self) -> None:
        if self.reached != self.current:
            self.reached = self.current
            self.reached_count += 1

    def _advance(self, landed: bool) -> bool:
        if self.current + 1 < len(self._items):
            self.current += 1
            self._replay.reached(self.current)
            return True
        self.finished = True
        if landed:
            self._announcer.announce(6, "Mission finished, landed", "mission_finished")
        else:
            self._announcer.announce(6, "Mission finished, loitering", "mission_finished_loiter")
        return False

    # --- positions and commands -----------------------------------------------------------------------

    def _issue(self, item: Item) -> None:
        parameters = item.command_parameters(self._home.alt_amsl_m)
        self.heading.handle_item(item, parameters)
        self._commands.send(item.command, *parameters, repeated=item.command != RETURN)

    def _position_of(self, item: Item) -> Vector:
        origin_lat, origin_lon, origin_alt = self._view.origin
        n, e = to_local(item.lat_deg, item.lon_deg, origin_lat, origin_lon)  # type: ignore[arg-type]
        return (float(n), float(e), origin_alt - item.alt_amsl_m(self._home.alt_amsl_m))

    def _next_target(self, seq: int) -> Vector | None:
        """Position of the next position item after `seq`; None: the vehicle stops at item `seq`."""
        item = next_position(self._items, seq, self._jump_counts)
        return None if item is None else self._position_of(item)

    def _acceptance_m(self, item: Item) -> float:
        radius_m = item.parameters[1] if item.command == WAYPOINT else 0.0
        is_set = math.isfinite(radius_m) and abs(radius_m) > 0.001
        return radius_m if is_set else self._view.parameter("NAV_ACC_RAD")

    def _altitude_acceptance_m(self, item: Item) -> float:
        default_m = self._view.parameter("NAV_MC_ALT_RAD")
        above_home_m = self._climb.goal_alt_amsl_m - self._home.alt_amsl_m
        is_low_takeoff = item.command == TAKEOFF and 0.0 < above_home_m < default_m
        return above_home_m / 2.0 if is_low_takeoff else default_m

    def _takeoff_amsl_m(self, item: Item, landed: bool) -> float:
        ground_amsl_m = self._view.estimate.alt_amsl_m if landed else self._home.alt_amsl_m
        min_amsl_m = ground_amsl_m + self._view.parameter("MIS_TAKEOFF_ALT")
        return max(min_amsl_m, item.alt_amsl_m(self._home.alt_amsl_m))

    def _must_climb(self, item: Item, takeoff_amsl_m: float, landed: bool) -> bool:
        if item.command == LAND:
            return False
        if landed:
            return True
        max_amsl_m = takeoff_amsl_m - self._view.parameter("NAV_MC_ALT_RAD")
        return item.command == TAKEOFF and self._view.estimate.alt_amsl_m <= max_amsl_m

    # --- flying ----------------------------------------------------------------------------------------

    def run(self) -> None:
        """Runs one tick of the motion."""
        if self._phase is Phase.TAKEOFF:
            self._climb.run()
            return
        if self._phase is Phase.LAND:
            self._path.descend()
            return
        self._path.yaw_target_rad = self.heading.setpoint_rad(self._leg.target_ned_m, self._leg.acceptance_m)
        self._leg.fly()

    @property
    def taking_off(self) -> bool:
        """Whether the vehicle climbs to the take-off altitude before the flight to the first item."""
        return self._phase is Phase.TAKEOFF

    @property
    def landing(self) -> bool:
        """Whether the vehicle descends for a landing item."""
        return self._phase is Phase.LAND

    def steady_task(self) -> SteadyTask | None:
        """The motion until the current item is finished; None: the mission needs full ticks."""
        if self.finished or not self.active or not self.current < len(self._items):
            return None
        item = self._items[self.current]
        if self._phase is Phase.TAKEOFF:
            end_amsl_m = self._climb.goal_alt_amsl_m - self._altitude_acceptance_m(item)
            return self._climb.steady_task(end_alt_amsl_m=end_amsl_m)
        if self._phase is Phase.LAND:
            return self._path.steady_task(Motion.DESCENT)
        if self._phase is Phase.NONE or item.command in (GATE, LOITER_UNLIMITED, RETURN):
            return None
        arrived_at_s = self._arrived_at_s if math.isfinite(self._arrived_at_s) else None
        if arrived_at_s is None and self._phase is not Phase.FLY:
            return None
        return self._leg.steady_task(self.heading, arrived_at_s, item.hold_time_s())

    def commanded_state(self) -> tuple[object, ...]:
        """State that commands can change between two ticks; for comparison."""
        return self.current, self._phase, self._arrived_at_s, self._leg.triplet, self.heading.item_yaw_rad
