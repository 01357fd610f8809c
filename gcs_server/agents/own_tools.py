"""Tools that are no call of the API: waiting, so that an agent need not ask again and again, and asking a
person for a flight."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final, Protocol

from gcs_server.agents.flight_requests import FlightRequestView
from gcs_server.clock import Clock
from gcs_server.control.authority import Authority
from gcs_server.control.principal import Principal
from gcs_server.errors import InvalidRequest
from gcs_server.operations.operations import Operations
from gcs_server.settings import AgentScope
from gcs_server.vehicle.fleet import Fleet

LOOK_S: Final = 0.25
MAX_WAIT_S: Final = 50.0
"""Clients of MCP give up after a minute."""
STATES: Final = ("on_ground", "in_air", "disarmed", "hold", "operation_ended", "request_answered", "time")


@dataclass(frozen=True, slots=True)
class OwnTool:
    """A tool that is no call of the API."""

    name: str
    scope: AgentScope
    description: str
    schema: dict[str, Any]


WAIT: Final = OwnTool(
    "wait",
    "read",
    "Waits until a vehicle or an operation is in a state, and returns the state. Meanwhile control of "
    "vehicles is kept; an agent that neither waits nor calls for half a minute loses it, and its vehicle "
    "holds.",
    {
        "type": "object",
        "properties": {
            "until": {"enum": list(STATES), "description": "State to wait for; time: only the time."},
            "at_most_s": {"type": "number", "exclusiveMinimum": 0, "maximum": MAX_WAIT_S},
            "vehicle": {"type": "string", "description": "Id of the vehicle."},
            "operation_id": {"type": "string", "description": "For operation_ended."},
            "request_id": {"type": "string", "description": "For request_answered."},
        },
        "required": ["until", "at_most_s"],
        "additionalProperties": False,
    },
)
REQUEST_FLIGHT: Final = OwnTool(
    "request_flight",
    "fly",
    "Asks a person on the page to allow the flight of a dry run: a stored plan on one vehicle, which is on "
    "the ground and disarmed. The dry run has passed within the last five minutes. If the person allows it, "
    "the server uploads and starts the plan, with this agent in control. Then wait until request_answered; "
    "the flight holds if this agent neither waits nor calls for half a minute.",
    {
        "type": "object",
        "properties": {"dry_run_id": {"type": "string", "description": "Id of the dry run."}},
        "required": ["dry_run_id"],
        "additionalProperties": False,
    },
)
OWN_TOOLS: Final = {tool.name: tool for tool in (WAIT, REQUEST_FLIGHT)}


class WaitedFor(Protocol):
    """What can be waited for."""

    clock: Clock
    fleet: Fleet
    authority: Authority
    operations: Operations


class Waits:
    """Executes the tool `wait`.

    Args:
        station: what can be waited for.
        request: a request of a flight by its id; raises InvalidRequest if there is none.
    """

    def __init__(self, station: WaitedFor, request: Callable[[str], FlightRequestView]) -> None:
        self._station = station
        self._request = request

    async def wait(self, principal: Principal, arguments: Mapping[str, Any]) -> dict[str, object]:
        """Waits, and returns the state.

        Raises:
            InvalidRequest: an argument is missing or not valid.
            UnknownVehicle, UnknownOperation: what is waited for does not exist.
        """
        until, at_most_s = arguments.get("until"), arguments.get("at_most_s")
        if until not in STATES:
            raise InvalidRequest("until", "There is no such state.", remedy=f"Accepted: {', '.join(STATES)}.")
        if (
            not isinstance(at_most_s, int | float)
            or isinstance(at_most_s, bool)
            or not 0 < at_most_s <= MAX_WAIT_S
        ):
            raise InvalidRequest("at_most_s", f"A number above 0 and up to {MAX_WAIT_S:g} [s] is needed.")
        look = self._look(str(until), arguments)
        clock = self._station.clock
        began_s = clock.monotonic_s()
        reached, state = look()
        with self._station.authority.answering(principal):
            while not reached and clock.monotonic_s() - began_s < at_most_s:
                await clock.sleep(LOOK_S)
                reached, state = look()
        waited_s = round(clock.monotonic_s() - began_s, 1)
        return {"reached": reached, "waited_s": waited_s, **state}

    def _look(self, until: str, arguments: Mapping[str, Any]) -> Callable[[], tuple[bool, dict[str, object]]]:
        """A function that returns whether the state is reached, and the state."""
        if until == "request_answered":
            request_id = arguments.get("request_id")
            if not isinstance(request_id, str):
                raise InvalidRequest("request_id", "The id of the request is needed.")
            return lambda: self._answer(request_id)
        if until == "operation_ended":
            operation_id = arguments.get("operation_id")
            if not isinstance(operation_id, str):
                raise InvalidRequest("operation_id", "The id of the operation is needed.")
            return lambda: self._operation(operation_id)
        vehicle_id = arguments.get("vehicle")
        if until == "time" and vehicle_id is None:
            return lambda: (False, {})
        if not isinstance(vehicle_id, str):
            raise InvalidRequest("vehicle", "The id of the vehicle is needed.")
        self._station.fleet.get(vehicle_id)
        return lambda: self._vehicle(vehicle_id, until)

    def _operation(self, operation_id: str) -> tuple[bool, dict[str, object]]:
        operation = self._station.operations.get(operation_id)
        state: dict[str, object] = {
            "state": operation.state,
            "text": operation.text,
            "result": operation.result,
            "error": None if operation.error is None else str(operation.error),
        }
        return operation.state not in ("running", "waiting"), state

    def _answer(self, request_id: str) -> tuple[bool, dict[str, object]]:
        request = self._request(request_id)
        return request.state not in ("waiting", "starting"), asdict(request)

    def _vehicle(self, vehicle_id: str, until: str) -> tuple[bool, dict[str, object]]:
        status = self._station.fleet.get(vehicle_id).status
        reached = {
            "on_ground": status.landed_state == "on_ground",
            "in_air": status.landed_state == "in_air",
            "disarmed": not status.armed,
            "hold": status.mode == "hold",
        }.get(until, False)
        return reached, {"vehicle": vehicle_id, "status": asdict(status)}
