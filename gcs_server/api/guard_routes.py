"""Guarded links: the programs that fly through this server."""

from __future__ import annotations

from fastapi import Response
from pydantic import BaseModel, ConfigDict, Field

from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.reflect import model_of
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import StationDep
from gcs_server.control.accepted import authorized_command
from gcs_server.guard import table
from gcs_server.guard.guard import GuardView
from gcs_server.guard.program import ProgramView, Refusal

router = Routes(prefix="/guards", tags=["guards"], responses=RESPONSES)

RefusalModel = model_of(Refusal, "ProgramRefusal")
ProgramModel = model_of(ProgramView, "Program", refusals=list[RefusalModel])
GuardModel = model_of(GuardView, "Guard", programs=list[ProgramModel])


class GuardList(BaseModel):
    """All guarded links."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    guards: list[GuardModel] = Field(description="The guarded links.")  # type: ignore[valid-type]


class GuardRule(BaseModel):
    """What becomes of one message, command or topic of a program."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str = Field(description="The message, the MAV_CMD, or the ROS 2 topic.")
    way: str = Field(
        description="read: passed. command: needs control as `row` says, passed and journaled. input: the "
        "same, with one line of the journal for many. sensor: passed without control. part: of a command "
        "that was admitted. setpoint: becomes a setpoint of the server's stream. kept: used by the guard. "
        "refused: neither."
    )
    row: str | None = Field(description="Command of docs/authority.md whose requirements apply.")
    why: str | None = Field(description="Why it is kept or refused, or what of it.")


class GuardTable(BaseModel):
    """What becomes of each message, command and topic of a program."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    messages: list[GuardRule] = Field(description="Messages; others are not passed.")
    commands: list[GuardRule] = Field(
        description="Commands in COMMAND_LONG and COMMAND_INT; others need control and are passed."
    )
    topics: list[GuardRule] = Field(description="Topics of ROS 2 programs; others are not passed.")


@router.get("", response_model=GuardList)
async def list_guards(station: StationDep) -> Response:
    """The guarded links and their programs: what each is, what it sends, and what was limited or refused, and
    why. A guarded link is opened with `POST /links` (`guard=ask` in its URL), and closed with `DELETE
    /links/{name}`; then the setpoints of its program expire."""
    return json_response({"guards": station.guards.all()})


@router.get("/table", response_model=GuardTable)
async def show_table() -> Response:
    """What becomes of each message and command of a program: passed, checked or refused."""
    return json_response(table.as_json())


@router.post("/{name}/resume", response_model=GuardModel)
async def resume(name: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Lets a program command again after another client, the pilot or another station has commanded its
    vehicle. Nothing is sent to the vehicle."""
    with authorized_command(station, principal, "guards/resume", None, {"name": name}):
        guard = station.guards.get(name)
        guard.resume()
        return json_response(guard.view())
