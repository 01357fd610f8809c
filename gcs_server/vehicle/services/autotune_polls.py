"""When PX4's autotune may be asked for its progress. Pure: the caller tells the time.

PX4 (v1.13 to v1.18) reports progress and result of its autotune only in the acknowledgement of the command
that starts it. While it runs, the command changes nothing; once it has ended it keeps its result for 2 s, and
then the same command starts it again. So a request is sent only if it must arrive before that: within 2 s,
less a margin for the way, of a time at which autotune certainly had not ended. That is when the oldest
request was sent that the last answer may belong to, as acknowledgements do not say which they answer. Without
an answer in that time nothing is sent any more.

An answer is assumed to arrive within `PERIOD_S` of its request, and a request within `MARGIN_S`; over a
slower link all answers come too late to ask again.
"""

from __future__ import annotations

import math
from typing import Final

RESULT_KEPT_S: Final = 2.0
"""Time for which PX4 keeps the result before the command starts autotune again [s]."""
MARGIN_S: Final = 0.5
PERIOD_S: Final = 0.5
RETRY_AFTER_S: Final = 0.2
RETRY_S: Final = 0.1
"""A request without an answer is sent again after `RETRY_AFTER_S`, and then with this period [s]."""
LATE_S: Final = 0.5
"""An answer may arrive so long after the last request [s]."""


class AutotunePolls:
    """The requests to one run of autotune, beginning with the command that starts it.

    Args:
        now_s: time of the start command [s, monotonic]; autotune cannot have ended before.
    """

    def __init__(self, now_s: float) -> None:
        self._running_s = self._next_s = now_s
        self._first_unanswered_s: float | None = None
        self._sent_s = now_s

    @property
    def until_s(self) -> float:
        """A request must not be sent later [s, monotonic]."""
        return self._running_s + RESULT_KEPT_S - MARGIN_S

    @property
    def next_s(self) -> float:
        """When the next request is due [s, monotonic]; infinite: none may be sent any more."""
        return self._next_s if self._next_s <= self.until_s else math.inf

    @property
    def silent_s(self) -> float:
        """From when no answer is to be expected any more [s, monotonic]."""
        return self.until_s + LATE_S

    def sent(self, now_s: float) -> None:
        """A request was sent."""
        retries = self._first_unanswered_s is not None
        if self._first_unanswered_s is None:
            self._first_unanswered_s = now_s
        self._sent_s = now_s
        self._next_s = now_s + (RETRY_S if retries else RETRY_AFTER_S)

    def answered(self, now_s: float) -> None:
        """The vehicle has answered that autotune runs."""
        if self._first_unanswered_s is not None:  # otherwise a second answer, which says nothing new
            self._running_s = self._first_unanswered_s
            self._first_unanswered_s = None
            # By then the answers to all that was sent have arrived; none is taken for that of the next one.
            self._next_s = self._sent_s + PERIOD_S
