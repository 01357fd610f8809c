"""The services of a vehicle that need nothing but the vehicle. A new MAVLink service is a file in this folder
and a row here; routes reach it by `vehicle.service(LogService)`."""

from __future__ import annotations

from gcs_server.vehicle.services.autotune import AutotuneService
from gcs_server.vehicle.services.camera import CameraService
from gcs_server.vehicle.services.files import VehicleFiles
from gcs_server.vehicle.services.gimbal_setup import GimbalSetupService
from gcs_server.vehicle.services.inspector import MessageInspector
from gcs_server.vehicle.services.log_stream import LogStreamService
from gcs_server.vehicle.services.logs import LogService
from gcs_server.vehicle.services.manual_control import ManualControlService
from gcs_server.vehicle.services.param_changes import ParamChanges
from gcs_server.vehicle.services.raw_messages import RawMessages
from gcs_server.vehicle.services.restart import RestartService
from gcs_server.vehicle.services.shell import ShellService

SERVICES = (
    AutotuneService,
    CameraService,
    GimbalSetupService,
    LogService,
    LogStreamService,
    ManualControlService,
    MessageInspector,
    ParamChanges,
    RawMessages,
    RestartService,
    ShellService,
    VehicleFiles,
)
