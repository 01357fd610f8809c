"""The steps of an offboard mission, one class each; `step` tells them apart.

Names, units and frames are those of `missions.setpoints`: metres, seconds, radians, NED.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from missions.offboard.places import Place
from missions.values import Model

Finite = Annotated[float, Field(allow_inf_nan=False)]
Seconds = Annotated[float, Field(ge=0.0, le=86_400.0, allow_inf_nan=False)]
Timeout = Annotated[float, Field(gt=0.0, le=86_400.0, allow_inf_nan=False)]
Speed = Annotated[float, Field(gt=0.0, le=100.0, allow_inf_nan=False)]
Angle = Annotated[float, Field(ge=-1000.0, le=1000.0, allow_inf_nan=False)]
Metres = Annotated[float, Field(gt=0.0, le=10_000.0, allow_inf_nan=False)]
Climb = Annotated[float, Field(ge=-10_000.0, le=10_000.0, allow_inf_nan=False)]
Rounds = Annotated[float, Field(ge=0.01, le=200.0, allow_inf_nan=False)]
Text = Annotated[str, Field(max_length=200)]
Name = Annotated[str, Field(min_length=1, max_length=100)]
MAX_STEPS = 1000
"""Most steps in one list."""

Action = Literal["continue", "hold", "return", "land"]
"""The runner's action: continue, hold here, return to launch, land here."""


class Step(Model):
    """Fields of all steps."""

    name: Text | None = None
    """Shown to people."""


class TakeOff(Step):
    """Arm and climb; the mission goes on at that height."""

    step: Literal["take_off"] = "take_off"
    height_m: Annotated[float, Field(ge=0.5, le=500.0, allow_inf_nan=False)]
    """Above the take-off position."""
    timeout_s: Timeout = 60.0


class Land(Step):
    """Land here and disarm."""

    step: Literal["land"] = "land"
    timeout_s: Timeout = 300.0


class Hold(Step):
    """Hold the position."""

    step: Literal["hold"] = "hold"
    duration_s: Seconds
    yaw_ned_rad: Angle | None = None
    """Heading to turn to first; None keeps the present one."""


class PathStep(Step):
    """Fields of all steps along a path: speed, heading, pictures on the way.

    The heading is a yaw, along the path, towards a place, or else the one before the step.
    """

    speed_m_s: Speed | None = None
    """Highest speed over the ground; None: MPC_XY_CRUISE."""
    heading: Literal["keep", "along_path"] = "keep"
    yaw_ned_rad: Angle | None = None
    look_at: Place | None = None
    photo_every_m: Metres | None = None
    avoidance: bool | None = None
    """Lead the vehicle past obstacles that its sensors measure; None: as the mission says."""

    @model_validator(mode="after")
    def _one_heading(self) -> PathStep:
        said = [self.heading != "keep", self.yaw_ned_rad is not None, self.look_at is not None]
        if sum(said) > 1:
            raise ValueError("give one of heading, yaw_ned_rad and look_at")
        return self


class FlyPoint(Place):
    """A point to fly through."""

    yaw_ned_rad: Angle | None = None
    """Heading at the point; between two such points the vehicle turns evenly."""
    stop: bool = False
    hold_s: Seconds = 0.0
    """Time to wait at the point; the vehicle stops there."""
    corner_m: Annotated[float, Field(ge=0.0, le=1000.0, allow_inf_nan=False)] = 1.0
    """Greatest distance from the point at which a bend between straight legs may pass."""


class Fly(PathStep):
    """Fly through points: on straight legs with bends, or exactly through them on a smooth curve."""

    step: Literal["fly"] = "fly"
    points: Annotated[tuple[FlyPoint, ...], Field(min_length=1, max_length=5000)]
    curve: Literal["straight", "smooth"] = "straight"

    @model_validator(mode="after")
    def _one_yaw(self) -> Fly:
        named = any(point.yaw_ned_rad is not None for point in self.points)
        if named and (self.heading != "keep" or self.yaw_ned_rad is not None or self.look_at is not None):
            raise ValueError("give yaws at points, or a heading for the step")
        return self


class Orbit(PathStep):
    """Circles around a place, at its height."""

    step: Literal["orbit"] = "orbit"
    center: Place
    radius_m: Metres
    turns: Rounds = 1.0
    clockwise: bool = True
    start_angle_ned_rad: Angle | None = None
    """Bearing of the start from the centre; None: the nearest point."""


class Helix(Orbit):
    """Circles around a place while climbing; negative `climb_m` descends."""

    step: Literal["helix"] = "helix"  # type: ignore[assignment]
    climb_m: Climb


class Spiral(Orbit):
    """Circles that widen or narrow to `end_radius_m`."""

    step: Literal["spiral"] = "spiral"  # type: ignore[assignment]
    end_radius_m: Metres
    climb_m: Climb = 0.0


class FigureEight(PathStep):
    """A figure-eight through its centre."""

    step: Literal["figure_eight"] = "figure_eight"
    center: Place
    length_m: Metres
    """Length of the figure from tip to tip."""
    width_m: Metres
    """Width of each loop."""
    rounds: Rounds = 1.0
    axis_ned_rad: Angle = 0.0
    """Direction of its length, clockwise from north."""


class Table(Step):
    """A trajectory from a file, flown at its own times: CSV, or a NumPy array (.npy).

    CSV columns: t_s, north_m, east_m, down_m, and yaw_ned_rad where wanted; a NumPy array (N, 4 or 5) has the
    same order. Positions are local, or relative to the start of the mission.
    """

    step: Literal["table"] = "table"
    file: Name
    relative: bool = True


class VelocityStep(Step):
    """A velocity for a time, reached and left within acceleration and jerk."""

    step: Literal["velocity"] = "velocity"
    velocity_ned_m_s: tuple[Finite, Finite, Finite]
    duration_s: Annotated[float, Field(gt=0.0, le=3600.0, allow_inf_nan=False)]
    """Duration, changes of speed included."""
    yaw_ned_rad: Angle | None = None


class AttitudeStep(Step):
    """An attitude with thrust for a short time: position and altitude are not held meanwhile."""

    step: Literal["attitude"] = "attitude"
    roll_rad: Annotated[float, Field(ge=-1.5, le=1.5, allow_inf_nan=False)] = 0.0
    pitch_rad: Annotated[float, Field(ge=-1.5, le=1.5, allow_inf_nan=False)] = 0.0
    yaw_ned_rad: Angle | None = None
    thrust: Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
    duration_s: Annotated[float, Field(gt=0.0, le=30.0, allow_inf_nan=False)]


class Gimbal(Step):
    """How the gimbal points from here on, while other steps are flown."""

    step: Literal["gimbal"] = "gimbal"
    track: Literal["fixed", "look_at", "along_path", "sweep", "release"]
    pitch_rad: Annotated[float, Field(ge=-3.15, le=3.15, allow_inf_nan=False)] = 0.0
    """For fixed, along_path and the middle of a sweep; up is positive."""
    yaw_rad: Angle = 0.0
    """For fixed and the middle of a sweep, relative to the vehicle's nose."""
    place: Place | None = None
    """The place to look at, for look_at."""
    sweep_pitch_rad: Annotated[float, Field(ge=0.0, le=3.15, allow_inf_nan=False)] = 0.0
    """Half width of a sweep, to both sides of its middle."""
    sweep_yaw_rad: Annotated[float, Field(ge=0.0, le=3.15, allow_inf_nan=False)] = 0.0
    period_s: Annotated[float, Field(ge=0.5, le=3600.0, allow_inf_nan=False)] = 10.0

    @model_validator(mode="after")
    def _place_given(self) -> Gimbal:
        if (self.place is not None) != (self.track == "look_at"):
            raise ValueError("give a place with track look_at, and only there")
        return self


class Photo(Step):
    """Take pictures while holding."""

    step: Literal["photo"] = "photo"
    count: Annotated[int, Field(ge=1, le=10_000)] = 1
    interval_s: Annotated[float, Field(ge=0.1, le=3600.0, allow_inf_nan=False)] = 1.0


class Condition(Model):
    """A value that is above or below a bound, and stays so for a time."""

    value: Literal[
        "battery_share",
        "wind_speed_m_s",
        "ground_speed_m_s",
        "distance_m",
        "satellites",
        "horizontal_error_m",
    ]
    """`battery_share` is 0 to 1, `distance_m` the distance sensor's."""
    above: Finite | None = None
    below: Finite | None = None
    for_s: Seconds = 0.0

    @model_validator(mode="after")
    def _one_bound(self) -> Condition:
        if (self.above is None) == (self.below is None):
            raise ValueError("give one of above and below")
        return self


class Wait(Step):
    """Hold until a person goes on, or until a condition; at the timeout do `on_timeout`."""

    step: Literal["wait"] = "wait"
    until: Condition | Literal["person"]
    message: Text | None = None
    """The question shown to the person."""
    timeout_s: Timeout
    on_timeout: Action = "hold"


class Repeat(Step):
    """The same steps several times."""

    step: Literal["repeat"] = "repeat"
    times: Annotated[int, Field(ge=1, le=1000)]
    steps: Annotated[tuple[MissionStep, ...], Field(min_length=1, max_length=MAX_STEPS)]


class Branch(Step):
    """One list of steps or another, decided when it is reached; an unknown value counts as false."""

    step: Literal["branch"] = "branch"
    condition: Condition
    then: Annotated[tuple[MissionStep, ...], Field(max_length=MAX_STEPS)]
    otherwise: Annotated[tuple[MissionStep, ...], Field(max_length=MAX_STEPS)] = ()


class Call(Step):
    """The steps of another mission of the document's `missions`."""

    step: Literal["call"] = "call"
    mission: Name


class Meet(Step):
    """Hold until every role of the mission has come to this meeting; then all go on at one moment."""

    step: Literal["meet"] = "meet"
    meeting: Name
    """All roles have the same meetings, in the same order."""
    timeout_s: Timeout = 120.0
    """Without the others after so long, all hold and the mission is over."""


MissionStep = Annotated[
    TakeOff | Land | Hold | Fly | Orbit | Helix | Spiral | FigureEight | Table | VelocityStep | AttitudeStep
    | Gimbal | Photo | Wait | Repeat | Branch | Call | Meet,
    Field(discriminator="step"),
]  # fmt: skip
Repeat.model_rebuild()
Branch.model_rebuild()
