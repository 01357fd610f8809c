"""Routes of a gimbal's set-up: what is set and missing, the gimbal module, a test of each axis, positions."""

from __future__ import annotations

from contextlib import suppress
from typing import Literal

from fastapi import Response
from pydantic import Field

from gcs_server.api import responses
from gcs_server.api.command_routes import GIMBAL, plain_command
from gcs_server.api.param_routes import ListModel, ParameterView, param_view
from gcs_server.api.problems import RESPONSES
from gcs_server.api.reflect import model_of
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import VehicleDep
from gcs_server.api.strict_body import ResponseBody, StrictBody, example
from gcs_server.errors import NotYet
from gcs_server.vehicle.services.gimbal_setup import (
    GimbalModule,
    GimbalOutput,
    GimbalSetup,
    GimbalSetupService,
    SetupChange,
    SetupFinding,
)
from gcs_server.vehicle.vehicle import Vehicle

router = Routes(prefix="/vehicles", tags=["gimbal"], responses=RESPONSES)

ModuleModel = model_of(GimbalModule)
SetupModel = model_of(
    GimbalSetup,
    "GimbalSetup",
    outputs=tuple[model_of(GimbalOutput), ...],
    module=ModuleModel,
    findings=tuple[model_of(SetupFinding, changes=tuple[model_of(SetupChange), ...]), ...],
)


class GimbalSetupView(ResponseBody):
    """A gimbal's set-up."""

    vehicle: str
    """The vehicle's id."""
    list: ListModel  # type: ignore[valid-type]
    """State of the list of parameters."""
    setup: SetupModel | None  # type: ignore[valid-type]
    """What is set, and what is missing; null until the parameters have been read."""
    params: tuple[ParameterView, ...]
    """The parameters that the set-up names."""


class ModuleRequest(StrictBody):
    """What to do with the gimbal module."""

    model_config = example(action="status")

    action: Literal["status", "start"]
    """status: `gimbal status` on the vehicle's console; start: `gimbal start`, of a running module after
    `gimbal stop`, so that it reads its parameters again."""


class ModuleDone(responses.CommandDone):
    """Result of a call to the gimbal module."""

    module: ModuleModel  # type: ignore[valid-type]
    """Its state afterwards."""


class PoseRequest(StrictBody):
    """A position of the gimbal."""

    model_config = example(pose="neutral")

    pose: Literal["neutral", "retract", "centre"]
    """neutral and retract: the gimbal's own positions (PX4 centres servos for both); centre: level, straight
    ahead."""


class TryRequest(StrictBody):
    """One axis of the gimbal, and its angle."""

    model_config = example(axis="pitch", angle_deg=-20)

    axis: Literal["roll", "pitch", "yaw"]
    """The axis; the others turn to zero."""
    angle_deg: float = Field(ge=-360, le=360)
    """Angle; right side down, up, and to the right are positive [deg]."""
    while_armed: bool = False
    """Turn it also while the vehicle is armed, so that its motors may turn."""


@router.get("/{v}/gimbal/setup", response_model=GimbalSetupView)
async def show_setup(vehicle: VehicleDep) -> Response:
    """Parameters and outputs of the gimbal, the state of its module, and what keeps it from working, with the
    parameters that mend it (`POST …/param_changes/review`, then `POST …/param_changes/apply`)."""
    setup, params = None, ()
    with suppress(NotYet):
        setup = await vehicle.service(GimbalSetupService).read()
        names = (*setup.settings, *setup.reverse_params, *(each.function_param for each in setup.outputs))
        params = tuple(filter(None, vehicle.params.known_each(names)))
    return json_response(
        {
            "vehicle": vehicle.id,
            "list": vehicle.params.list,
            "setup": setup,
            "params": [param_view(vehicle, each) for each in params],
        }
    )


async def _call_module(vehicle: Vehicle, action: str) -> GimbalModule:
    service = vehicle.service(GimbalSetupService)
    return await (service.start() if action == "start" else service.ask())


gimbal_module = plain_command(
    "gimbal/module",
    ModuleRequest,
    lambda g: _call_module(g.vehicle, g.body.action),
    """Starts PX4's gimbal module, or asks for its status, on the vehicle's console; refused while the vehicle
    is armed.""",
    result_as="module",
    response=ModuleDone,
)
gimbal_pose = plain_command(
    "gimbal/pose",
    PoseRequest,
    lambda g: g.gimbal.set_pose(g.body.pose),
    "Moves the gimbal to its neutral or retracted position, or to the centre.",
    part=GIMBAL,
)
gimbal_try = plain_command(
    "gimbal/try",
    TryRequest,
    lambda g: g.gimbal.try_axis(g.body.axis, g.body.angle_deg, while_armed=g.body.while_armed),
    """Turns one axis, and the others to zero, for a test on the bench; refused while the vehicle is armed,
    unless `while_armed` is set. Needs control of the gimbal; answers as `gimbal/angles`.""",
    part=GIMBAL,
    result_as="limited",
    response=responses.GimbalPointed,
)
