"""The two ends of a guard: what is sent to the vehicle for a program, and to a program as its vehicle."""

from __future__ import annotations

from typing import Any, Final, Protocol

from gcs_server.control.accepted import Commanded
from gcs_server.control.principal import Principal
from gcs_server.errors import GcsError, NotInControl
from gcs_server.guard import replies
from gcs_server.guard.program import Program
from gcs_server.links.base import GuardOptions
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame, encode_payload, full_payload
from gcs_server.mavlink.connection import Connection
from gcs_server.streamer.offboard.control import OffboardControl
from gcs_server.supervise import Supervisor
from gcs_server.vehicle.vehicle import Vehicle

ASK_AGAIN_S: Final = 30.0
"""Control is not asked for again within this time, so that a denial stays one [s]."""


class GuardedStation(Commanded, Protocol):
    """The parts of the running server that a guard needs."""

    def offboard(self, vehicle_id: str) -> OffboardControl: ...


class Ends:
    """One guarded link and its vehicle.

    Args:
        station: the parts of the server that execute commands.
        supervisor: owns the tasks.
        connection: the link to the programs.
    """

    def __init__(self, station: GuardedStation, supervisor: Supervisor, connection: Connection) -> None:
        options = connection.link.guard
        assert options is not None
        self.station, self.supervisor, self.connection = station, supervisor, connection
        self.options: GuardOptions = options
        self.vehicle: Vehicle | None = None
        self.programs: dict[str, Program] = {}
        """By name of the peer."""
        name = options.client or f"Program on {connection.name}"
        self.principal = Principal.from_identity(name, f"guard {connection.name}", connection.name)
        """The client that the programs of this link are: it has control, and stands in the journal."""
        self._asked_s = float("-inf")

    def now_s(self) -> float:
        """The time [s, monotonic]."""
        return self.station.clock.monotonic_s()

    def unix_s(self) -> float:
        """The time [s since 1970 UTC]."""
        return self.station.clock.unix_s()

    def pass_on(self, program: Program, frame: Frame, payload: bytes | None = None) -> None:
        """Sends the message of a program to the vehicle, from the program's component of this server."""
        if self.vehicle is not None:
            sent = full_payload(frame) if payload is None else payload
            self.vehicle.send_payload(frame.msg_id, sent, component_id=program.own_component)

    def refuse(self, program: Program, frame: Frame, what: str, error: GcsError) -> None:
        """Answers a message that was not executed, in MAVLink's words and in a text."""
        text = str(error) if error.remedy is None or error.remedy in str(error) else f"{error} {error.remedy}"
        program.refuse(self.unix_s(), what, text)
        answer = replies.refusal(frame, error)
        if answer is not None:
            self.send(program, answer)
            if isinstance(error, NotInControl) and self._asks_for_control(what):
                text = f"{text} It was asked for control."
        self.tell(program, text)

    def _asks_for_control(self, what: str) -> bool:
        """Asks the client in control for it, if the link says so; returns whether it did."""
        now_s = self.now_s()
        if self.options.control != "ask" or self.vehicle is None or now_s - self._asked_s < ASK_AGAIN_S:
            return False
        self._asked_s = now_s
        lease = self.station.authority.control(self.vehicle.id).lease
        lease.request(self.principal, f"its program sent {what}")
        return True

    def acknowledge(self, program: Program, frame: Frame, result: int) -> None:
        """Answers a command with a MAV_RESULT."""
        answer = replies.acknowledgement(frame, result)
        if answer is not None:
            self.send(program, answer)

    def tell(self, program: Program, text: str, severity: int = d.MAV_SEVERITY_WARNING) -> None:
        """Sends a text to a program, unless it has just been sent."""
        if program.may_tell(text, self.now_s()):
            for message in replies.texts(f"GCS: {text}", severity):
                self.send(program, message)

    def tell_all(self, text: str) -> None:
        """Sends a text to every program that was heard."""
        for program in self.programs.values():
            if program.messages:
                self.tell(program, text)

    def send(self, program: Program, message: Any) -> None:
        """Sends a message to a program as the vehicle's autopilot."""
        if self.vehicle is None:
            return
        identity = self.vehicle.identity
        sender = self.connection.sender_as(identity.system_id, identity.component_id)
        sender.send(message.get_msgId(), encode_payload(message), program.peer)
