"""Build data that the simulator reports: PX4 SITL on Linux."""

from __future__ import annotations

from typing import Final

VENDOR_VERSION: Final = 0xFF
"""No vendor version; the last byte marks a release."""
BOARD: Final = "PX4_SITL"
OS_NAME: Final = "Linux"
OS_VERSION: Final = 0x06122CFF
"""6.18.44; the last byte marks a release."""
TOOLCHAIN: Final = "GNU GCC"
TOOLCHAIN_VERSION: Final = "12.2.0"
DATA_FORMAT: Final = 2
"""Format version of the log's contents; PX4 increments it when it renames topic fields."""


def version_text(version: int) -> str:
    """The version in the format "Release 1.16.0 (17826047)"."""
    major, minor, patch = version >> 24 & 0xFF, version >> 16 & 0xFF, version >> 8 & 0xFF
    return f"Release {major}.{minor}.{patch} ({version})"
