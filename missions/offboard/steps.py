"""The steps of an offboard mission, one class each; `step` is the kind.

Names, units and frames are those of `missions.setpoints`: metres, seconds, radians, NED.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from missions.avoidance.values import AvoidanceWay
from missions.offboard.positions import MissionPosition
from missions.values import DisplayText, Model

Finite = Annotated[float, Field(allow_inf_nan=False)]
Seconds = Annotated[float, Field(ge=0.0, le=86_400.0, allow_inf_nan=False)]
Timeout = Annotated[float, Field(gt=0.0, le=86_400.0, allow_inf_nan=False)]
Speed = Annotated[float, Field(gt=0.0, le=100.0, allow_inf_nan=False)]
Angle = Annotated[float, Field(ge=-1000.0, le=1000.0, allow_inf_nan=False)]
Metres = Annotated[float, Field(gt=0.0, le=10_000.0, allow_inf_nan=False)]
Climb = Annotated[float, Field(ge=-10_000.0, le=10_000.0, allow_inf_nan=False)]
Rounds = Annotated[float, Field(ge=0.01, le=200.0, allow_inf_nan=False)]
Text = Annotated[str, Field(max_length=200)]


def _check_avoidance(value: Any) -> Any:
    """One message for all wrong values, instead of one for each type."""
    if isinstance(value, bool) or value in ("over", "around"):
        return value
    raise ValueError("give over, around, true or false")


Avoidance = Annotated[bool | AvoidanceWay, BeforeValidator(_check_avoidance)]
"""What obstacle avoidance tries first: over or around; true means over, false means off."""
Name = Annotated[DisplayText, Field(min_length=1, max_length=100)]
MAX_STEPS = 1000
"""Maximum number of steps in one list."""

Action = Literal["continue", "hold", "return", "land"]
"""Action of the mission runner: continue, hold the position, return to launch, or land."""


class Step(Model):
    """Base class of all steps."""

    name: Annotated[DisplayText, Field(max_length=200)] | None = None
    """Name shown to the pilot."""


class TakeOff(Step):
    """Arm and climb to `height_m`; the next step starts at this height."""

    step: Literal["take_off"] = "take_off"
    height_m: Annotated[float, Field(ge=0.5, le=500.0, allow_inf_nan=False)]
    """Height above the take-off position [m]."""
    timeout_s: Timeout = 60.0


class Land(Step):
    """Land at the current position and disarm."""

    step: Literal["land"] = "land"
    timeout_s: Timeout = 300.0


class Hold(Step):
    """Hold the position."""

    step: Literal["hold"] = "hold"
    duration_s: Seconds
    yaw_ned_rad: Angle | None = None
    """Heading to turn to first; None: keep the current heading."""


class PathStep(Step):
    """Base class of all steps along a path: speed, heading, photos.

    The heading is a fixed yaw, along the path, towards a position, or unchanged.
    """

    speed_m_s: Speed | None = None
    """Maximum horizontal speed; None: MPC_XY_CRUISE."""
    heading: Literal["keep", "along_path"] = "keep"
    yaw_ned_rad: Angle | None = None
    look_at: MissionPosition | None = None
    photo_every_m: Metres | None = None
    avoidance: Avoidance | None = None
    """Avoid obstacles that the vehicle's sensors measure; None: the mission's setting."""

    @model_validator(mode="after")
    def _one_heading(self) -> PathStep:
        given = [self.heading != "keep", self.yaw_ned_rad is not None, self.look_at is not None]
        if sum(given) > 1:
            raise ValueError("give one of heading, yaw_ned_rad and look_at")
        return self


class FlyPoint(MissionPosition):
    """A point to fly through."""

    yaw_ned_rad: Angle | None = None
    """Heading at the point; between two points the heading changes at a constant rate."""
    stop: bool = False
    hold_s: Seconds = 0.0
    """Time to wait at the point; if it is above 0, the vehicle stops at the point."""
    corner_m: Annotated[float, Field(ge=0.0, le=1000.0, allow_inf_nan=False)] = 1.0
    """Maximum distance between the point and the rounded corner."""


class Fly(PathStep):
    """Fly through points: on straight legs with rounded corners, or on a smooth curve exactly through
    them."""

    step: Literal["fly"] = "fly"
    points: Annotated[tuple[FlyPoint, ...], Field(min_length=1, max_length=5000)]
    curve: Literal["straight", "smooth"] = "straight"

    @model_validator(mode="after")
    def _one_yaw(self) -> Fly:
        has_yaw = any(point.yaw_ned_rad is not None for point in self.points)
        if has_yaw and (self.heading != "keep" or self.yaw_ned_rad is not None or self.look_at is not None):
            raise ValueError("give yaws at points, or a heading for the step")
        return self


class Orbit(PathStep):
    """Fly circles around a position, at the altitude of the position."""

    step: Literal["orbit"] = "orbit"
    center: MissionPosition
    radius_m: Metres
    turns: Rounds = 1.0
    clockwise: bool = True
    start_angle_ned_rad: Angle | None = None
    """Bearing of the start from the centre; None: the point nearest to the vehicle."""


class Helix(Orbit):
    """Fly circles around a position while climbing; a negative `climb_m` descends."""

    step: Literal["helix"] = "helix"  # type: ignore[assignment]
    climb_m: Climb


class Spiral(Orbit):
    """Fly circles whose radius changes to `end_radius_m`."""

    step: Literal["spiral"] = "spiral"  # type: ignore[assignment]
    end_radius_m: Metres
    climb_m: Climb = 0.0


class FigureEight(PathStep):
    """Fly a figure-eight around its centre."""

    step: Literal["figure_eight"] = "figure_eight"
    center: MissionPosition
    length_m: Metres
    """Length of the figure from tip to tip."""
    width_m: Metres
    """Width of each loop."""
    rounds: Rounds = 1.0
    axis_ned_rad: Angle = 0.0
    """Direction of the long axis, clockwise from north."""


class Table(Step):
    """Fly a trajectory from a file with its own times: CSV, or a NumPy array (.npy).

    CSV columns: t_s, north_m, east_m, down_m, and optionally yaw_ned_rad; a NumPy array (N, 4 or 5) has the
    same order. Positions are local, or relative to the start of the mission.
    """

    step: Literal["table"] = "table"
    file: Name
    relative: bool = True


class VelocityStep(Step):
    """Fly a velocity for a time, with limited acceleration and jerk."""

    step: Literal["velocity"] = "velocity"
    velocity_ned_m_s: tuple[Finite, Finite, Finite]
    duration_s: Annotated[float, Field(gt=0.0, le=3600.0, allow_inf_nan=False)]
    """Duration, including acceleration and braking."""
    yaw_ned_rad: Angle | None = None


class AttitudeStep(Step):
    """Fly an attitude with thrust for a short time; position and altitude are not controlled."""

    step: Literal["attitude"] = "attitude"
    roll_rad: Annotated[float, Field(ge=-1.5, le=1.5, allow_inf_nan=False)] = 0.0
    pitch_rad: Annotated[float, Field(ge=-1.5, le=1.5, allow_inf_nan=False)] = 0.0
    yaw_ned_rad: Angle | None = None
    thrust: Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
    duration_s: Annotated[float, Field(gt=0.0, le=30.0, allow_inf_nan=False)]


class Gimbal(Step):
    """Set the gimbal direction for the following steps."""

    step: Literal["gimbal"] = "gimbal"
    track: Literal["fixed", "look_at", "along_path", "sweep", "release"]
    pitch_rad: Annotated[float, Field(ge=-3.15, le=3.15, allow_inf_nan=False)] = 0.0
    """Pitch for the tracks fixed and along_path, and the middle pitch of a sweep; up is positive."""
    yaw_rad: Angle = 0.0
    """Yaw relative to the vehicle's nose, for the track fixed, and the middle yaw of a sweep."""
    place: MissionPosition | None = None
    """The position to look at, for look_at."""
    sweep_pitch_rad: Annotated[float, Field(ge=0.0, le=3.15, allow_inf_nan=False)] = 0.0
    """Amplitude of a sweep, to both sides of its middle pitch."""
    sweep_yaw_rad: Annotated[float, Field(ge=0.0, le=3.15, allow_inf_nan=False)] = 0.0
    period_s: Annotated[float, Field(ge=0.5, le=3600.0, allow_inf_nan=False)] = 10.0

    @model_validator(mode="after")
    def _place_given(self) -> Gimbal:
        if (self.place is not None) != (self.track == "look_at"):
            raise ValueError("`place` is required for track look_at, and for no other track")
        return self


class Photo(Step):
    """Take photos while holding the position."""

    step: Literal["photo"] = "photo"
    count: Annotated[int, Field(ge=1, le=10_000)] = 1
    interval_s: Annotated[float, Field(ge=0.1, le=3600.0, allow_inf_nan=False)] = 1.0
    component: Annotated[int, Field(ge=1, le=255)] | None = None
    """MAVLink component id of the camera; None: the connected camera with the lowest id."""


class Condition(Model):
    """True once a value has been above or below a limit for `for_s` seconds."""

    value: Literal[
        "battery_share",
        "wind_speed_m_s",
        "ground_speed_m_s",
        "distance_m",
        "satellites",
        "horizontal_error_m",
    ]
    """`battery_share` is 0 to 1, `distance_m` is the distance sensor's value."""
    above: Finite | None = None
    below: Finite | None = None
    for_s: Seconds = 0.0

    @model_validator(mode="after")
    def _one_bound(self) -> Condition:
        if (self.above is None) == (self.below is None):
            raise ValueError("give one of above and below")
        return self


class Wait(Step):
    """Hold until the pilot continues or a condition is true. After the timeout, the action `on_timeout`
    follows."""

    step: Literal["wait"] = "wait"
    until: Condition | Literal["person"]
    message: Text | None = None
    """The question shown to the pilot."""
    timeout_s: Timeout
    on_timeout: Action = "hold"


class Repeat(Step):
    """Repeat the same steps several times."""

    step: Literal["repeat"] = "repeat"
    times: Annotated[int, Field(ge=1, le=1000)]
    steps: Annotated[tuple[MissionStep, ...], Field(min_length=1, max_length=MAX_STEPS)]


class Branch(Step):
    """Fly `then` if the condition is true when the step starts, otherwise `otherwise`. An unknown value
    counts as false."""

    step: Literal["branch"] = "branch"
    condition: Condition
    then: Annotated[tuple[MissionStep, ...], Field(max_length=MAX_STEPS)]
    otherwise: Annotated[tuple[MissionStep, ...], Field(max_length=MAX_STEPS)] = ()


class Call(Step):
    """Fly the steps of a list from the document's `missions`."""

    step: Literal["call"] = "call"
    mission: Name


class Meet(Step):
    """Hold until every role has reached this meeting; then all roles continue at the same time."""

    step: Literal["meet"] = "meet"
    meeting: Name
    """Name of the meeting. All roles must have the same meetings in the same order."""
    timeout_s: Timeout = 120.0
    """If another role has not arrived within this time, all roles hold and the mission ends."""


MissionStep = Annotated[
    TakeOff | Land | Hold | Fly | Orbit | Helix | Spiral | FigureEight | Table | VelocityStep | AttitudeStep
    | Gimbal | Photo | Wait | Repeat | Branch | Call | Meet,
    Field(discriminator="step"),
]  # fmt: skip
Repeat.model_rebuild()
Branch.model_rebuild()
