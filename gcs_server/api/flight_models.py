"""Bodies and answers of the routes of flights."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from gcs_server.api.offboard_mission_models import FlownMissionModel
from gcs_server.api.reflect import model_of
from gcs_server.api.strict_body import ResponseBody, StrictBody, example
from gcs_server.logbook.beside_plan import BesidePlan, Excursion
from gcs_server.logbook.logged_flights import LoggedFlight
from gcs_server.logbook.uploads import MAX_BYTES


class NewUpload(StrictBody):
    """A log that is added."""

    model_config = example(name="2026-11-21-flight.ulg", bytes=3_400_000)

    name: Annotated[str, Field(min_length=1, max_length=255)]
    """Name of the file; its end says the kind of the log."""
    bytes: Annotated[int, Field(ge=1, le=MAX_BYTES)]
    """Size of the file."""


class UploadView(ResponseBody):
    """A log of which parts have been received."""

    id: str
    """Id of the upload."""
    received_bytes: int
    """Position of the next part."""
    part_bytes: int
    """Maximum size of a part."""
    flight: str | None
    """Id of the flight; null until the log is complete."""


class FlightFile(ResponseBody):
    """A recording or a log."""

    id: str
    """Id of the file."""
    name: str
    """Name of the file."""
    source: Literal["recording", "vehicle", "file"]
    """Recorded by the server, downloaded from a vehicle, or added by a person."""
    kind: Literal["ulog", "tlog", "mcap"]
    """Kind of the log."""
    bytes: int
    """Size."""
    added_unix_s: float
    """When the server first found the file [s since 1970 UTC]."""
    start_unix_s: float | None
    """Start of the log [s since 1970 UTC]; null: not known, or not read yet."""
    duration_s: float | None
    """Duration [s]; null: not read yet."""
    vehicles: list[str]
    """System ids of the vehicles, as far as they are known."""
    firmware: str | None
    """The vehicle's firmware; null: not known, or not read yet."""
    problem: str | None
    """What of the file is damaged, or why it cannot be read; null: nothing is known to be wrong."""
    running: bool
    """Whether it is still being recorded or streamed."""
    read: bool
    """Whether the log has been read in its present version."""


FlightInLog = model_of(LoggedFlight)
ExcursionModel = model_of(Excursion)
BesidePlanModel = model_of(
    BesidePlan,
    far_from_path=tuple[ExcursionModel, ...],
    outside_corridor=tuple[ExcursionModel, ...],
)


class FlightPart(ResponseBody):
    """What one log, or the server's own notes, know of a flight."""

    id: str
    """Id of the part."""
    file: str | None
    """Id of the log; null: notes of this server."""
    source: Literal["recording", "vehicle", "file", "notes"]
    """Recorded by the server, downloaded from the vehicle, added by a person, or noted by this server."""
    offset_s: float
    """What is added to times of this log to get those of the main one [s]."""
    begin_s: float
    """Arming [s since the log's start]."""
    end_s: float
    """Disarming, or the log's end."""
    why: str | None
    """Why the part belongs to the flight; null for the only part."""


class UnsurePart(ResponseBody):
    """A part of another flight that could belong to this one, but not surely; a person may join it."""

    part: str
    """Id of the part."""
    why: str
    """Why it was not joined."""


class JoinedFlight(ResponseBody):
    """One flight of one vehicle, from arming to disarming."""

    id: str
    """Id; the ids of all its parts are accepted."""
    name: str | None
    """Name that a person has given; null: none."""
    vehicle: str
    """MAVLink system id; empty: not known."""
    start_unix_s: float | None
    """Arming [s since 1970 UTC]; null: not known."""
    duration_s: float
    """Time armed [s]."""
    distance_m: float | None
    """Length of the flown path over ground; null: not known."""
    height_m: float | None
    """Greatest height above the place of arming; null: not known."""
    modes: list[str]
    """Modes in the order in which they were first flown."""
    failsafes: int
    """Number of times in which the vehicle was in a failsafe."""
    ended: Literal["landed", "disarmed", "disarmed_in_air", "log_ends"]
    """How it ended: disarmed on the ground, disarmed (not known where), disarmed in the air, or not known
    because all logs end before."""
    plan: str | None
    """Name of the flown plan or program; null: none, or it has no name."""
    parts: list[FlightPart]
    """The main one, on whose time the others are shown, first."""
    unsure: list[UnsurePart]
    """What could belong to the flight as well."""


class FlightName(StrictBody):
    """A name for a flight."""

    model_config = example(name="Bridge survey, second try")

    name: Annotated[str, Field(max_length=100)]
    """The name; empty takes it away."""


class PartDecision(StrictBody):
    """Joins a part of another flight to a flight, or separates one of its parts."""

    model_config = example(part="0123456789abcdef-0", joined=False)

    part: Annotated[str, Field(min_length=1, max_length=60)]
    """Id of the part."""
    joined: bool
    """True joins it, with its whole flight; false separates it."""


class FlightCommand(ResponseBody):
    """A command to the vehicle, as in the journal."""

    t_s: float
    """Time on the main log [s]."""
    unix_s: float
    """Time [s since 1970 UTC]."""
    client: str
    """Who gave it."""
    command: str
    """The command."""
    result: str
    """`ok`, or the code of the error."""
    detail: str | None
    """Text of the error; null: none."""


class FlownPlan(ResponseBody):
    """The plan or program that was flown."""

    kind: Literal["waypoint_plan", "offboard_mission"]
    """Its kind."""
    name: str | None
    """Its name; null: it has none, or is not stored."""
    id: str | None
    """Id of the stored plan; null: not stored on this server."""
    version: int | None
    """Its version; null: not stored."""
    dry_run: str | None
    """Id of the dry run with which the flight was compared; null: none."""
    begin_s: float
    """Time on the main log of the comparison's start [s]."""
    flown: FlownMissionModel | None  # type: ignore[valid-type]
    """The flight compared with its plan; null: it was not compared."""
    compared: BesidePlanModel | None  # type: ignore[valid-type]
    """Figures of the comparison, and of that with the dry run; null: it was not compared."""


class LogFinding(ResponseBody):
    """One thing that a log shows."""

    kind: str
    """Its kind, such as `vibration` or `failsafe`."""
    title: str
    """The kind in words."""
    vehicle: str
    """MAVLink system id; empty: not known."""
    severity: Literal["warning", "caution"]
    """warning: it endangered the flight; caution: look at it before the next one."""
    begin_s: float
    """Begin [s since the log's start]."""
    end_s: float
    """End."""
    text: str
    """What happened."""
    limit: str
    """What would be normal, and who says so."""
    remedy: str
    """What to do."""
    panes: list[list[str]]
    """Fields and expressions that show it, for each pane of plots."""


class FlightRecord(ResponseBody):
    """A flight with what this server noted of it."""

    flight: JoinedFlight
    """The flight."""
    plan: FlownPlan | None
    """The plan or program that was flown; null: none that this server knows."""
    findings: list[LogFinding]
    """What of the comparison with plan and dry run is a finding; times are those of the main log."""
    commands: list[FlightCommand]
    """Commands to its vehicle from two minutes before arming, oldest first; those of other vehicles are left
    out."""
    parameters: list[LogParameter]
    """Parameters that the server knew at arming, by name."""


class RemovedFlight(ResponseBody):
    """A file that was deleted to make room."""

    name: str
    """Name of the file."""
    bytes: int
    """Size."""
    unix_s: float
    """Time of the removal [s since 1970 UTC]."""


class FlightList(ResponseBody):
    """All flights, and all files of flights."""

    flights: list[JoinedFlight]
    """The newest first."""
    files: list[FlightFile]
    """Recordings and logs, the newest first; also those without a flight."""
    total_bytes: int
    """Size of all files."""
    max_bytes: int
    """Limit of this size (`--flights-gb`); then the oldest are deleted."""
    removed: list[RemovedFlight]
    """The last files that were deleted to make room, the newest removal first."""


class LogField(ResponseBody):
    """A field of a topic."""

    name: str
    """Name, such as `q[0]`."""
    unit: str | None
    """Unit; null: not known."""
    type: str
    """Type of the values, as NumPy names it."""


class LogTopic(ResponseBody):
    """A topic of a log, or a message of one sender."""

    id: str
    """Name and instance, as in the field of a series: `vehicle_attitude:0`, `ATTITUDE:1.1`."""
    name: str
    """Name of the topic or message."""
    instance: str
    """ULog: number of the instance; tlog: `system.component`, with the message's own instance as third."""
    samples: int
    """Number of samples."""
    begin_s: float
    """Time of the first sample [s since the log's start]."""
    end_s: float
    """Time of the last sample."""
    rate_hz: float | None
    """Mean rate; null: one sample."""
    fields: list[LogField]
    """The fields."""


class LogSpan(ResponseBody):
    """A time in which the vehicle was in one state."""

    begin_s: float
    """Begin [s since the log's start]."""
    end_s: float
    """End."""
    name: str
    """The mode, `Armed` or `Failsafe`."""


class LogVehicle(ResponseBody):
    """What a vehicle of the log was doing."""

    id: str
    """MAVLink system id; empty: not known."""
    uid: str | None
    """Hexadecimal uid of the autopilot; null: not known."""
    modes: list[LogSpan]
    """Flight modes."""
    armed: list[LogSpan]
    """When it was armed."""
    failsafe: list[LogSpan]
    """When it was in a failsafe."""


class LogParameter(ResponseBody):
    """A parameter."""

    name: str
    """Name."""
    value: float
    """Its first known value."""


class LogParameterChange(ResponseBody):
    """A change of a parameter."""

    t_s: float
    """Time [s since the log's start]."""
    name: str
    """Name."""
    value: float
    """The new value."""


class LogMessage(ResponseBody):
    """A text that the vehicle has logged or sent."""

    t_s: float
    """Time [s since the log's start]."""
    severity: int
    """MAV_SEVERITY: 0 emergency to 7 debug."""
    text: str
    """The text."""


class LogDropout(ResponseBody):
    """A gap in which the vehicle could not write its log."""

    t_s: float
    """Time [s since the log's start]."""
    duration_s: float
    """Duration [s]."""


class FlightOverview(ResponseBody):
    """What a log has."""

    kind: Literal["ulog", "tlog", "mcap"]
    """Kind of the log; of an MCAP file that this program has written, that of the log in it."""
    start_unix_s: float | None
    """Start [s since 1970 UTC]; null: the vehicle did not know the time."""
    duration_s: float
    """Duration [s]."""
    firmware: str | None
    """The vehicle's firmware; null: not known."""
    hardware: str | None
    """The vehicle's board; null: not known."""
    vehicles: list[LogVehicle]
    """The vehicles of the log."""
    flights: list[FlightInLog]  # type: ignore[valid-type]
    """The flights in the log, oldest first."""
    topics: list[LogTopic]
    """Topics with their fields, by name."""
    parameters: list[LogParameter]
    """Parameters at the start, by name."""
    parameter_changes: list[LogParameterChange]
    """Later changes."""
    messages: list[LogMessage]
    """Messages, oldest first."""
    messages_left_out: int
    """Messages left out because there are too many; the least severe."""
    dropouts: list[LogDropout]
    """Gaps in the log."""
    problems: list[str]
    """What of the log is damaged or left out, as sentences."""


class LogSeries(ResponseBody):
    """Values of a field or expression."""

    field: str
    """The field or expression."""
    unit: str | None
    """Unit; null: not known."""
    samples: int
    """Number of samples in the window, before they were reduced."""
    t_s: list[float]
    """Times [s since the log's start], ascending."""
    values: list[float | None]
    """The values; null: not a number, or infinite."""


class FlightSeries(ResponseBody):
    """Values for a plot."""

    series: list[LogSeries]
    """In the order of the request."""


class FlightSpectrum(ResponseBody):
    """Which frequencies a value has, and when: segments with a Hann window that overlap by half, without
    their means, averaged by Welch's method."""

    field: str
    """The field or expression."""
    unit: str | None
    """Unit of `density`, one-sided: its sum times the resolution is the variance; null: not known."""
    rate_hz: float
    """Rate of the samples [Hz]; values are interpolated at it."""
    segment_s: float
    """Length of a segment [s]; the resolution is its inverse."""
    segments: int
    """Number of segments."""
    gaps: int
    """Gaps in the samples; no segment reaches over one."""
    irregular: float
    """Part of the steps between samples that differ by more than a fifth from the usual one: the highest
    frequencies are then too weak."""
    frequencies_hz: list[float]
    """From 0 to half the rate."""
    density: list[float]
    """Power spectral density at each frequency."""
    t_s: list[float]
    """Middle of each column of the spectrogram [s since the log's start]."""
    decibels: list[list[int]]
    """Spectrogram: for each of these times 10·log10 of the density at each frequency."""


class TableColumn(ResponseBody):
    """A column of a table."""

    name: str
    """Name of the field."""
    unit: str | None
    """Unit; null: not known."""
    type: str
    """Type of the values, as NumPy names it."""


class FlightTable(ResponseBody):
    """Some rows of a topic."""

    topic: str
    """Id of the topic."""
    samples: int
    """Number of all its rows."""
    from_row: int
    """Number of the first row of `rows`; the topic's first is 0."""
    columns: list[TableColumn]
    """The fields."""
    t_s: list[float]
    """Time of each row [s since the log's start]."""
    rows: list[list[float | int | str | bool | None]]
    """Values of each row; null: not a number, or infinite."""


class NotJudged(ResponseBody):
    """A kind of finding for which a log has no values."""

    kind: str
    """The kind."""
    title: str
    """The kind in words."""
    vehicle: str
    """MAVLink system id; empty: not known."""
    reason: str
    """What is missing."""


class FlightFindings(ResponseBody):
    """What a log means."""

    findings: list[LogFinding]
    """The first in time first; at most 20 of each kind."""
    not_judged: list[NotJudged]
    """What could not be judged."""
