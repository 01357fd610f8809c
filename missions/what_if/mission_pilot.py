"""Flies an offboard mission on from a logged moment: the runner of real flights, and a person who answers its
questions after the time that it took in the log."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from missions.dry_run.fleet import Vehicle
from missions.dry_run.offboard import OffboardPilot, send
from missions.dry_run.pilot import Step
from missions.frames import Vector3
from missions.offboard.segments import CurveSegment, HoldSegment, Segment
from missions.runner.requests import Notify, Request
from missions.runner.runner import Runner
from missions.setpoints import Position
from missions.what_if.flight import LoggedFlight
from vehicle_sim.autopilot.modes import NavState

AT_WAIT_M, AT_WAIT_M_S = 0.02, 0.1
"""A logged setpoint so near to the place of a wait, and so slow, waits there."""
SAMPLE_S = 0.02


class Answers:
    """When a person answered the questions of a logged mission.

    Args:
        flight: the logged flight.
        from_s: the moment [s since the log's start].
    """

    def __init__(self, flight: LoggedFlight, from_s: float) -> None:
        self._flight, self._next = flight, flight.first_after(from_s)

    def stayed_s(self, place_ned_m: Vector3) -> float:
        """How long the logged setpoints next stayed at a place [s]; 0: they did not."""
        rest = slice(self._next, None)
        targets, t_s = self._flight.target_position_ned_m[rest], self._flight.t_s[rest]
        speed_m_s = np.linalg.norm(np.nan_to_num(self._flight.target_velocity_ned_m_s[rest]), axis=1)
        near = np.linalg.norm(targets - np.array(place_ned_m), axis=1) < AT_WAIT_M
        waits = near & (speed_m_s < AT_WAIT_M_S)
        if not waits.any():
            return 0.0
        begin = int(waits.argmax())
        left = ~near[begin:]
        end = begin + (int(left.argmax()) if left.any() else len(left) - 1)
        self._next += end
        return float(t_s[end] - t_s[begin])


class MissionPilot(OffboardPilot):
    """Flies on with a mission.

    Args:
        vehicle: the vehicle, at its home.
        runner: at the moment.
        home_ned_m: home in the mission's local frame.
        answers: of this flight.
        say: gets the time [s] and the text of each warning of the mission.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        runner: Runner,
        home_ned_m: Vector3,
        answers: Answers,
        say: Callable[[float, str], None],
    ) -> None:
        super().__init__(vehicle, runner, home_ned_m, alone=False)
        self._answer_log, self._say = answers, say
        self._answer_at_s: float | None = None

    def stream_hover(self) -> None:
        """Sends the present position as a setpoint, without which PX4 does not switch to Offboard."""
        estimate = self._vehicle.autopilot.view.estimate
        hover = Position(estimate.position_ned_m, estimate.yaw_ned_rad)
        send(self._vehicle.autopilot.offboard, hover, (0.0, 0.0, 0.0))

    def fly_on(self, now_s: float) -> None:
        """Begins in Offboard, in flight. Raises CannotDo as `Runner.start`."""
        self._stream, self._commanded = "flying", NavState.OFFBOARD
        self.begin(now_s, self.runner.start(now_s, self.reading()))
        segment = self.runner.segment
        if segment is not None:
            self.step = Step(segment.place, segment.title, None)
        self._send(now_s)

    def tick(self, now_s: float) -> None:
        super().tick(now_s)
        if self.runner.question is None:
            self._answer_at_s = None

    def _answers(self, now_s: float) -> bool:
        if self._answer_at_s is None:
            segments, n = self.runner.flight.course.segments, self.runner.flight.index
            stayed_s = self._answer_log.stayed_s(segments[n].end_ned_m)
            self._answer_at_s = now_s + max(0.0, stayed_s - _stood_s(segments[:n]))
        return now_s >= self._answer_at_s

    def _execute_request(self, now_s: float, request: Request) -> str | None:
        if isinstance(request, Notify) and request.warning:
            self._say(now_s, request.text)
        return super()._execute_request(now_s, request)


def _stood_s(segments: Sequence[Segment]) -> float:
    """How long the setpoints already stand at the end of these segments [s]: holds, and the end of a path."""
    stood_s = 0.0
    for segment in reversed(segments):
        if isinstance(segment, CurveSegment):
            t_s = np.arange(segment.duration_s, 0.0, -SAMPLE_S)
            samples = segment.curve.sample(t_s)
            away_m = np.linalg.norm(samples.position_ned_m - np.array(segment.end_ned_m), axis=1)
            speed_m_s = np.linalg.norm(samples.velocity_ned_m_s, axis=1)
            moves = (away_m >= AT_WAIT_M) | (speed_m_s >= AT_WAIT_M_S)
            return stood_s + SAMPLE_S * float(moves.argmax() if moves.any() else len(moves))
        if not isinstance(segment, HoldSegment):
            break
        stood_s += segment.duration_s
    return stood_s
