"""Models of responses for the OpenAPI description, and the functions that build responses."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields
from functools import partial
from typing import Any, Literal

from fastapi import Response
from msgspec import Raw
from pydantic import BaseModel, ConfigDict, Field, create_model

from gcs_server.api.offboard_models import OffboardModel
from gcs_server.api.reflect import model_of
from gcs_server.api.strict_body import ResponseBody
from gcs_server.control.authority import ControlStatus
from gcs_server.control.journal import JournalEntry
from gcs_server.control.lease import ControlRequest
from gcs_server.links.base import LinkInfo, Recording, SigningReport
from gcs_server.replay.catalogue import RecordingInfo
from gcs_server.replay.marks import ArmedSpan, MessageMark, ModeSpan, VehicleMarks
from gcs_server.replay.service import RecordingIndex, Replay
from gcs_server.telemetry.wire import encode
from gcs_server.vehicle.components import Component
from gcs_server.vehicle.events import Event
from gcs_server.vehicle.fleet import Notice
from gcs_server.vehicle.identity import Identity
from gcs_server.vehicle.mode_cause import ModeCause
from gcs_server.vehicle.reach import Reach
from gcs_server.vehicle.samples import (
    TOPICS,
    BatteryReading,
    DistanceSensor,
    GimbalReading,
    OutputGroup,
    Sample,
)
from gcs_server.vehicle.services.gimbal import Roi
from gcs_server.vehicle.services.gimbal_limits import GimbalLimited
from gcs_server.vehicle.vehicle import Vehicle

SAMPLES_PER_PIECE = 500
"""Number of samples of a history that are encoded in one iteration of the event loop."""


_LIST_FIELDS: dict[str, dict[str, Any]] = {
    "battery": {"batteries": tuple[model_of(BatteryReading), ...]},
    "gimbal": {"gimbals": tuple[model_of(GimbalReading), ...]},
    "motors": {"groups": tuple[model_of(OutputGroup), ...]},
    "distance_sensors": {"sensors": tuple[model_of(DistanceSensor), ...]},
}
TOPIC_MODELS = {name: model_of(kind, **_LIST_FIELDS.get(name, {})) for name, kind in TOPICS.items()}
IdentityModel = model_of(Identity)
ComponentModel = model_of(Component)
ReachModel = model_of(Reach)
StatusModel = TOPIC_MODELS["status"]
RoiModel = model_of(Roi)
GimbalLimitedModel = model_of(GimbalLimited)
GimbalModel = TOPIC_MODELS["gimbal"]
LinkModel = model_of(
    LinkInfo, "Link", recording=model_of(Recording) | None, signing=model_of(SigningReport) | None
)
NoticeModel = model_of(Notice)
JournalEntryModel = model_of(JournalEntry, "JournalEntry")


RecordingModel = model_of(RecordingInfo, "RecordedFlight")
ReplayModel = model_of(Replay)
VehicleMarksModel = model_of(
    VehicleMarks,
    modes=tuple[model_of(ModeSpan), ...],
    armed=tuple[model_of(ArmedSpan), ...],
    messages=tuple[model_of(MessageMark), ...],
)
RecordingIndexModel = model_of(RecordingIndex, vehicles=tuple[VehicleMarksModel, ...])


ControlModel = model_of(
    ControlStatus,
    "Control",
    requests=tuple[model_of(ControlRequest), ...],
    mode_cause=model_of(ModeCause) | None,
)


class ControlView(ControlModel):  # type: ignore[misc,valid-type]
    """State of control of a vehicle, with fields about the caller."""

    yours: bool = Field(description="Whether the caller has control.")
    your_key: str = Field(description="The caller's key.")


class Me(ResponseBody):
    """The caller."""

    name: str
    """Name in the journal and for other clients."""
    key: str
    """Distinguishes clients of the same name; as in `holder_key`."""
    controls: list[str]
    """Vehicles that the caller controls."""


def _sample_model(name: str, topic_model: Any) -> type[BaseModel]:
    return create_model(
        f"{topic_model.__name__}Sample",
        __config__=ConfigDict(frozen=True, extra="forbid", defer_build=True),
        __doc__=f"The newest `{name}` with its time on two clocks.",
        vehicle_time_boot_s=(
            float | None,
            Field(description="The vehicle's boot clock [s]; null if its message has no time."),
        ),
        received_unix_s=(float, Field(description="Time of reception by the server [s since 1970 UTC].")),
        value=(topic_model, Field(description="The sample itself.")),
    )


_topic_fields: dict[str, Any] = {
    name: (_sample_model(name, model) | None, Field(default=None, description=f"Newest `{name}`."))
    for name, model in TOPIC_MODELS.items()
}
TopicsModel = create_model(
    "Topics",
    __config__=ConfigDict(frozen=True, extra="forbid", defer_build=True),
    __doc__="Newest sample of every topic; topics never received are omitted.",
    **_topic_fields,
)
_vehicle_fields: dict[str, Any] = {
    "id": (str, Field(description="Id of the vehicle in the API.")),
    "identity": (IdentityModel, Field(description="Identity of the vehicle.")),
    "components": (
        list[ComponentModel],
        Field(description="Components that have sent a heartbeat, the autopilot first."),
    ),
    "status": (StatusModel, Field(description="State of the vehicle.")),
    "links": (
        list[str],
        Field(description="Names of the links over which the vehicle is connected, most recent first."),
    ),
    "reach": (ReachModel, Field(description="Protocols over which the vehicle is connected.")),
    "topics": (TopicsModel, Field(description="Newest sample of each topic.")),
    "control": (ControlModel | None, Field(description="State of control; null for a replayed vehicle.")),  # type: ignore[operator]
    "offboard": (OffboardModel | None, Field(description="The vehicle's setpoint stream.")),  # type: ignore[operator]
}
VehicleModel = create_model(
    "Vehicle",
    __config__=ConfigDict(frozen=True, extra="forbid", defer_build=True),
    __doc__="The current data of a vehicle.",
    **_vehicle_fields,
)


class HistorySample(ResponseBody):
    """One stored sample."""

    vehicle: str
    """The vehicle's id."""
    topic: str
    """Name of the topic."""
    vehicle_time_boot_s: float | None
    """The vehicle's own boot clock [s]."""
    received_unix_s: float
    """Time of reception by the server [s since 1970 UTC]."""
    value: dict[str, Any]
    """As in `topics` of the vehicle."""


class History(ResponseBody):
    """The samples of the last minutes at up to 4 Hz, oldest first."""

    samples: list[HistorySample]
    """Samples of all requested topics, by time."""


class Message(ResponseBody):
    """One event of a vehicle."""

    index: int
    """Number of the event, increasing for each vehicle; the value for `since`."""
    kind: str
    """status_text, event, mode_changed, armed, disarmed, command, …"""
    vehicle: str | None
    """The vehicle's id."""
    unix_s: float
    """Time of the event at the server [s since 1970 UTC]."""
    severity: int
    """MAV_SEVERITY: 0 emergency … 6 info, 7 debug."""
    text: str
    """Message for the pilot."""
    data: dict[str, Any]
    """Further data, depending on the kind."""


class Messages(ResponseBody):
    """Status texts and events, oldest first."""

    messages: list[Message]
    """At most the last thousand messages."""


class CommandDone(ResponseBody):
    """The result of a command that succeeded: the vehicle's own state shows the change."""

    vehicle: str
    """The vehicle's id."""
    command: str
    """The command."""
    duration_s: float
    """Time from the request until the vehicle's state showed the result [s]."""
    status: StatusModel  # type: ignore[valid-type]
    """State of the vehicle afterwards."""


class GimbalPointed(CommandDone):
    """Result of pointing the gimbal."""

    limited: GimbalLimitedModel | None  # type: ignore[valid-type]
    """Angles at which the gimbal stopped at its own limit; null if it reached the requested angles, is still
    moving after 3 s, or does not report its attitude."""


class GimbalView(ResponseBody):
    """State of the selected gimbal; default: the first gimbal."""

    vehicle: str
    """The vehicle's id."""
    available: bool
    """False: the vehicle has reported no gimbal."""
    in_control: bool
    """Whether this server is in primary control."""
    roi: RoiModel | None  # type: ignore[valid-type]
    """The ROI that this server has set; null: no ROI is set, or it was cleared."""
    gimbal: GimbalModel | None  # type: ignore[valid-type]
    """State, limits, and the component that controls it."""


class Links(ResponseBody):
    """All links."""

    links: list[LinkModel]  # type: ignore[valid-type]
    """All links, sorted by name."""


class MapFile(ResponseBody):
    """An offline map of the operator."""

    name: str
    """The file's name in the maps folder; for a source its name."""
    url: str
    """For PMTiles, the URL of the file, which is read in parts. Otherwise append `/{zoom}/{x}/{y}`."""
    format: Literal["pmtiles", "mbtiles", "source"]
    """Format of the file; `source`: the chosen map source."""
    tiles: Literal["raster", "vector"]
    """Content of the tiles: raster images or vector shapes."""
    min_zoom: int
    """Smallest zoom with tiles."""
    max_zoom: int
    """Largest zoom with tiles."""
    bounds_deg: tuple[float, float, float, float] | None
    """West, south, east, north; null if unknown."""
    attribution: str | None
    """Attribution that its licence requires; may contain HTML."""
    layers: tuple[str, ...]
    """Names of a vector map's layers."""
    bytes: int
    """Size of the file; 0 for a source."""


class Maps(ResponseBody):
    """Offline maps."""

    folder: str
    """Folder for PMTiles and MBTiles files."""
    maps: list[MapFile]
    """The chosen map source, then the files by name; the first is drawn at the bottom."""
    unreadable: list[str]
    """Files in the folder that cannot be shown, each with the reason."""


class Recordings(ResponseBody):
    """Recorded flights, newest first."""

    recordings: list[RecordingModel]  # type: ignore[valid-type]
    """Recordings in the data folder."""


class Replays(ResponseBody):
    """Open replays."""

    replays: list[ReplayModel]  # type: ignore[valid-type]
    """Open replays; may be empty."""


class Journal(ResponseBody):
    """Commands, newest first."""

    entries: list[JournalEntryModel]  # type: ignore[valid-type]
    """At most `limit` entries."""


class Warnings(ResponseBody):
    """Current warnings."""

    warnings: list[NoticeModel]  # type: ignore[valid-type]
    """Current warnings; may be empty."""


class ServerHealth(ResponseBody):
    """Health of the running server."""

    status: str
    """Always `ok`: a server with a problem does not answer."""
    uptime_s: float
    """Time since the server's start [s]."""
    vehicles: int
    """Number of known vehicles."""


class Version(ResponseBody):
    """Version and features of the server."""

    name: str
    """Name of the program."""
    version: str
    """Version of the program."""
    schema_version: int
    """Version of the telemetry format; a page with another version cannot read it."""
    simulator: bool
    """Whether this server started or found a simulated vehicle."""
    scene: bool
    """Whether there is a 3D view at /scene/."""
    recording: bool
    """Whether links are recorded; details are in /links."""


class SimulatorInstance(ResponseBody):
    """A real PX4 in simulation."""

    instance: int
    """Number of the instance; its vehicle has the system id instance + 1."""
    system_id: int
    """MAVLink system id."""
    state: Literal["starting", "running", "crashed", "ended"]
    """`crashed`: it is started again; `ended`: it was shut down."""
    restarts: int
    """How often it has ended by itself."""
    problem: str | None
    """Why it does not run, or that it was started again."""
    console: str
    """The last 16 kB that it printed."""


class Simulator(ResponseBody):
    """The simulated vehicles that this server runs."""

    kind: Literal["bundled", "px4"] | None
    """`bundled`: the own simulator; `px4`: real PX4s; null: none."""
    source: str | None = None
    """Where PX4 comes from: a build, an installed package, or a container image."""
    agent: str | None = None
    """State of the DDS agent."""
    instances: list[SimulatorInstance]
    """The real PX4s; empty for the own simulator."""


def json_response(value: object, status_code: int = 200) -> Response:
    """A JSON response; NaN and infinity become null."""
    return Response(encode(value), status_code=status_code, media_type="application/json")


def json_bytes(body: bytes, status_code: int = 200) -> Response:
    """A response that is JSON already, such as the answer of a task."""
    return Response(body, status_code=status_code, media_type="application/json")


def fields_of(value: Any) -> dict[str, object]:
    """Fields of a dataclass by name, not converted."""
    return {field.name: getattr(value, field.name) for field in fields(value)}


def sample_view(sample: Sample) -> dict[str, object]:
    """One sample, as in a vehicle's `topics`."""
    return {
        "vehicle_time_boot_s": sample.vehicle_time_boot_s,
        "received_unix_s": sample.received_unix_s,
        "value": sample.value,
    }


def vehicle_view(vehicle: Vehicle) -> dict[str, object]:
    """A vehicle with all its data. Data that cannot be encoded are omitted, or null if the field is
    required."""

    def part(name: str, make: Callable[[], object | None]) -> Raw | None:
        def encoded() -> Raw | None:
            value = make()
            return None if value is None else Raw(encode(value))

        return vehicle.isolation.run(f"the view of {name}", encoded)

    def newest(name: str) -> dict[str, object] | None:
        sample = vehicle.topic(name)
        return None if sample is None else sample_view(sample)

    topics = {name: part(name, partial(newest, name)) for name in TOPICS}
    is_replayed = vehicle.identity.replayed
    return {
        "id": vehicle.id,
        "identity": vehicle.identity,
        "components": vehicle.components.all(),
        "status": vehicle.status,
        "links": vehicle.links,
        "reach": vehicle.reach,
        "topics": {name: sample for name, sample in topics.items() if sample is not None},
        "control": None if is_replayed or not vehicle.control else part("control", vehicle.control.status),
        "offboard": part("offboard", vehicle.offboard.status) if vehicle.offboard is not None else None,
    }


def history_pieces(vehicle: Vehicle, samples: Sequence[Sample]) -> Iterator[bytes]:
    """Samples of the history as JSON, SAMPLES_PER_PIECE at a time; a sample that cannot be encoded is
    omitted."""
    run = vehicle.isolation.run

    def history_sample(sample: Sample) -> dict[str, object]:
        return {"vehicle": vehicle.id, "topic": sample.topic, **sample_view(sample)}

    def encode_samples(part: Sequence[Sample]) -> bytes:
        return encode([history_sample(sample) for sample in part])[1:-1]

    for start in range(0, len(samples), SAMPLES_PER_PIECE):
        part = samples[start : start + SAMPLES_PER_PIECE]
        piece = run("the history", encode_samples, part)
        if piece is None:
            encoded_samples = (
                run(f"the history of {sample.topic}", encode_samples, [sample]) for sample in part
            )
            piece = b",".join(encoded for encoded in encoded_samples if encoded)
        if piece:
            yield piece


def history_view(pieces: Sequence[bytes]) -> dict[str, object]:
    """Joins the pieces of a history."""
    return {"samples": Raw(b"[" + b",".join(pieces) + b"]")}


def message_view(event: Event) -> dict[str, object]:
    """One message as JSON."""
    return {
        "index": event.index,
        "kind": event.kind,
        "vehicle": event.vehicle,
        "unix_s": event.unix_s,
        "severity": event.severity,
        "text": event.text,
        "data": dict(event.data),
    }
