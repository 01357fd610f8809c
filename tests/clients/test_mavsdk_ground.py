"""MAVSDK's requests to a vehicle on the ground: parameters, console, files, streams, calibration, gimbal."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
from mavsdk import System
from mavsdk.action import ActionError, ActionResult
from mavsdk.calibration import CalibrationError, CalibrationResult
from mavsdk.ftp import FtpError, FtpResult
from mavsdk.gimbal import ControlMode, GimbalMode, SendMode
from mavsdk.param import ParamError, ParamResult
from mavsdk.telemetry import TelemetryError
from mavsdk.tune import SongElement, TuneDescription
from pyulog import ULog

from tests.clients.mavsdk_drone import TIMEOUT_S, connected_drone, next_value, until

pytestmark = pytest.mark.timeout(TIMEOUT_S + 20.0)
CALIBRATION_PAUSE_S = 1.0
"""Pause between two calibrations: like PX4, the vehicle denies a calibration for 0.6 s after the end of
another."""


async def collect(stream: AsyncIterator[Any]) -> list[Any]:
    return [value async for value in stream]


def test_parameters_console_files_and_logs_are_read_and_written(tmp_path: Path) -> None:
    asyncio.run(_read_and_write(tmp_path))


async def _read_and_write(folder: Path) -> None:
    async with asyncio.timeout(TIMEOUT_S), connected_drone() as drone:
        await _check_parameters(drone)
        await _check_console(drone)
        await _check_files(drone, folder)
        (entry,) = await drone.log_files.get_entries()
        log = folder / "log.ulg"
        await collect(drone.log_files.download_log_file(entry, str(log)))
        assert log.stat().st_size == entry.size_bytes
        assert "vehicle_local_position" in {data.name for data in ULog(str(log)).data_list}


async def _check_parameters(drone: System) -> None:
    param = drone.param
    assert await param.get_param_int("SYS_AUTOSTART") == 10040
    await param.set_param_float("MPC_XY_P", 0.9)
    assert await param.get_param_float("MPC_XY_P") == pytest.approx(0.9)
    all_params = await param.get_all_params()
    assert len(all_params.int_params) + len(all_params.float_params) == 913
    with pytest.raises(ParamError) as refused:
        await param.get_param_int("MPC_XY_P")
    assert refused.value._result.result is ParamResult.Result.WRONG_TYPE


async def _check_console(drone: System) -> None:
    reply = asyncio.ensure_future(until(drone.shell.receive(), lambda text: "HW arch" in text, "a reply", 30))
    await asyncio.sleep(0.5)
    await drone.shell.send("ver all")
    assert "SITL" in await reply


async def _check_files(drone: System, folder: Path) -> None:
    ftp = drone.ftp
    sent = folder / "note.txt"
    sent.write_text("as it was\n" * 300, encoding="utf-8")
    await ftp.create_directory("/notes")
    await collect(ftp.upload(str(sent), "/notes"))
    assert await ftp.are_files_identical(str(sent), "/notes/note.txt")
    for burst in (False, True):
        downloaded = folder / f"back-{burst}"
        downloaded.mkdir()
        await collect(ftp.download("/notes/note.txt", str(downloaded), burst))
        assert (downloaded / "note.txt").read_bytes() == sent.read_bytes()
    await ftp.rename("/notes/note.txt", "/notes/other.txt")
    assert [name for name in (await ftp.list_directory("/notes")).files if "other.txt" in name]
    await ftp.remove_file("/notes/other.txt")
    await ftp.remove_directory("/notes")
    with pytest.raises(FtpError) as refused:
        await ftp.list_directory("/notes")
    assert refused.value._result.result is FtpResult.Result.FILE_DOES_NOT_EXIST


STREAMS = (
    "position", "home", "in_air", "landed_state", "armed", "vtol_state", "attitude_quaternion",
    "attitude_euler", "attitude_angular_velocity_body", "velocity_ned", "gps_info", "raw_gps",
    "battery", "flight_mode", "health", "rc_status", "actuator_output_status", "odometry",
    "position_velocity_ned", "ground_truth", "fixedwing_metrics", "imu", "scaled_imu", "health_all_ok",
    "unix_epoch_time", "distance_sensor", "scaled_pressure", "heading", "altitude",
)  # fmt: skip
STREAMS_WITH_RATE = (
    "position", "home", "in_air", "landed_state", "vtol_state", "attitude_quaternion", "attitude_euler",
    "velocity_ned", "gps_info", "raw_gps", "battery", "rc_status", "actuator_output_status", "odometry",
    "position_velocity_ned", "ground_truth", "fixedwing_metrics", "imu", "scaled_imu",
    "unix_epoch_time", "distance_sensor", "altitude", "health",
)  # fmt: skip
RATES_REFUSED_BY_PX4 = ("actuator_control_target", "raw_imu")


def test_every_telemetry_stream_sends_a_value_and_the_vehicle_information_is_read() -> None:
    asyncio.run(_check_streams())


async def _check_streams() -> None:
    async with asyncio.timeout(TIMEOUT_S), connected_drone() as drone:
        for name in STREAMS_WITH_RATE:
            await getattr(drone.telemetry, f"set_rate_{name}")(5.0)
        for name in RATES_REFUSED_BY_PX4:
            with pytest.raises(TelemetryError):
                await getattr(drone.telemetry, f"set_rate_{name}")(5.0)
        await drone.transponder.set_rate_transponder(1.0)
        values = {name: await next_value(getattr(drone.telemetry, name)(), 20) for name in STREAMS}
        truth = values["ground_truth"]
        assert truth.latitude_deg == pytest.approx(values["position"].latitude_deg, abs=2e-5)
        assert values["gps_info"].num_satellites == 10
        assert values["imu"].acceleration_frd.down_m_s2 == pytest.approx(-9.8, abs=0.8)
        origin = await drone.telemetry.get_gps_global_origin()
        assert origin.latitude_deg == pytest.approx(truth.latitude_deg, abs=2e-5)
        version = await drone.info.get_version()
        assert (version.flight_sw_major, version.flight_sw_minor) == (1, 17)
        assert (await drone.info.get_identification()).legacy_uid == 0x4954_414C_4449_4E4F
        await drone.tune.play_tune(TuneDescription([SongElement.DURATION_4, SongElement.NOTE_G], 200))
        with pytest.raises(ActionError) as refused:
            await drone.action.reboot()
        assert refused.value._result.result is ActionResult.Result.COMMAND_DENIED


def test_calibrations_end_as_succeeded_failed_or_cancelled() -> None:
    asyncio.run(_calibrate())


async def _calibrate() -> None:
    async with asyncio.timeout(TIMEOUT_S), connected_drone() as drone:
        for method in ("calibrate_gyro", "calibrate_level_horizon"):
            steps = await collect(getattr(drone.calibration, method)())
            assert max(step.progress for step in steps if step.has_progress) == pytest.approx(1.0)
            await asyncio.sleep(CALIBRATION_PAUSE_S)
        with pytest.raises(CalibrationError) as failed:
            # The vehicle stays on its first side.
            await collect(drone.calibration.calibrate_accelerometer())
        assert failed.value._result.result is CalibrationResult.Result.FAILED
        calibration = asyncio.ensure_future(collect(drone.calibration.calibrate_magnetometer()))
        await asyncio.sleep(2.0)
        await drone.calibration.cancel()
        with pytest.raises(CalibrationError) as cancelled:
            await calibration
        assert cancelled.value._result.result is CalibrationResult.Result.CANCELLED


def test_the_gimbal_is_controlled_turned_and_released() -> None:
    asyncio.run(_check_gimbal())


async def _check_gimbal() -> None:
    async with asyncio.timeout(TIMEOUT_S), connected_drone() as drone:
        gimbal = drone.gimbal
        listed = await until(gimbal.gimbal_list(), lambda found: found.gimbals, "a gimbal", 40)
        gimbal_id = listed.gimbals[0].gimbal_id
        await gimbal.take_control(gimbal_id, ControlMode.PRIMARY)
        control = await until(
            gimbal.control_status(),
            lambda status: status.control_mode is ControlMode.PRIMARY,
            "control of the gimbal",
        )
        assert control.sysid_primary_control == 245  # MAVSDK's system id
        await gimbal.set_angles(gimbal_id, 0.0, -20.0, 30.0, GimbalMode.YAW_FOLLOW, SendMode.ONCE)
        await until(
            gimbal.attitude(),
            lambda a: (
                abs(a.euler_angle_forward.pitch_deg + 20.0) < 2.0
                and abs(a.euler_angle_forward.yaw_deg - 30.0) < 2.0
            ),
            "the requested angles",
        )
        await gimbal.set_angular_rates(gimbal_id, 0.0, 10.0, 0.0, GimbalMode.YAW_FOLLOW, SendMode.ONCE)
        await until(gimbal.attitude(), lambda a: a.euler_angle_forward.pitch_deg > -5.0, "upward rotation")
        home = await next_value(drone.telemetry.home())
        await gimbal.set_roi_location(
            gimbal_id, home.latitude_deg, home.longitude_deg + 1e-3, home.absolute_altitude_m
        )
        await until(
            gimbal.attitude(),
            lambda a: not math.isclose(a.euler_angle_forward.yaw_deg, 30.0, abs_tol=5.0),
            "the gimbal turning to the position",
        )
        await gimbal.release_control(gimbal_id)
        await until(
            gimbal.control_status(),
            lambda status: status.control_mode is ControlMode.NONE,
            "release of the gimbal",
        )
