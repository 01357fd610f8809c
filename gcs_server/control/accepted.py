"""Runs a command: checks the requirements in the command table, opens its ticket, measures the duration, and
writes a journal line."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Protocol

from gcs_server.clock import Clock
from gcs_server.control.authority import Authority
from gcs_server.control.commands import BY_NAME
from gcs_server.control.journal import Journal
from gcs_server.control.principal import Principal
from gcs_server.errors import GcsError
from gcs_server.plain import plain
from gcs_server.vehicle.fleet import Fleet
from gcs_server.vehicle.tickets import Ticket

SETPOINT_LINE_PERIOD_S = 1.0
MAX_SETPOINT_STREAMS = 1000
SETPOINT = "offboard/setpoint"


class Commanded(Protocol):
    """The parts of the running server that a command needs."""

    clock: Clock
    fleet: Fleet
    authority: Authority
    journal: Journal
    setpoint_lines: dict[tuple[str, str, str], tuple[float, int]]
    """Time of the last journal line and number of setpoints since then, by client key, vehicle and result."""


class AcceptedCommand:
    """A command that was accepted."""

    duration_s: float = 0.0
    """Set at the end of the block of `authorized_command`."""

    def __init__(self, ticket: Ticket | None) -> None:
        self._ticket = ticket

    @property
    def ticket(self) -> Ticket:
        """The command's ticket; only commands that move or stop a vehicle have one."""
        assert self._ticket is not None
        return self._ticket


@contextmanager
def authorized_command(
    station: Commanded,
    principal: Principal,
    name: str,
    vehicle_id: str | None,
    arguments: dict[str, object] | Callable[[], dict[str, object]],
    *,
    refusal: GcsError | None = None,
) -> Generator[AcceptedCommand]:
    """Wraps every command: checks control as the command table requires, opens the command's ticket, and
    writes the result to the journal.

    Args:
        station: the running server.
        principal: the caller.
        name: the command's row in `control/commands.py`.
        vehicle_id: the commanded vehicle; None for commands to no vehicle or to several.
        arguments: arguments of the command, written to the journal; or returns them if they are written.
        refusal: error of an earlier check; raised here, so that the journal contains the refusal.

    Raises:
        NotInControl: another client has control of the vehicle.
    """
    command = BY_NAME[name]
    began_s = station.clock.monotonic_s()
    accepted = AcceptedCommand(None)
    ticket: Ticket | None = None
    result, detail = "ok", None
    try:
        if refusal is not None:
            raise refusal
        if vehicle_id is not None:
            station.authority.admit(principal, command, vehicle_id)
            if command.acts != "no":
                key = principal.key if command.control == "lease" else None
                ticket = station.fleet.get(vehicle_id).tickets.open(command.label or name, key)
                accepted = AcceptedCommand(ticket)
        yield accepted
        if vehicle_id is not None:
            station.authority.report_command(principal, command, vehicle_id)
    except GcsError as error:
        result, detail = error.code, str(error)
        raise
    except asyncio.CancelledError:
        result, detail = "cancelled", "The client disconnected or the server was shut down."
        raise
    except Exception as error:
        result, detail = "internal", f"{type(error).__name__}: {error}"
        raise
    finally:
        if ticket is not None:
            ticket.close()
        accepted.duration_s = station.clock.monotonic_s() - began_s
        outcome = (result, detail, accepted.duration_s)
        if name == SETPOINT and result in ("ok", "not_in_control"):
            _write_setpoint_line(station, principal, vehicle_id or "", arguments, outcome)
        else:
            written = arguments() if callable(arguments) else arguments
            station.journal.add(principal.name, name, vehicle_id, plain(written), *outcome)


def _write_setpoint_line(
    station: Commanded,
    principal: Principal,
    vehicle_id: str,
    arguments: dict[str, object] | Callable[[], dict[str, object]],
    outcome: tuple[str, str | None, float],
) -> None:
    """Writes one journal line per second for a stream of setpoints: the newest setpoint, and the number of
    setpoints since the last line."""
    now_s = station.clock.monotonic_s()
    # The number of entries is limited, because a caller may change its name for each request.
    if len(station.setpoint_lines) >= MAX_SETPOINT_STREAMS:
        station.setpoint_lines.clear()
    key = (principal.key, vehicle_id, outcome[0])
    last_s, count = station.setpoint_lines.get(key, (float("-inf"), 0))
    if now_s - last_s < SETPOINT_LINE_PERIOD_S:
        station.setpoint_lines[key] = (last_s, count + 1)
        return
    station.setpoint_lines[key] = (now_s, 0)
    written = arguments() if callable(arguments) else arguments
    line: dict[str, object] = {**plain(written), "setpoints_since_last_line": count + 1}
    station.journal.add(principal.name, SETPOINT, vehicle_id, line, *outcome)
