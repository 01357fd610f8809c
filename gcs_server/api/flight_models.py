"""Bodies and answers of the routes of flights."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from gcs_server.api.strict_body import ResponseBody, StrictBody, example
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
    kind: Literal["ulog", "tlog"]
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
    """Whether it is still being recorded."""
    read: bool
    """Whether the log has been read in its present version."""


class RemovedFlight(ResponseBody):
    """A file that was deleted to make room."""

    name: str
    """Name of the file."""
    bytes: int
    """Size."""
    unix_s: float
    """Time of the removal [s since 1970 UTC]."""


class FlightList(ResponseBody):
    """All files of flights."""

    flights: list[FlightFile]
    """The newest first."""
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

    kind: Literal["ulog", "tlog"]
    """Kind of the log."""
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
