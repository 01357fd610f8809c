"""Identity of a vehicle, and whether this server may command it.

PX4 reads its uid from the processor. PX4 on Linux, including its simulator, reports a constant instead.
Therefore this constant identifies simulators and does not distinguish vehicles.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace

from gcs_server.vehicle.autopilot import Autopilot, autopilot_of

PX4_SITL_UID = 0x4954414C44494E4F
SITL_BOARD_VERSION = 1
"""Board version that only PX4's simulator reports; the simulator reports no USB vendor and product id."""
_version = struct.Struct("<QQIIIIHH24s18s")


@dataclass(frozen=True, slots=True)
class Identity:
    """Data of a vehicle that do not change in flight; unknown data are None."""

    system_id: int
    component_id: int
    autopilot: int
    """MAV_AUTOPILOT: 12 is PX4, 3 ArduPilot."""
    vehicle_type: int
    """MAV_TYPE: 2 is a quadrotor."""
    uid: str | None
    """Hexadecimal uid from AUTOPILOT_VERSION (uid2, or else uid); None: not received yet, or the
    vehicle has no uid."""
    simulated: bool | None
    """Whether the vehicle is simulated; None until AUTOPILOT_VERSION is received, and for autopilots other
    than PX4."""
    replayed: bool
    firmware: str | None
    """Version, as `1.16.0`; None until AUTOPILOT_VERSION is received."""
    capabilities: int | None
    """MAV_PROTOCOL_CAPABILITY."""
    warnings: tuple[str, ...] = ()
    """Warnings about this identity, as sentences."""

    @property
    def software(self) -> Autopilot:
        """The autopilot, in the version that the vehicle reported."""
        return autopilot_of(self.autopilot, self.firmware)

    @property
    def commandable(self) -> bool:
        """Whether this server commands such a vehicle."""
        return self.software.commands(self.vehicle_type)


@dataclass(frozen=True, slots=True)
class Version:
    """The used fields of AUTOPILOT_VERSION."""

    uid: str | None
    unique: bool
    """Whether the uid is unique; false for the constant that all simulators report."""
    firmware: str
    capabilities: int
    is_sitl: bool


def read_version(payload: bytes) -> Version:
    """Decodes a full AUTOPILOT_VERSION payload."""
    capabilities, uid, software, _, _, board, vendor, product, _, uid2 = _version.unpack(payload)
    is_constant_uid = uid == PX4_SITL_UID
    text = uid2.hex() if any(uid2) else f"{uid:016x}" if uid else None
    return Version(
        uid=text,
        unique=text is not None and (any(uid2) or not is_constant_uid),
        firmware=f"{software >> 24}.{software >> 16 & 0xFF}.{software >> 8 & 0xFF}",
        capabilities=capabilities,
        is_sitl=vendor == 0 and product == 0 and (is_constant_uid or board == SITL_BOARD_VERSION),
    )


def with_version(identity: Identity, version: Version) -> Identity:
    """The identity completed by AUTOPILOT_VERSION."""
    return replace(
        identity,
        uid=version.uid,
        firmware=version.firmware,
        capabilities=version.capabilities,
        simulated=identity.simulated
        or (version.is_sitl if identity.software.supported else identity.simulated),
    )
