"""Exceptions of the client: refusals of the server or the vehicle, and missing responses.

ApiError                    any response that is not a success
├── NotAllowed              401, 403: the token is missing or wrong, or the request is not permitted
├── Invalid                 422: a field is missing, not finite or out of range
├── Unknown                 404: no such vehicle, link or parameter
├── Refused                 409: the server's checks or the vehicle refused, with the vehicle's reasons
│   └── NotInControl        409: another client has control of the vehicle
└── NoReply                 504: the vehicle did not reply
Unreachable                 the server itself did not respond
Timeout                     a condition did not become true in time
"""

from __future__ import annotations

from typing import NoReturn

import httpx


class ApiError(Exception):
    """An error response (problem+json) of the server."""

    def __init__(self, status: int, problem: dict[str, object]) -> None:
        reasons = problem.get("reasons")
        self.status = status
        self.code = str(problem.get("code", "error"))
        self.detail = str(problem.get("detail", problem.get("title", f"HTTP {status}")))
        self.remedy = str(problem["remedy"]) if problem.get("remedy") else None
        self.reasons = [str(reason) for reason in reasons] if isinstance(reasons, list) else []
        """Texts from the vehicle."""
        self.field = str(problem["field"]) if problem.get("field") else None
        super().__init__(" ".join(part for part in (self.detail, self.remedy) if part))


class NotAllowed(ApiError):
    """The token is missing or wrong (`Gcs(token=…)`, `GCS_TOKEN`), or the request is not permitted."""


class Invalid(ApiError):
    """A value is invalid; `field` is its path in the request."""


class Unknown(ApiError):
    """There is no such vehicle, link or parameter."""


class Refused(ApiError):
    """The server's checks or the vehicle refused."""


class NotInControl(Refused):
    """Another client has control of the vehicle; `holder` is the name of that client."""

    def __init__(self, status: int, problem: dict[str, object]) -> None:
        super().__init__(status, problem)
        self.holder = str(problem.get("holder", ""))
        self.holder_key = str(problem.get("holder_key", ""))
        """Distinguishes clients with the same name."""


class NoReply(ApiError):
    """The vehicle did not reply in time."""


class Unreachable(Exception):
    """The server did not respond; the request may or may not have been executed."""


class Timeout(Exception):
    """A condition did not become true in time."""


_ERROR_BY_STATUS: dict[int, type[ApiError]] = {
    401: NotAllowed,
    403: NotAllowed,
    404: Unknown,
    409: Refused,
    422: Invalid,
    504: NoReply,
}


_STATUS_BY_CODE = {"invalid_request": 422, "unknown_vehicle": 404, "disconnected": 503, "no_reply": 504}


def raise_problem(problem: dict[str, object]) -> NoReturn:
    """Raises the `ApiError` for a problem inside another document, such as an operation."""
    code = str(problem.get("code"))
    sent_status = problem.get("status")
    status = sent_status if isinstance(sent_status, int) else _STATUS_BY_CODE.get(code, 409)
    error_type = NotInControl if code == "not_in_control" else _ERROR_BY_STATUS.get(status, ApiError)
    raise error_type(status, problem)


def raise_for(response: httpx.Response) -> None:
    """Raises the `ApiError` for an unsuccessful response."""
    if response.is_success:
        return
    try:
        body: object = response.json()
    except ValueError:
        body = response.text or response.reason_phrase
    problem: dict[str, object] = dict(body) if isinstance(body, dict) else {"detail": str(body)}
    if problem.get("code") == "not_in_control":
        raise NotInControl(response.status_code, problem)
    raise _ERROR_BY_STATUS.get(response.status_code, ApiError)(response.status_code, problem)
