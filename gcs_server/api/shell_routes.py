"""Routes of the vehicle's console (PX4's shell): send a line, read the output."""

from __future__ import annotations

from typing import Annotated

from fastapi import Query, Response
from pydantic import Field

from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.reflect import model_of
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import StationDep, VehicleDep
from gcs_server.api.strict_body import ResponseBody, StrictBody
from gcs_server.control.accepted import authorized_command
from gcs_server.vehicle.services.shell import MAX_LINE_BYTES, ShellOutput, ShellService

router = Routes(prefix="/vehicles/{v}/shell", tags=["shell"], responses=RESPONSES)

ShellOutputModel = model_of(ShellOutput, "ShellOutput")
MAX_WAIT_S = 30.0


class ShellLine(StrictBody):
    """A line for the vehicle's console."""

    line: str = Field(max_length=MAX_LINE_BYTES, examples=["gimbal status"])
    """One line of printable ASCII characters, without its end."""
    while_armed: bool = False
    """Send it also while the vehicle is armed. It acts at once, and nothing of it is checked."""
    wait_s: float = Field(2.0, ge=0, le=MAX_WAIT_S)
    """Maximum wait for the end of its output [s]; what comes later is read by GET or the topic `shell`."""


class ShellAnswer(ResponseBody):
    """What the console answered."""

    output: str
    """Output from the line's echo on."""
    complete: bool
    """Whether the prompt has come back; false: the command still runs, or its output was lost."""


@router.post("", response_model=ShellAnswer)
async def run(v: str, body: ShellLine, station: StationDep, principal: PrincipalDep) -> Response:
    """Sends a line to the vehicle's console. Needs control; refused while the vehicle is armed unless
    `while_armed` is set. The line is sent once: 504 `no_reply` means that the vehicle did not echo it."""
    with authorized_command(station, principal, "shell", v, {"line": body.line}):
        service = station.fleet.get(v).service(ShellService)
        output, complete = await service.run(body.line, while_armed=body.while_armed, wait_s=body.wait_s)
    return json_response({"output": output, "complete": complete})


@router.get("", response_model=ShellOutputModel)
async def output(
    vehicle: VehicleDep,
    after: Annotated[int, Query(ge=0, description="`end` of the output that the client has.")] = 0,
) -> Response:
    """The console's output since this server found the vehicle (the newest 100,000 characters). For
    continuous output subscribe to the telemetry topic `shell`, which has the newest 4,000."""
    vehicle.require("shell")
    return json_response(vehicle.service(ShellService).output(after))
