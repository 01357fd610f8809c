"""PX4's ROS 2 topics for a plain DDS program: hand-written message types, a publisher and a subscriber.

It needs `cyclonedds`, not ROS. `ros2_offboard_node.py` and `ros2_flow.py` use it.
"""

from typing import Any

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct, make_idl_struct
from cyclonedds.idl import types as idl
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

_PRIMITIVES: dict[str, Any] = {
    "bool": bool, "u8": idl.uint8, "i8": idl.int8, "u16": idl.uint16, "u32": idl.uint32, "u64": idl.uint64,
    "i64": idl.int64, "f32": idl.float32, "f64": idl.float64,
}  # fmt: skip

_ZERO_FIELDS: dict[Any, dict[str, Any]] = {}
QOS = Qos(Policy.Reliability.BestEffort, Policy.Durability.TransientLocal, Policy.History.KeepLast(1))
"""The QoS of PX4's example programs; a reliable reader receives nothing from PX4."""


def define_message(name: str, declaration: str) -> Any:
    """A message type of px4_msgs; `declaration` has `type:name` or `type[n]:name` for each field."""
    fields: dict[str, Any] = {}
    zeros: dict[str, Any] = {}
    for field_declaration in declaration.split():
        type_name, _, field = field_declaration.partition(":")
        type_name, _, length = type_name.rstrip("]").partition("[")
        element_type = _PRIMITIVES[type_name]
        fields[field] = idl.array[element_type, int(length)] if length else element_type
        zeros[field] = [0.0] * int(length) if length else 0
    message_type = make_idl_struct(name, f"px4_msgs.msg.dds_.{name}_", fields)
    _ZERO_FIELDS[message_type] = zeros
    return message_type


OffboardControlMode = define_message(
    "OffboardControlMode",
    "u64:timestamp bool:position bool:velocity bool:acceleration bool:attitude bool:body_rate "
    "bool:thrust_and_torque bool:direct_actuator",
)
TrajectorySetpoint = define_message(
    "TrajectorySetpoint",
    "u64:timestamp f32[3]:position f32[3]:velocity f32[3]:acceleration f32[3]:jerk f32:yaw f32:yawspeed",
)
VehicleCommand = define_message(
    "VehicleCommand",
    "u64:timestamp f32:param1 f32:param2 f32:param3 f32:param4 f64:param5 f64:param6 f32:param7 u32:command "
    "u8:target_system u8:target_component u8:source_system u16:source_component u8:confirmation "
    "bool:from_external",
)
VehicleStatus = define_message(
    "VehicleStatus",
    "u64:timestamp u64:armed_time u64:takeoff_time u8:arming_state u8:latest_arming_reason "
    "u8:latest_disarming_reason u64:nav_state_timestamp u8:nav_state_user_intention u8:nav_state "
    "u8:executor_in_charge u32:valid_nav_states_mask u32:can_set_nav_states_mask u16:failure_detector_status "
    "u8:hil_state u8:vehicle_type bool:failsafe bool:failsafe_and_user_took_over u8:failsafe_defer_state "
    "bool:gcs_connection_lost u8:gcs_connection_lost_counter bool:high_latency_data_link_lost bool:is_vtol "
    "bool:is_vtol_tailsitter bool:in_transition_mode bool:in_transition_to_fw u8:system_type u8:system_id "
    "u8:component_id bool:safety_button_available bool:safety_off bool:power_input_valid bool:usb_connected "
    "bool:open_drone_id_system_present bool:open_drone_id_system_healthy bool:parachute_system_present "
    "bool:parachute_system_healthy bool:rc_calibration_in_progress bool:calibration_enabled "
    "bool:pre_flight_checks_pass",
)
VehicleLocalPosition = define_message(
    "VehicleLocalPosition",
    "u64:timestamp u64:timestamp_sample bool:xy_valid bool:z_valid bool:v_xy_valid bool:v_z_valid f32:x "
    "f32:y f32:z f32[2]:delta_xy u8:xy_reset_counter f32:delta_z u8:z_reset_counter f32:vx f32:vy f32:vz "
    "f32:z_deriv "
    "f32[2]:delta_vxy u8:vxy_reset_counter f32:delta_vz u8:vz_reset_counter f32:ax f32:ay f32:az f32:heading "
    "f32:heading_var f32:unaided_heading f32:delta_heading u8:heading_reset_counter "
    "bool:heading_good_for_control f32:tilt_var bool:xy_global bool:z_global u64:ref_timestamp f64:ref_lat "
    "f64:ref_lon f32:ref_alt bool:dist_bottom_valid f32:dist_bottom f32:dist_bottom_var "
    "f32:delta_dist_bottom u8:dist_bottom_reset_counter u8:dist_bottom_sensor_bitfield f32:eph f32:epv "
    "f32:evh f32:evv bool:dead_reckoning f32:vxy_max f32:vz_max f32:hagl_min f32:hagl_max_z f32:hagl_max_xy",
)
VehicleOdometry = define_message(
    "VehicleOdometry",
    "u64:timestamp u64:timestamp_sample u8:pose_frame f32[3]:position f32[4]:q u8:velocity_frame "
    "f32[3]:velocity f32[3]:angular_velocity f32[3]:position_variance f32[3]:orientation_variance "
    "f32[3]:velocity_variance u8:reset_counter i8:quality",
)
TimesyncStatus = define_message(
    "TimesyncStatus",
    "u64:timestamp u8:source_protocol u64:remote_timestamp i64:observed_offset i64:estimated_offset "
    "u32:round_trip_time",
)


def new_message(message_type: Any, **fields: Any) -> Any:
    """A message; fields that are not given are zero, as in ROS."""
    zeros = {
        name: list(value) if isinstance(value, list) else value
        for name, value in _ZERO_FIELDS[message_type].items()
    }
    return message_type(**(zeros | fields))


class Node:
    """Publishers and subscribers of one program."""

    def __init__(self, domain: int, namespace: str = "") -> None:
        self._participant = DomainParticipant(domain)
        self._prefix = f"rt/{namespace}" if namespace else "rt"

    def _topic(self, message_type: type[IdlStruct], name: str) -> Any:
        return Topic(self._participant, self._prefix + name, message_type)

    def publisher(self, message_type: Any, name: str) -> Any:
        """A writer; `write(message)` publishes."""
        return DataWriter(self._participant, self._topic(message_type, name), qos=QOS)

    def subscription(self, message_type: Any, name: str) -> "Subscription":
        """A reader."""
        return Subscription(DataReader(self._participant, self._topic(message_type, name), qos=QOS))


class Subscription:
    """Keeps a topic's newest message."""

    def __init__(self, reader: Any) -> None:
        self._reader = reader
        self._latest: Any = None

    @property
    def latest(self) -> Any:
        """The newest message; None before the first one."""
        for sample in self._reader.take(10):
            if isinstance(sample, IdlStruct):  # not the notification that a writer has ended
                self._latest = sample
        return self._latest
