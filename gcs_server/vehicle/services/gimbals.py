"""The gimbals of a vehicle: the services that command them, and requests for their limits."""

from __future__ import annotations

from gcs_server.errors import InvalidRequest
from gcs_server.mavlink import dialect as d
from gcs_server.vehicle.gimbals import GimbalAddress
from gcs_server.vehicle.services.gimbal import GimbalService, Roi
from gcs_server.vehicle.services.port import VehiclePort
from gcs_server.vehicle.services.transaction import Request
from gcs_server.vehicle.state import VehicleState

MAX_LIMITS_REQUESTS = 5
LIMITS_REQUEST_PERIOD_S = 1.0
STATUS_ID = d.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS
LIMITS_ID = d.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION


class Gimbals:
    """All gimbals of one vehicle."""

    def __init__(self, vehicle: VehiclePort, state: VehicleState) -> None:
        self._vehicle = vehicle
        self._state = state
        self._services: dict[GimbalAddress, GimbalService] = {}
        self._requests_sent: dict[int, int] = {}
        """Number of requests for limits since the link was last restored, by component id of the manager."""
        self._next_s = float("-inf")
        self._outdated_before_s = float("-inf")
        """Limits received before this time are requested again [s, monotonic]."""
        self._rois: dict[GimbalAddress | None, Roi] = {}
        self.first = GimbalService(vehicle, None, self._rois)
        """Commands the first gimbal."""

    def addresses(self) -> tuple[GimbalAddress, ...]:
        """The connected gimbals, the autopilot's first."""
        return self._state.gimbals()

    def service_for(self, component_id: int | None, device_id: int | None) -> GimbalService:
        """The service of the first gimbal with this device id whose manager has this component id; None: any
        id.

        Raises:
            InvalidRequest: the vehicle has no such gimbal.
        """
        if component_id is None and device_id is None:
            return self.first
        addresses = self.addresses()
        for address in addresses:
            if component_id in (None, address.component_id) and device_id in (None, address.device_id):
                return self._services.setdefault(address, GimbalService(self._vehicle, address, self._rois))
        selected = (("component", component_id), ("device", device_id))
        selected_text = ", ".join(f"{name} {value}" for name, value in selected if value is not None)
        gimbals_text = (
            "; ".join(f"component {a.component_id}, device {a.device_id}" for a in addresses) or "none"
        )
        raise InvalidRequest(
            "device" if component_id is None else "component",
            f"Vehicle {self._vehicle.id} has no gimbal with {selected_text}.",
            remedy=f"Its gimbals: {gimbals_text}. "
            "Without component and device, the first gimbal is commanded.",
        )

    def request_limits(self) -> None:
        """Requests GIMBAL_MANAGER_INFORMATION, which the vehicle does not stream, a few times until it
        arrives, and again when the link is restored. The request is always sent to PX4, and to another
        component only after a message of its gimbal manager.
        """
        vehicle, state = self._vehicle, self._state
        now_s = vehicle.clock.monotonic_s()
        if now_s < self._next_s:
            return
        identity = vehicle.identity
        if identity.replayed or state.link_lost:
            return
        self._next_s = now_s + LIMITS_REQUEST_PERIOD_S
        managers = state.senders(STATUS_ID)
        if identity.software.supported:
            managers |= {identity.component_id}
        for component_id in sorted(managers):
            sent = self._requests_sent.get(component_id, 0)
            limits_frame = state.newest(LIMITS_ID, component_id, None)
            is_current = (
                limits_frame is not None and limits_frame.received_monotonic_s >= self._outdated_before_s
            )
            if sent < MAX_LIMITS_REQUESTS and not is_current:
                self._requests_sent[component_id] = sent + 1
                request = Request(d.MAV_CMD_REQUEST_MESSAGE, (float(LIMITS_ID), 0, 0, 0, 0, 0, 0))
                vehicle.send(request.message(identity.system_id, component_id, 0, False))

    def link_restored(self) -> None:
        """Requests the limits again, because the vehicle may have another gimbal or firmware now."""
        self._requests_sent, self._outdated_before_s = {}, self._vehicle.clock.monotonic_s()
