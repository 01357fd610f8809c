"""Routes that change several parameters of a vehicle: review, write as reviewed, undo; and its restart."""

from __future__ import annotations

from typing import Annotated, Self

from fastapi import Response
from pydantic import Field, model_validator

from gcs_server.api import responses
from gcs_server.api.command_routes import plain_command
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.reflect import model_of
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import Station, StationDep, VehicleDep
from gcs_server.api.strict_body import ResponseBody, StrictBody, example
from gcs_server.control.accepted import authorized_command
from gcs_server.control.commands import API
from gcs_server.errors import Refused
from gcs_server.operations.operations import ReportProgress
from gcs_server.vehicle import param_file
from gcs_server.vehicle.param_review import ReviewRow, WantedParam
from gcs_server.vehicle.services.param_changes import ParamChange, ParamChanges, WrittenParam, WrittenParams
from gcs_server.vehicle.services.restart import RestartService
from gcs_server.vehicle.vehicle import Vehicle

router = Routes(prefix="/vehicles", tags=["parameters"], responses=RESPONSES)

MAX_FILE_CHARACTERS = 900_000
"""PX4's largest has 30,000."""
MAX_CHANGES = 2_000
"""Maximum number of changes in one request; PX4 has about 900 parameters."""
ParamName = Annotated[str, Field(max_length=16, pattern=r"^[A-Za-z0-9_]+$")]

ReviewRowModel = model_of(ReviewRow)
WrittenModel = model_of(WrittenParams, rows=tuple[model_of(WrittenParam), ...])


class WantedValue(StrictBody):
    """A value that a parameter should have."""

    name: ParamName
    """Up to 16 of A–Z, 0–9, _."""
    value: float
    """In the parameter's own unit."""


class ReviewRequest(StrictBody):
    """What to compare with the vehicle's parameters; exactly one of `changes`, `file`, `defaults`,
    `of_vehicle`, `undo`."""

    model_config = example(changes=[{"name": "MNT_MODE_IN", "value": 4}])

    changes: list[WantedValue] | None = Field(default=None, max_length=MAX_CHANGES)
    """Single values."""
    file: str | None = Field(default=None, max_length=MAX_FILE_CHARACTERS)
    """Content of a file of QGroundControl (`.params`)."""
    defaults: bool = False
    """The defaults in the vehicle's metadata, of all parameters that differ and that the vehicle does not
    change by itself."""
    of_vehicle: str | None = Field(default=None, max_length=32)
    """Id of a vehicle whose parameters to compare; they must have been read."""
    undo: bool = False
    """The values before the newest change."""
    force: bool = False
    """Accept values outside the documented range and choices."""

    @model_validator(mode="after")
    def _check_one_source(self) -> Self:
        given = (
            self.changes is not None,
            self.file is not None,
            self.defaults,
            self.of_vehicle is not None,
            self.undo,
        )
        if sum(given) != 1:
            raise ValueError("give exactly one of changes, file, defaults, of_vehicle, undo")
        return self


class ReviewView(ResponseBody):
    """The comparison. Nothing was written."""

    vehicle: str
    """The vehicle's id."""
    rows: tuple[ReviewRowModel, ...]  # type: ignore[valid-type]
    """One row for each wanted value, in their order."""
    notes: tuple[str, ...]
    """What to know before applying it, such as a file of another vehicle or version."""


class ReviewedChange(StrictBody):
    """One change, as the review showed it."""

    name: ParamName
    """Up to 16 of A–Z, 0–9, _."""
    old: float | None
    """The vehicle's value in the review; refused if it has another one now."""
    value: float
    """The new value."""


class ApplyRequest(StrictBody):
    """Reviewed changes."""

    model_config = example(changes=[{"name": "MNT_MODE_IN", "old": -1, "value": 4}])

    changes: list[ReviewedChange] = Field(min_length=1, max_length=MAX_CHANGES)
    """The changes; none is written unless all can be."""
    force: bool = False
    """Write also values outside the documented range and choices."""
    while_armed: bool = False
    """Write also while the vehicle is armed; the values act at once."""
    undo: bool = False
    """Whether these are the values of a review with `undo`: then the newest change counts as undone."""
    wait: bool = True
    """Answer once all are written; false: answer at once, and `GET …/param_changes` has the result."""


class ChangesView(ResponseBody):
    """State of the changes of a vehicle's parameters."""

    vehicle: str
    """The vehicle's id."""
    writing: bool
    """Whether a change is being written."""
    operation: str | None
    """Id of the operation that writes, in the answer of `apply` without `wait`."""
    waiting: tuple[str, ...]
    """Changed parameters that take effect only after a restart of the vehicle."""
    undo_count: int
    """Number of changes that can be undone, one after the other."""
    last: WrittenModel | None  # type: ignore[valid-type]
    """What became of the newest change; null: there was none."""


class RestartRequest(StrictBody):
    """Confirmation of a restart."""

    model_config = example(confirm="vehicle 1 restarts")

    confirm: str = Field(max_length=100)
    """Exactly `vehicle {id} restarts`, with the vehicle's id."""


def _wanted(vehicle: Vehicle, body: ReviewRequest, station: Station) -> list[WantedParam]:
    if body.changes is not None:
        return [WantedParam(each.name, each.value) for each in body.changes]
    if body.undo:
        return list(vehicle.service(ParamChanges).undone())
    if body.of_vehicle is not None:
        other = station.fleet.get(body.of_vehicle)
        _require_read(other)
        return [WantedParam(each.name, each.value, each.is_integer) for each in other.params.all()]
    _require_read(vehicle)
    described = ((param, vehicle.params.metadata_of(param.name)) for param in vehicle.params.all())
    return [
        WantedParam(param.name, metadata.default)
        for param, metadata in described
        if metadata is not None and metadata.default is not None and not metadata.volatile
    ]


def _require_read(vehicle: Vehicle) -> None:
    if vehicle.params.list.state not in ("ready", "outdated"):
        raise Refused(
            f"The parameters of vehicle {vehicle.id} have not been read yet.",
            remedy="Read them first (POST …/params/refresh).",
        )


@router.post("/{v}/param_changes/review", response_model=ReviewView)
async def review(vehicle: VehicleDep, body: ReviewRequest, station: StationDep) -> Response:
    """Compares values with the vehicle's parameters and names what would change and what is refused, and why.
    Writes nothing; up to 80 parameters that were not read before are read."""
    notes: tuple[str, ...] = ()
    if body.file is not None:
        identity = vehicle.identity
        file = param_file.read(body.file, identity.component_id)
        wanted, notes = list(file.rows), param_file.notes(file, identity.system_id, identity.firmware)
    else:
        wanted = _wanted(vehicle, body, station)
    rows = await vehicle.service(ParamChanges).review(wanted, force=body.force)
    return json_response({"vehicle": vehicle.id, "rows": rows, "notes": notes})


@router.get(
    "/{v}/param_file",
    response_class=Response,
    responses={200: {"content": {"text/plain": {}}, "description": "The file."}},
)
async def show_file(vehicle: VehicleDep) -> Response:
    """The parameters that the server has read, as a file of QGroundControl (`.params`)."""
    _require_read(vehicle)
    identity = vehicle.identity
    text = param_file.write(
        vehicle.params.all(), identity.system_id, identity.component_id, identity.firmware
    )
    headers = {"Content-Disposition": f'attachment; filename="vehicle-{identity.system_id}.params"'}
    return Response(text, media_type="text/plain; charset=utf-8", headers=headers)


@router.post(
    "/{v}/param_changes/apply",
    response_model=ChangesView,
    responses={202: {"model": ChangesView, "description": "Without `wait`: the values are being written."}},
)
async def apply(v: str, body: ApplyRequest, station: StationDep, principal: PrincipalDep) -> Response:
    """Writes reviewed changes one after the other; the vehicle's answer shows which were taken (`last`).

    Refused as a whole (409 `changes_refused`, with reasons), before anything is written, if one of them
    cannot be written, or if the vehicle has another value than the review showed; also while the vehicle is
    armed, unless `while_armed` is set. The rest is not written once the client has lost control. An
    operation: `DELETE /operations/{id}` stops it.
    """
    arguments: dict[str, object] = {
        "changes": {each.name: each.value for each in body.changes},
        **body.model_dump(exclude={"changes", "wait"}, exclude_defaults=True),
    }
    with authorized_command(station, principal, "param_changes/apply", v, arguments):
        vehicle = station.fleet.get(v)
        service = vehicle.service(ParamChanges)

        def require_control() -> None:
            refusal = station.authority.refusal(principal, "param_changes/apply", [v])
            if refusal is not None:
                raise refusal

        async def work(report: ReportProgress) -> dict[str, object]:
            written = await service.apply(
                [ParamChange(each.name, each.old, each.value) for each in body.changes],
                force=body.force,
                while_armed=body.while_armed,
                undoes=body.undo,
                may_go_on=require_control,
                progress=report,
            )
            count = sum(row.state == "set" for row in written.rows)
            return {"set": count, "not_set": len(written.rows) - count}

        operation = station.operations.start(
            "param_changes/apply",
            work,
            text=f"Writing parameters of vehicle {v}.",
            vehicle=v,
            by=(principal.name, principal.key),
            needs_vehicle=True,
            command=True,
        )
        if body.wait:
            ended = await station.operations.wait(operation.id)
            if ended.state == "cancelled":
                raise Refused(f"Writing parameters of vehicle {v} was cancelled.")
            return json_response(_changes_view(vehicle))
    response = json_response(_changes_view(vehicle) | {"writing": True, "operation": operation.id}, 202)
    response.headers["Location"] = f"{API}/operations/{operation.id}"
    return response


@router.get("/{v}/param_changes", response_model=ChangesView)
async def show_changes(vehicle: VehicleDep) -> Response:
    """What became of the newest change, what waits for a restart, and how much can be undone."""
    return json_response(_changes_view(vehicle))


def _changes_view(vehicle: Vehicle) -> dict[str, object]:
    service = vehicle.service(ParamChanges)
    return {
        "vehicle": vehicle.id,
        "writing": service.is_writing,
        "operation": None,
        "waiting": service.waiting(),
        "undo_count": service.undo_count,
        "last": service.last,
    }


restart = plain_command(
    "restart",
    RestartRequest,
    lambda g: g.vehicle.service(RestartService).restart(),
    """Restarts the vehicle's autopilot; refused while armed. Answers once the vehicle has acknowledged it; it
    is then silent for some seconds. PX4 in simulation refuses (409 `rejected`).""",
    response=responses.CommandDone,
)
