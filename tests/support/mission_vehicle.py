"""A vehicle without physics for the mission runner: it reaches each setpoint within one time step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from missions.offboard.compiler import compile_mission
from missions.offboard.document import OffboardMission
from missions.offboard.timeline import Timeline
from missions.runner.reading import Reading
from missions.runner.requests import (
    ChangeScript,
    Notify,
    Request,
    RunnerStatus,
    SetMode,
    StopStream,
    StreamScript,
    TakeOff,
)
from missions.runner.runner import Runner
from missions.runner.sampler import ScriptSampler
from missions.setpoints import Estimate, Position, Trajectory, Velocity, zeros_for_none

STEP_S = 0.1
VERTICAL_SPEED_M_S = 2.0
ALL_ESTIMATES: frozenset[Estimate] = frozenset({"position", "velocity", "heading", "global_position", "home"})


class FakeFlight:
    """A mission runner, a script sampler and a fake vehicle on one clock.

    Args:
        mission: the mission.
        timeline: timeline of one role; None: the mission's timeline.
        options: options of the runner.
    """

    def __init__(self, mission: OffboardMission, timeline: Timeline | None = None, **options: Any) -> None:
        self.runner = Runner(timeline or compile_mission(mission), mission.name, **options)
        self.now_s = 100.0
        self.reading = Reading(
            mode="hold", armed=False, landed="on_ground", position_ned_m=(0.0, 0.0, 0.0),
            velocity_ned_m_s=(0.0, 0.0, 0.0), yaw_ned_rad=0.0, estimates=ALL_ESTIMATES,
            control_holder="alice", control_holder_name="Alice", battery_share=0.9,
        )  # fmt: skip
        self.sampler: ScriptSampler | None = None
        self.requests: list[Request] = []
        self.sent_setpoints: list[tuple[float, Any]] = []
        """The time [s] and the setpoint of each sent setpoint."""
        self.flown_path: list[tuple[float, float, float]] = []
        """The position in NED [m] after each step."""
        self.refused_requests: dict[type, str] = {}
        """Classes of requests that the vehicle refuses, with the reason."""
        self._take_off_down_m = 0.0
        self._blocked_at: tuple[float, float, float] | None = None

    # --- disturbances -----------------------------------------------------------------------------

    def set_reading(self, **changes: Any) -> None:
        """Sets fields of the reading: the state of the vehicle as the runner knows it."""
        self.reading = self.reading._replace(**changes)

    def change_mode(self, mode: str, source: str, text: str | None = None) -> None:
        """Changes the vehicle's mode without a request of the runner; this ends the stream."""
        self.sampler = None
        self.set_reading(mode=mode, mode_source=source, mode_text=text, stream="idle", progress=None)

    def block(self) -> Any:
        """Keeps the vehicle at its position: it ignores its setpoints. Returns the position."""
        self._blocked_at = self.reading.position_ned_m
        return self._blocked_at

    def unblock(self) -> None:
        """Lets the vehicle follow its setpoints again."""
        self._blocked_at = None

    def interrupt(self) -> None:
        """The vehicle's failsafe leaves the mission's mode; the stream keeps the vehicle at its place."""
        self.change_mode("position", "failsafe", "The failsafe")
        self.set_reading(stream="interrupted")

    def return_at(self, north_m: float, down_m: float) -> tuple[float, float, float]:
        """The vehicle is back in the mission's mode, displaced; the stream still keeps it there."""
        n, e, d = self.reading.position_ned_m or (0.0, 0.0, 0.0)
        position_ned_m = (n + north_m, e, d + down_m)
        self._set_mode(self.runner.flight.mode)
        self.set_reading(position_ned_m=position_ned_m, velocity_ned_m_s=(0.0, 0.0, 0.0))
        return position_ned_m

    def lose_link(self) -> None:
        """Stops all messages of the vehicle; the server has already ended the stream and commanded Hold."""
        self.change_mode("hold", "command", "The server commanded Hold")
        self.set_reading(link_active=False)

    # --- commands of the operator -----------------------------------------------------------------

    def start(self) -> FakeFlight:
        """Starts the mission."""
        self.execute(self.runner.start(self.now_s, self.reading))
        return self

    def pause(self) -> None:
        self.execute(self.runner.pause(self.now_s, self.reading, "Alice"))

    def resume(self) -> None:
        self.execute(self.runner.resume(self.now_s, self.reading, "Alice"))

    def skip(self) -> None:
        self.execute(self.runner.skip(self.now_s, self.reading, "Alice"))

    def abort(self, then: str = "hold") -> None:
        self.execute(self.runner.abort(self.reading, "Alice", then))

    def continue_after_question(self) -> None:
        self.execute(self.runner.continue_after_question("Alice"))

    # --- time -------------------------------------------------------------------------------------

    def until(self, condition: Callable[[], bool], within_s: float = 600.0) -> FakeFlight:
        """Flies until the condition is true.

        Raises:
            AssertionError: the condition was not true in time.
        """
        end_s = self.now_s + within_s
        while not condition():
            assert self.now_s < end_s, f"not within {within_s} s; {self.status}, {self.event_texts[-3:]}"
            self.step()
        return self

    def fly(self, for_s: float) -> FakeFlight:
        """Flies for this time [s]."""
        end_s = self.now_s + for_s
        return self.until(lambda: self.now_s >= end_s, for_s + 1.0)

    def until_state(self, *states: str) -> FakeFlight:
        """Flies until the mission is in one of these states."""
        return self.until(lambda: self.status.state in states)

    def step(self) -> None:
        """Moves the vehicle by one setpoint and updates the runner once."""
        self.now_s += STEP_S
        self._move()
        self.execute(self.runner.tick(self.now_s, self.reading))

    # --- results ----------------------------------------------------------------------------------

    @property
    def status(self) -> RunnerStatus:
        return self.runner.status(self.reading)

    @property
    def event_texts(self) -> list[str]:
        """Texts of the events."""
        return [request.text for request in self.requests if isinstance(request, Notify)]

    def requested_modes(self) -> list[str]:
        """Requested modes."""
        return [request.mode for request in self.requests if isinstance(request, SetMode)]

    def count_requests(self, request_class: type) -> int:
        return sum(isinstance(request, request_class) for request in self.requests)

    # --- the vehicle ------------------------------------------------------------------------------

    def execute(self, requests: list[Request]) -> None:
        """Executes the runner's requests."""
        for request in requests:
            self.requests.append(request)
            if type(request) in self.refused_requests:
                text = self.refused_requests[type(request)]
                self.execute(self.runner.request_failed(request, self.reading, text))
            elif isinstance(request, TakeOff):
                self._take_off_down_m = self._down_m - request.height_m
                self._set_mode("takeoff")
                self.set_reading(armed=True)
            elif isinstance(request, StreamScript):
                self.sampler = ScriptSampler(request.script, self.now_s)
                self._set_mode(self.runner.flight.mode)
                self.set_reading(stream="flying", progress=self.sampler.progress)
            elif isinstance(request, ChangeScript) and self.sampler is not None:
                self.sampler.change_script(request.change)
            elif isinstance(request, SetMode):
                self.change_mode(request.mode, "command", "The mission")
            elif isinstance(request, StopStream):
                self.sampler = None
                self.set_reading(stream="idle", progress=None)

    def _set_mode(self, mode: str) -> None:
        self.set_reading(mode=mode, mode_source="command", mode_text="The mission")

    @property
    def _down_m(self) -> float:
        return (self.reading.position_ned_m or (0.0, 0.0, 0.0))[2]

    def _move(self) -> None:
        n, e, d = self.reading.position_ned_m or (self.flown_path[-1] if self.flown_path else (0.0, 0.0, 0.0))
        velocity = (0.0, 0.0, 0.0)
        if self.sampler is not None:
            setpoint = self.sampler.at(self.now_s, self.reading.position_ned_m, self.reading.velocity_ned_m_s)
            self.sent_setpoints.append((self.now_s, setpoint))
            self.set_reading(progress=self.sampler.progress)
            if isinstance(setpoint, Trajectory | Position):
                n, e, d = (axis or 0.0 for axis in setpoint.position_ned_m)
                if isinstance(setpoint, Trajectory):
                    velocity = zeros_for_none(setpoint.velocity_ned_m_s)
                if setpoint.yaw_ned_rad is not None:
                    self.set_reading(yaw_ned_rad=setpoint.yaw_ned_rad)
            elif isinstance(setpoint, Velocity):
                velocity = zeros_for_none(setpoint.velocity_ned_m_s)
                n, e, d = (x + v * STEP_S for x, v in zip((n, e, d), velocity, strict=True))
        elif self.reading.mode == "takeoff":
            d = max(self._take_off_down_m, d - VERTICAL_SPEED_M_S * STEP_S)
            self.set_reading(landed="in_air" if d < -0.1 else "taking_off")
            if d == self._take_off_down_m:
                self.set_reading(mode="hold", mode_source="vehicle", mode_text="PX4 completed the take-off")
        elif self.reading.mode == "land" and self.reading.armed:
            d = min(0.0, d + VERTICAL_SPEED_M_S * STEP_S)
            if d == 0.0:
                self.set_reading(landed="on_ground", armed=False)
        if self._blocked_at is not None:
            (n, e, d), velocity = self._blocked_at, (0.0, 0.0, 0.0)
        self.flown_path.append((n, e, d))
        if self.reading.position_ned_m is not None:
            self.set_reading(position_ned_m=(n, e, d), velocity_ned_m_s=velocity)
