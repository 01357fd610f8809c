"""An offboard mission in a dry run: the mission runner of real flights commands a simulated vehicle.

The pilot continues immediately at each question of the mission. No other client takes control of the vehicle.
"""

from __future__ import annotations

import math
from functools import cache

from missions.dry_run.avoidance import SimulatedAvoidance
from missions.dry_run.document import DryRunFinding
from missions.dry_run.fleet import Vehicle
from missions.dry_run.pilot import READY_WITHIN_S, SETTLED_S, FailsafeWatch, Step, finding_now
from missions.frames import Vector3
from missions.offboard.segments import Segment
from missions.runner.reading import Reading, StreamPhase
from missions.runner.requests import (
    ChangeScript,
    PointGimbal,
    ReleaseGimbal,
    Request,
    SetMode,
    StopStream,
    StreamScript,
    TakeOff,
)
from missions.runner.runner import CannotDo, Runner
from missions.runner.sampler import ScriptSampler
from missions.setpoints import (
    Acceleration,
    Attitude,
    DirectSetpoint,
    Estimate,
    Partial3,
    Position,
    Rates,
    Trajectory,
    Velocity,
)
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.autopilot.offboard import NAN3, Offboard, trajectory_setpoint
from vehicle_sim.payload.gimbal import Flag
from vehicle_sim.state import VehicleEstimate

RUNNER_EVERY_TICKS = 5
"""The runner runs at 10 Hz, as in the server."""
STREAMED_BEFORE_S = 0.5
"""Setpoints are streamed for this long before Offboard mode is requested."""
MODE_NAMES: dict[NavState, str] = {mode: mode.name.lower() for mode in NavState}
"""The values of `Reading.mode`."""
MODES: dict[str, NavState] = {"hold": NavState.HOLD, "land": NavState.LAND, "rtl": NavState.RTL}
LANDED = {0: None, 1: "on_ground", 2: "in_air", 3: "taking_off", 4: "landing"}
"""The values of `Reading.landed` for MAV_LANDED_STATE."""
STILL_M_S = 0.5
"""A vehicle slower than this counts as holding its position."""
CONTROL_HOLDER = "the dry run"
"""Id and name of the client that has control of the vehicle."""


@cache
def _valid_estimates(position: bool, velocity: bool, heading: bool, home: bool) -> frozenset[Estimate]:
    """The names of the valid estimates."""
    valid: dict[Estimate, bool] = {
        "position": position, "global_position": position, "velocity": velocity, "heading": heading,
        "home": home,
    }  # fmt: skip
    return frozenset(name for name, is_valid in valid.items() if is_valid)


class OffboardPilot:
    """Starts the runner and executes its requests.

    Args:
        vehicle: the vehicle to command; its local origin is its start position.
        runner: the runner of the mission.
        start_ned_m: start position in the mission's local frame.
        alone: true: the flight starts as soon as the vehicle is ready; false: the caller starts it with
            `begin`, or ends it with `refuse`.
    """

    def __init__(self, vehicle: Vehicle, runner: Runner, start_ned_m: Vector3, *, alone: bool = True) -> None:
        self._vehicle, self.runner, self._start_ned_m, self._alone = vehicle, runner, start_ned_m, alone
        self._failsafe = FailsafeWatch(vehicle)
        self.findings: list[DryRunFinding] = []
        self._avoidance = SimulatedAvoidance(vehicle, self.findings)
        self._sampler: ScriptSampler | None = None
        self._stream: StreamPhase = "idle"
        self._streaming_since_s = 0.0
        self._ticks = 0
        self._segment: Segment | None = None
        self._holding_since_s: float | None = None
        self._commanded: NavState | None = None
        """The mode of the runner's last request; the vehicle itself changes to any other mode."""
        self.started_s: float | None = None
        self.ended = self.finished = False
        self.step: Step | None = None

    def tick(self, now_s: float) -> None:
        """Sends the current setpoint, and runs the runner at 10 Hz."""
        if self.ended:
            return
        if self.started_s is None:
            if self._alone and self.may_start(now_s):
                self._start(now_s)
            return
        self._send(now_s)
        self._ticks += 1
        if self._ticks % RUNNER_EVERY_TICKS == 0:
            self._tick_runner(now_s, self.started_s)

    def may_start(self, now_s: float) -> bool:
        """Whether the vehicle is ready, or the time limit for becoming ready has passed."""
        estimate = self._vehicle.autopilot.view.estimate
        commander = self._vehicle.autopilot.commander
        ready = estimate.valid_position and commander.report.armable(NavState.TAKEOFF)
        return ready or now_s >= READY_WITHIN_S

    def begin(self, now_s: float, requests: list[Request]) -> None:
        """Executes the first requests of the started runner."""
        self.started_s = now_s
        self.execute(now_s, requests)

    def refuse(self, error: CannotDo) -> None:
        """Ends the flight, because the runner cannot start."""
        message = f"The mission cannot start: {error}."
        self.findings.append(finding_now("start_refused", message, None, 0.0, self._vehicle))
        self.ended = True

    def _start(self, now_s: float) -> None:
        try:
            self.begin(now_s, self.runner.start(now_s, self.reading()))
        except CannotDo as error:
            self.refuse(error)

    def _tick_runner(self, now_s: float, started_s: float) -> None:
        runner = self.runner
        self.execute(now_s, runner.tick(now_s, self.reading()))
        state, segment = runner.state, runner.segment
        if runner.question is not None and self._answers(now_s):
            self.execute(now_s, runner.continue_after_question(CONTROL_HOLDER))
        if segment is not None and segment is not self._segment:
            self._segment, self.step = segment, Step(segment.place, segment.title, None)
        t_s = now_s - started_s
        self._avoidance.add_findings(now_s, self.step, t_s)
        failsafe = self._failsafe.check(self.step, t_s)
        if failsafe is not None:
            self.findings.append(failsafe)
        if not (runner.over or state == "suspended"):
            return
        self.finished = state == "done"
        if not self._vehicle.armed:
            self._end(t_s)
            return
        speed_m_s = math.hypot(*self._vehicle.autopilot.view.estimate.velocity_ned_m_s)
        is_holding = self._vehicle.autopilot.commander.active is NavState.HOLD and speed_m_s < STILL_M_S
        if not is_holding:
            self._holding_since_s = None
        elif self._holding_since_s is None:
            self._holding_since_s = now_s
        elif now_s - self._holding_since_s >= SETTLED_S:
            message = f"The flight ends in the air after {self.step.place if self.step else 'the start'}."
            self.findings.append(finding_now("ends_in_air", message, self.step, t_s, self._vehicle))
            self._end(t_s)

    def _answers(self, now_s: float) -> bool:
        """Whether the pilot continues at a question of the mission now."""
        return True

    def _end(self, t_s: float) -> None:
        self.ended = True
        reason = self.runner.status(self.reading()).reason
        if not self.finished and reason:
            message = f"The mission ends early: {reason.rstrip('.')}."
            self.findings.append(finding_now("mission_left", message, self.step, t_s, self._vehicle))

    # --- the runner's inputs and requests -----------------------------------------------------------

    def reading(self) -> Reading:
        """The vehicle's current state, as input of the runner."""
        autopilot, simulation = self._vehicle.autopilot, self._vehicle.autopilot.view.simulation
        commander, row = autopilot.commander, autopilot.row
        estimate = simulation.estimates[row]
        valid = _valid_estimates(
            estimate.valid_position, estimate.valid_velocity, estimate.valid_attitude, autopilot.home.valid
        )
        wind_m_s = commander.monitors.wind_m_s
        distance_m = estimate.height_above_ground_m
        return Reading(
            mode=MODE_NAMES[commander.active],
            mode_source=self._mode_source(),
            mode_text=None,
            armed=commander.armed,
            landed=LANDED[commander.landed_state()],
            position_ned_m=self._position_ned_m(estimate),
            velocity_ned_m_s=estimate.velocity_ned_m_s if estimate.valid_velocity else None,
            yaw_ned_rad=estimate.yaw_ned_rad,
            estimates=valid,
            control_holder=CONTROL_HOLDER,
            control_holder_name=CONTROL_HOLDER,
            battery_share=simulation.battery.remaining.item(row),
            wind_speed_m_s=wind_m_s if math.isfinite(wind_m_s) else None,
            distance_m=distance_m if math.isfinite(distance_m) else None,
            satellites=simulation.sensors.gps_satellites.item(row),
            horizontal_error_m=simulation.estimate.horizontal_accuracy_m.item(row),
            stream=self._stream,
            progress=None if self._sampler is None else self._sampler.progress,
        )

    def _mode_source(self) -> str:
        commander = self._vehicle.autopilot.commander
        if commander.in_failsafe:
            return "failsafe"
        return "command" if commander.active is self._commanded else "vehicle"

    def _position_ned_m(self, estimate: VehicleEstimate) -> Vector3 | None:
        """The vehicle's estimated position in the mission's local frame."""
        if not estimate.valid_position:
            return None
        (n, e, d), (n0, e0, d0) = estimate.position_ned_m, self._start_ned_m
        return (n + n0, e + e0, d + d0)

    def execute(self, now_s: float, requests: list[Request]) -> None:
        """Executes requests of the runner, and reports failed requests to the runner."""
        for request in requests:
            refusal = self._execute_request(now_s, request)
            if refusal is not None:
                self.execute(now_s, self.runner.request_failed(request, self.reading(), refusal))

    def _execute_request(self, now_s: float, request: Request) -> str | None:
        """Why the request failed; None: the request succeeded."""
        autopilot, commander = self._vehicle.autopilot, self._vehicle.autopilot.commander
        if isinstance(request, TakeOff):
            autopilot.navigator.request_takeoff(autopilot.view.estimate.alt_amsl_m + request.height_m)
            if not (self._set_mode(NavState.TAKEOFF) and commander.arm()):
                return self._vehicle.last_warning
        elif isinstance(request, StreamScript):
            if self._stream == "idle":
                self._stream, self._streaming_since_s = "starting", now_s
            self._sampler = ScriptSampler(request.script, now_s)
        elif isinstance(request, ChangeScript):
            if self._sampler is not None:
                self._sampler.change_script(request.change)
        elif isinstance(request, SetMode):
            self._stop_stream()
            if not self._set_mode(MODES[request.mode]):
                return self._vehicle.last_warning
        elif isinstance(request, StopStream):
            self._stop_stream()
        elif isinstance(request, PointGimbal):
            flags = Flag.ROLL_LOCK | Flag.PITCH_LOCK | Flag.YAW_LOCK
            autopilot.gimbal.set_pitch_yaw(int(flags), request.pitch_rad, request.yaw_ned_rad)
        elif isinstance(request, ReleaseGimbal):
            autopilot.gimbal.set_pitch_yaw(int(Flag.NEUTRAL), 0.0, 0.0)
        return None

    def _set_mode(self, mode: NavState) -> bool:
        self._commanded = mode
        return self._vehicle.autopilot.commander.set_mode(mode)

    # --- the stream --------------------------------------------------------------------------------

    def _stop_stream(self) -> None:
        self._sampler, self._stream = None, "idle"
        self._avoidance.reset()

    def _send(self, now_s: float) -> None:
        sampler = self._sampler
        if sampler is None:
            return
        autopilot = self._vehicle.autopilot
        estimate, commander = autopilot.view.estimate, autopilot.commander
        is_starting = self._stream == "starting"
        position = self._position_ned_m(estimate)
        setpoint = sampler.at(now_s, position, estimate.velocity_ned_m_s, waiting=is_starting)
        if self._avoidance.is_needed and not is_starting:
            setpoint = self._avoidance.apply(now_s, sampler, setpoint, position)
        send(autopilot.offboard, setpoint, self._start_ned_m)
        if is_starting and now_s - self._streaming_since_s >= STREAMED_BEFORE_S:
            self._set_mode(NavState.OFFBOARD)
            if commander.active is NavState.OFFBOARD:
                sampler.restart_time(now_s)
                self._stream = "flying"


IGNORE_YAW_RATE, IGNORE_RATES, IGNORE_ATTITUDE = 4, 7, 128
"""Bits of SET_ATTITUDE_TARGET's type_mask. With IGNORE_YAW_RATE cleared, the third rate is the yaw rate."""

# Tuples: `isinstance` is faster with a tuple than with a union.
_TRAJECTORIES = (Trajectory, Position, Velocity, Acceleration)
_WITH_POSITION, _WITH_VELOCITY = (Trajectory, Position), (Trajectory, Velocity)
_WITH_ACCELERATION = (Trajectory, Acceleration)


def send(offboard: Offboard, setpoint: DirectSetpoint, start_ned_m: Vector3) -> None:
    """Sends a setpoint.

    Args:
        offboard: the vehicle's offboard receiver; its local origin is the vehicle's start position.
        setpoint: in the mission's local frame.
        start_ned_m: the vehicle's start position in the mission's local frame.

    Raises:
        ValueError: missions do not send this kind of setpoint.
    """
    if isinstance(setpoint, _TRAJECTORIES):  # first, because most setpoints are of these kinds
        position, velocity, acceleration = NAN3, NAN3, NAN3
        if isinstance(setpoint, _WITH_POSITION):
            (n, e, d), (n0, e0, d0) = _none_as_nan(setpoint.position_ned_m), start_ned_m
            position = (n - n0, e - e0, d - d0)
        if isinstance(setpoint, _WITH_VELOCITY):
            velocity = _none_as_nan(setpoint.velocity_ned_m_s)
        if isinstance(setpoint, _WITH_ACCELERATION):
            acceleration = _none_as_nan(setpoint.acceleration_ned_m_s2)
        yaw, yaw_rate = setpoint.yaw_ned_rad, setpoint.yaw_rate_ned_rad_s
        yaw, yaw_rate = math.nan if yaw is None else yaw, math.nan if yaw_rate is None else yaw_rate
        offboard.trajectory(trajectory_setpoint(position, velocity, acceleration, yaw, yaw_rate))
    elif isinstance(setpoint, Attitude):
        yaw_rate = setpoint.yaw_rate_ned_rad_s
        mask = IGNORE_RATES if yaw_rate is None else IGNORE_RATES & ~IGNORE_YAW_RATE
        offboard.attitude(mask, setpoint.q_ned_frd, (0.0, 0.0, yaw_rate or 0.0), setpoint.thrust)
    elif isinstance(setpoint, Rates):
        level = (1.0, 0.0, 0.0, 0.0)
        offboard.attitude(IGNORE_ATTITUDE, level, setpoint.rates_frd_rad_s, setpoint.thrust)
    else:
        raise ValueError(f"a mission sends no {setpoint.type}")


def _none_as_nan(vector: Partial3) -> Vector3:
    """NaN for a value that is not controlled."""
    x, y, z = vector
    if x is not None and y is not None and z is not None:
        return vector  # type: ignore[return-value]
    return (math.nan if x is None else x, math.nan if y is None else y, math.nan if z is None else z)
