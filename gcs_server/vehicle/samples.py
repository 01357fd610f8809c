"""Topics of a vehicle: one frozen sample class per topic, with the field names of the JSON.

Frames: NED from the vehicle's own local origin, FRD body. SI units, radians; degrees only for
latitude, longitude and fields that end in `_deg`. `q_ned_frd` (w, x, y, z) rotates FRD vectors to NED. All
numbers are finite; None: unknown.

`TOPICS` maps a topic's name (in REST, WebSocket and Python alike) to its class.
"""

from __future__ import annotations

from dataclasses import dataclass

from missions.frames import Quaternion, Vector3


@dataclass(frozen=True, slots=True)
class Attitude:
    """ATTITUDE_QUATERNION, or ATTITUDE if it is newer."""

    roll_rad: float
    pitch_rad: float
    yaw_ned_rad: float
    q_ned_frd: Quaternion
    rates_frd_rad_s: Vector3 | None


@dataclass(frozen=True, slots=True)
class LocalPosition:
    """LOCAL_POSITION_NED: the estimated position from the estimator's origin."""

    position_ned_m: Vector3
    velocity_ned_m_s: Vector3


@dataclass(frozen=True, slots=True)
class GlobalPosition:
    """GLOBAL_POSITION_INT."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
    alt_home_m: float
    velocity_ned_m_s: Vector3
    heading_deg: float | None
    """0–360, clockwise from north."""


@dataclass(frozen=True, slots=True)
class Gps:
    """GPS_RAW_INT."""

    fix_type: int
    """GPS_FIX_TYPE: 0 no GPS, 1 no fix, 2 2-D, 3 3-D, 4 DGPS, 5 RTK float, 6 RTK fixed."""
    satellites: int | None
    hdop: float | None
    horizontal_accuracy_m: float | None


@dataclass(frozen=True, slots=True)
class BatteryReading:
    """One of several batteries."""

    battery_id: int
    """BATTERY_STATUS.id, from 0."""
    remaining_percent: int | None
    voltage_v: float | None
    current_a: float | None
    consumed_mah: int | None
    time_remaining_s: int | None
    cell_voltages_v: tuple[float, ...] | None = None
    """Voltage of each cell; null if only the sum is known."""


@dataclass(frozen=True, slots=True)
class Battery:
    """BATTERY_STATUS (SYS_STATUS until the first one): of several batteries, the battery with the
    least charge."""

    remaining_percent: int | None
    voltage_v: float | None
    current_a: float | None
    consumed_mah: int | None
    time_remaining_s: int | None
    cell_voltages_v: tuple[float, ...] | None = None
    """Voltage of each cell; null if only the sum is known."""
    battery_id: int | None = None
    """Id of this battery, from 0; None if the values are from SYS_STATUS."""
    batteries: tuple[BatteryReading, ...] = ()
    """All batteries, by id; empty if there is only one."""


@dataclass(frozen=True, slots=True)
class Home:
    """HOME_POSITION."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
    position_ned_m: Vector3 | None


@dataclass(frozen=True, slots=True)
class Orbit:
    """ORBIT_EXECUTION_STATUS: the circle of the mode Orbit; PX4 sends it only while it flies one."""

    lat_deg: float
    """Of the centre."""
    lon_deg: float
    """Of the centre."""
    alt_amsl_m: float | None
    radius_m: float
    clockwise: bool
    """Seen from above."""


@dataclass(frozen=True, slots=True)
class GimbalReading:
    """One gimbal."""

    gimbal_device_id: int
    """Device id at the gimbal's manager; 0 if the manager does not report it."""
    roll_rad: float
    pitch_rad: float
    yaw_frd_rad: float | None
    """Relative to the vehicle's heading."""
    yaw_ned_rad: float | None
    """Relative to north."""
    q: Quaternion
    """Quaternion from the device; `yaw_in_earth_frame` states the frame of its yaw."""
    yaw_in_earth_frame: bool
    yaw_lock: bool
    primary_control: tuple[int, int] | None
    """(system id, component id) of the controller; null if the gimbal is not controlled."""
    secondary_control: tuple[int, int] | None
    flags: int
    """GIMBAL_DEVICE_FLAGS."""
    pitch_min_rad: float | None
    pitch_max_rad: float | None
    yaw_min_rad: float | None
    yaw_max_rad: float | None
    component_id: int
    """MAVLink component id of the gimbal's manager, to which commands are sent."""


@dataclass(frozen=True, slots=True)
class Gimbal(GimbalReading):
    """The gimbal as its manager and device report it: of several gimbals, the first."""

    gimbals: tuple[GimbalReading, ...] = ()
    """All gimbals, the autopilot's first; empty if there is only one."""


@dataclass(frozen=True, slots=True)
class OutputGroup:
    """One of several groups of outputs."""

    port: int
    """SERVO_OUTPUT_RAW.port: 0 main, 1 auxiliary."""
    pwm_us: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Motors:
    """SERVO_OUTPUT_RAW: of several groups, the group with the lowest port (the main outputs)."""

    pwm_us: tuple[int, ...]
    groups: tuple[OutputGroup, ...] = ()
    """All groups, by port; empty if there is only one."""


@dataclass(frozen=True, slots=True)
class TargetLocal:
    """POSITION_TARGET_LOCAL_NED: the target of the vehicle's controllers. Null: not controlled."""

    position_ned_m: tuple[float | None, float | None, float | None]
    velocity_ned_m_s: tuple[float | None, float | None, float | None]
    acceleration_ned_m_s2: tuple[float | None, float | None, float | None]
    yaw_ned_rad: float | None
    yaw_rate_ned_rad_s: float | None


@dataclass(frozen=True, slots=True)
class TargetAttitude:
    """ATTITUDE_TARGET; PX4 does not update it while it controls only body rates."""

    q_ned_frd: Quaternion
    rates_frd_rad_s: Vector3
    thrust: float


@dataclass(frozen=True, slots=True)
class Hud:
    """VFR_HUD."""

    groundspeed_m_s: float | None
    airspeed_m_s: float | None
    """None without an airspeed sensor."""
    climb_m_s: float | None
    throttle_percent: int


@dataclass(frozen=True, slots=True)
class Health:
    """SYS_STATUS bit masks (MAV_SYS_STATUS_SENSOR) and CPU load."""

    sensors_present: int
    sensors_enabled: int
    sensors_healthy: int
    ready_to_arm: bool | None
    """MAV_SYS_STATUS_PREARM_CHECK healthy; None before the vehicle has reported any sensor."""
    cpu_load: float | None
    """0–1."""


@dataclass(frozen=True, slots=True)
class Estimator:
    """ESTIMATOR_STATUS flags (ESTIMATOR_STATUS_FLAGS) and accuracies."""

    flags: int
    horizontal_accuracy_m: float | None
    vertical_accuracy_m: float | None


@dataclass(frozen=True, slots=True)
class Mission:
    """MISSION_CURRENT and MISSION_ITEM_REACHED: the vehicle's mission, and its progress."""

    current: int
    """Index of the current or next item, from 0."""
    count: int | None
    """Number of items of the mission; null if unknown."""
    reached: int | None
    """Index of the item that the vehicle last reported as reached, from 0; null: no item yet."""
    mission_id: int
    """The vehicle's checksum of its mission; 0: no mission, or unknown."""
    fence_id: int
    """The vehicle's checksum of its geofence."""
    rally_points_id: int
    """The vehicle's checksum of its rally points."""


@dataclass(frozen=True, slots=True)
class Status:
    """State of the vehicle, from HEARTBEAT, CURRENT_MODE and EXTENDED_SYS_STATE."""

    armed: bool
    mode: str
    """Name of the mode in the API: hold, takeoff, land, rtl, position, offboard, mission, …"""
    mode_label: str
    """Label for the display: Hold, Take off, Return, …"""
    custom_mode: int
    intended_custom_mode: int | None
    """Intended mode of CURRENT_MODE: the requested mode, also while a failsafe flies another mode. null: the
    vehicle has not reported it since the last change of the mode."""
    landed_state: str
    """unknown, on_ground, in_air, taking_off, landing."""
    system_status: int
    """MAV_STATE."""
    link_lost: bool
    """Whether the connection is lost: no message of the autopilot for 3.5 s on any link."""
    last_heartbeat_age_s: float | None
    """Age at the time of the sample; null before the first heartbeat."""


@dataclass(frozen=True, slots=True)
class DistanceSensor:
    """DISTANCE_SENSOR of one sensor."""

    sensor_id: int
    direction_frd: Vector3
    """Direction of the measurement, as a unit vector."""
    distance_m: float | None
    """More than `range_max_m`: no obstacle within range; null: unknown."""
    range_min_m: float
    range_max_m: float
    width_rad: float | None
    """Horizontal field of view; null if unknown."""
    behind_s: float
    """Age of this measurement relative to the newest measurement of the vehicle's sensors [s]."""


@dataclass(frozen=True, slots=True)
class DistanceSensors:
    """DISTANCE_SENSOR of each sensor."""

    sensors: tuple[DistanceSensor, ...]


@dataclass(frozen=True, slots=True)
class ObstacleDistance:
    """OBSTACLE_DISTANCE: distances in sectors around the vehicle."""

    frame: str
    """Reference of the angles: body (the nose) or north."""
    first_deg: float
    """Direction of the middle of the first sector, clockwise."""
    step_deg: float
    """Angle between sectors, clockwise; negative: counter-clockwise."""
    distances_m: tuple[float | None, ...]
    """More than `range_max_m`: no obstacle within range; null: unknown."""
    range_min_m: float
    range_max_m: float


@dataclass(frozen=True, slots=True)
class Wind:
    """WIND_COV: the wind estimate of the vehicle; a multicopter seldom has one."""

    wind_ned_m_s: Vector3
    """Velocity of the air; the vertical part is 0 if the vehicle does not report it."""
    speed_m_s: float
    """Speed of the air over the ground."""


TOPICS: dict[str, type] = {
    "status": Status,
    "attitude": Attitude,
    "local_position": LocalPosition,
    "global_position": GlobalPosition,
    "gps": Gps,
    "battery": Battery,
    "home": Home,
    "gimbal": Gimbal,
    "motors": Motors,
    "target_local": TargetLocal,
    "target_attitude": TargetAttitude,
    "hud": Hud,
    "health": Health,
    "estimator": Estimator,
    "mission": Mission,
    "distance_sensors": DistanceSensors,
    "obstacle_distance": ObstacleDistance,
    "wind": Wind,
    "orbit": Orbit,
}


@dataclass(frozen=True, slots=True)
class Sample:
    """Newest value of a topic, with its time on both clocks."""

    topic: str
    vehicle_time_boot_s: float | None
    """Time since the vehicle's boot, if the message contains it."""
    received_unix_s: float
    received_monotonic_s: float
    value: object
    """An instance of TOPICS[topic]."""
