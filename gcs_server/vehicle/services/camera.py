"""Takes photos with the vehicle's cameras (MAVLink camera protocol version 2)."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from gcs_server.errors import InvalidRequest, NoReply, Rejected
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.mailbox import Reply
from gcs_server.vehicle.services.port import VehiclePort
from gcs_server.vehicle.services.transaction import RESULT_TEXT, Request

ATTEMPTS = 3
ACK_TIMEOUT_S = 0.7


class CameraService:
    """Takes photos, one at a time, with a connected camera."""

    def __init__(self, vehicle: VehiclePort) -> None:
        self._vehicle = vehicle
        self._sequence = 0

    async def take_picture(self, component: int | None = None) -> None:
        """Takes one photo; returns once the camera has acknowledged it.

        All attempts have the same sequence number, so that a camera that receives two of them takes only one
        photo.

        Args:
            component: MAVLink component id of the camera; None: the connected camera with the lowest id.

        Raises:
            InvalidRequest: no camera with this id is connected.
            Rejected: the camera refuses the request.
            NoReply: no camera acknowledges the request.
        """
        vehicle = self._vehicle
        vehicle.require("camera")
        camera = vehicle.components.camera(component)
        if camera is None and component is not None:
            raise InvalidRequest(
                "component",
                f"Vehicle {vehicle.id} has no connected camera with component id {component}.",
                remedy="Omit `component`, or use the id of a camera in the vehicle's `components`.",
            )
        camera = camera or d.MAV_COMP_ID_CAMERA
        self._sequence += 1
        request = Request(d.MAV_CMD_IMAGE_START_CAPTURE, (0.0, 0.0, 1.0, float(self._sequence), 0, 0, 0))
        with vehicle.mailbox.expect(
            d.MAVLINK_MSG_ID_COMMAND_ACK, matches=self._is_ack_from(camera)
        ) as waiter:
            for attempt in range(ATTEMPTS):
                vehicle.send(request.message(vehicle.identity.system_id, camera, attempt, False))
                try:
                    async with asyncio.timeout(ACK_TIMEOUT_S):
                        ack = await waiter.next()
                except TimeoutError:
                    continue
                if ack.result == d.MAV_RESULT_ACCEPTED:
                    return
                reason = RESULT_TEXT.get(ack.result, f"result {ack.result}")
                raise Rejected(f"The camera of vehicle {vehicle.id} took no photo: {reason}.")
        raise NoReply(
            f"No camera of vehicle {vehicle.id} answered within {ATTEMPTS * ACK_TIMEOUT_S:.1f} s.",
            deadline_s=ATTEMPTS * ACK_TIMEOUT_S,
            remedy=f"The request went to MAVLink component {camera}. Check that the camera is switched on.",
        )

    def _is_ack_from(self, camera: int) -> Callable[[Reply], bool]:
        sender = (self._vehicle.identity.system_id, camera)
        return lambda message: (
            (message.get_srcSystem(), message.get_srcComponent()) == sender
            and message.command == d.MAV_CMD_IMAGE_START_CAPTURE
        )
