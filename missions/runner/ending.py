"""Whether a runner still flies its mission, why not, and what people are told of it."""

from __future__ import annotations

from missions.runner.requests import Request, Tell


class Ending:
    """The part of a runner that knows how it ends; what is to be done is collected here too."""

    def __init__(self) -> None:
        self._over: str | None = None
        self._reason: str | None = None
        self._suspended = False
        self._paused_in_hold = False
        """Suspended because a person paused it during take-off or landing."""
        self._out: list[Request] = []

    @property
    def over(self) -> bool:
        """Whether it is done, aborted or stopped."""
        return self._over is not None

    @property
    def left_early(self) -> str | None:
        """Why it flies its mission no more though that is not done; None: it does, or it is done."""
        if self._over in ("aborted", "stopped") or (self._suspended and not self._paused_in_hold):
            return self._reason or "It was interrupted"
        return None

    def _taken(self) -> list[Request]:
        out, self._out = self._out, []
        return out

    def _suspend(self, reason: str) -> None:
        self._paused_in_hold = False
        self._suspended, self._reason = True, reason
        self._tell("suspended", f"{reason}.", warning=True)

    def _end(self, how: str, reason: str | None) -> None:
        self._over, self._reason = how, reason
        self._tell(how, f"{reason}." if reason else "The mission is done.", warning=how == "stopped")

    def _tell(self, code: str, text: str, *, warning: bool = False) -> None:
        self._out.append(Tell(code, text, warning))
