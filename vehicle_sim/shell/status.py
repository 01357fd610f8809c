"""The console commands `ver`, `mavlink`, `sensors`, `ekf2`, `system_time`, `logger` and of sensor drivers."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from functools import partial

from vehicle_sim import build
from vehicle_sim.logger.logger import Logger
from vehicle_sim.mavlink.link import Link
from vehicle_sim.px4_version import Px4Version
from vehicle_sim.sensors.suite import Driver
from vehicle_sim.shell.console import Arguments, Command, CommandFailed, UsageError, error, info, warning
from vehicle_sim.vehicle_view import VehicleView

_OS_LINES = f"OS: {build.OS_NAME}\nOS version: {build.version_text(build.OS_VERSION)}\n"
_VERSION_LINES = {
    "hw": f"HW arch: {build.BOARD}\n",
    "gcc": f"Toolchain: {build.TOOLCHAIN}, {build.TOOLCHAIN_VERSION}\n",
    "uri": "Build uri: localhost\n",
}
LINK_MODES = {"gcs": "Normal", "api": "Onboard", "tcp": "Normal"}
"""Mode of the MAVLink instance, by the name of the link."""
MAX_RATE_B_S = 4_000_000


def ver(px4: Px4Version, arguments: Arguments) -> str:
    """Runs `ver hw|git|gcc|uri|all` or `ver hwcmp|hwtypecmp|hwbasecmp BOARD...`."""
    px4_lines = f"PX4 git-hash: {px4.git_hash}\nPX4 version: {build.version_text(px4.release)}\n"
    lines = _VERSION_LINES | {"git": px4_lines + _OS_LINES}
    if arguments == ["all"]:
        return "".join(lines[name] for name in ("hw", "git", "uri", "gcc"))
    if len(arguments) == 1 and arguments[0] in lines:
        return lines[arguments[0]]
    if len(arguments) > 1 and arguments[0] in ("hwcmp", "hwtypecmp", "hwbasecmp"):
        if build.BOARD not in arguments[1:]:
            raise CommandFailed()
        return ""
    raise UsageError


def ver_command(px4: Px4Version) -> Command:
    """The command `ver` of a vehicle of this version."""
    return Command(partial(ver, px4), "hw | git | gcc | uri | all | hwcmp BOARD...")


class MavlinkCommand:
    """The command `mavlink status [streams]`."""

    def __init__(
        self, links: Sequence[Link], message_name: Callable[[int], str], gcs_connected: Callable[[Link], bool]
    ) -> None:
        self._links, self._message_name, self._gcs_connected = links, message_name, gcs_connected
        self.command = Command(self.run, "status [streams]")

    def run(self, arguments: Arguments) -> str:
        """Runs `mavlink …`."""
        if arguments == ["status", "streams"]:
            return "".join(self._streams(n, link) for n, link in enumerate(self._links))
        if arguments == ["status"]:
            return "".join(self._status(n, link) for n, link in enumerate(self._links))
        raise UsageError

    def _status(self, instance: int, link: Link) -> str:
        gcs_line = "\tGCS heartbeat valid\n" if self._gcs_connected(link) else ""
        ports, mode = link.ports, LINK_MODES.get(link.name, "Normal")
        if ports is None:
            transport = ""
        elif ports[1] is None:
            transport = f"\ttransport protocol: TCP ({ports[0]})\n"
        else:
            transport = f"\ttransport protocol: UDP ({ports[0]}, remote port: {ports[1]})\n"
        return (
            f"\ninstance #{instance}:\n{gcs_line}\tmavlink chan: #{instance}\n"
            "\ttype:\t\tGENERIC LINK OR RADIO\n"
            f"\tflow control: OFF\n\trates:\n\t  tx: {link.tx_rate:.1f} B/s\n\t  txerr: 0.0 B/s\n"
            f"\t  tx rate mult: 1.000\n\t  tx rate max: {MAX_RATE_B_S} B/s\n\t  rx: {link.rx_rate:.1f} B/s\n"
            f"\t  rx loss: 0.0%\n\tFTP enabled: YES, TX enabled: YES\n\tmode: {mode}\n"
            f"\tForwarding: On\n\tMAVLink version: 2\n{transport}\tBroadcast enabled: NO\n"
        )

    def _streams(self, instance: int, link: Link) -> str:
        title = f"\ninstance #{instance}:\n\t{'Name':<32} Rate\n"
        rates = sorted(
            (self._message_name(msg_id), 1e6 / link.interval_us(msg_id)) for msg_id in link.streamed_ids()
        )
        return "".join((title, *(f"\t{name:<32} {hz:.2f}\n" for name, hz in rates)))


class ModuleCommands:
    """The commands `sensors`, `ekf2` and `system_time` of one vehicle."""

    def __init__(self, view: VehicleView) -> None:
        self._view = view
        self.sensors = Command(self._sensors, "status")
        self.ekf2 = Command(self._ekf2, "status")
        self.system_time = Command(self._system_time, "get")

    def _sensors(self, arguments: Arguments) -> str:
        if arguments[:1] != ["status"]:
            raise UsageError
        sensors, i = self._view.simulation.sensors, self._view.row
        gyro, accel, mag = (
            values[i].tolist()
            for values in (sensors.gyro_frd_rad_s, sensors.accel_frd_m_s2, sensors.mag_frd_gauss)
        )
        fix_type, satellites = int(sensors.gps_fix_type[i]), int(sensors.gps_satellites[i])
        return (
            info("sensors", "gyro [rad/s]:  {:8.4f} {:8.4f} {:8.4f}".format(*gyro))
            + info("sensors", "accel [m/s^2]: {:8.4f} {:8.4f} {:8.4f}".format(*accel))
            + info("sensors", "mag [gauss]:   {:8.4f} {:8.4f} {:8.4f}".format(*mag))
            + info("sensors", f"baro: {float(sensors.baro_pressure_hpa[i]):.2f} hPa")
            + info("sensors", f"gps: fix type {fix_type}, {satellites} satellites")
        )

    def _ekf2(self, arguments: Arguments) -> str:
        if arguments[:1] != ["status"]:
            raise UsageError
        estimate, i = self._view.simulation.estimate, self._view.row
        validity = {
            name: "valid" if valid else "invalid"
            for name, valid in (
                ("attitude", estimate.valid_attitude[i]), ("altitude", estimate.valid_altitude[i]),
                ("velocity", estimate.valid_velocity[i]), ("local position", estimate.valid_position[i]),
                ("global position", math.isfinite(float(estimate.lat_deg[i]))),
            )
        }  # fmt: skip
        ratios = {
            "velocity": estimate.innovation_ratio_velocity, "position": estimate.innovation_ratio_position,
            "height": estimate.innovation_ratio_height, "heading": estimate.innovation_ratio_mag,
        }  # fmt: skip
        return (
            info("ekf2", ", ".join(f"{name}: {text}" for name, text in validity.items()))
            + info("ekf2", f"eph {float(estimate.horizontal_accuracy_m[i]):.2f} m, "
                   f"epv {float(estimate.vertical_accuracy_m[i]):.2f} m")
            + info("ekf2", "test ratios: " + ", ".join(
                f"{name} {float(ratio[i]):.3f}" for name, ratio in ratios.items()))
        )  # fmt: skip

    def _system_time(self, arguments: Arguments) -> str:
        if arguments != ["get"]:
            raise UsageError("the simulated time cannot be set")
        seconds = self._view.time_unix_us() / 1e6
        utc = datetime.fromtimestamp(seconds, UTC)
        return f"Unix epoch time: {int(seconds)}\nSystem time: {utc:%a %b %d %H:%M:%S %Y}\n"


class DriverCommand:
    """The command `DRIVER start|stop|status` of one simulated sensor driver."""

    def __init__(self, view: VehicleView, driver: Driver) -> None:
        self._view, self._driver = view, driver
        self.command = Command(self.run, "start | stop | status")

    def run(self, arguments: Arguments) -> str:
        """Starts or stops the driver, or returns its status."""
        simulation, row, name = self._view.simulation, self._view.row, self._driver.value
        runs = simulation.driver_runs(row, self._driver)
        if arguments == ["status"]:
            if not runs:
                raise CommandFailed(info(name, "not running"))
            return info(name, "running")
        if arguments not in (["start"], ["stop"]):
            raise UsageError
        if runs and arguments == ["start"]:
            raise CommandFailed(error(name, "Task already running"))
        simulation.set_driver(row, self._driver, arguments == ["start"])
        return ""


class LoggerCommand:
    """The command `logger on|off|status`."""

    def __init__(self, logger: Logger) -> None:
        self._logger = logger
        self.command = Command(self.run, "on | off | status")

    def run(self, arguments: Arguments) -> str:
        """Runs `logger …`."""
        if arguments not in (["on"], ["off"], ["status"]):
            raise UsageError
        logger = self._logger
        if not logger.can_log:
            raise CommandFailed(error("logger", "not running: this vehicle was started without logs"))
        if arguments == ["on"]:
            if not logger.start_manually():
                raise CommandFailed(error("logger", "no log could be started"))
            return ""
        if arguments == ["off"]:
            logger.stop_manual_log()
            return warning("logger", "the log continues while armed") if logger.running else ""
        mode_line = info("logger", f"Running in mode: {logger.mode}")
        if not logger.running:
            return mode_line + info("logger", "Not logging")
        return (
            mode_line
            + info("logger", f"Full File Logging Running: ./{logger.path}")
            + info(
                "logger",
                f"Wrote {logger.written_bytes / 1e6:.2f} MB since {logger.started_at_us / 1e6:.1f} s",
            )
        )
