"""Ends and suspends a mission, and notifies the pilot of the reason or of a payload failure."""

from __future__ import annotations

from missions.runner.requests import Notify, Photo, Request
from missions.runner.status import CannotDo


class Ending:
    """Base class of the runner: its end, its suspension, and the requests collected in one update."""

    def __init__(self) -> None:
        self._final_state: str | None = None
        self._reason: str | None = None
        self._suspended = False
        self._paused_in_hold = False
        """Whether the mission is suspended because the operator paused it during take-off or landing."""
        self._requests: list[Request] = []
        self._reported_payload_failures: set[str] = set()

    @property
    def over(self) -> bool:
        """Whether the mission is done, aborted or stopped."""
        return self._final_state is not None

    @property
    def early_end_reason(self) -> str | None:
        """The reason why the mission ended early or is suspended; None: it is active, paused or done."""
        if self._final_state in ("aborted", "stopped") or (self._suspended and not self._paused_in_hold):
            return self._reason or "The mission was interrupted"
        return None

    def _take_requests(self) -> list[Request]:
        requests, self._requests = self._requests, []
        return requests

    def _suspend(self, reason: str) -> None:
        self._paused_in_hold = False
        self._suspended, self._reason = True, reason
        self._notify("suspended", f"{reason}.", warning=True)

    def _end(self, state: str, reason: str | None) -> None:
        self._final_state, self._reason = state, reason
        self._notify(state, f"{reason}." if reason else "The mission is done.", warning=state == "stopped")

    def _notify(self, code: str, text: str, *, warning: bool = False) -> None:
        self._requests.append(Notify(code, text, warning))

    def _payload_failed(self, request: Request, text: str) -> None:
        failure = "A photo was not taken" if isinstance(request, Photo) else "The gimbal did not follow"
        if failure not in self._reported_payload_failures:
            self._reported_payload_failures.add(failure)
            self._notify("payload", f"{failure}: {text}. The mission continues.", warning=True)

    def _require_not_over(self, verb: str) -> None:
        if self._final_state is not None:
            raise CannotDo(f"the mission has ended: there is nothing to {verb}", "Start the mission again.")
