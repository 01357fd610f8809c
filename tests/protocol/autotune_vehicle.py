"""PX4's autotune of a scripted vehicle, as its module and its MAVLink receiver do it (v1.16; v1.18 where
said): the command is a request for the progress while it runs, and starts it whenever it is idle."""

from typing import Any

from tests.protocol.fake_autopilot import INT32, REAL32, FakeAutopilot
from vehicle_sim.mavlink import generated_dialect as sim

AUTOTUNE = sim.MAV_CMD_DO_AUTOTUNE_ENABLE
PERIOD_S = 0.1
RESULT_KEPT_S = STEP_PAUSE_S = 2.0
STEP_LIMIT_S = 20.0
PROGRESS = {
    "idle": 0, "init": 0, "roll": 20, "pitch": 40, "yaw": 60, "verification": 80, "apply": 85, "test": 90,
    "wait_for_disarm": 95, "complete": 100, "fail": 0,
}  # fmt: skip
DURATION_S = {
    "init": 0.4,
    "roll": 8.0,
    "pitch": 8.0,
    "yaw": 8.0,
    "verification": 0.1,
    "apply": 0.1,
    "test": 4.0,
}
AFTER = {"init": "roll", "roll": "pitch", "pitch": "yaw", "yaw": "verification", "verification": "apply"}


class Px4Autotune:
    """Adds autotune to a vehicle.

    Args:
        autopilot: the vehicle.
        has_start_parameter: up to v1.17; later PX4 has no MC_AT_START.
        runs_module: whether the module was started at boot.
    """

    def __init__(
        self, autopilot: FakeAutopilot, *, has_start_parameter: bool = True, runs_module: bool = True
    ) -> None:
        self.autopilot, self.runs_module = autopilot, runs_module
        self.state, self.start_mode, self.since_s = "idle", 0, 0.0
        self.starts: list[float] = []
        """Times at which autotune was started [s]."""
        self.requests: list[float] = []
        self.durations_s = dict(DURATION_S)
        self.gains_are_good = True
        self.answers = True
        autopilot.params |= {
            "MC_AT_EN": (INT32, 1),
            "MC_AT_APPLY": (INT32, 0),
            "MC_ROLLRATE_P": (REAL32, 0.15),
        }
        if has_start_parameter:
            autopilot.params["MC_AT_START"] = (INT32, 0)
        autopilot.handlers.append(self._handle)
        self._run()

    def set(self, name: str, value: int) -> None:
        self.autopilot.params[name] = (INT32, value)

    def move_stick(self) -> None:
        if self.state not in ("idle", "wait_for_disarm"):
            self._enter("fail")

    def _enter(self, state: str) -> None:
        self.state, self.since_s = state, self.autopilot.loop.time()

    def _run(self) -> None:
        self._step()
        self.autopilot.loop.call_later(PERIOD_S, self._run)

    def _step(self) -> None:
        lasted_s = self.autopilot.loop.time() - self.since_s
        state, apply = self.state, self.autopilot.params["MC_AT_APPLY"][1]
        if state in ("complete", "fail"):
            if lasted_s > RESULT_KEPT_S:
                self._enter("idle")
                if "MC_AT_START" in self.autopilot.params:
                    self.set("MC_AT_START", 0)
                    self.autopilot.send_param_value("MC_AT_START")
        elif state == "wait_for_disarm":
            if not self.autopilot.armed:
                self._enter("complete")
        elif state != "idle" and (self.autopilot.mode != self.start_mode or lasted_s > STEP_LIMIT_S):
            self._enter("fail")
        elif lasted_s > self.durations_s.get(state, 1e9):
            if state == "verification" and not self.gains_are_good:
                self._enter("fail")
            elif state == "apply":
                self._enter({0: "complete", 1: "wait_for_disarm", 2: "test"}[int(apply)])
            else:
                self._enter(AFTER.get(state, "complete"))

    def _handle(self, message: Any) -> bool:
        if message.get_type() != "COMMAND_LONG" or message.command != AUTOTUNE:
            return False
        if AUTOTUNE in self.autopilot.refusals or AUTOTUNE in self.autopilot.silent_commands:
            return False
        state, now_s = self.state, self.autopilot.loop.time()
        self.requests.append(now_s)
        if state == "idle":
            if "MC_AT_START" in self.autopilot.params:
                self.set("MC_AT_START", 1)
            if self.runs_module:
                self.starts.append(now_s)
                self.start_mode = self.autopilot.mode
                self._enter("init")
        result = {"complete": sim.MAV_RESULT_ACCEPTED, "fail": sim.MAV_RESULT_FAILED}
        if self.answers:
            self.autopilot.send_ack(AUTOTUNE, result.get(state, sim.MAV_RESULT_IN_PROGRESS), PROGRESS[state])
        return True
