"""The only module that imports the generated dialect (see tools/build_dialect.py)."""

from __future__ import annotations

from gcs_server.mavlink.generated_dialect import *  # noqa: F403
from gcs_server.mavlink.generated_dialect import MAVLink_message as MAVLink_message
from gcs_server.mavlink.generated_dialect import enums as enums
from gcs_server.mavlink.generated_dialect import mavlink_map as mavlink_map
