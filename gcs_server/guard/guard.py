"""One guarded link: to the programs on it this server is the vehicle, and to the vehicle the programs are
components of this server.

What the vehicle sends is passed to every program, addressed to it where it was an answer to it. What a
program sends is passed, checked, or refused by `table.py`; its setpoints become those of this server's
stream, which has their validity, limits, fence and fallback. Of several programs on one link those of one
count, until it has been silent for `PRESENT_S`.

A command of another client, of the pilot or of another station ends what the program flies, and the program's
further commands are refused until a person lets it continue, or it was ended and the vehicle is disarmed:
many programs ask for Offboard and arm again and again, and would fly on against the pilot's Hold, or take off
beside a person who has landed the vehicle.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from gcs_server.guard import replies
from gcs_server.guard import setpoints as program_setpoints
from gcs_server.guard.commands import ProgramCommands
from gcs_server.guard.ends import Ends, GuardedStation
from gcs_server.guard.flight import ProgramFlight
from gcs_server.guard.program import Program, ProgramView
from gcs_server.guard.rates import ArrivingRates
from gcs_server.links.base import Peer
from gcs_server.links.names import shown_url
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame, decode, full_payload, payload_byte
from gcs_server.mavlink.connection import Connection
from gcs_server.mavlink.tables import TARGET_SYSTEM_OFFSET
from gcs_server.ros2.guard_link import Ros2GuardLink
from gcs_server.supervise import Supervisor
from gcs_server.vehicle.endpoint import Endpoint, dds_address
from gcs_server.vehicle.events import Event
from gcs_server.vehicle.vehicle import Vehicle

CHANGE_ROUTE_AFTER_S: Final = 2.0
"""If the vehicle sends nothing on the link whose messages are passed for this time, those of another link are
[s]."""
MAX_MESSAGES_PER_S: Final = 1000
"""More messages of a program per second, apart from setpoints, are not looked at."""
RENEW_S: Final = 1.0
"""Period at which the messages of a program renew its client's control [s]."""


@dataclass(frozen=True, slots=True)
class GuardView:
    """A guarded link with its programs."""

    name: str
    """Name of the link."""
    url: str
    """URL of the link."""
    vehicle: str | None
    """Id of the vehicle; null: none yet, see `problem`."""
    control: str
    """ask: control is taken if nobody has it, and asked for if somebody has. free: it is only taken if nobody
    has it. read: the programs may not command."""
    client: str
    """Name of the programs as a client, which has control and stands in the journal."""
    client_key: str
    """Key of this client."""
    valid_for_s: float
    """Time after which a setpoint has expired if no other follows [s]."""
    on_expiry: str
    """Action when a setpoint has expired: hold, land, stop_stream."""
    same_for_s: float
    """Time for which a setpoint that moves the vehicle is flown without any change [s]; 0: for ever."""
    problem: str | None
    """Why programs cannot fly now; null: they can."""
    paused: str | None
    """Who has overruled the program, so that its commands are refused until a person lets it continue, or it
    was ended and the vehicle is disarmed; null: nobody."""
    flying: bool
    """Whether its setpoints are flown."""
    programs: tuple[ProgramView, ...]
    """The programs, the one that commands first."""


class Guard:
    """The programs of one link, and their vehicle.

    Args:
        station: the parts of the server that execute their commands.
        supervisor: owns the tasks.
        connection: the link to the programs.
        components: component ids of this server that are free.
    """

    def __init__(
        self, station: GuardedStation, supervisor: Supervisor, connection: Connection, components: list[int]
    ) -> None:
        self.connection = connection
        self._ends = Ends(station, supervisor, connection)
        self._arriving = ArrivingRates()
        self._flight = ProgramFlight(self._ends)
        self._commands = ProgramCommands(self._ends, self._flight, self._arriving)
        self._components = components
        self._endpoint: Endpoint | None = None
        self._endpoint_s = float("-inf")
        self._renewed_s = float("-inf")
        self._ros2 = connection.link if isinstance(connection.link, Ros2GuardLink) else None
        """The link, if its programs have the vehicle's own topics, so that only answers are sent to them."""
        if self._ros2 is not None:
            self._ros2.on_refused = self._refuse_topic

    # --- the vehicle ----------------------------------------------------------------------------

    @property
    def vehicle(self) -> Vehicle | None:
        """The vehicle; None: not connected, or not decided."""
        return self._ends.vehicle

    def choose_vehicle(self) -> None:
        """Called when vehicles come and go. Without a name in the link's URL it is the only one that is
        connected; it stays so once a program was heard."""
        ends = self._ends
        live = self._live_vehicles()
        heard = any(program.messages for program in ends.programs.values())
        if ends.options.vehicle is not None:
            chosen = next((each for each in live if each.id == ends.options.vehicle), None)
        elif ends.vehicle in live and (len(live) == 1 or heard):
            chosen = ends.vehicle
        else:
            chosen = live[0] if len(live) == 1 else None
        if chosen is ends.vehicle:
            return
        self.release_vehicle()
        ends.vehicle = chosen
        if chosen is not None:
            chosen.taps += (self._from_vehicle,)

    def release_vehicle(self) -> None:
        """Lets go of the vehicle: it was removed, or another is chosen."""
        vehicle = self._ends.vehicle
        if vehicle is not None:
            vehicle.taps = tuple(tap for tap in vehicle.taps if tap != self._from_vehicle)
        self._ends.vehicle = self._endpoint = None
        self._flight.reset()

    def close(self) -> None:
        """Called when the link was removed: setpoints of its programs expire."""
        self.release_vehicle()
        for name in list(self._ends.programs):
            self.peer_gone(name)

    def _live_vehicles(self) -> list[Vehicle]:
        return [vehicle for vehicle in self._ends.station.fleet.all() if not vehicle.identity.replayed]

    def _from_vehicle(self, frame: Frame, endpoint: Endpoint) -> None:
        """Passes a message of the vehicle to the programs."""
        now_s = frame.received_monotonic_s
        if self._endpoint is not endpoint:
            if self._endpoint is not None and now_s - self._endpoint_s <= CHANGE_ROUTE_AFTER_S:
                return  # the same message has come, or will come, over the other link
            self._endpoint = endpoint
        self._endpoint_s = now_s
        if self._ros2 is not None and frame.msg_id != d.MAVLINK_MSG_ID_COMMAND_ACK:
            return
        if frame.component_id == endpoint.component_id:
            self._arriving.take(frame.msg_id, now_s)
        peers = self.connection.link.peers()
        if not peers:
            return
        if not frame.known:
            for peer in peers:
                self.connection.forward(frame, peer)
            return
        offset = TARGET_SYSTEM_OFFSET.get(frame.msg_id)
        target = (0, 0) if offset is None else (payload_byte(frame, offset), payload_byte(frame, offset + 1))
        own_system = 0 if self.vehicle is None else self.vehicle.own_ids[0]
        sender = self.connection.sender_as(frame.system_id, frame.component_id)
        for peer in peers:
            program = self._program(peer)
            if program is None or not program.rates.passes(frame.msg_id, frame.component_id, now_s):
                continue
            payload = frame.payload
            if target[0] != 0:
                if target != (own_system, program.own_component) or offset is None:
                    continue
                payload = replies.addressed(full_payload(frame), offset, program)
            elif frame.msg_id == d.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS:
                payload = replies.gimbal_status(full_payload(frame), own_system, program)
            sender.relay(frame, payload, peer)

    # --- programs -------------------------------------------------------------------------------

    def peer_gone(self, name: str) -> None:
        """Called when a peer was lost: its setpoints expire."""
        program = self._ends.programs.pop(name, None)
        if program is not None:
            self._components.append(program.own_component)
            self._flight.gone(program)

    def from_program(self, frame: Frame, peer: Peer) -> None:
        """Handles a message of a program."""
        program = self._program(peer)
        if program is None:
            return
        ends, now_s = self._ends, self._ends.now_s()
        if not program.messages:
            program.system, program.component = frame.system_id, frame.component_id
            self.choose_vehicle()
        program.messages += 1
        program.heard_s = now_s
        if program is self._flight.commanding and now_s - self._renewed_s >= RENEW_S:
            self._renewed_s = now_s
            ends.station.authority.renew(ends.principal)
        if frame.msg_id == d.MAVLINK_MSG_ID_HEARTBEAT:
            program.kind = replies.kind_of(decode(frame))
            return
        vehicle = ends.vehicle
        if vehicle is None or not _is_for(frame, vehicle):
            return
        if frame.msg_id in program_setpoints.MESSAGES:
            self._flight.take_setpoint(program, frame)
        elif self._is_within_rate(program, now_s):
            self._commands.handle(program, frame, vehicle)

    def _is_within_rate(self, program: Program, now_s: float) -> bool:
        if now_s - program.second_s >= 1.0:
            program.second_s, program.in_second = now_s, 0
        program.in_second += 1
        if program.in_second == MAX_MESSAGES_PER_S + 1:
            text = f"More than {MAX_MESSAGES_PER_S} messages came in a second; the others were not passed."
            program.refuse(self._ends.unix_s(), "messages", text)
            self._ends.tell(program, text)
        return program.in_second <= MAX_MESSAGES_PER_S

    def _program(self, peer: Peer) -> Program | None:
        programs = self._ends.programs
        program = programs.get(peer.name)
        if program is None and self._components:
            program = programs[peer.name] = Program(peer, self._components.pop())
        return program

    def resume(self) -> None:
        """Lets the program command again after it was overruled."""
        self._flight.resume()

    def tick(self) -> None:
        """Looks ten times a second what has become of the program's flight."""
        vehicle = self.vehicle
        if self._ros2 is not None and vehicle is None:
            self._ros2.serve(None, 0)
        elif self._ros2 is not None and vehicle is not None:
            self._ros2.serve(dds_address(vehicle.endpoints), vehicle.identity.system_id)
        if vehicle is not None:
            self._flight.tick(vehicle)

    def _refuse_topic(self, peer: Peer, topic: str, why: str) -> None:
        """Notes what a ROS 2 program sent and is not passed."""
        program = self._program(peer)
        if program is not None:
            program.heard_s = self._ends.now_s()
            program.refuse(self._ends.unix_s(), topic, f"{topic}: {why}")

    def take_event(self, event: Event) -> None:
        """Tells the programs what becomes of their client's control."""
        vehicle = self.vehicle
        concerned = (event.data or {}).get("previous_key"), (event.data or {}).get("to_key")
        is_control = vehicle is not None and event.vehicle == vehicle.id and event.kind == "control"
        if is_control and self._ends.principal.key in concerned:
            self._ends.tell_all(event.text)

    # --- view -----------------------------------------------------------------------------------

    @property
    def paused(self) -> str | None:
        """Who has overruled the program; None: nobody."""
        return self._flight.paused

    @property
    def client(self) -> str:
        """Name of the programs as a client."""
        return self._ends.principal.name

    def view(self) -> GuardView:
        """The guard as the API shows it."""
        ends, commanding = self._ends, self._flight.commanding
        programs = sorted(ends.programs.values(), key=lambda each: each is not commanding)
        return GuardView(
            self.connection.name,
            shown_url(self.connection.link.url),
            None if ends.vehicle is None else ends.vehicle.id,
            ends.options.control,
            ends.principal.name,
            ends.principal.key,
            ends.options.valid_for_s,
            ends.options.on_expiry,
            ends.options.same_for_s,
            self.problem(),
            self.paused,
            self._flight.flying,
            tuple(each.view(ends.now_s(), each is commanding) for each in programs),
        )

    def problem(self) -> str | None:
        """Why programs cannot fly now; None: they can."""
        detail = self.connection.info().detail
        if detail and (self._ros2 is None or self.vehicle is not None):
            return detail
        vehicle, wanted = self.vehicle, self._ends.options.vehicle
        if vehicle is not None:
            return f"The connection to vehicle {vehicle.id} is lost." if vehicle.link_lost else None
        if wanted is not None:
            return f"Vehicle {wanted} is not connected."
        count = len(self._live_vehicles())
        if not count:
            return "No vehicle is connected."
        return f"{count} vehicles are connected: name one in the link's URL (vehicle=ID)."


def _is_for(frame: Frame, vehicle: Vehicle) -> bool:
    """Whether a message is for this vehicle: a direct link to it would carry no other."""
    offset = TARGET_SYSTEM_OFFSET.get(frame.msg_id)
    return offset is None or payload_byte(frame, offset) in (0, vehicle.identity.system_id)
