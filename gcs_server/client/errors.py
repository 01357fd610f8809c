"""What a call may raise, with the server's own words."""

from __future__ import annotations

from typing import Any


class GcsClientError(Exception):
    """Root of all errors of this client."""


class Unreachable(GcsClientError):
    """The server did not answer: the command may or may not have reached the vehicle."""


class RequestFailed(GcsClientError):
    """The server answered with a problem; `str()` is what happened, why, and what to do."""

    def __init__(self, status: int, body: dict[str, Any]) -> None:
        self.status = status
        self.code = str(body.get("code", f"http_{status}"))
        self.detail = str(body.get("detail", f"The server answered {status}."))
        self.remedy: str | None = body.get("remedy")
        self.field: str | None = body.get("field")
        self.reasons: tuple[str, ...] = tuple(body.get("reasons") or ())
        """The vehicle's own words."""
        parts = [self.detail, *(r for r in self.reasons if r not in self.detail), self.remedy or ""]
        super().__init__(" ".join(part for part in parts if part))


class Refused(RequestFailed):
    """409: this server or the vehicle said no."""


class Invalid(RequestFailed):
    """422: a value is missing, not finite or out of range; `field` names it."""


class NotFound(RequestFailed):
    """404: no such vehicle or link."""


class NoReply(RequestFailed):
    """503 and 504: the vehicle did not answer or was lost."""


class GaveUp(GcsClientError):
    """What was waited for did not come in time."""


_BY_STATUS: dict[int, type[RequestFailed]] = {
    404: NotFound,
    409: Refused,
    422: Invalid,
    503: NoReply,
    504: NoReply,
}


def failed(status: int, body: object) -> RequestFailed:
    """The exception for an answer."""
    kind = _BY_STATUS.get(status, RequestFailed)
    return kind(status, body if isinstance(body, dict) else {})
