"""Detects external control of a vehicle: another ground station or the RC pilot changes its mode, or another
ground station takes its gimbal. The server reports external control and never interferes with it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.tables import LAYOUTS
from gcs_server.vehicle.gimbal_decoder import control_of, device_id_of
from gcs_server.vehicle.mode_cause import (
    MAV_SYS_STATUS_SENSOR_RC_RECEIVER,
    MODE_COMMANDS,
    ForeignAck,
    ModeCause,
    cause_of,
    is_overruled,
)
from gcs_server.vehicle.reducers import FlightState
from gcs_server.vehicle.samples import Health
from gcs_server.vehicle.services.command import CommandService
from gcs_server.vehicle.services.manual_control import ManualControlService
from gcs_server.vehicle.services.port import VehiclePort

S = TypeVar("S")
_ack = LAYOUTS[d.MAVLINK_MSG_ID_COMMAND_ACK]


class ObservedVehicle(VehiclePort, Protocol):
    """The vehicle as this module uses it."""

    def service(self, kind: type[S]) -> S: ...


class ExternalControl:
    """External control of one vehicle.

    Args:
        vehicle: the vehicle; its messages are evaluated.
        command: the command service, which has the modes that this server requested.
        stream_request: returns the mode that the setpoint stream requests before it ends; None: no request.
        plan_returns: whether the plan on the vehicle is at its own Return.
    """

    def __init__(
        self,
        vehicle: ObservedVehicle,
        command: CommandService,
        stream_request: Callable[[], str | None],
        plan_returns: Callable[[], bool],
    ) -> None:
        self._vehicle = vehicle
        self._command = command
        self._stream_request = stream_request
        self._plan_returns = plan_returns
        self._changed_s = float("-inf")
        """Time of the last mode change [s, monotonic]."""
        self._foreign_ack: ForeignAck | None = None
        self._gimbal_control: dict[tuple[int, int], tuple[int, int] | None] = {}
        """Primary controller of each gimbal, by (component id of the manager, device id)."""
        self.mode_cause: ModeCause | None = None
        """Cause of the current mode; None before the first mode change."""

    def mode(self, before: FlightState, after: FlightState) -> ModeCause | None:
        """The cause of a mode change; None: no mode change, the first reported mode, or not PX4."""
        vehicle = self._vehicle
        self._reclassify_as_failsafe(before, after)
        if after.custom_mode == before.custom_mode or before.heartbeat_s == float("-inf"):
            return None
        if not vehicle.identity.software.supported:
            return None
        name, label = vehicle.mode_names.registered(after.mode_name)
        own_command = self._command.recent_command(name)
        was_failsafe = self.mode_cause is not None and self.mode_cause.source == "failsafe"
        if was_failsafe and own_command is not None and own_command.since_s < self._changed_s:
            own_command = None  # it selected the mode before the failsafe, to which the vehicle now returns
        self._changed_s = vehicle.clock.monotonic_s()
        requested = None if own_command is None else (own_command.label, own_command.by)
        if requested is None and self._stream_request() == name:
            requested = (label, None)
        self.mode_cause = cause_of(
            before,
            after,
            requested=requested,
            foreign=self._foreign_ack,
            has_transmitter=self._has_transmitter(),
            stick_client=vehicle.service(ManualControlService).status().by,
            was_failsafe=was_failsafe,
            plan_returns=self._plan_returns,
            now_s=vehicle.clock.monotonic_s(),
            unix_s=vehicle.clock.unix_s(),
        )
        return self.mode_cause

    def _reclassify_as_failsafe(self, before: FlightState, after: FlightState) -> None:
        """Changes the cause to failsafe if CURRENT_MODE, received after the heartbeat, has another intended
        mode."""
        cause = self.mode_cause
        from_current_mode = after.mode_s > before.mode_s and after.heartbeat_s == before.heartbeat_s
        if (
            from_current_mode
            and cause is not None
            and cause.is_external
            and cause.source != "station"
            and after.custom_mode == before.custom_mode
            and is_overruled(after)
        ):
            self.mode_cause = ModeCause("failsafe", None, "the failsafe", cause.since_unix_s)

    def ack(self, payload: bytes) -> None:
        """Handles COMMAND_ACK: an acknowledgement to another station shows that this station commands the
        vehicle."""
        ack_fields = dict(zip(_ack.fields, _ack.unpacker.unpack(payload), strict=True))
        target = (ack_fields["target_system"], ack_fields["target_component"])
        own_command = target[0] in (0, self._vehicle.own_ids[0])
        if (
            not own_command
            and ack_fields["result"] == d.MAV_RESULT_ACCEPTED
            and ack_fields["command"] in MODE_COMMANDS
        ):
            self._foreign_ack = ForeignAck(*target, self._vehicle.clock.monotonic_s())

    def gimbal(self, component_id: int, payload: bytes) -> None:
        """Handles GIMBAL_MANAGER_STATUS: another station may have taken the gimbal from this server."""
        vehicle, control = self._vehicle, control_of(payload)
        gimbal_key = (component_id, device_id_of(payload))
        if self._gimbal_control.get(gimbal_key) == vehicle.own_ids and control not in (None, vehicle.own_ids):
            station = f"{control[0]}/{control[1]}"
            vehicle.events.add(
                "control",
                vehicle.clock.unix_s(),
                f"Station {station} has taken the gimbal from this server.",
                severity=d.MAV_SEVERITY_WARNING,
                data={"action": "gimbal_taken", "by": station},
            )
        self._gimbal_control[gimbal_key] = control

    def _has_transmitter(self) -> bool:
        sample = self._vehicle.topic("health")
        if sample is None or not isinstance(sample.value, Health):
            return False
        health = sample.value
        return bool(health.sensors_present & health.sensors_healthy & MAV_SYS_STATUS_SENSOR_RC_RECEIVER)
