"""Flying by stick: a WebSocket for stick positions (MANUAL_CONTROL), and what the vehicle makes of them."""

from __future__ import annotations

import asyncio
import json
from collections import deque
from typing import Annotated, Final, Literal, Protocol

from fastapi import Response, WebSocket, WebSocketDisconnect
from pydantic import Field, TypeAdapter, ValidationError

from gcs_server.api.json_limits import json_fault
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.reflect import model_of
from gcs_server.api.responses import fields_of, json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import Station, StationDep, VehicleDep
from gcs_server.api.strict_body import StrictBody
from gcs_server.control.accepted import authorized_command
from gcs_server.control.principal import Principal
from gcs_server.errors import GcsError
from gcs_server.mavlink.dialect import MAV_SEVERITY_NOTICE, MAV_SEVERITY_WARNING
from gcs_server.telemetry.wire import encode
from gcs_server.vehicle.px4.stick_input import StickLoss
from gcs_server.vehicle.services.manual_control import (
    VALID_S,
    ManualControlService,
    ManualControlStatus,
    Phase,
    StickPositions,
    StickRules,
    StickStream,
)

MAX_HZ: Final = 50.0
"""Frames beyond this rate are replaced by newer ones before they are sent."""
FLOOD_PER_S: Final = 1000
"""Maximum number of messages per second; the server closes the socket of a client that sends more."""
MAX_MESSAGE_CHARACTERS: Final = 1000
MAX_UNSENT: Final = 50
"""Answers that wait for a client that does not read; older ones are dropped."""
CLOSE_DONE, CLOSE_REFUSED = 1000, 1008

router = Routes(prefix="/vehicles/{v}/manual_control", tags=["offboard"], responses=RESPONSES)

RulesModel = model_of(StickRules, loss=model_of(StickLoss))
ManualControlView = model_of(ManualControlStatus, "ManualControlView", rules=RulesModel)

Deflection = Annotated[float, Field(ge=-1000, le=1000)]


class Sticks(StrictBody):
    """The positions of all sticks."""

    type: Literal["sticks"]
    pitch: Deflection
    roll: Deflection
    throttle: Annotated[float, Field(ge=0, le=1000)]
    yaw: Deflection


class HandsOff(StrictBody):
    """`neutral`: the pilot cannot be read now; `resume`: goes on after an interruption; `end`: the last."""

    type: Literal["neutral", "resume", "end"]


_message: TypeAdapter[Sticks | HandsOff] = TypeAdapter(
    Annotated[Sticks | HandsOff, Field(discriminator="type")]
)


class Socket(Protocol):
    """The part of a WebSocket that this module uses."""

    async def send_text(self, data: str) -> None: ...
    async def receive_text(self) -> str: ...
    async def close(self, code: int = 1000, reason: str | None = None) -> None: ...


@router.get("", response_model=ManualControlView)
async def show(vehicle: VehicleDep) -> Response:
    """Whose stick positions are sent, whether the vehicle uses them, and what it does when they stop."""
    service = vehicle.service(ManualControlService)
    rules = await service.rules()
    return json_response(fields_of(service.status()) | {"rules": rules})


class StickSocket:
    """One client's stick positions for one vehicle, until the socket closes or the stream ends."""

    def __init__(self, station: Station, principal: Principal, vehicle_id: str, socket: Socket) -> None:
        self._station, self._principal, self._id, self._socket = station, principal, vehicle_id, socket
        self._newest: StickPositions | None = None
        self._arrived = asyncio.Event()
        self._answers: deque[dict[str, object]] = deque(maxlen=MAX_UNSENT)
        self._answered = asyncio.Event()
        self._told: tuple[Phase, str | None] | None = None

    async def serve(self) -> None:
        """Flies; returns once the stream has ended."""
        station, principal, vehicle_id = self._station, self._principal, self._id
        try:
            with authorized_command(station, principal, "manual_control", vehicle_id, {"action": "begin"}):
                vehicle = station.fleet.get(vehicle_id)
                service = vehicle.service(ManualControlService)
                stream = await service.begin(principal.name, principal.key, self._refusal)
        except GcsError as error:
            fields = {"code": error.code, "detail": error.message, "remedy": error.remedy, **error.details()}
            await self._socket.send_text(encode({"error": fields}).decode())
            await self._socket.close(CLOSE_REFUSED, error.code)
            return
        began_s = station.clock.monotonic_s()
        self._report(f"{principal.name} flies by stick.", MAV_SEVERITY_NOTICE)
        try:
            await self._run(stream)
        finally:
            stream.end("The client closed its connection.")
            reason = stream.reason or ""
            self._report(f"{principal.name} no longer flies by stick. {reason}", MAV_SEVERITY_WARNING)
            arguments: dict[str, object] = {"action": "end", "frames": stream.sent_count}
            duration_s = station.clock.monotonic_s() - began_s
            station.journal.add(
                principal.name, "manual_control", vehicle_id, arguments, "ok", reason, duration_s
            )

    async def _run(self, stream: StickStream) -> None:
        self._tell(stream)
        async with asyncio.TaskGroup() as group:
            flying = group.create_task(self._fly(stream))
            others = [group.create_task(work) for work in (self._receive(stream), self._send())]
            await asyncio.wait([flying, *others], return_when=asyncio.FIRST_COMPLETED)
            for task in (flying, *others):
                task.cancel()
        if flying.done() and not flying.cancelled():
            for answer in self._answers:
                await self._socket.send_text(encode(answer).decode())
            await self._socket.close(CLOSE_DONE, "ended")

    async def _fly(self, stream: StickStream) -> None:
        while not stream.has_ended():
            try:
                async with asyncio.timeout(VALID_S):
                    await self._arrived.wait()
            except TimeoutError:
                stream.end(f"No stick positions for {VALID_S:g} s.")
            else:
                self._arrived.clear()
                if not stream.has_ended():
                    stream.fly(self._newest)
            self._tell(stream)
            await self._station.clock.sleep(1.0 / MAX_HZ)

    async def _receive(self, stream: StickStream) -> None:
        clock = self._station.clock
        window_s, count = clock.monotonic_s(), 0
        while True:
            text = await self._socket.receive_text()
            now_s = clock.monotonic_s()
            if now_s - window_s >= 1.0:
                window_s, count = now_s, 0
            count += 1
            if count > FLOOD_PER_S:
                stream.end(f"The client sent more than {FLOOD_PER_S} messages in a second.")
                return
            try:
                message = _parsed(text)
            except ValueError as error:
                self._answer({"error": {"code": "invalid_request", "detail": str(error)}})
                continue
            if isinstance(message, Sticks):
                self._newest = StickPositions(message.pitch, message.roll, message.throttle, message.yaw)
            elif message.type == "end":
                stream.end("Its pilot has ended it.", neutral=True)
            elif message.type == "resume":
                stream.resume()
                continue
            else:
                self._newest = None
            self._arrived.set()

    async def _send(self) -> None:
        while True:
            await self._answered.wait()
            self._answered.clear()
            while self._answers:
                await self._socket.send_text(encode(self._answers.popleft()).decode())

    def _answer(self, answer: dict[str, object]) -> None:
        self._answers.append(answer)
        self._answered.set()

    def _tell(self, stream: StickStream) -> None:
        """Tells the client each change of the phase, and everybody an interruption."""
        told = (stream.phase, stream.reason)
        if told == self._told:
            return
        self._told = told
        self._answer({"phase": stream.phase, "reason": stream.reason})
        if stream.phase == "interrupted":
            text = f"The sticks of {self._principal.name} are neutral. {stream.reason}"
            self._report(text, MAV_SEVERITY_NOTICE)

    def _refusal(self) -> str | None:
        """Why this client may not send stick positions, as a sentence; None: it may."""
        try:
            control = self._station.authority.control(self._id).status()
        except GcsError as error:
            return str(error)
        if control.holder_key == self._principal.key:
            return None
        if control.holder is None:
            return "It no longer has control of the vehicle."
        return f"{control.holder} has control of the vehicle now."

    def _report(self, text: str, severity: int) -> None:
        try:
            events = self._station.fleet.get(self._id).events
        except GcsError:  # the vehicle was removed
            return
        data = {"client": self._principal.name, "client_key": self._principal.key}
        events.add("manual_control", self._station.clock.unix_s(), text, severity=severity, data=data)


def _parsed(text: str) -> Sticks | HandsOff:
    """A client's message. Raises ValueError: it is none, with the reason."""
    if len(text) > MAX_MESSAGE_CHARACTERS:
        raise ValueError(f"A message has at most {MAX_MESSAGE_CHARACTERS} characters.")
    fault = json_fault(text.encode())
    if fault is not None:
        raise ValueError(f"not read: {fault}")
    try:
        return _message.validate_python(json.loads(text))
    except json.JSONDecodeError as error:
        raise ValueError(f"not JSON: {error.msg} at {error.pos}") from error
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(str(part) for part in first["loc"][1:]) or "type"
        raise ValueError(f"{field}: {first['msg']}") from error


@router.websocket("/stream")
async def stream(socket: WebSocket, v: str, station: StationDep, principal: PrincipalDep) -> None:
    """Receives stick positions on a WebSocket and sends each to the vehicle; see "Flying by stick" in
    docs/api.md."""
    await socket.accept()
    try:
        with station.authority.connected(principal):
            await StickSocket(station, principal, v, socket).serve()
    except* (WebSocketDisconnect, RuntimeError):
        pass  # the client disconnected; sending to a closed socket raises RuntimeError
