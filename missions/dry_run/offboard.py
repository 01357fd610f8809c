"""An offboard mission in a dry run: the runner that flies real vehicles, with a simulated one to command.

A person who is asked answers at once; nobody else takes the vehicle over.
"""

from __future__ import annotations

import math

from missions.dry_run.findings import DryRunFinding
from missions.dry_run.fleet import Vehicle
from missions.dry_run.pilot import READY_WITHIN_S, SETTLED_S, FailsafeWatch, Step, found
from missions.dry_run.setpoint_input import send
from missions.frames import Vector3
from missions.runner.player import Player
from missions.runner.reading import Reading, StreamPhase
from missions.runner.requests import (
    Play,
    PointGimbal,
    ReleaseGimbal,
    Request,
    SetMode,
    Steer,
    StopStream,
    TakeOff,
    Tell,
)
from missions.runner.runner import CannotDo, Runner
from missions.setpoints import Estimate
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.payload.gimbal import Flag

LOOK_EVERY_TICKS = 5
"""The runner looks at the vehicle at 10 Hz, as in the server."""
STREAMED_BEFORE_S = 0.5
"""Setpoints are streamed for so long before Offboard is asked for."""
NAMES: dict[NavState, str] = {
    NavState.OFFBOARD: "offboard", NavState.HOLD: "hold", NavState.LAND: "land", NavState.RTL: "rtl",
    NavState.TAKEOFF: "takeoff",
}  # fmt: skip
MODES: dict[str, NavState] = {"hold": NavState.HOLD, "land": NavState.LAND, "rtl": NavState.RTL}
LANDED = {0: None, 1: "on_ground", 2: "in_air", 3: "taking_off", 4: "landing"}
"""MAV_LANDED_STATE in the words of a reading."""
STILL_M_S = 0.5
"""So slow it holds."""
NOBODY = "the dry run"


class OffboardPilot:
    """Starts the runner and does what it asks for.

    Args:
        vehicle: that it commands; its own local origin is where it stands.
        runner: of the mission.
        start_ned_m: where it stands in the mission's local frame.
        alone: starts as soon as its vehicle is ready; else `begin` or `refuse` is called for it.
    """

    def __init__(self, vehicle: Vehicle, runner: Runner, start_ned_m: Vector3, *, alone: bool = True) -> None:
        self._vehicle, self.runner, self._start_ned_m, self._alone = vehicle, runner, start_ned_m, alone
        self._failsafe = FailsafeWatch(vehicle)
        self._player: Player | None = None
        self._stream: StreamPhase = "idle"
        self._streaming_since_s = 0.0
        self._ticks = 0
        self._settled_s: float | None = None
        self._told = ""
        self.started_s: float | None = None
        self.done = self.finished = False
        self.step: Step | None = None
        self.findings: list[DryRunFinding] = []

    def tick(self, now_s: float) -> None:
        """Sends the setpoint of this moment; lets the runner look at 10 Hz."""
        if self.done:
            return
        if self.started_s is None:
            if self._alone and self.may_start(now_s):
                self._start(now_s)
            return
        self._send(now_s)
        self._ticks += 1
        if self._ticks % LOOK_EVERY_TICKS == 0:
            self._look(now_s, self.started_s)

    def may_start(self, now_s: float) -> bool:
        """Whether the vehicle is ready, or will not be any more."""
        estimate = self._vehicle.autopilot.view.estimate
        commander = self._vehicle.autopilot.commander
        ready = estimate.valid_position and commander.report.armable(NavState.TAKEOFF)
        return ready or now_s >= READY_WITHIN_S

    def begin(self, now_s: float, requests: list[Request]) -> None:
        """The runner has started; this is what it asks for first."""
        self.started_s = now_s
        self.carry_out(now_s, requests)

    def refuse(self, error: CannotDo) -> None:
        """The runner cannot start."""
        message = f"The mission cannot start: {error}."
        self.findings.append(found("start_refused", message, None, 0.0, self._vehicle))
        self.done = True

    def _start(self, now_s: float) -> None:
        try:
            self.begin(now_s, self.runner.start(now_s, self.reading()))
        except CannotDo as error:
            self.refuse(error)

    def _look(self, now_s: float, started_s: float) -> None:
        runner = self.runner
        self.carry_out(now_s, runner.tick(now_s, self.reading()))
        status = runner.status(self.reading())
        if status.question is not None:
            self.carry_out(now_s, runner.go_on(NOBODY))
        if status.place is not None:
            self.step = Step(status.place, status.title or "", None)
        t_s = now_s - started_s
        failsafe = self._failsafe.look(self.step, t_s)
        if failsafe is not None:
            self.findings.append(failsafe)
        if not (runner.over or status.state == "suspended"):
            return
        self.finished = status.state == "done"
        if not self._vehicle.armed:
            self._end(status.reason, t_s)
            return
        speed_m_s = math.hypot(*self._vehicle.autopilot.view.estimate.velocity_ned_m_s)
        holds = self._vehicle.autopilot.commander.active is NavState.HOLD and speed_m_s < STILL_M_S
        if not holds:
            self._settled_s = None
        elif self._settled_s is None:
            self._settled_s = now_s
        elif now_s - self._settled_s >= SETTLED_S:
            message = f"The flight ends in the air after {self.step.place if self.step else 'its start'}."
            self.findings.append(found("ends_in_air", message, self.step, t_s, self._vehicle))
            self._end(status.reason, t_s)

    def _end(self, reason: str | None, t_s: float) -> None:
        self.done = True
        if not self.finished and reason:
            message = f"The mission ends early: {reason.rstrip('.')}."
            self.findings.append(found("mission_left", message, self.step, t_s, self._vehicle))

    # --- what the runner knows and asks for --------------------------------------------------------

    def reading(self) -> Reading:
        """What the runner is told of the vehicle now."""
        autopilot, simulation = self._vehicle.autopilot, self._vehicle.autopilot.view.simulation
        estimate, commander, row = autopilot.view.estimate, autopilot.commander, autopilot.view.row
        valid: set[Estimate] = set()
        if estimate.valid_position:
            valid |= {"position", "global_position"}
        if estimate.valid_velocity:
            valid.add("velocity")
        if estimate.valid_attitude:
            valid.add("heading")
        if autopilot.home.valid:
            valid.add("home")
        wind_m_s = commander.monitors.wind_m_s
        distance_m = estimate.height_above_ground_m
        return Reading(
            mode=NAMES.get(commander.active, commander.active.name.lower()),
            mode_source="failsafe" if commander.in_failsafe else "command",
            mode_text=None,
            armed=commander.armed,
            landed=LANDED[int(commander.landed_state())],
            position_ned_m=self._place(),
            velocity_ned_m_s=estimate.velocity_ned_m_s if estimate.valid_velocity else None,
            yaw_ned_rad=estimate.yaw_ned_rad,
            estimates=frozenset(valid),
            holder=NOBODY,
            holder_name=NOBODY,
            battery_share=float(simulation.battery.remaining[row]),
            wind_speed_m_s=wind_m_s if math.isfinite(wind_m_s) else None,
            distance_m=distance_m if math.isfinite(distance_m) else None,
            satellites=int(simulation.sensors.gps_satellites[row]),
            horizontal_error_m=float(simulation.estimate.horizontal_accuracy_m[row]),
            stream=self._stream,
            played=None if self._player is None else self._player.played,
        )

    def _place(self) -> Vector3 | None:
        """Where the vehicle believes to be, in the mission's local frame."""
        estimate = self._vehicle.autopilot.view.estimate
        if not estimate.valid_position:
            return None
        n, e, d = (at + start for at, start in zip(estimate.position_ned_m, self._start_ned_m, strict=True))
        return (n, e, d)

    def carry_out(self, now_s: float, requests: list[Request]) -> None:
        """What the runner asks for; it is told what cannot be done."""
        for request in requests:
            refusal = self._carry_out(now_s, request)
            if refusal is not None:
                self.carry_out(now_s, self.runner.failed(request, self.reading(), refusal))

    def _carry_out(self, now_s: float, request: Request) -> str | None:
        """None, or why it was not done."""
        autopilot, commander = self._vehicle.autopilot, self._vehicle.autopilot.commander
        if isinstance(request, TakeOff):
            autopilot.navigator.request_takeoff(autopilot.view.estimate.alt_amsl_m + request.height_m)
            if not (commander.set_mode(NavState.TAKEOFF) and commander.arm()):
                return self._vehicle.last_warning
        elif isinstance(request, Play):
            if self._stream == "idle":
                self._stream, self._streaming_since_s = "starting", now_s
            self._player = Player(request.script, now_s)
        elif isinstance(request, Steer):
            if self._player is not None:
                self._player.steer(request.steering)
        elif isinstance(request, SetMode):
            self._stop_stream()
            if not commander.set_mode(MODES[request.mode]):
                return self._vehicle.last_warning
        elif isinstance(request, StopStream):
            self._stop_stream()
        elif isinstance(request, PointGimbal):
            flags = Flag.ROLL_LOCK | Flag.PITCH_LOCK | Flag.YAW_LOCK
            autopilot.gimbal.set_pitch_yaw(int(flags), request.pitch_rad, request.yaw_ned_rad)
        elif isinstance(request, ReleaseGimbal):
            autopilot.gimbal.set_pitch_yaw(int(Flag.NEUTRAL), 0.0, 0.0)
        elif isinstance(request, Tell) and request.warning:
            self._told = request.text
        return None

    # --- the stream --------------------------------------------------------------------------------

    def _stop_stream(self) -> None:
        self._player, self._stream = None, "idle"

    def _send(self, now_s: float) -> None:
        player = self._player
        if player is None:
            return
        autopilot, commander = self._vehicle.autopilot, self._vehicle.autopilot.commander
        estimate = autopilot.view.estimate
        waiting = self._stream == "starting"
        setpoint = player.at(now_s, self._place(), estimate.velocity_ned_m_s, waiting=waiting)
        send(autopilot.offboard, setpoint, self._start_ned_m)
        if waiting and now_s - self._streaming_since_s >= STREAMED_BEFORE_S:
            commander.set_mode(NavState.OFFBOARD)
            if commander.active is NavState.OFFBOARD:
                player.begin_anew(now_s)
                self._stream = "flying"
