"""Coordinates the runners of a mission of several vehicles: they continue from each meeting at the same time,
and end at the same time.

Each role's runner flies its own vehicle. `GroupRunner` is updated after all runners. If one vehicle leaves
the mission early, or does not follow its setpoints, all other vehicles hold and the mission ends. If one
vehicle is paused, all vehicles are paused.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from missions.runner.reading import Reading
from missions.runner.requests import CannotDo, Request
from missions.runner.runner import Runner

Requests = dict[str, list[Request]]
"""Requests of each runner, by role."""


class GroupRunner:
    """All roles of one mission.

    Args:
        runners: the runners, by role.
    """

    def __init__(self, runners: Mapping[str, Runner]) -> None:
        self.runners = dict(runners)

    @property
    def over(self) -> bool:
        """Whether all roles have ended."""
        return all(runner.over for runner in self.runners.values())

    def start(self, now_s: float, readings: Mapping[str, Reading]) -> Requests:
        """Starts all roles; each role waits at the common start for the other roles.

        Raises:
            CannotDo: One role cannot start. No role is started.
        """
        for role, runner in self.runners.items():
            self._check_role(role, runner.require_startable, readings[role])
        return {role: runner.start(now_s, readings[role]) for role, runner in self.runners.items()}

    def update(self, now_s: float, readings: Mapping[str, Reading]) -> Requests:
        """The additional requests for all roles; call it after all runners were updated."""
        reasons = {role: runner.early_end_reason for role, runner in self.runners.items()}
        early_ends = {role: reason for role, reason in reasons.items() if reason is not None}
        if early_ends:
            role, reason = next(iter(early_ends.items()))
            return self.stop(
                readings, f"{role} has left the mission ({reason.rstrip('.')}): all other vehicles hold"
            )
        lost_role = next((role for role, runner in self.runners.items() if runner.interrupted), None)
        if lost_role is not None:
            reason = f"{lost_role} does not follow its setpoints: all vehicles hold"
            return self.stop(readings, reason)
        active = {role: runner for role, runner in self.runners.items() if not runner.over}
        if any(runner.paused for runner in active.values()):
            return self._pause(now_s, readings, "The pause of another vehicle")
        parts = [runner.setpoint_part for runner in self.runners.values()]
        arrived = [part for part in parts if part is not None and part.meeting is not None]
        if len(arrived) == len(parts) and len({part.meeting for part in arrived}) == 1:
            for part in arrived:
                part.leave_meeting()
        return {}

    def stop(self, readings: Mapping[str, Reading], reason: str) -> Requests:
        """Ends the mission; the vehicles that are still flying hold."""
        return {role: runner.stop(readings[role], reason) for role, runner in self.runners.items()}

    # --- requests of clients ----------------------------------------------------------------------

    def pause(self, now_s: float, readings: Mapping[str, Reading], by: str) -> Requests:
        """Pauses all roles.

        Raises:
            CannotDo: The mission has ended.
        """
        self._require_not_over("pause")
        return self._pause(now_s, readings, by)

    def resume(self, now_s: float, readings: Mapping[str, Reading], by: str) -> Requests:
        """Resumes all roles.

        Raises:
            CannotDo: One role cannot be resumed. No role is resumed.
        """
        self._require_not_over("resume")
        for role, runner in self.runners.items():
            if not runner.over:
                self._check_role(role, runner.require_resumable, readings[role])
        return {
            role: runner.resume(now_s, readings[role], by)
            for role, runner in self.runners.items()
            if not runner.over
        }

    def abort(self, readings: Mapping[str, Reading], by: str, then: str) -> Requests:
        """Aborts the mission; the vehicles hold, or land at their positions (`then`: hold, land).

        Raises:
            CannotDo: The mission has ended.
        """
        self._require_not_over("abort")
        return {
            role: runner.abort(readings[role], by, then)
            for role, runner in self.runners.items()
            if not runner.over
        }

    # --- inside -----------------------------------------------------------------------------------

    def _pause(self, now_s: float, readings: Mapping[str, Reading], by: str) -> Requests:
        return {
            role: runner.pause(now_s, readings[role], by)
            for role, runner in self.runners.items()
            if runner.in_charge and not runner.paused
        }

    def _require_not_over(self, verb: str) -> None:
        if self.over:
            raise CannotDo(f"the mission has ended: there is nothing to {verb}", "Start the mission again.")

    @staticmethod
    def _check_role(role: str, check: Callable[[Reading], None], reading: Reading) -> None:
        try:
            check(reading)
        except CannotDo as error:
            raise CannotDo(f"role {role}: {error}", error.remedy) from error
