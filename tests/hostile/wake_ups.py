"""A process that wakes up 50 times a second and does nothing else: the longest gap between its
wake-ups shows the delay that the machine itself causes."""

from __future__ import annotations

import select
import subprocess
import sys
import time

from gcs_server.streamer.process.worker import request_priority

WAKE_UP_PERIOD_S = 0.02
"""Equal to the period of the setpoints."""


class WakeUpMeter:
    """Runs from its creation until `stop`.

    Args:
        priority: of the stream process (`stream`), or the usual one (`usual`), as the server has.
    """

    def __init__(self, priority: str = "stream") -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.hostile.wake_ups", priority],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )

    def stop(self) -> float:
        """Ends the process; returns the longest time [s] between two wake-ups."""
        output, _ = self._process.communicate(b"\n", timeout=30)
        return float(output)


def main(priority: str) -> None:
    """Prints the longest time [s] between two wake-ups when its input ends."""
    if priority == "stream":
        request_priority()
    longest_s, next_s, last_s = 0.0, time.monotonic(), time.monotonic()
    while not select.select([sys.stdin], [], [], max(0.0, next_s - time.monotonic()))[0]:
        now_s = time.monotonic()
        longest_s, last_s, next_s = (
            max(longest_s, now_s - last_s),
            now_s,
            max(next_s + WAKE_UP_PERIOD_S, now_s),
        )
    print(longest_s)


if __name__ == "__main__":
    main(*sys.argv[1:])
