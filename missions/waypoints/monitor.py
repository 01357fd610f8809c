"""Monitors a flight in PX4's Mission mode: progress, deviation from the planned path, corridor. The monitor
sends no commands."""

from __future__ import annotations

from typing import Literal

from missions.frames import Vector3
from missions.items import ReturnHome
from missions.plan import Plan
from missions.runner.corridor import Corridor, CorridorWatch
from missions.runner.flown import PlannedFlight, PlannedState
from missions.runner.reading import Reading
from missions.runner.requests import Notify
from missions.waypoints.planned import PlannedPasses, item_title
from missions.waypoints.progress import Match, Progress
from missions.waypoints.resume import leg_start

State = Literal["flying", "paused", "done", "stopped"]
EXTERNAL_SOURCES = ("command", "pilot", "station", "failsafe")
"""Sources of a mode change that is not part of the mission."""


class WaypointMonitor:
    """One flight of a plan.

    Args:
        plan: the plan on the vehicle.
        planned: the planned flight; None: the flight is not compared with its plan.
        reason_not_compared: why the flight is not compared, as a sentence.
        corridor: corridor of the dry run; None: no corridor is monitored.
        from_start: whether the monitor has observed the flight since its take-off.
    """

    def __init__(
        self,
        plan: Plan,
        planned: PlannedPasses | None,
        *,
        reason_not_compared: str | None = None,
        corridor: Corridor | None = None,
        from_start: bool,
    ) -> None:
        self._items = [item for _, item in plan.simple_items()]
        self._returns = {index for index, item in enumerate(self._items) if isinstance(item, ReturnHome)}
        self._planned, self._reason_not_compared = planned, reason_not_compared
        self._corridor = corridor
        self._watch = None if corridor is None else CorridorWatch(corridor)
        self._from_start = from_start
        first_pass = planned is not None and planned.passes[:1]
        self._start_items = first_pass[0].items if first_pass else frozenset[int]()
        self._progress: Progress | None = None
        self._match: Match | None = None
        self._position_is_known = True
        self._first_item: int | None = None
        """Index of the item at which the flight began."""
        self.item: int | None = None
        """Index of the current item."""
        self.state: State = "flying"
        self.reason: str | None = None
        """Why the flight is paused or was stopped."""

    @property
    def over(self) -> bool:
        """Whether the flight has ended."""
        return self.state in ("done", "stopped")

    # --- status ---------------------------------------------------------------------------------------

    @property
    def place(self) -> str | None:
        """Where the vehicle is in the plan, for messages: "item 3"."""
        current = None if self._progress is None else self._progress.current
        if current is not None and self.item in current.items:
            return current.leg.place
        return None if self.item is None else f"item {self.item + 1}"

    @property
    def title(self) -> str | None:
        """Kind of the current item."""
        is_known = self.item is not None and self.item < len(self._items)
        return item_title(self._items[self.item or 0]) if is_known else None

    @property
    def leg_start(self) -> int | None:
        """Index of the item at which the flight would resume after an interruption at this time; None: at the
        beginning of the plan."""
        if self.item is None or self.item >= len(self._items):
            return None
        return leg_start(self._items, self.item, self._first_item if self._from_start else None)

    @property
    def remaining_s(self) -> float | None:
        """Planned time until the end of the flight; None: not known, or the flight has ended."""
        planned, progress = self._planned, self._progress
        if planned is None or planned.duration_s is None or progress is None or self.over:
            return None
        if not self._from_start and planned.has_repeated_items():
            return None
        return max(0.0, planned.duration_s - progress.t_s)

    @property
    def horizontal_m(self) -> float | None:
        """Horizontal distance from the planned path [m]."""
        return None if self._match is None else self._match.horizontal_m

    @property
    def vertical_m(self) -> float | None:
        """Vertical distance from the planned path; positive: above the path."""
        return None if self._match is None else self._match.vertical_m

    @property
    def outside_corridor_m(self) -> float | None:
        """Distance outside the corridor; None: the corridor is not monitored now."""
        return None if self._watch is None or self._match is None else self._watch.outside_m

    def progress_now(self, now_s: float) -> tuple[int, float, bool] | None:
        """Index of the current pass, the planned time, and whether the vehicle is on the planned path.

        None: the vehicle is not flying the plan now, or there is no planned path.
        """
        if self.state != "flying" or self._planned is None:
            return None
        if self._progress is None:
            return (0, 0.0, True) if self._from_start else None
        index_and_time = self._progress.index_and_time(now_s)
        return None if index_and_time is None else (*index_and_time, self._progress.on_path)

    @property
    def reason_not_compared(self) -> str | None:
        """Why the flight is not compared with its plan now; None: it is compared, or has ended or paused."""
        if self.over or self.state == "paused" or self._match is not None:
            return None
        if self._planned is None:
            return self._reason_not_compared
        if not self._position_is_known:
            return "The vehicle has no valid position estimate."
        if self._progress is not None and not self._progress.on_path:
            return "The vehicle is flying to the planned path."
        return "PX4 chooses the path of this item itself."

    def planned_state(self, reading: Reading) -> PlannedState:
        """The planned values for the vehicle's current position."""
        match = self._match
        place = self.place if match is None else match.place
        nearest = None if match is None else match.nearest_ned_m
        return PlannedState(place, nearest, self.outside_corridor_m, reading.armed)

    def planned_flight(self) -> PlannedFlight:
        """The planned path, from the item at which the flight began."""
        if self._planned is None:
            return PlannedFlight("plan", None, None, ())
        return self._planned.planned_flight(0 if self._progress is None else self._progress.first)

    # --- updates --------------------------------------------------------------------------------------

    def update(self, now_s: float, reading: Reading, item: int | None, reached: int | None) -> list[Notify]:
        """Updates the flight with the vehicle's state.

        Args:
            now_s: time on any clock; the same clock for all updates.
            reading: the vehicle's state.
            item: index of the item that the vehicle reports as current.
            reached: index of the item that the vehicle last reported as reached.

        Returns:
            Messages for the pilot.
        """
        if self.over:
            return []
        if self._is_flying_plan(reading, item):
            return self._update_flight(now_s, reading.position_ned_m, item)
        if reading.armed is False:
            landed_by_mission = self.state == "flying" and self._is_at_last_item()
            place = "an unknown item" if self.item is None else f"item {self.item + 1}"
            return self._end(
                "done" if landed_by_mission else "stopped", f"The vehicle was disarmed at {place}."
            )
        if self._completed_in_air(reading, reached):
            return self._end("done", None)
        if self.item is None:
            self.item = item  # the flight was interrupted before the monitoring began
        return self._pause(reading)

    def stop(self, reason: str) -> None:
        """Ends the flight, because the vehicle no longer flies this plan."""
        if not self.over:
            self._end("stopped", reason)

    def _is_flying_plan(self, reading: Reading, item: int | None) -> bool:
        if reading.armed is not True:
            return False
        is_returning = item in self._returns and reading.mode_source not in EXTERNAL_SOURCES
        return reading.mode == "mission" or (reading.mode == "rtl" and is_returning)

    def _update_flight(self, now_s: float, position_ned_m: Vector3 | None, item: int | None) -> list[Notify]:
        notices: list[Notify] = []
        if self.state == "paused":
            notices.append(
                Notify("monitoring_resumed", "The vehicle is flying the plan again. The flight is monitored.")
            )
        self.state, self.reason = "flying", None
        self.item = self.item if item is None else item
        if self.item is not None and (self._first_item is None or self.item < self._first_item):
            self._first_item = self.item  # PX4 may start again at the first item
        self._position_is_known = position_ned_m is not None
        if self._planned is not None and self._progress is None and item is not None:
            on_path = self._from_start and item in self._start_items
            self._progress = Progress(self._planned, on_path=on_path)
        self._match = None
        if self._progress is not None:
            self._match = self._progress.update(now_s, item, position_ned_m)
        if self._watch is not None and self._match is not None and self._watch.update(now_s, position_ned_m):
            notices.append(self._watch.notification())
        return notices

    def _pause(self, reading: Reading) -> list[Notify]:
        state_before, self.state = self.state, "paused"
        self._leave_path()
        self.reason = "The vehicle has left Mission mode" + (
            f": {reading.mode_text}." if reading.mode_text else "."
        )
        if state_before == "paused":
            return []
        return [Notify("monitoring_paused", f"The flight is not monitored now. {self.reason}")]

    def _end(self, state: State, reason: str | None) -> list[Notify]:
        self._leave_path()
        self.state, self.reason = state, None if state == "done" else reason
        return []

    def _leave_path(self) -> None:
        self._match = None
        if self._progress is not None:
            self._progress.leave()
        if self._corridor is not None:
            self._watch = CorridorWatch(self._corridor)

    def _is_at_last_item(self) -> bool:
        """Whether the vehicle is flying the last item."""
        if self._progress is not None:
            return self._progress.is_at_last_item
        return self.item is not None and self.item >= len(self._items) - 1

    def _completed_in_air(self, reading: Reading, reached: int | None) -> bool:
        """Whether PX4 has finished the mission in the air and holds the position."""
        is_hold_by_vehicle = reading.mode == "hold" and reading.mode_source == "vehicle"
        was_at_end = self.state == "flying" and self._is_at_last_item()
        return is_hold_by_vehicle and was_at_end and reached == self.item
