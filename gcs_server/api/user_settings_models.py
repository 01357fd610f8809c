"""The page's settings of a user: each value may be missing, which is the page's default."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationError

from gcs_server.api.strict_body import ResponseBody, StrictBody, example
from gcs_server.errors import InvalidRequest
from gcs_server.storage.user_settings import KIND, VERSION

Speed = Literal["m/s", "km/h", "mph", "kn"]
ShortName = Annotated[str, Field(min_length=1, max_length=64)]
PlottedField = Annotated[str, Field(min_length=1, max_length=600)]
ParamName = Annotated[str, Field(pattern="^[A-Za-z0-9_]{1,16}$")]


class Units(StrictBody):
    """The unit of each quantity on the page. Requests and answers of the API are always in SI units."""

    height: Literal["m", "ft"] | None = None
    """Heights, altitudes, and other lengths of a vehicle's surroundings."""
    distance: Literal["m", "ft", "nmi"] | None = None
    """Distances over ground: m and km, ft and mi, or nmi."""
    speed: Speed | None = None
    """Speed over ground and of the wind."""
    vertical_speed: Literal["m/s", "ft/min"] | None = None
    """Climb and descent."""


class Voice(StrictBody):
    """What the page says aloud."""

    on: bool | None = None
    """Whether it speaks; default: no."""
    mode: bool | None = None
    """Changes of mode, arming and connection."""
    battery: bool | None = None
    """The charge as it falls."""
    distance: bool | None = None
    """Distance from home on the way out."""
    warnings: bool | None = None
    """Warnings and errors, also failsafes."""
    tone: bool | None = None
    """A tone with warnings and errors, also without a voice; default: no."""


class DefaultAltitudes(StrictBody):
    """Altitudes above home that the page's forms begin with [m]."""

    takeoff_m: float | None = Field(default=None, ge=1, le=120)
    """Of a take-off [m]; default: 10."""
    go_m: float | None = Field(default=None, ge=1, le=1000)
    """Of a flight to a position [m]; default: the present one, or that of a take-off on the ground."""
    plan_m: float | None = Field(default=None, ge=1, le=1000)
    """Of new items in a plan [m]; default: 30."""


class GamepadAxis(StrictBody):
    """The axis of a gamepad that a stick of the vehicle or its gimbal follows."""

    axis: int | None = Field(default=None, ge=0, le=31)
    """Number of the axis as the browser counts; null: none."""
    reverse: bool | None = None
    """Whether it is reversed: most gamepads count down as positive."""


class GamepadButton(StrictBody):
    """What a button of a gamepad does."""

    button: int = Field(ge=0, le=63)
    """Number of the button as the browser counts."""
    action: Literal["hold", "stop", "go_on", "land", "arm"]
    """`hold`: Hold; `stop`: ends flying by stick; `go_on`: goes on when interrupted; `land`, `arm`: opens
    the page's confirmation."""


class Gamepad(StrictBody):
    """How the page uses a gamepad for flying by stick; missing axes are those of mode 2."""

    pitch: GamepadAxis | None = None
    """Stick that pitches: forward is down."""
    roll: GamepadAxis | None = None
    """Stick that rolls."""
    throttle: GamepadAxis | None = None
    """Stick of the throttle: up climbs."""
    yaw: GamepadAxis | None = None
    """Stick that turns the nose."""
    gimbal_pitch: GamepadAxis | None = None
    """Axis that turns the gimbal up and down."""
    gimbal_yaw: GamepadAxis | None = None
    """Axis that turns the gimbal to the sides."""
    dead_zone: float | None = Field(default=None, ge=0, le=0.5)
    """Deflection without effect, as a part of the whole; default: 0.05."""
    expo: float | None = Field(default=None, ge=0, le=1)
    """0: linear, 1: fine near the middle; default: 0, as PX4 has its own."""
    gimbal_rate_deg_s: float | None = Field(default=None, ge=1, le=90)
    """The gimbal's rate at full deflection; default: 30."""
    buttons: Annotated[tuple[GamepadButton, ...], Field(max_length=32)] | None = None
    """Default: button 1 holds."""


class PlotPane(StrictBody):
    """A pane of plots."""

    fields: Annotated[tuple[PlottedField, ...], Field(max_length=8)]
    """Its fields and expressions, as in a request of values."""
    right_axis: Annotated[tuple[PlottedField, ...], Field(max_length=8)] | None = None
    """Those with the axis at the right; null: those whose unit is not that of the first."""
    spectrum: bool = False
    """Whether it shows frequencies, not times."""


def _pane(value: object) -> object:
    """A pane as earlier versions kept it: the list of its fields."""
    return {"fields": value} if isinstance(value, list | tuple) else value


class PlotLayout(StrictBody):
    """Panes of plots that a person has saved, for logs and for vehicles that fly."""

    name: ShortName
    """Its name."""
    panes: Annotated[tuple[Annotated[PlotPane, BeforeValidator(_pane)], ...], Field(max_length=8)]
    """Its panes."""
    window_s: float | None = Field(default=None, gt=0, le=1e7)
    """Length of the window of time [s]; null: the whole flight, and in flight the present one."""


class UserSettingValues(StrictBody):
    """What a user has set. Missing or null: the page's default."""

    model_config = example(theme="dark", units={"height": "ft"}, default_altitudes={"takeoff_m": 20})

    theme: Literal["system", "light", "dark"] | None = None
    """Colours of the page; `system`: those of the computer."""
    language: Annotated[str, Field(pattern="^[a-z]{2}$")] | None = None
    """Language of the page (ISO 639); default: the browser's."""
    units: Units | None = None
    """Units of the page."""
    voice: Voice | None = None
    """What the page says aloud."""
    default_altitudes: DefaultAltitudes | None = None
    """Altitudes that forms begin with."""
    single_keys: bool | None = None
    """Whether single keys act; default: yes."""
    values: Annotated[tuple[ShortName, ...], Field(max_length=18)] | None = None
    """The values beside the map, in their order."""
    param_favourites: Annotated[tuple[ParamName, ...], Field(max_length=200)] | None = None
    """Names of the parameters that are marked."""
    gamepad: Gamepad | None = None
    """Axes and buttons of a gamepad."""
    plot_layouts: Annotated[tuple[PlotLayout, ...], Field(max_length=40)] | None = None
    """Saved panes of plots."""
    profile_folded: bool | None = None
    """Whether the altitude profile of a plan is folded."""


class UserSettingsFile(StrictBody):
    """The settings of a user as a file."""

    model_config = example(kind=KIND, version=VERSION, settings={"theme": "dark"})

    kind: str = Field(max_length=40)
    """`gcs-settings`."""
    version: int = Field(ge=1, le=1_000_000)
    """Version of the values; a file of an older version is brought up to date."""
    user: str | None = Field(default=None, max_length=100)
    """Whose settings they were; ignored."""
    settings: dict[str, Any]
    """The values, as `POST /settings` takes them."""


class UserSettingsView(ResponseBody):
    """The settings of a user; also the content of an exported file."""

    kind: str
    """`gcs-settings`."""
    version: int
    """Version of the values."""
    user: str
    """The user; empty: all who have given no name."""
    settings: UserSettingValues
    """The values that were set; all others are the page's defaults."""


def checked_settings(settings: Mapping[str, object]) -> dict[str, object]:
    """The settings with their types and bounds checked, without missing values.

    Raises:
        InvalidRequest: names the first wrong value.
    """
    try:
        values = UserSettingValues.model_validate(settings)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(["settings", *(str(part) for part in first["loc"])])
        raise InvalidRequest(place, f"{place}: {first['msg']}.") from None
    return values.model_dump(mode="json", exclude_none=True)
