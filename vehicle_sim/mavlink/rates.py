"""Messages that PX4 streams by default on its two default links, and their rates.

Rates are those that PX4 configures, in Hz; measured rates of a real vehicle are up to 1 % lower. A message
that is not in a link's table is not streamed on the link until a client sets an interval.
"""

from __future__ import annotations

from typing import Final

GCS: Final[dict[str, float]] = {
    "HEARTBEAT": 1.0,
    "SYS_STATUS": 1.0,
    "PING": 0.1,
    "LINK_NODE_STATUS": 1.0,
    "GPS_RAW_INT": 5.0,
    "SCALED_PRESSURE": 1.0,
    "ATTITUDE": 50.0,
    "ATTITUDE_QUATERNION": 50.0,
    "LOCAL_POSITION_NED": 50.0,
    "GLOBAL_POSITION_INT": 50.0,
    "SERVO_OUTPUT_RAW": 50.0,
    "MISSION_CURRENT": 1.0,
    "VFR_HUD": 4.0,
    "ATTITUDE_TARGET": 50.0,
    "POSITION_TARGET_LOCAL_NED": 50.0,
    "POSITION_TARGET_GLOBAL_INT": 1.0,
    "DISTANCE_SENSOR": 0.5,
    "ALTITUDE": 1.0,
    "BATTERY_STATUS": 0.5,
    "ESTIMATOR_STATUS": 0.5,
    "VIBRATION": 0.1,
    "HOME_POSITION": 0.5,
    "EXTENDED_SYS_STATE": 1.0,
    "MOUNT_ORIENTATION": 10.0,
    "GIMBAL_MANAGER_STATUS": 0.5,
    "GIMBAL_DEVICE_ATTITUDE_STATUS": 1.0,
    "TIME_ESTIMATE_TO_TARGET": 0.5,
    "CURRENT_EVENT_SEQUENCE": 1.0 / 3.0,
    "CURRENT_MODE": 0.5,
    "ORBIT_EXECUTION_STATUS": 2.0,
    "OPEN_DRONE_ID_LOCATION": 1.0,
    "OPEN_DRONE_ID_SYSTEM": 1.0,
}

API: Final[dict[str, float]] = GCS | {
    "SYS_STATUS": 5.0,
    "SYSTEM_TIME": 1.0,
    "PING": 1.0,
    "GPS_RAW_INT": 8.0,
    "ATTITUDE": 100.0,
    "LOCAL_POSITION_NED": 30.0,
    "SERVO_OUTPUT_RAW": 10.0,
    "VFR_HUD": 10.0,
    "ATTITUDE_TARGET": 10.0,
    "POSITION_TARGET_LOCAL_NED": 10.0,
    "POSITION_TARGET_GLOBAL_INT": 10.0,
    "HIGHRES_IMU": 50.0,
    "TIMESYNC": 10.0,
    "DISTANCE_SENSOR": 10.0,
    "ALTITUDE": 10.0,
    "ESTIMATOR_STATUS": 1.0,
    "VIBRATION": 0.5,
    "EXTENDED_SYS_STATE": 5.0,
    "ODOMETRY": 30.0,
}

PROFILES: Final[dict[str, dict[str, float]]] = {"gcs": GCS, "api": API}

RESTORED_HZ: Final[dict[str, float]] = {"ATTITUDE": 15.0}
"""Rates after a client has set interval 0 ("default"), if they differ from the rates at boot."""

FIXED_INTERVAL: Final = frozenset({"HEARTBEAT", "CURRENT_EVENT_SEQUENCE", "EVENT"})
"""Messages for which PX4 accepts no interval."""
