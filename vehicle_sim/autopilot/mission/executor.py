"""Mission mode: selects the current item, executes it, and detects its end."""

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
from vehicle_sim.autopilot.mission.leg import Leg
from vehicle_sim.autopilot.mission.replay import Replay
from vehicle_sim.autopilot.own_commands import OwnCommands
from vehicle_sim.autopilot.path import Path
from vehicle_sim.autopilot.plans import FENCE, MISSION, Plans
from vehicle_sim.autopilot.steady_task import SteadyTask
from vehicle_sim.autopilot.tasks.climb import Climb
from vehicle_sim.autopilot.tasks.descent import Descent
from vehicle_sim.frames import wrap_angle
from vehicle_sim.geodesy import to_local
from vehicle_sim.home import Home
from vehicle_sim.vehicle_view import Vector, VehicleView

ITEMS_PER_TICK = 20
"""Maximum items per tick: items without a position are executed immediately, and jumps may form a loop."""


class Work(Enum):
    """Phase of the current item."""

    NONE = "none"
    TAKEOFF = "takeoff"
    FLY = "fly"
    LAND = "land"
    WAIT = "wait"


class Mission:
    """The mission of one vehicle. Call `update` at each tick in Mission mode, and `run` while it may fly."""

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
        descent: Descent,
    ) -> None:
        self._view, self._announcer, self._path, self._home = view, announcer, path, home
        self._plans, self._fence, self._commands = plans, fence, commands
        self._climb, self._descent = climb, descent
        self._leg = Leg(path)
        self.heading = Heading(view, path, home)
        self._replay = Replay(self._issue)
        self.current = 0
        self.reached: int | None = None
        self.reached_count = 0
        """Number of items reached so far; each increase is reported."""
        self.finished = False
        self.active = False
        self._work = Work.NONE
        self._arrived_at_s = math.nan
        self._jumps: dict[int, int] = {}
        self._revision = 0
        self._needs_takeoff = True
        self._disarmed_after_start = False
        self._validity: tuple[object, bool] = (None, False)
        self._validity_inputs: tuple[object, ...] = ()
        """Inputs of the feasibility check at the last check."""

    # --- the plan --------------------------------------------------------------------------------------

    @property
    def _items(self) -> tuple[Item, ...]:
        return self._plans.mission

    def valid(self, *, landed: bool) -> bool:
        """Whether there is a mission that can be flown; reports the reason once if not."""
        inputs = self._plans.changes, self._home.set_at_us, self._home.valid, self._view.parameter_changes
        if inputs == self._validity_inputs:
            return self._validity[1]
        self._validity_inputs = inputs
        key = (
            self._plans.revision(MISSION), self._plans.revision(FENCE), self._home.set_at_us,
            self._home.valid, self._fence.limits(),
        )  # fmt: skip
        if self._validity[0] != key:
            self._validity = (key, self._check_feasibility(landed))
        return self._validity[1]

    def _check_feasibility(self, landed: bool) -> bool:
        if not self._items:
            return False
        findings = feasibility.check(
            self._items,
            feasibility.FeasibilityInputs(
                home_valid=self._home.valid,
                home_alt_amsl_m=self._home.alt_amsl_m,
                altitude_acceptance_m=self._view.parameter("NAV_MC_ALT_RAD"),
                zones=self._fence.zones,
                cylinder=self._fence.cylinder(),
                landed=landed,
                required=self._view.optional_choice("MIS_TKO_LAND_REQ", 0),
                fence_active=self._view.choice("GF_ACTION") != 0,
            ),
        )
        for finding in findings:
            self._announcer.event(finding.event, finding.argument_format, *finding.arguments)
        return not any(finding.rejects for finding in findings)

    def load_plan(self, *, armed: bool) -> None:
        """Loads a changed plan; called at each tick in any mode."""
        self._disarmed_after_start = self._disarmed_after_start or not armed
        if self._revision != self._plans.revision(MISSION):
            self._revision = self._plans.revision(MISSION)
            self.current = self._plans.start_seq
            self.reached, self.finished = None, False
            self._jumps.clear()
            self._work, self._replay.left_at = Work.NONE, None

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
        """Continues with another item."""
        if not 0 <= seq < len(self._items):
            return False
        if seq != self.current:
            self._replay.left_at = None
        self.current, self.finished = seq, False
        self._work = Work.NONE
        return True

    # --- the mode --------------------------------------------------------------------------------------

    def enter(self) -> None:
        """Starts the mission, or continues it."""
        if self._disarmed_after_start and self.current + 1 >= len(self._items):
            self.current, self.finished, self.reached = 0, False, None
            self._jumps.clear()
            self._replay.left_at = None
        self.active, self._disarmed_after_start = True, False
        self._work, self._needs_takeoff = Work.NONE, True
        self._path.cruise_m_s = math.nan
        self._leg.restart()
        self.heading.reset()
        self._announcer.both(6, "Executing Mission", "mission_execute")
        self.current = self._replay.begin(self._items, self.current)

    def leave(self) -> None:
        """Called when another mode becomes active: stops camera triggers and releases the gimbal."""
        self.active = False
        self._work, self._replay.left_at = Work.NONE, self.current
        self._commands.stop_triggering()
        self._commands.release_gimbal()

    def update(self, *, landed: bool) -> None:
        """One tick: starts items, and continues with the next one when an item is done."""
        if self.finished or not self.valid(landed=landed):
            return
        for _ in range(ITEMS_PER_TICK):
            item = self._items[self.current]
            if item.command == JUMP and self._work is Work.NONE:
                if not self._jump(item):
                    break
                continue
            if self._work is Work.NONE:
                self._begin(item, landed)
            if not self._done(item, landed):
                break
            if not self._complete(item, landed):
                break

    def _begin(self, item: Item, landed: bool) -> None:
        self._arrived_at_s = math.nan
        if not item.is_position:
            self._work = Work.WAIT
            if item.command not in (LAND_START, GATE):
                self._issue(item)
            if item.command == GATE:
                self._fly_to(self._place(item), self._next_place(self.current), item)
            return
        takeoff_amsl_m = self._takeoff_altitude(item, landed)
        if self._needs_takeoff and self._must_climb(item, takeoff_amsl_m, landed):
            self._needs_takeoff = False
            self._work = Work.TAKEOFF
            self._climb.begin(takeoff_amsl_m)
            above_m = takeoff_amsl_m - self._home.alt_amsl_m
            text = f"Climb to {above_m:.1f} meters above home"
            self._announcer.both(6, text, "mission_climb_before_start", "f", above_m)
            return
        self._needs_takeoff = False
        self._replay.after_climb()
        self._work = Work.FLY
        place = self._place(item)
        if item.command == LAND:
            place = (place[0], place[1], self._path.position_ned_m[2])
        self._fly_to(place, self._next_place(self.current), item)

    def _fly_to(self, place: Vector, onward: Vector | None, item: Item) -> None:
        if item.hold_time_s() > 0.0 or item.command in (LAND, LOITER_UNLIMITED):
            onward = None
        self._leg.set(place, onward, self._acceptance(item))
        self.heading.item_yaw_rad = item.yaw_rad()

    def _jump(self, item: Item) -> bool:
        """Executes or skips a jump; False: the mission has ended."""
        target, repeats = int(item.parameters[0]), int(item.parameters[1])
        done = self._jumps.get(self.current, 0)
        if 0 <= target < len(self._items) and (repeats < 0 or done < repeats):
            self._jumps[self.current] = done + 1
            self.current = target
            return True
        self._jumps.pop(self.current, None)
        return self._advance(landed=False)

    def _done(self, item: Item, landed: bool) -> bool:
        if self._work is Work.TAKEOFF:
            if self._view.estimate.alt_amsl_m > self._climb.goal_alt_amsl_m - self._altitude_acceptance(item):
                self._work = Work.NONE
                self._leg.restart()
                self._begin(item, landed)
                return self._done(item, landed)
            return False
        if self._work is Work.LAND:
            return landed
        if item.command == GATE:
            return self._through_gate(item)
        if item.is_position and not self._arrived(item):
            return False
        if item.command == LAND:
            self._work = Work.LAND
            return False
        if item.command in (LOITER_UNLIMITED, RETURN):
            return False
        if math.isnan(self._arrived_at_s):
            self._arrived_at_s = self._view.time_s
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
        return self._turned(item)

    def _turned(self, item: Item) -> bool:
        yaw = item.yaw_rad()
        timeout_s = self._view.parameter("MIS_YAW_TMT")
        if math.isnan(yaw) or timeout_s > 0.0 or self.heading.has_roi:
            return True
        off = abs(wrap_angle(yaw - self._view.estimate.yaw_ned_rad))
        return off < math.radians(self._view.parameter("MIS_YAW_ERR"))

    def _through_gate(self, item: Item) -> bool:
        onward = self._next_place(self.current)
        if onward is None:
            return True
        gn, ge, _ = self._place(item)
        n, e, _ = self._view.estimate.position_ned_m
        return (onward[0] - gn) * (n - gn) + (onward[1] - ge) * (e - ge) >= 0.0

    def _complete(self, item: Item, landed: bool) -> bool:
        self.reached = self.current
        self.reached_count += 1
        self._work = Work.NONE
        if not item.autocontinue:
            self._work = Work.WAIT
            self._arrived_at_s = math.inf
            return False
        return self._advance(landed)

    def _advance(self, landed: bool) -> bool:
        if self.current + 1 < len(self._items):
            self.current += 1
            self._replay.reached(self.current)
            return True
        self.finished = True
        if landed:
            self._announcer.both(6, "Mission finished, landed", "mission_finished")
        else:
            self._announcer.both(6, "Mission finished, loitering", "mission_finished_loiter")
        return False

    # --- places and commands ---------------------------------------------------------------------------

    def _issue(self, item: Item) -> None:
        parameters = item.command_parameters(self._home.alt_amsl_m)
        self.heading.handle_item(item, parameters)
        self._commands.send(item.command, *parameters, repeated=item.command != RETURN)

    def _place(self, item: Item) -> Vector:
        origin_lat, origin_lon, origin_alt = self._view.origin
        n, e = to_local(item.lat_deg, item.lon_deg, origin_lat, origin_lon)  # type: ignore[arg-type]
        return (float(n), float(e), origin_alt - item.alt_amsl_m(self._home.alt_amsl_m))

    def _next_place(self, seq: int) -> Vector | None:
        """Position of the next item after `seq` that is flown to; None: the vehicle stops at item `seq`."""
        item = next_position(self._items, seq, self._jumps)
        return None if item is None else self._place(item)

    def _acceptance(self, item: Item) -> float:
        given = item.parameters[1] if item.command == WAYPOINT else 0.0
        return given if math.isfinite(given) and abs(given) > 0.001 else self._view.parameter("NAV_ACC_RAD")

    def _altitude_acceptance(self, item: Item) -> float:
        usual = self._view.parameter("NAV_MC_ALT_RAD")
        height = self._climb.goal_alt_amsl_m - self._home.alt_amsl_m
        return height / 2.0 if item.command == TAKEOFF and 0.0 < height < usual else usual

    def _takeoff_altitude(self, item: Item, landed: bool) -> float:
        ground = self._view.estimate.alt_amsl_m if landed else self._home.alt_amsl_m
        lowest = ground + self._view.parameter("MIS_TAKEOFF_ALT")
        return max(lowest, item.alt_amsl_m(self._home.alt_amsl_m))

    def _must_climb(self, item: Item, takeoff_amsl_m: float, landed: bool) -> bool:
        if item.command == LAND:
            return False
        if landed:
            return True
        low = self._view.estimate.alt_amsl_m <= takeoff_amsl_m - self._view.parameter("NAV_MC_ALT_RAD")
        return item.command == TAKEOFF and low

    # --- flying ----------------------------------------------------------------------------------------

    def run(self) -> None:
        """One tick of motion."""
        if self._work is Work.TAKEOFF:
            self._climb.run()
            return
        if self._work is Work.LAND:
            self._descent.run()
            return
        self._path.yaw_target_rad = self.heading.wanted(self._leg.target_ned_m, self._leg.acceptance_m)
        self._leg.fly()

    @property
    def taking_off(self) -> bool:
        """Whether the vehicle climbs before the first item."""
        return self._work is Work.TAKEOFF

    @property
    def landing(self) -> bool:
        """Whether the vehicle descends for a landing item."""
        return self._work is Work.LAND

    def steady_task(self) -> SteadyTask | None:
        """What the mission flies until its item is finished; None: it decides at each tick."""
        if self.finished or not self.active or not self.current < len(self._items):
            return None
        item = self._items[self.current]
        if self._work is Work.TAKEOFF:
            ends_m = self._climb.goal_alt_amsl_m - self._altitude_acceptance(item)
            return self._climb.steady_task(ends_above_amsl_m=ends_m)
        if self._work is Work.LAND:
            return self._descent.steady_task()
        if self._work is Work.NONE or item.command in (GATE, LOITER_UNLIMITED, RETURN):
            return None
        arrived_at_s = self._arrived_at_s if math.isfinite(self._arrived_at_s) else None
        if arrived_at_s is None and self._work is not Work.FLY:
            return None
        return self._leg.steady_task(self.heading, arrived_at_s, item.hold_time_s())

    def situation(self) -> tuple[object, ...]:
        """State that commands can change between two ticks."""
        return self.current, self._work, self._arrived_at_s, self._leg.triplet, self.heading.item_yaw_rad
