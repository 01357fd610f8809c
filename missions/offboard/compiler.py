"""Compiles a mission document to its timeline. A step that cannot be flown becomes a finding. No I/O."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from missions.errors import PlanError
from missions.flight_times import land_time_s, takeoff_time_s
from missions.geodesy import LocalOrigin
from missions.offboard import compile_paths, mission_checks
from missions.offboard.document import OffboardMission
from missions.offboard.positions import MissingReference, Start, fence_area
from missions.offboard.segments import Decision, Event, GimbalTrack, WaitKind, WaitSegment
from missions.offboard.state import Compilation, MissionVehicle, State
from missions.offboard.steps import (
    AttitudeStep,
    Branch,
    Call,
    Condition,
    FigureEight,
    Fly,
    Gimbal,
    Helix,
    Hold,
    Land,
    Meet,
    MissionStep,
    Orbit,
    PathStep,
    Photo,
    Repeat,
    Spiral,
    Table,
    TakeOff,
    VelocityStep,
    Wait,
)
from missions.offboard.timeline import FlightActions, Timeline

COMMON_START = "start"
"""Name of the meeting of all roles before their first step."""
COMMON_START_TIMEOUT_S = 60.0
"""Time in which all roles must be at the common start [s]."""
MAX_SUCCESSIVE_BRANCHES = 12
"""Maximum number of successive branches; each branch doubles the number of paths through the mission."""


@dataclass(frozen=True, slots=True)
class _StepCursor:
    """The next step to compile in a list of steps, and where to continue after the list."""

    steps: tuple[MissionStep, ...]
    prefix: str
    index: int = 0
    times_left: int = 1
    after: _StepCursor | None = None


def compile_mission(
    mission: OffboardMission,
    vehicle: MissionVehicle | None = None,
    start: Start | None = None,
    files: Mapping[str, bytes] | None = None,
    first_step: int = 0,
    role: str | None = None,
) -> Timeline:
    """The timeline of a mission, with its findings.

    Args:
        mission: the document.
        vehicle: limits of the vehicle; None: PX4's defaults.
        start: state of the vehicle at the start; None: on the ground at the local origin. The local origin is
            then the document's home, if the document has one.
        files: contents of the table files, by name.
        first_step: index of the first step to fly, to continue a mission; the gimbal tracks of the steps
            before it still apply.
        role: the role to compile, in a mission for several vehicles; its timeline starts with a meeting of
            all roles.

    Raises:
        PlanError: The mission is too large, or has no such role.
    """
    steps = _steps_of(mission, role)
    vehicle = vehicle or MissionVehicle()
    start = _with_home(mission, start or Start())
    compilation = Compilation(mission, vehicle, start, files or {}, vehicle.motion_within(mission.limits))
    state = State(compilation, start.position_ned_m, start.yaw_ned_rad, start.in_air)
    _apply_gimbal_tracks(state, steps[:first_step])
    if role is not None:
        state.place, state.title = f"{role}, start", "Common start"
        _compile_meet(state, Meet(meeting=COMMON_START, timeout_s=COMMON_START_TIMEOUT_S))
    timeline = _compile_from(
        state, _StepCursor(steps, "step " if role is None else f"{role}, step ", first_step), 0
    )
    findings = (*compilation.findings, *mission_checks.check(timeline, compilation))
    energy_wh = mission_checks.energy_wh(timeline, compilation)
    fence = None if start.origin is None else fence_area(mission.fence, start.origin)
    return replace(timeline, findings=tuple(dict.fromkeys(findings)), energy_wh=energy_wh, fence=fence)


def _steps_of(mission: OffboardMission, role: str | None) -> tuple[MissionStep, ...]:
    if role is None and mission.roles:
        raise PlanError(
            "the mission",
            f"it is for {len(mission.roles)} vehicles (roles: {', '.join(mission.roles)}), not for one",
            "Start it with a vehicle for each role.",
        )
    if role not in mission.steps_by_role:
        raise PlanError("the mission", f"there is no role {role!r}", "Choose one of its roles.")
    return mission.steps_by_role[role]


def _apply_gimbal_tracks(state: State, steps: tuple[MissionStep, ...]) -> None:
    """Applies the gimbal tracks of steps that are not flown again."""
    for index, step in enumerate(steps, 1):
        if isinstance(step, Gimbal):
            state.place, state.title = f"step {index}", "Gimbal"
            _compile_step(state, step)


def _with_home(mission: OffboardMission, start: Start) -> Start:
    """The start with the document's home, if the vehicle's global position is unknown."""
    home = mission.home
    if home is None or start.origin is not None:
        return start
    origin = LocalOrigin(home.lat_deg, home.lon_deg, home.alt_amsl_m)
    return replace(start, origin=origin, home_alt_amsl_m=home.alt_amsl_m)


def _compile_from(state: State, cursor: _StepCursor | None, branches_before: int) -> Timeline:
    """Compiles the steps from the cursor to the end of the mission. At a branch it compiles both
    continuations."""
    while (next_step := _next_step(cursor)) is not None:
        step, state.place, cursor = next_step
        state.title = step.name or step.step.replace("_", " ").capitalize()
        state.compilation.add_size(steps=1)
        state.executed_step = state.compilation.step_count
        if isinstance(step, Repeat):
            cursor = _StepCursor(step.steps, f"{state.place}.", times_left=step.times, after=cursor)
        elif isinstance(step, Call):
            called = state.compilation.mission.missions[step.mission]
            cursor = _StepCursor(called, f"{state.place}, {step.mission} ", after=cursor)
        elif isinstance(step, Branch):
            if branches_before >= MAX_SUCCESSIVE_BRANCHES:
                reason = f"more than {MAX_SUCCESSIVE_BRANCHES} branches one after the other"
                raise PlanError(state.place, reason, "Split the mission.")
            return _compile_branch(state, step, cursor, branches_before)
        else:
            _compile_step(state, step)
    if state.in_air:
        state.place = "the end"
        state.report(
            "landing_missing",
            "The mission ends in the air; the vehicle holds its position.",
            "Add a landing.",
        )
    return _timeline(state)


def _next_step(cursor: _StepCursor | None) -> tuple[MissionStep, str, _StepCursor | None] | None:
    """The next step, its label ("step 4.2"), and the cursor after this step; None: the mission ends."""
    while cursor is not None:
        if cursor.index < len(cursor.steps):
            step = cursor.steps[cursor.index]
            return step, f"{cursor.prefix}{cursor.index + 1}", replace(cursor, index=cursor.index + 1)
        repeats = cursor.times_left > 1
        cursor = replace(cursor, index=0, times_left=cursor.times_left - 1) if repeats else cursor.after
    return None


def _compile_branch(state: State, step: Branch, cursor: _StepCursor | None, branches_before: int) -> Timeline:
    condition = step.condition
    _check_condition(state, condition, "the mission continues with `otherwise`")
    decision = Decision(state.place, condition.value, condition.above, condition.below, condition.for_s)
    continuations: list[Timeline] = []
    for keyword, steps in (("then", step.then), ("otherwise", step.otherwise)):
        branch_state = state.fork()
        continuations.append(
            _compile_from(
                branch_state,
                _StepCursor(steps, f"{decision.place} {keyword} ", after=cursor),
                branches_before + 1,
            )
        )
        state.needs |= branch_state.needs
    return replace(_timeline(state), decision=decision, then=continuations[0], otherwise=continuations[1])


def _timeline(state: State) -> Timeline:
    starts: list[float] = []
    now_s = 0.0
    for segment in state.segments:
        starts.append(now_s)
        now_s += segment.duration_s
    actions = state.compilation.mission.actions
    needs = dict.fromkeys(("position", "velocity", *sorted(state.needs)))
    return Timeline(
        tuple(state.segments), tuple(starts), (), tuple(needs),
        FlightActions(actions.failure, actions.low_battery, actions.link_loss, actions.control_lost),
    )  # fmt: skip


def _compile_step(state: State, step: Any) -> None:
    """Compiles one step; a step that cannot be flown becomes a finding and is omitted."""
    requires_flight = not isinstance(step, TakeOff | Gimbal | Photo | Wait | Meet)
    if requires_flight and not state.in_air:
        state.report(
            "takeoff_missing",
            f"{state.title}: the vehicle is on the ground.",
            "Add a take-off before this step.",
        )
        state.in_air = True  # so that the following steps do not report the same problem
    step_setting = step.avoidance if isinstance(step, PathStep) else None
    requested = state.compilation.mission.avoidance if step_setting is None else step_setting
    state.avoidance = ("over" if requested else None) if isinstance(requested, bool) else requested
    segments_before = len(state.segments)
    pose_before = (state.position_ned_m, state.yaw_ned_rad)
    try:
        _COMPILERS[type(step)](state, step)
    except MissingReference as error:
        names = {"global_position": "global position", "home": "altitude of home"}
        message = f"The position of this step requires the {names[error.missing]}, which is unknown."
        state.report(
            "estimate_missing", message, "Give the mission a home, or wait for the vehicle's position."
        )
    except PlanError as error:
        if error.place == "the mission":
            raise
        state.report("step_invalid", f"{error.place}: {error.reason}.", error.fix)
    else:
        return
    del state.segments[segments_before:]
    state.position_ned_m, state.yaw_ned_rad = pose_before


def _compile_take_off(state: State, step: TakeOff) -> None:
    if state.in_air:
        state.report(
            "takeoff_in_air",
            "The mission takes off, but the vehicle is already flying.",
            "Remove this take-off.",
        )
        return
    north, east, down = state.position_ned_m
    state.in_air = True
    duration_s = takeoff_time_s(step.height_m, state.compilation.vehicle.limits.vehicle)
    _add_wait(
        state, "take_off", duration_s, (north, east, down - step.height_m), step.timeout_s,
        length_m=step.height_m, height_m=step.height_m,
    )  # fmt: skip


def _compile_land(state: State, step: Land) -> None:
    north, east, down = state.position_ned_m
    height_m = max(0.0, state.compilation.start.reference_ned_m[2] - down)
    duration_s = land_time_s(height_m, state.compilation.vehicle.limits.vehicle)
    state.in_air = False
    _add_wait(state, "land", duration_s, (north, east, down + height_m), step.timeout_s, length_m=height_m)


def _compile_wait(state: State, step: Wait) -> None:
    fields: dict[str, Any] = {"message": step.message, "on_timeout": step.on_timeout}
    if step.until == "person":
        _add_wait(state, "person", 0.0, state.position_ned_m, step.timeout_s, **fields)
        return
    condition = step.until
    _check_condition(state, condition, f"after {step.timeout_s:g} s the action is {step.on_timeout}")
    fields |= {
        "value": condition.value,
        "above": condition.above,
        "below": condition.below,
        "for_s": condition.for_s,
    }
    _add_wait(state, "condition", condition.for_s, state.position_ned_m, step.timeout_s, **fields)


def _compile_meet(state: State, step: Meet) -> None:
    _add_wait(state, "meet", 0.0, state.position_ned_m, step.timeout_s, message=step.meeting)


def _check_condition(state: State, condition: Condition, consequence: str) -> None:
    """Reports a condition that can never become true, or whose value the vehicle does not report.

    Args:
        consequence: what happens while the condition is false, for the message.
    """
    name, above, below = condition.value, condition.above, condition.below
    if (below is not None and below <= 0.0) or (
        name == "battery_share" and above is not None and above >= 1.0
    ):
        bound = f"above {above:g}" if above is not None else f"below {below:g}"
        message = f"{name} is never {bound}: {consequence}."
        state.report("condition_never", message, "Change the bound (battery_share is 0 to 1).")
    reported = state.compilation.vehicle.reported
    if reported is not None and name not in reported:
        message = f"The vehicle does not report {name}, so the condition stays false: {consequence}."
        state.report("condition_unreported", message, "Choose another value, or enable its sensor.")


def _add_wait(
    state: State,
    kind: WaitKind,
    duration_s: float,
    end_ned_m: tuple[float, float, float],
    timeout_s: float,
    **fields: Any,
) -> None:
    state.add(
        WaitSegment(
            state.place, state.title, duration_s, end_ned_m, state.yaw_ned_rad, gimbal=state.gimbal,
            kind=kind, timeout_s=timeout_s, **fields,
        )
    )  # fmt: skip


def _compile_gimbal(state: State, step: Gimbal) -> None:
    if step.track == "release":
        state.gimbal = None
    else:
        steepest_rad = abs(step.pitch_rad) + (step.sweep_pitch_rad if step.track == "sweep" else 0.0)
        if steepest_rad > 1.5708:
            message = f"The gimbal is commanded to a pitch of {steepest_rad:.2f} rad."
            state.report("gimbal_steep", message, "Stay within straight up and straight down (1.57 rad).")
        target_ned_m = (0.0, 0.0, 0.0) if step.place is None else state.locate(step.place)
        state.gimbal = GimbalTrack(
            step.track,
            step.pitch_rad,
            step.yaw_rad,
            target_ned_m,
            step.sweep_pitch_rad,
            step.sweep_yaw_rad,
            step.period_s,
        )
    compile_paths.hold_position(state, 0.0, (Event(0.0, "gimbal"),))


_COMPILERS: dict[type, Callable[[State, Any], None]] = {
    TakeOff: _compile_take_off,
    Land: _compile_land,
    Wait: _compile_wait,
    Meet: _compile_meet,
    Gimbal: _compile_gimbal,
    Hold: compile_paths.compile_hold,
    Photo: compile_paths.compile_photo,
    Fly: compile_paths.compile_fly,
    Orbit: compile_paths.compile_shape,
    Helix: compile_paths.compile_shape,
    Spiral: compile_paths.compile_shape,
    FigureEight: compile_paths.compile_shape,
    Table: compile_paths.compile_table,
    VelocityStep: compile_paths.compile_velocity,
    AttitudeStep: compile_paths.compile_attitude,
}
