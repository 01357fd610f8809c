"""Runs a command: checks the requirements in the command table, measures the duration, and writes a journal
line."""

from __future__ import annotations

import asyncio
from collections.abc import Generator
from contextlib import contextmanager

from gcs_server.api.station import Station
from gcs_server.control.commands import BY_NAME
from gcs_server.control.principal import Principal
from gcs_server.errors import GcsError, NotInControl
from gcs_server.telemetry.wire import plain
from gcs_server.vehicle.services.transaction import ReportProgress
from gcs_server.vehicle.vehicle import Vehicle

SETPOINT_LINE_PERIOD_S = 1.0
MAX_SETPOINT_STREAMS = 1000
SETPOINT = "offboard/setpoint"
DEBUG = 7
"""MAV_SEVERITY of progress events."""


def progress_reporter(vehicle: Vehicle, principal: Principal, command: str) -> ReportProgress:
    """Returns a function that sends the progress of a command to all telemetry clients. Progress is not
    stored as an event."""

    def report(text: str, fraction: float | None) -> None:
        data: dict[str, object] = {
            "command": command,
            "client": principal.name,
            "client_key": principal.key,
            "fraction": fraction,
        }
        vehicle.events.add("progress", vehicle.clock.unix_s(), text, severity=DEBUG, data=data, stored=False)

    return report


class CommandDuration:
    """The duration of a command; set at the end of the block of `authorized_command`."""

    duration_s: float = 0.0


@contextmanager
def authorized_command(
    station: Station,
    principal: Principal,
    name: str,
    vehicle_id: str | None,
    arguments: dict[str, object],
    *,
    refusal: NotInControl | None = None,
) -> Generator[CommandDuration]:
    """Wraps every command: checks control as the command table requires, and writes the result to the
    journal.

    Args:
        station: the running server.
        principal: the caller.
        name: the command's row in `control/commands.py`.
        vehicle_id: the commanded vehicle; None for commands to no vehicle or to several.
        arguments: arguments of the command, written to the journal.
        refusal: error of an earlier check; raised here, so that the journal contains the refusal.

    Raises:
        NotInControl: another client has control of the vehicle.
    """
    command = BY_NAME[name]
    began_s = station.clock.monotonic_s()
    duration = CommandDuration()
    result, detail = "ok", None
    try:
        if refusal is not None:
            raise refusal
        if vehicle_id is not None:
            station.authority.admit(principal, command, vehicle_id)
        yield duration
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
        duration.duration_s = station.clock.monotonic_s() - began_s
        outcome = (result, detail, duration.duration_s)
        if name == SETPOINT and result in ("ok", "not_in_control"):
            _write_setpoint_line(station, principal, vehicle_id or "", arguments, outcome)
        else:
            station.journal.add(principal.name, name, vehicle_id, plain(arguments), *outcome)


def _write_setpoint_line(
    station: Station,
    principal: Principal,
    vehicle_id: str,
    arguments: dict[str, object],
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
    arguments = {**plain(arguments), "setpoints_since_last_line": count + 1}
    station.journal.add(principal.name, SETPOINT, vehicle_id, arguments, *outcome)
