"""The console commands `commander`, `gimbal` and `failure`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from vehicle_sim.autopilot.arming import Reason
from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.autopilot.modes import MODES, NavState
from vehicle_sim.commands.command import ACCEPTED, Command
from vehicle_sim.shell.console import Arguments, CommandFailed, UsageError, error, info, warning
from vehicle_sim.shell.console import Command as ShellCommand

MODE_BY_NAME: Mapping[str, NavState] = {
    "manual": NavState.MANUAL, "acro": NavState.ACRO, "offboard": NavState.OFFBOARD,
    "stabilized": NavState.STABILIZED, "altctl": NavState.ALTITUDE, "posctl": NavState.POSITION,
    "position:slow": NavState.POSITION_SLOW, "auto:mission": NavState.MISSION, "auto:loiter": NavState.HOLD,
    "auto:rtl": NavState.RTL, "auto:takeoff": NavState.TAKEOFF, "auto:land": NavState.LAND,
    "auto:precland": NavState.PRECISION_LAND, "ext1": NavState.EXTERNAL1,
}  # fmt: skip
FAILURE_UNITS: Mapping[str, int] = {
    "gyro": 0, "accel": 1, "mag": 2, "baro": 3, "gps": 4, "optical_flow": 5, "vio": 6, "distance_sensor": 7,
    "airspeed": 8, "battery": 100, "motor": 101, "servo": 102, "avoidance": 103, "rc_signal": 104,
    "mavlink_signal": 105,
}  # fmt: skip
"""FAILURE_UNIT by the name that the command takes."""
FAILURE_TYPES: Mapping[str, int] = {
    "ok": 0, "off": 1, "stuck": 2, "garbage": 3, "wrong": 4, "slow": 5, "delayed": 6, "intermittent": 7,
}  # fmt: skip
"""FAILURE_TYPE by the name that the command takes."""
INJECT_FAILURE = 420
"""MAV_CMD_INJECT_FAILURE."""
ROLL_PITCH_LOCK = 12
"""GIMBAL_MANAGER_FLAGS: roll and pitch relative to the horizon."""
MAX_ERROR_SEVERITY = 3
"""Log level ERROR; higher numbers are less severe."""
YES_NO = ("no", "yes")


class CommanderCommand:
    """The command `commander`."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot, self._commander = autopilot, autopilot.commander
        self._subcommands: dict[str, Callable[[Arguments], str]] = {
            "status": self._status, "check": self._check, "arm": self._arm, "disarm": self._disarm,
            "takeoff": self._takeoff, "land": lambda arguments: self._set_mode(NavState.LAND),
            "mode": self._mode, "termination": self._termination,
        }  # fmt: skip
        self.command = ShellCommand(
            self.run,
            f"status | check | arm | disarm [-f] | takeoff | land | mode {'|'.join(MODE_BY_NAME)} | "
            "termination on",
        )

    def run(self, arguments: Arguments) -> str:
        """Runs `commander …`."""
        subcommand = self._subcommands.get(arguments[0]) if arguments else None
        if subcommand is None:
            raise UsageError(f"unknown: {arguments[0]}" if arguments else "")
        return subcommand(arguments[1:])

    def _status(self, arguments: Arguments) -> str:
        commander = self._commander
        return "".join(
            info("commander", line)
            for line in (
                "Armed" if commander.armed else "Disarmed",
                f"navigation mode: {MODES[commander.active].name}",
                f"user intended navigation mode: {MODES[commander.intended].name}",
                f"in failsafe: {YES_NO[commander.in_failsafe]}",
                f"landed: {YES_NO[commander.landed]}",
            )
        )

    def _check(self, arguments: Arguments) -> str:
        commander = self._commander
        commander.run_checks()
        findings = [
            (error if finding.severity <= MAX_ERROR_SEVERITY else warning)(
                "health_and_arming_checks", finding.text or finding.event
            )
            for finding in commander.report.findings
            if (finding.blocks_arming | finding.blocks_running) >> commander.intended & 1
        ]
        can_arm = commander.report.armable(commander.intended)
        return "".join(findings) + info("commander", f"Preflight check: {'OK' if can_arm else 'FAILED'}")

    def _arm(self, arguments: Arguments) -> str:
        if not self._commander.arm(Reason.INTERNAL_COMMAND):
            raise CommandFailed(error("commander", "not armed; see `commander check`"))
        return ""

    def _disarm(self, arguments: Arguments) -> str:
        if not self._commander.disarm(Reason.INTERNAL_COMMAND, force="-f" in arguments):
            raise CommandFailed(
                error("commander", "not disarmed: the vehicle is flying; -f disarms in flight")
            )
        return ""

    def _takeoff(self, arguments: Arguments) -> str:
        self._autopilot.navigator.request_takeoff(math.nan)
        self._set_mode(NavState.TAKEOFF)
        return self._arm([])

    def _mode(self, arguments: Arguments) -> str:
        mode = MODE_BY_NAME.get(arguments[0]) if arguments else None
        if mode is None:
            raise UsageError("no such mode")
        return self._set_mode(mode)

    def _set_mode(self, mode: NavState) -> str:
        if not self._commander.set_mode(mode):
            raise CommandFailed(error("commander", f"{MODES[mode].name} is not available now"))
        return ""

    def _termination(self, arguments: Arguments) -> str:
        if arguments != ["on"]:
            raise UsageError("`on` stops all motors; this cannot be undone")
        if not self._commander.terminate():
            raise CommandFailed(error("commander", "termination is possible only while armed"))
        return ""


class GimbalCommand:
    """The command `gimbal`."""

    usage = "start | stop | status | primary-control SYSTEM COMPONENT | test pitch|yaw DEGREES ..."

    def __init__(self, autopilot: Autopilot, autopilot_id: tuple[int, int]) -> None:
        self._gimbal, self._autopilot_id = autopilot.gimbal, autopilot_id
        self._test_angles_deg: dict[str, float] = {}
        """Angles of the last `gimbal test`, by axis."""
        self.command = ShellCommand(self.run, self.usage)

    def run(self, arguments: Arguments) -> str:
        """Runs `gimbal …`."""
        if arguments == ["start"]:
            return self._start()
        if not arguments:
            raise UsageError
        if not self._gimbal.running:
            raise CommandFailed(warning("gimbal", "not running"))
        if arguments == ["stop"]:
            self._gimbal.stop()
            return ""
        if arguments == ["status"]:
            return self._status()
        if arguments[0] == "primary-control" and len(arguments) == 3:
            return self._set_primary_control(arguments[1:])
        if arguments[0] == "test" and len(arguments) >= 3 and len(arguments) % 2 == 1:
            return self._set_test_angles(arguments[1:])
        raise UsageError(f"unknown: {' '.join(arguments)}")

    def _start(self) -> str:
        if self._gimbal.running:
            return warning("gimbal", "already running")
        self._gimbal.start()
        return (
            ""
            if self._gimbal.enabled
            else error("gimbal", "no input by MAVLink: MNT_MODE_IN is neither 0 nor 4")
        )

    def _status(self) -> str:
        angles = {axis: self._test_angles_deg.get(axis, math.nan) for axis in ("roll", "pitch", "yaw")}
        return (
            info("gimbal", "Input Selected")
            + info("gimbal", "Input not selected")
            + info("gimbal", "Input: Test")
            + f"  roll : {angles['roll']: .1f} deg\n"
            f"  pitch: {angles['pitch']: .1f} deg\n"
            f"  yaw  : {angles['yaw']: .1f} deg\n"
            "  rollrate :  nan deg/s\n  pitchrate:  nan deg/s\n  yawrate  :  nan deg/s\n"
            + (info("gimbal", "Input: Mavlink (Gimbal V2)") if self._gimbal.enabled else "")
            + info("gimbal", "Primary control:   {}/{}".format(*self._gimbal.primary))
            + info(
                "gimbal", "Output: MAVLink gimbal protocol v2" if self._gimbal.has_device else "Output: AUX"
            )
        )

    def _set_primary_control(self, arguments: Arguments) -> str:
        try:
            system, component = (int(text) for text in arguments)
        except ValueError:
            raise UsageError("primary-control takes a system id and a component id") from None
        if not (0 <= system <= 255 and 0 <= component <= 255):
            raise UsageError("system and component ids are 0 to 255")
        self._gimbal.configure(system, component, self._autopilot_id, self._autopilot_id)
        return info("gimbal", f"Control set to: {system}/{component}")

    def _set_test_angles(self, arguments: Arguments) -> str:
        try:
            angles_deg = {
                axis: float(text) for axis, text in zip(arguments[::2], arguments[1::2], strict=True)
            }
        except ValueError:
            raise UsageError("give angles in degrees") from None
        if not angles_deg.keys() <= {"pitch", "yaw"} or not all(map(math.isfinite, angles_deg.values())):
            raise UsageError("test takes pitch and yaw, in degrees")
        self._test_angles_deg = angles_deg
        pitch, yaw = (math.radians(angles_deg.get(axis, 0.0)) for axis in ("pitch", "yaw"))
        self._gimbal.set_pitch_yaw(ROLL_PITCH_LOCK, pitch, yaw, math.nan, math.nan)
        return ""


class FailureCommand:
    """The command `failure`."""

    def __init__(self, autopilot: Autopilot, inject_failure: Callable[[Command], int | None],
                 autopilot_id: tuple[int, int]) -> None:  # fmt: skip
        self._view, self._inject_failure, self._autopilot_id = autopilot.view, inject_failure, autopilot_id
        self.command = ShellCommand(
            self.run, f"{'|'.join(FAILURE_UNITS)} {'|'.join(FAILURE_TYPES)} [-i INSTANCE]"
        )

    def run(self, arguments: Arguments) -> str:
        """Runs `failure …`."""
        if arguments in (["help"], ["help", "-v"]):
            return f"Usage: failure {self.command.usage}\n"
        instance = 0
        if len(arguments) == 4 and arguments[2] == "-i" and arguments[3].isdecimal():
            arguments, instance = arguments[:2], int(arguments[3])
        if len(arguments) != 2 or arguments[0] not in FAILURE_UNITS or arguments[1] not in FAILURE_TYPES:
            raise UsageError("give a component and a failure type")
        if self._view.choice("SYS_FAILURE_EN") != 1:
            raise CommandFailed(error("failure", "failure injection is disabled: SYS_FAILURE_EN is not 1"))
        parameters = (float(FAILURE_UNITS[arguments[0]]), float(FAILURE_TYPES[arguments[1]]), float(instance))
        result = self._inject_failure(
            Command(INJECT_FAILURE, *parameters, 0.0, 0.0, 0.0, 0.0, self._autopilot_id, "shell")
        )
        if result != ACCEPTED:
            raise CommandFailed(
                error("failure", f"failure {arguments[1]} of {arguments[0]} is not supported")
            )
        return ""
