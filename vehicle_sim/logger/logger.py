"""The onboard log of one vehicle: start and stop by SDLOG_MODE, file names, limits and write errors."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Callable
from datetime import UTC, datetime
from functools import cache
from io import FileIO
from pathlib import Path
from typing import Final

from vehicle_sim import build
from vehicle_sim.autopilot.announcer import Announcer, Event, StatusText
from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.logger import ulog
from vehicle_sim.logger.recorder import Recorder, Recorders
from vehicle_sim.logger.stream import UlogStream
from vehicle_sim.parameters import Parameters, ParameterValue
from vehicle_sim.storage.files import VehicleFiles
from vehicle_sim.topics.layout import TopicLayout
from vehicle_sim.topics.states import States

FOLDER: Final = "log"
LOGGING_POSSIBLE_AFTER_US: Final = 488_000
"""PX4's logger in simulation starts this long after boot."""
STOP_DELAY_US: Final = 1_000_000
"""A log continues for this long after disarming."""
FILE_NAME_DELAY_US: Final = 45_000
"""Delay between the start of a log and the text with its file name."""
TICK_US: Final = 20_000
"""Period of the log's state topics: one autopilot tick. Log and autopilot read the estimate in the same step,
so that the simulation converts it to plain numbers only once."""
DISABLED, WHILE_ARMED, BOOT_TO_DISARM, BOOT_TO_SHUTDOWN, WHILE_AUX1, ARMED_TO_SHUTDOWN = range(-1, 5)
"""Values of SDLOG_MODE; WHILE_AUX1 requires an RC receiver, which a simulated vehicle does not have."""
BOOT_MODES: Final = frozenset({BOOT_TO_DISARM, BOOT_TO_SHUTDOWN})
ARMING_MODES: Final = frozenset({WHILE_ARMED, BOOT_TO_DISARM, ARMED_TO_SHUTDOWN})
SHUTDOWN_MODES: Final = frozenset({BOOT_TO_SHUTDOWN, ARMED_TO_SHUTDOWN})
"""Modes in which a log starts at boot, starts at arming, or continues until shutdown."""
MIN_FREE_BYTES: Final = 50 << 20
"""With less free space, no log starts and a running log ends."""
MAX_BYTES: Final = 1 << 30
"""Maximum size of a log, so that a vehicle left running does not fill the disk."""
CHECK_EVERY_US: Final = 5_000_000
DEFAULT_PROFILE: Final = 1


def free_bytes(path: Path) -> int:
    """Free space on the disk of a folder."""
    return shutil.disk_usage(path).free


class Logger:
    """Writes `log/DATE/TIME.ulg`.

    Args:
        autopilot: the autopilot to log.
        states: state topics of the autopilot.
        files: the vehicle's files, which contain the log.
        recorders: recorders that sample the array topics; None: the vehicle never logs.
        free_space: returns the free bytes on a folder's disk.
    """

    def __init__(
        self,
        autopilot: Autopilot,
        states: States,
        files: VehicleFiles,
        recorders: Recorders | None,
        free_space: Callable[[Path], int] = free_bytes,
    ) -> None:
        self.row = autopilot.view.row
        self.path: str | None = None
        """Path of the log being written, or of the last log."""
        self.written_bytes = 0
        self.started_at_us = 0
        self._autopilot, self._states, self._files, self._free_space = autopilot, states, files, free_space
        self._view = autopilot.view
        self._announcer: Announcer = autopilot.announcer
        self._recorders = recorders
        self._recorder: Recorder | None = None
        self._file: FileIO | None = None
        self._stream: UlogStream | None = None
        """Gets all that the file gets; it may run without a file."""
        self._pending: list[bytes] = []
        self._is_ready = False
        self._armed = False
        self._started_manually = False
        self._stop_at_us: int | None = None
        self._announce_at_us: int | None = None
        self._next_check_us = 0
        self._next_sample_us = 0
        if recorders is not None:
            self._announcer.add_listener(self._log_announcement)
            self._view.parameters.add_listener(self._log_parameter)

    @property
    def can_log(self) -> bool:
        """Whether the vehicle can write logs."""
        return self._recorders is not None

    @property
    def running(self) -> bool:
        """Whether a file is being written."""
        return self._file is not None

    @property
    def mode(self) -> int:
        """SDLOG_MODE."""
        return self._view.optional_choice("SDLOG_MODE", WHILE_ARMED)

    def step(self, now_us: int) -> None:
        """Called after each simulation step."""
        if not self._is_ready:
            if now_us < LOGGING_POSSIBLE_AFTER_US:
                return
            self._is_ready = True
            self._autopilot.commander.checks.logging = False
            self._delete_old_logs()
            if self.mode in BOOT_MODES:
                self._start(now_us)
        armed = self._autopilot.commander.armed
        if armed is not self._armed:
            self._armed = armed
            self._on_arming_change(armed, now_us)
        if self._stop_at_us is not None and now_us >= self._stop_at_us:
            self.stop()
        if self._announce_at_us is not None and now_us >= self._announce_at_us:
            self._announce_at_us = None
            self._announcer.text(6, f"[logger] ./{self.path}\t")
        if self._is_active and now_us >= self._next_sample_us:
            self._next_sample_us = (now_us // TICK_US + 1) * TICK_US
            self._sample_states(now_us)

    def start_manually(self) -> bool:
        """Starts logging until `stop_manual_log`; returns whether a file is being written."""
        self._started_manually = True
        if not self.running:
            self._start(self._view.time_boot_us())
        self._stop_at_us = None
        return self.running

    def stop_manual_log(self) -> None:
        """Ends logging started by `start_manually`. The log continues in mode BOOT_TO_SHUTDOWN, and in the
        ARMING_MODES while the vehicle is armed."""
        self._started_manually = False
        if not (self._armed and self.mode in ARMING_MODES) and self.mode != BOOT_TO_SHUTDOWN:
            self.stop()

    def start_stream(self) -> UlogStream:
        """Starts a stream of the log, also while no file is written; `can_log` is true."""
        now_us = self._view.time_boot_us()
        recorder = self._recorder
        if recorder is None:
            assert self._recorders is not None
            recorder = self._recorder = self._recorders.for_profile(self._profile, self._view.px4.name)
            recorder.add(self)
        else:
            recorder.flush()
            self._write_pending()
        self._stream = UlogStream(b"".join(self._definitions(recorder, now_us)))
        self._states.restart()
        return self._stream

    def stop_stream(self) -> None:
        """Ends the stream; a file goes on."""
        self._stream = None
        if self._file is None and self._recorder is not None:
            self._recorder.remove_without_flush(self)
            self._recorder, self._pending = None, []

    def flush(self) -> None:
        """Writes buffered data to the file."""
        if self._recorder is not None:
            self._recorder.flush()
            self._set_file_time()

    def stop(self) -> None:
        """Closes the log."""
        self._stop_at_us = None
        if self._file is None:
            return
        if self._recorder is not None:
            self._recorder.flush()
        self._write_pending()
        self._close()

    def write(self, data: bytes) -> None:
        """Writes pending messages and then samples of the array topics."""
        self._pending.append(data)
        self._write_pending()

    @property
    def _is_active(self) -> bool:
        """Whether a file or a stream gets what is logged."""
        return self._file is not None or self._stream is not None

    @property
    def _profile(self) -> int:
        return self._view.optional_choice("SDLOG_PROFILE", DEFAULT_PROFILE) or DEFAULT_PROFILE

    # --- start and stop ---------------------------------------------------------------------------------

    def _on_arming_change(self, armed: bool, now_us: int) -> None:
        mode = self.mode
        if armed and mode in ARMING_MODES:
            if self._stop_at_us is not None:
                self.stop()
            if not self.running:
                self._start(now_us)
        elif (
            not armed
            and mode in ARMING_MODES - SHUTDOWN_MODES
            and self.running
            and not self._started_manually
        ):
            self._stop_at_us = now_us + STOP_DELAY_US

    def _sample_states(self, now_us: int) -> None:
        data = self._states.due(now_us)
        if data:
            self._pending.append(data)
        if self._file is not None and now_us >= self._next_check_us:
            self._next_check_us = now_us + CHECK_EVERY_US
            self._check_limits()

    def _check_limits(self) -> None:
        if self.written_bytes >= MAX_BYTES:
            self.stop()
            self._announcer.text(4, "[logger] logging stopped: the log has reached 1 GiB\t")
            return
        try:
            free = self._free_space(self._files.root)
        except OSError as error:
            self.stop()
            self._report_error("logging stopped", error)
            return
        if free < MIN_FREE_BYTES:
            self.stop()
            self._report_full_disk(free)

    def _start(self, now_us: int) -> None:
        if self._recorders is None or self.mode == DISABLED:
            return
        if self._stream is not None and self._recorder is not None:
            self._recorder.flush()
            self._write_pending()  # what was logged before the file is only the stream's
        try:
            free = self._free_space(self._files.root)
            if free < MIN_FREE_BYTES:
                self._report_full_disk(free)
                return
            path, started_at = self._new_path()
            self._file = FileIO(self._files.host_path(path), "wb")
        except OSError as error:
            self._report_error("logging not started", error)
            return
        self.path, self.written_bytes, self.started_at_us = path, 0, now_us
        recorder = self._recorder or self._recorders.for_profile(self._profile, self._view.px4.name)
        self._next_check_us = now_us + CHECK_EVERY_US
        self._write_to_file(b"".join(self._definitions(recorder, now_us)))
        self._states.restart()
        if not self.running:
            return
        self._autopilot.commander.checks.logging = True
        if self._recorder is None:
            self._recorder = recorder
            recorder.add(self)
        self._announcer.event(
            "logger_open_file_time", "HBBBBB", started_at.year, started_at.month, started_at.day,
            started_at.hour, started_at.minute, started_at.second,
        )  # fmt: skip
        self._announce_at_us = now_us + FILE_NAME_DELAY_US

    def _definitions(self, recorder: Recorder, now_us: int) -> list[bytes]:
        """All that comes before the samples."""
        layouts = [topic.layout for topic in recorder.topics] + list(self._states.layouts)
        return [
            ulog.header(now_us),
            ulog.flag_bits(),
            *self._info_messages(),
            _formats(tuple(layouts)),
            _parameters(self._view.parameters),
            *(ulog.subscription(layout) for layout in layouts),
        ]

    def _new_path(self) -> tuple[str, datetime]:
        offset_s = 60 * self._view.optional_choice("SDLOG_UTC_OFFSET", 0)
        started_at = datetime.fromtimestamp(self._view.time_unix_us() // 1_000_000 + offset_s, UTC)
        stem = f"{FOLDER}/{started_at:%Y-%m-%d}/{started_at:%H_%M_%S}"
        path, number = f"{stem}.ulg", 0
        while self._files.host_path(path).exists():
            number += 1
            path = f"{stem}_{number:02d}.ulg"
        return path, started_at

    def _info_messages(self) -> list[bytes]:
        offset_s = 60 * self._view.optional_choice("SDLOG_UTC_OFFSET", 0)
        return [
            ulog.info("ver_sw", self._view.px4.git_hash),
            ulog.info("ver_sw_release", self._view.px4.release),
            ulog.info("ver_vendor_sw_release", build.VENDOR_VERSION),
            ulog.info("ver_hw", build.BOARD),
            ulog.info("sys_name", "PX4"),
            ulog.info("sys_os_name", build.OS_NAME),
            ulog.info("sys_os_ver_release", build.OS_VERSION),
            ulog.info("sys_toolchain", build.TOOLCHAIN),
            ulog.info("sys_toolchain_ver", build.TOOLCHAIN_VERSION),
            ulog.info("ver_data_format", build.DATA_FORMAT),
            ulog.info("time_ref_utc", offset_s, "int32_t"),
        ]

    def _delete_old_logs(self) -> None:
        """Deletes the oldest folders (one for each day) beyond SDLOG_DIRS_MAX."""
        days_kept = self._view.optional_choice("SDLOG_DIRS_MAX", 0)
        if days_kept <= 0 or self.mode == DISABLED:
            return
        try:
            days = [name for name, size in self._files.listing(FOLDER) if size is None]
            for name in days[:-days_kept]:
                self._files.delete_tree(f"{FOLDER}/{name}")
        except OSError:
            return  # no log yet

    def _log_announcement(self, announcement: StatusText | Event) -> None:
        if not self._is_active:
            return
        if isinstance(announcement, Event):
            self._pending.append(self._states.event(announcement))
        else:
            self._pending.append(
                ulog.logged_text(announcement.severity, self._view.time_boot_us(), announcement.text)
            )

    def _log_parameter(self, name: str, value: ParameterValue) -> None:
        if self._is_active:
            is_int = self._view.parameters.type_of(name) == "INT32"
            self._pending.append(ulog.parameter(name, value, integer=is_int))

    def _write_pending(self) -> None:
        data, self._pending = b"".join(self._pending), []
        if self._stream is not None:
            self._stream.add(data)
        self._write_to_file(data)

    def _write_to_file(self, data: bytes) -> None:
        if self._file is None or not data:
            return
        try:
            unwritten = memoryview(data)
            while unwritten:
                unwritten = unwritten[self._file.write(unwritten) :]
            self.written_bytes += len(data)
        except OSError as error:
            self._close()
            self._report_error("logging stopped", error)

    def _close(self) -> None:
        file, self._file, recorder = self._file, None, self._recorder
        self._announce_at_us = None
        self._autopilot.commander.checks.logging = False
        if recorder is not None and self._stream is None:
            recorder.remove_without_flush(self)
            self._recorder = None
        if file is not None:
            try:
                file.close()
            except OSError as error:
                self._report_error("log file not closed", error)
            self._set_file_time()

    def _set_file_time(self) -> None:
        """Gives the file the vehicle's time, which log lists contain."""
        time_ns = 1000 * self._view.time_unix_us()
        if self.path is not None:
            with contextlib.suppress(OSError):
                os.utime(self._files.host_path(self.path), ns=(time_ns, time_ns))

    def _report_full_disk(self, free: int) -> None:
        free_mib = free >> 20
        text = f"[logger] not logging: {free_mib} MiB free, 50 MiB required"
        self._announcer.announce(3, text, "logger_storage_full", "I", free_mib)

    def _report_error(self, consequence: str, error: OSError) -> None:
        self._announcer.text(3, f"[logger] {consequence}: {error.strerror or error}\t")


@cache
def _formats(layouts: tuple[TopicLayout, ...]) -> bytes:
    return b"".join({layout.name: ulog.topic_format(layout) for layout in layouts}.values())


def _parameters(parameters: Parameters) -> bytes:
    """All parameter values, then the defaults of the parameters that differ from them."""
    messages: list[bytes] = []
    for name, value in parameters.items():
        messages.append(ulog.parameter(name, value, integer=parameters.type_of(name) == "INT32"))
    for name in parameters.changed_names():
        integer = parameters.type_of(name) == "INT32"
        default = parameters.default_of(name)
        messages.append(ulog.default_parameter(name, default, integer=integer, sources=ulog.AIRFRAME_DEFAULT))
    return b"".join(messages)


class FleetLogs:
    """The logs of all vehicles of a fleet."""

    def __init__(self, recorders: Recorders, loggers: list[Logger]) -> None:
        self._recorders, self._loggers = recorders, loggers

    def step(self, now_us: int) -> None:
        """Called after each simulation step."""
        for logger in self._loggers:
            logger.step(now_us)
        for step in self._recorders.steps:
            step(now_us)

    def close(self) -> None:
        """Ends all logs, as a shutdown does."""
        for logger in self._loggers:
            logger.stop()
