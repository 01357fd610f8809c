"""Futures of a command before it is sent. This route sends nothing to a vehicle."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from fastapi import Response
from pydantic import Field, model_validator

from gcs_server.api.authorized import while_connected
from gcs_server.api.models import AltitudeRequest, GotoRequest, OrbitRequest
from gcs_server.api.plan_models import OriginModel
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.reflect import model_of
from gcs_server.api.responses import json_bytes
from gcs_server.api.routes import Routes
from gcs_server.api.setpoints import AnySetpoint
from gcs_server.api.station import StationDep
from gcs_server.api.strict_body import StrictBody, example
from gcs_server.flights.futures_command import Altitude, Circling, CommandAsked, Going, StreamAsked
from gcs_server.flights.futures_command import futures_task as task_of
from missions.values import MAX_OBSTACLES, Obstacle
from missions.what_if.futures import document as d
from missions.what_if.futures.commands import Hold, Land

router = Routes(prefix="/vehicles", tags=["vehicles"], responses=RESPONSES)

QuantilesModel = model_of(d.FuturesQuantiles)
NearestModel = model_of(d.NearestThing)
STOPPED = "Why the stream would stop flying the setpoint and keep the position; null: it would not."
FuturesModel = model_of(
    d.Futures,
    corridor=model_of(d.FuturesCorridor),
    arrival_s=QuantilesModel | None,
    battery_end_share=QuantilesModel | None,
    fence=NearestModel | None,
    obstacle=NearestModel | None,
    vehicle=NearestModel | None,
    spread=model_of(d.FuturesSpread),
    vehicle_id=Annotated[str, Field(description="Id of the vehicle that flies.")],
    state_unix_s=Annotated[float, Field(description="Time of the state [s since 1970 UTC].")],
    origin=Annotated[
        OriginModel | None,
        Field(description="Origin of the vehicle's local frame; null: not known."),
    ],
    clear=Annotated[bool, Field(description="Whether no flight touches anything or loses control.")],
    limited=Annotated[list[str], Field(description="What the stream's limits reduce of the setpoint.")],
    stopped=Annotated[str | None, Field(description=STOPPED)],
)
COMMANDS = ("goto", "altitude", "orbit", "mode", "setpoint")


class FuturesRequest(StrictBody):
    """A command as its own route takes it; exactly one of `goto`, `altitude`, `orbit`, `mode` and
    `setpoint`."""

    model_config = example(goto={"lat_deg": 47.3982, "lon_deg": 8.5462, "alt_home_m": 15})

    goto: GotoRequest | None = None
    """A go-to (`POST /vehicles/{v}/goto`)."""
    altitude: AltitudeRequest | None = None
    """A change of the altitude (`POST /vehicles/{v}/altitude`)."""
    orbit: OrbitRequest | None = None
    """An orbit (`POST /vehicles/{v}/orbit`)."""
    mode: Literal["hold", "land"] | None = None
    """A change to this mode."""
    setpoint: AnySetpoint | None = None
    """A setpoint of the stream, renewed all the time."""
    horizon_s: float = Field(default=d.HORIZON_S, allow_inf_nan=False, ge=1, le=d.MAX_HORIZON_S)
    """How far the flights reach [s]."""
    flights: Annotated[int, Field(ge=20, le=200)] = d.FLIGHTS
    """Number of flights."""
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 0
    """Seed of deviations, noise and gusts."""
    obstacles: Annotated[list[Obstacle], Field(max_length=MAX_OBSTACLES)] = Field(default=[])
    """Known obstacles, as in a plan."""

    @model_validator(mode="after")
    def _check_one_command(self) -> Self:
        if sum(getattr(self, name) is not None for name in COMMANDS) != 1:
            raise ValueError(f"give exactly one of {', '.join(COMMANDS)}")
        return self

    def asked(self) -> CommandAsked:
        """The command, for the server."""
        if self.goto is not None:
            goto = self.goto
            return Going(
                goto.lat_deg, goto.lon_deg, goto.alt_amsl_m, goto.alt_home_m, goto.yaw_ned_deg, goto.speed_m_s
            )
        if self.altitude is not None:
            return Altitude(self.altitude.alt_amsl_m, self.altitude.alt_home_m)
        if self.orbit is not None:
            orbit = self.orbit
            return Circling(
                orbit.lat_deg, orbit.lon_deg, orbit.alt_amsl_m, orbit.alt_home_m, orbit.radius_m,
                orbit.speed_m_s, orbit.clockwise, orbit.yaw,
            )  # fmt: skip
        if self.setpoint is not None:
            return StreamAsked(self.setpoint)
        return Land() if self.mode == "land" else Hold()


@router.post("/{v}/futures", response_model=FuturesModel)
async def futures(v: str, body: FuturesRequest, station: StationDep, principal: PrincipalDep) -> Response:
    """Flies a command about a hundred times in simulation, from the vehicle's present state, and says where
    it may be when, how near it comes to the geofence, obstacles and other vehicles, and when it arrives.

    Changes nothing and commands no vehicle; no command waits for it. A newer request of a client replaces its
    older one (409), and the end of the connection ends it. What is not flown: failsafes, the geofence's
    action, sticks, other commands. `assumed` says what was not known.
    """
    flights = station.flights
    vehicle = flights.fleet.get(v)
    task = await task_of(
        flights, vehicle, body.asked(), obstacles=body.obstacles, horizon_s=body.horizon_s,
        count=body.flights, seed=body.seed,
    )  # fmt: skip
    return json_bytes(await while_connected(flights.futures.fly(task, principal.key)))
