"""What hangs on a file of PX4: what is lost, or changes at the next start, when it is removed or written.

The folders are those of PX4 on hardware (below `/fs/microsd`) and in simulation (below its working folder).
The memory card's file system does not distinguish capital letters, so neither does this module.
"""

from __future__ import annotations

from typing import Final, Literal

FileDanger = Literal["startup", "parameters", "missions", "log", "firmware", "device"]
"""`startup`: PX4 runs or reads it as it starts; a mistake may keep it from starting, or change how it flies.
`parameters`: parameters with calibration and tuning. `missions`: mission, geofence and rally points. `log`: a
recorded flight. `firmware`: flashed onto other devices at the next start. `device`: no file but a device or a
view of the running system."""
CARD: Final = "fs/microsd/"
FLASH: Final = "fs/mtd"
FOLDERS: Final[tuple[tuple[str, FileDanger], ...]] = (
    ("dev", "device"),
    ("proc", "device"),
    ("eeprom", "parameters"),
    ("etc", "startup"),
    ("ext_autostart", "startup"),
    ("uavcan.db", "firmware"),
    ("ufw", "firmware"),
    ("ufw_staging", "firmware"),
    ("log", "log"),
)
FILES: Final[dict[str, FileDanger]] = {
    "params": "parameters",
    "parameters.bson": "parameters",
    "parameters_backup.bson": "parameters",
    "params_backup": "parameters",
    "dataman": "missions",
}


def danger_of(path: str) -> FileDanger | None:
    """What hangs on a file or folder; None: nothing that is known.

    Args:
        path: path on the vehicle.
    """
    plain = path.strip("/").lower()
    plain = plain.removeprefix(CARD)
    if plain in FILES:
        return FILES[plain]
    if plain.startswith(FLASH):
        return "parameters"
    for folder, danger in FOLDERS:
        if plain == folder or plain.startswith(f"{folder}/"):
            return danger
    return "log" if plain.endswith((".ulg", ".ulge")) else None
