"""Finds the gimbals of a vehicle, and the messages that belong to each.

Commands for a gimbal are addressed to its manager (a component, usually the autopilot) and contain the
device id that the manager reports. Device ids 1 to 6 are devices without their own MAVLink component,
attached to the component that reports the id; a larger device id is the component id of the device. A device
that is a component reports device id 0 for itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame
from gcs_server.vehicle.instances import component_of, instance_of

MAX_ATTACHED_ID = 6
NO_DATA_AFTER_S = 3.0
"""Time without an attitude after which a gimbal is ignored, while another gimbal is connected [s]."""
MANAGER_IDS = (d.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS, d.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION)
ATTITUDE_ID = d.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS
ATTITUDE_IDS = (ATTITUDE_ID, d.MAVLINK_MSG_ID_MOUNT_ORIENTATION)

Device = tuple[int, int]
"""(component, attached id); attached id 0: the component itself is the device."""


@dataclass(frozen=True, slots=True)
class GimbalAddress:
    """The address for commands to a gimbal."""

    component_id: int
    """The gimbal manager's component."""
    device_id: int
    """Device id at the manager; 0 if the manager does not report it."""


def device_of(component_id: int, device_id: int) -> Device:
    """The device to which a device id refers in a component's messages."""
    return (component_id, device_id) if device_id <= MAX_ATTACHED_ID else (device_id, 0)


def frames_by_gimbal(
    frames: Mapping[int, Frame], autopilot: int
) -> list[tuple[GimbalAddress, dict[int, Frame]]]:
    """The gimbals whose attitude is received, with the newest frame of each message; the autopilot's gimbals
    are first. If several components send the same message about one device, the autopilot's message is used,
    or else the message of the lowest component id. If this component no longer sends, the next component's
    message is used.

    Args:
        frames: the gimbal messages (`gimbal_decoder.IDS`), by key.
        autopilot: the autopilot's component id.
    """
    managed: dict[Device, tuple[int, GimbalAddress, dict[int, Frame]]] = {}
    for key, frame in _sorted_frames(frames, MANAGER_IDS):
        device = device_of(frame.component_id, instance_of(key))
        address = GimbalAddress(frame.component_id, instance_of(key))
        _, manager, messages = managed.setdefault(device, (component_of(key), address, {}))
        if manager == address:
            messages[frame.msg_id] = frame
    attitudes_of: dict[Device, list[Frame]] = {}
    for key, frame in _sorted_frames(frames, ATTITUDE_IDS):
        attitudes_of.setdefault(_known_device(frame.component_id, instance_of(key), managed), []).append(
            frame
        )
    newest_s = max((f.received_monotonic_s for each in attitudes_of.values() for f in each), default=0.0)
    gimbals: list[tuple[tuple[int, int, int], GimbalAddress, dict[int, Frame]]] = []
    for device, attitudes in attitudes_of.items():
        if newest_s - max(f.received_monotonic_s for f in attitudes) > NO_DATA_AFTER_S:
            continue
        unmanaged = GimbalAddress(autopilot, device[1] or (device[0] if device[0] != autopilot else 0))
        order, address, messages = managed.get(device, (0, unmanaged, {}))
        for msg_id in ATTITUDE_IDS:
            frames_of_message = [f for f in attitudes if f.msg_id == msg_id]
            received_s = max((f.received_monotonic_s for f in frames_of_message), default=0.0)
            recent = [f for f in frames_of_message if received_s - f.received_monotonic_s <= NO_DATA_AFTER_S]
            if recent:
                messages = {**messages, msg_id: recent[0]}
        gimbals.append(((order, *device), address, messages))
    return [(address, messages) for _, address, messages in sorted(gimbals, key=lambda each: each[0])]


def is_attitude_of(address: GimbalAddress, component_id: int, device_id: int) -> bool:
    """Whether an attitude from this component with this device id belongs to the gimbal at `address`."""
    device = device_of(address.component_id, address.device_id)
    return device_of(component_id, device_id) == device or (
        device_id == 0 and component_id == address.component_id
    )


def _sorted_frames(frames: Mapping[int, Frame], msg_ids: tuple[int, ...]) -> Iterable[tuple[int, Frame]]:
    """The frames of these messages: the autopilot's first, then by component and device."""
    selected = [(key, frame) for key, frame in frames.items() if frame.msg_id in msg_ids]
    return sorted(selected, key=lambda each: each[0] >> 24)


def _known_device(
    component_id: int, device_id: int, managed: Mapping[Device, tuple[int, GimbalAddress, dict[int, Frame]]]
) -> Device:
    """The device of an attitude. An attitude that a manager sends without a device id belongs to the
    manager's first device."""
    device = device_of(component_id, device_id)
    if device in managed:
        return device
    if device_id == 0:
        devices_of_manager = [
            each for each, (_, address, _) in managed.items() if address.component_id == component_id
        ]
        return min(devices_of_manager, default=device)
    return (component_id, 0) if (component_id, 0) in managed else device
