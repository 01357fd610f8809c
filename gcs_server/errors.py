"""The tree of all errors; `api/problems.py` converts them to HTTP.

    GcsError
    ├── LinkError                a port, a socket, a serial device
    ├── UnknownVehicle           no vehicle with this id
    ├── UnknownLink              no link with this name
    ├── UnknownGroup             no group with this id
    ├── UnknownOperation         no operation with this id (or it was dropped)
    ├── UnknownPlan              no plan with this id, or no such version of the plan
    ├── UnknownDryRun            no dry run with this id (or it was dropped)
    ├── UnknownProof             no proof with this id (or it was dropped)
    ├── PlanConflict             another client saved the plan meanwhile
    ├── UnknownRecording         no recording or replay with this name
    ├── RecordingUnusable        a recording that cannot be read
    ├── UnknownFlight            no file of a flight with this id
    ├── LogUnusable              a log that cannot be read
    ├── InvalidRequest           the request is invalid; names the field
    ├── NotPermitted             the caller's role does not include the command
    ├── Refused                  a check of this server refused the command; nothing was sent
    │   ├── NotVerified          commands are not verified for this autopilot or airframe
    │   ├── NotInControl         another client has control of the vehicle
    │   ├── PlanFindings         a plan has errors that the caller has not accepted
    │   ├── ClientHasTooMany     too much work of one client is running or waiting
    │   ├── ServerBusy           too much work of all clients is waiting
    │   ├── NotYet               the vehicle has not reported yet what the command needs
    │   ├── Interrupted          a later command, or the end of its client's control, ended the command
    │   └── NotTogether          a group cannot fly: a vehicle cannot join, or two come too close
    ├── Rejected                 the vehicle refused, with its reasons
    ├── NoReply                  the vehicle did not reply within the deadline
    └── Disconnected             link or vehicle was lost while a reply was awaited

`str(error)` is a message for the operator: what happened, why, and what to do.
"""

from __future__ import annotations

from collections.abc import Iterable

MAX_REASONS = 12
MAX_REASON_LENGTH = 300


def bounded_reasons(reasons: Iterable[str]) -> tuple[str, ...]:
    """Limits the number and the length of reasons, which may come from a vehicle."""
    texts = [text if len(text) <= MAX_REASON_LENGTH else f"{text[:MAX_REASON_LENGTH]}…" for text in reasons]
    excess = len(texts) - MAX_REASONS
    return (*texts[:MAX_REASONS], f"and {excess} more") if excess > 0 else tuple(texts)


class GcsError(Exception):
    """Base class of all errors that a caller may get."""

    code = "error"

    def __init__(self, message: str, *, remedy: str | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.remedy = remedy
        """What the operator can do about it, as a sentence."""

    def details(self) -> dict[str, object]:
        """Additional fields for problem+json."""
        return {}


class LinkError(GcsError):
    """A link could not be opened or used."""

    code = "link_error"


class UnknownVehicle(GcsError):
    """No vehicle has this id."""

    code = "unknown_vehicle"

    def __init__(self, vehicle_id: str, known_ids: list[str]) -> None:
        super().__init__(
            f"There is no vehicle {vehicle_id!r}.",
            remedy=f"Known vehicles: {', '.join(known_ids)}."
            if known_ids
            else "No vehicle has connected yet.",
        )
        self.vehicle_id = vehicle_id

    def details(self) -> dict[str, object]:
        return {"vehicle": self.vehicle_id}


class UnknownLink(GcsError):
    """No link has this name."""

    code = "unknown_link"


class UnknownGroup(GcsError):
    """No group has this id."""

    code = "unknown_group"


class UnknownOperation(GcsError):
    """No operation has this id, or it was dropped."""

    code = "unknown_operation"


class UnknownPlan(GcsError):
    """No plan has this id, or the plan has no such version."""

    code = "unknown_plan"


class UnknownDryRun(GcsError):
    """No dry run has this id, or it was dropped."""

    code = "unknown_dry_run"


class UnknownProof(GcsError):
    """No proof of gains has this id, or it was dropped."""

    code = "unknown_proof"


class PlanConflict(GcsError):
    """The plan has a newer version than the version that the caller changed; nothing was saved."""

    code = "conflict"

    def __init__(
        self,
        plan_id: str,
        name: str,
        version: int,
        changed_by: str,
        changed_unix_s: float,
        base_version: int,
    ) -> None:
        super().__init__(
            f"Plan {name!r} is at version {version}, saved by {changed_by}; yours is based on version "
            f"{base_version}. Nothing was saved.",
            remedy=f"Open version {version} and make your changes again, or save yours as a new plan.",
        )
        self.plan_id, self.version = plan_id, version
        self.changed_by, self.changed_unix_s = changed_by, changed_unix_s

    def details(self) -> dict[str, object]:
        return {
            "plan": self.plan_id,
            "version": self.version,
            "changed_by": self.changed_by,
            "changed_unix_s": self.changed_unix_s,
        }


class UnknownRecording(GcsError):
    """No recording, or no replay, has this name."""

    code = "unknown_recording"


class RecordingUnusable(GcsError):
    """Nothing can be read in this recording."""

    code = "recording_unusable"


class UnknownFlight(GcsError):
    """No file of a flight has this id."""

    code = "unknown_flight"


class LogUnusable(GcsError):
    """A log cannot be read."""

    code = "log_unusable"


class InvalidRequest(GcsError):
    """A value is missing, not finite or out of range."""

    code = "invalid_request"

    def __init__(self, field: str, message: str, *, remedy: str | None = None) -> None:
        super().__init__(message, remedy=remedy)
        self.field = field

    def details(self) -> dict[str, object]:
        return {"field": self.field}


class NotPermitted(GcsError):
    """The caller's role does not include the command; control of the vehicle does not matter."""

    code = "not_permitted"

    def __init__(self, caller: str, command: str, permission: str) -> None:
        super().__init__(
            f"{caller} may not use {command!r}: its role does not include {permission!r}. Nothing was sent.",
            remedy="Ask a person with a role that includes it.",
        )
        self.permission = permission

    def details(self) -> dict[str, object]:
        return {"permission": self.permission}


class Refused(GcsError):
    """A check of this server refused the command; nothing was sent."""

    code = "refused"


class NotYet(Refused):
    """The vehicle has not reported yet what the command needs, and may still do so."""


class ClientHasTooMany(Refused):
    """Too much work of this client is running or waiting."""

    code = "too_many_requests"


class ServerBusy(Refused):
    """Too much work of all clients is waiting."""

    code = "server_busy"


class NotVerified(Refused):
    """Commands are not verified for this type of vehicle."""

    code = "not_verified"


class NotInControl(Refused):
    """Another client has control of the vehicle."""

    code = "not_in_control"

    def __init__(self, vehicle_id: str, *, holder: str, holder_key: str, can_be_asked: bool) -> None:
        advice = (
            "Request control (control/request); the client in control may grant it."
            if can_be_asked
            else "The client in control cannot be asked (it receives no telemetry): wait until it releases "
            "control, or take control by force (control/take with force)."
        )
        super().__init__(
            f"{holder} has control of vehicle {vehicle_id}, not you: nothing was sent.",
            remedy=f"{advice} Hold, Land now and Stop motors need no control.",
        )
        self.holder = holder
        self.holder_key = holder_key

    def details(self) -> dict[str, object]:
        return {"holder": self.holder, "holder_key": self.holder_key}


class PlanFindings(Refused):
    """A plan has error findings that the caller has not accepted."""

    code = "plan_findings"

    def __init__(
        self,
        message: str,
        *,
        codes: tuple[str, ...],
        reasons: tuple[str, ...] = (),
        remedy: str | None = None,
    ) -> None:
        super().__init__(f"{message} Nothing was sent.", remedy=remedy)
        self.codes = codes
        self.reasons = bounded_reasons(reasons)

    def details(self) -> dict[str, object]:
        return {"codes": list(self.codes), "reasons": list(self.reasons) or None}


class ChangesRefused(Refused):
    """Some of several changes cannot be made, so none was made."""

    code = "changes_refused"

    def __init__(self, message: str, *, reasons: tuple[str, ...], remedy: str | None = None) -> None:
        super().__init__(f"{message} Nothing was written.", remedy=remedy)
        self.reasons = bounded_reasons(reasons)

    def details(self) -> dict[str, object]:
        return {"reasons": list(self.reasons)}


class Interrupted(Refused):
    """The command ended before its result, because a later command was accepted, its client lost control or
    disconnected, or the vehicle was removed. Nothing more is sent for it."""

    code = "interrupted"

    def __init__(self, reason: str) -> None:
        super().__init__(reason, remedy="Check the vehicle's state before you repeat the command.")


class NotTogether(Refused):
    """A group cannot fly as requested; none of its vehicles moves."""

    code = "not_together"

    def __init__(
        self,
        message: str,
        *,
        vehicles: tuple[str, ...],
        distance_m: float | None = None,
        reasons: tuple[str, ...] = (),
        remedy: str | None = None,
    ) -> None:
        super().__init__(message, remedy=remedy)
        self.vehicles = vehicles
        """The vehicles that cause the refusal."""
        self.distance_m = distance_m
        """Predicted distance of two vehicles that would come too close [m]; None: another cause."""
        self.reasons = bounded_reasons(reasons)

    def details(self) -> dict[str, object]:
        return {
            "vehicles": list(self.vehicles),
            "distance_m": self.distance_m,
            "reasons": list(self.reasons) or None,
        }


class Rejected(GcsError):
    """The vehicle refused, as shown by its acknowledgement or its state."""

    code = "rejected"

    def __init__(
        self,
        message: str,
        *,
        mav_result: int | None = None,
        reasons: tuple[str, ...] = (),
        remedy: str | None = None,
    ) -> None:
        super().__init__(message, remedy=remedy)
        self.mav_result = mav_result
        """MAV_RESULT of the acknowledgement; None if the vehicle's state showed the refusal."""
        self.reasons = bounded_reasons(reasons)
        """Texts of the vehicle: status texts and events that came with the refusal."""

    def details(self) -> dict[str, object]:
        return {"mav_result": self.mav_result, "reasons": list(self.reasons)}


class NoReply(GcsError):
    """The vehicle did not reply within the deadline."""

    code = "no_reply"

    def __init__(self, message: str, *, deadline_s: float, remedy: str | None = None) -> None:
        super().__init__(message, remedy=remedy)
        self.deadline_s = deadline_s

    def details(self) -> dict[str, object]:
        return {"deadline_s": self.deadline_s}


class Disconnected(GcsError):
    """The link was closed or the vehicle was lost while a reply was awaited."""

    code = "disconnected"
