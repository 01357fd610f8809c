// The messages of px4_msgs 1.16 that the programs use, with their fields in wire order, and their CDR by Fast CDR.
#pragma once

#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>
#include <fastcdr/exceptions/Exception.h>
#include <fastdds/dds/topic/TopicDataType.hpp>

#include <array>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>

struct OffboardControlMode {
  static constexpr const char* name = "OffboardControlMode";
  uint64_t timestamp = 0;
  bool position = false, velocity = false, acceleration = false, attitude = false, body_rate = false,
       thrust_and_torque = false, direct_actuator = false;

  template <class F>
  void fields(F&& field) {
    field(timestamp), field(position), field(velocity), field(acceleration), field(attitude), field(body_rate),
        field(thrust_and_torque), field(direct_actuator);
  }
};

struct TrajectorySetpoint {
  static constexpr const char* name = "TrajectorySetpoint";
  uint64_t timestamp = 0;
  std::array<float, 3> position{}, velocity{}, acceleration{}, jerk{};
  float yaw = 0, yawspeed = 0;

  template <class F>
  void fields(F&& field) {
    field(timestamp), field(position), field(velocity), field(acceleration), field(jerk), field(yaw), field(yawspeed);
  }
};

struct VehicleCommand {
  static constexpr const char* name = "VehicleCommand";
  uint64_t timestamp = 0;
  float param1 = 0, param2 = 0, param3 = 0, param4 = 0;
  double param5 = 0, param6 = 0;
  float param7 = 0;
  uint32_t command = 0;
  uint8_t target_system = 1, target_component = 1, source_system = 1;
  uint16_t source_component = 1;
  uint8_t confirmation = 0;
  bool from_external = true;

  template <class F>
  void fields(F&& field) {
    field(timestamp), field(param1), field(param2), field(param3), field(param4), field(param5), field(param6),
        field(param7), field(command), field(target_system), field(target_component), field(source_system),
        field(source_component), field(confirmation), field(from_external);
  }
};

struct VehicleCommandAck {
  static constexpr const char* name = "VehicleCommandAck";
  uint64_t timestamp = 0;
  uint32_t command = 0;
  uint8_t result = 0, result_param1 = 0;
  int32_t result_param2 = 0;
  uint8_t target_system = 0;
  uint16_t target_component = 0;
  bool from_external = false;

  template <class F>
  void fields(F&& field) {
    field(timestamp), field(command), field(result), field(result_param1), field(result_param2), field(target_system),
        field(target_component), field(from_external);
  }
};

struct VehicleAttitude {
  static constexpr const char* name = "VehicleAttitude";
  uint64_t timestamp = 0, timestamp_sample = 0;
  std::array<float, 4> q{1, 0, 0, 0}, delta_q_reset{1, 0, 0, 0};
  uint8_t quat_reset_counter = 0;

  template <class F>
  void fields(F&& field) {
    field(timestamp), field(timestamp_sample), field(q), field(delta_q_reset), field(quat_reset_counter);
  }
};

struct VehicleAttitudeSetpoint {
  static constexpr const char* name = "VehicleAttitudeSetpoint";
  uint64_t timestamp = 0;
  float yaw_sp_move_rate = 0;
  std::array<float, 4> q_d{};
  std::array<float, 3> thrust_body{};
  bool reset_integral = false, fw_control_yaw_wheel = false;

  template <class F>
  void fields(F&& field) {
    field(timestamp), field(yaw_sp_move_rate), field(q_d), field(thrust_body), field(reset_integral),
        field(fw_control_yaw_wheel);
  }
};

struct VehicleStatus {
  static constexpr const char* name = "VehicleStatus";
  uint64_t timestamp = 0, armed_time = 0, takeoff_time = 0;
  uint8_t arming_state = 0, latest_arming_reason = 0, latest_disarming_reason = 0;
  uint64_t nav_state_timestamp = 0;
  uint8_t nav_state_user_intention = 0, nav_state = 0, executor_in_charge = 0;
  uint32_t valid_nav_states_mask = 0, can_set_nav_states_mask = 0;
  uint16_t failure_detector_status = 0;
  uint8_t hil_state = 0, vehicle_type = 0;
  bool failsafe = false, failsafe_and_user_took_over = false;
  uint8_t failsafe_defer_state = 0;
  bool gcs_connection_lost = false;
  uint8_t gcs_connection_lost_counter = 0;
  bool high_latency_data_link_lost = false, is_vtol = false, is_vtol_tailsitter = false, in_transition_mode = false,
       in_transition_to_fw = false;
  uint8_t system_type = 0, system_id = 0, component_id = 0;
  std::array<bool, 10> safety_to_calibration{};  // ten booleans that are not used here
  bool pre_flight_checks_pass = false;

  template <class F>
  void fields(F&& field) {
    field(timestamp), field(armed_time), field(takeoff_time), field(arming_state), field(latest_arming_reason),
        field(latest_disarming_reason), field(nav_state_timestamp), field(nav_state_user_intention), field(nav_state),
        field(executor_in_charge), field(valid_nav_states_mask), field(can_set_nav_states_mask),
        field(failure_detector_status), field(hil_state), field(vehicle_type), field(failsafe),
        field(failsafe_and_user_took_over), field(failsafe_defer_state), field(gcs_connection_lost),
        field(gcs_connection_lost_counter), field(high_latency_data_link_lost), field(is_vtol),
        field(is_vtol_tailsitter), field(in_transition_mode), field(in_transition_to_fw), field(system_type),
        field(system_id), field(component_id), field(safety_to_calibration), field(pre_flight_checks_pass);
  }
};

// The type of a message for Fast DDS, under its name in ROS 2.
template <class Message>
class Px4Type : public eprosima::fastdds::dds::TopicDataType {
 public:
  Px4Type() {
    setName(("px4_msgs::msg::dds_::" + std::string(Message::name) + "_").c_str());
    m_typeSize = max_bytes;
    m_isGetKeyDefined = false;
  }

  bool serialize(void* data, eprosima::fastrtps::rtps::SerializedPayload_t* payload) override {
    eprosima::fastcdr::FastBuffer buffer(reinterpret_cast<char*>(payload->data), payload->max_size);
    eprosima::fastcdr::Cdr cdr(buffer, eprosima::fastcdr::Cdr::LITTLE_ENDIANNESS, eprosima::fastcdr::Cdr::DDS_CDR);
    payload->encapsulation = CDR_LE;
    cdr.serialize_encapsulation();
    static_cast<Message*>(data)->fields([&](auto& value) { cdr << value; });
    payload->length = static_cast<uint32_t>(cdr.getSerializedDataLength());
    return true;
  }

  bool deserialize(eprosima::fastrtps::rtps::SerializedPayload_t* payload, void* data) override {
    eprosima::fastcdr::FastBuffer buffer(reinterpret_cast<char*>(payload->data), payload->length);
    eprosima::fastcdr::Cdr cdr(buffer, eprosima::fastcdr::Cdr::DEFAULT_ENDIAN, eprosima::fastcdr::Cdr::DDS_CDR);
    try {
      cdr.read_encapsulation();
      static_cast<Message*>(data)->fields([&](auto& value) { cdr >> value; });
    } catch (const eprosima::fastcdr::exception::Exception&) {
      return false;
    }
    return true;
  }

  std::function<uint32_t()> getSerializedSizeProvider(void*) override {
    return [] { return max_bytes; };
  }
  void* createData() override { return new Message(); }
  void deleteData(void* data) override { delete static_cast<Message*>(data); }
  bool getKey(void*, eprosima::fastrtps::rtps::InstanceHandle_t*, bool) override { return false; }

 private:
  static constexpr uint32_t max_bytes = 256;
};

// A vehicle status of nine bytes, as a faulty program would send it.
struct MalformedStatus {
  static constexpr const char* name = "VehicleStatus";
  uint64_t timestamp = 0;
  uint8_t byte = 0;

  template <class F>
  void fields(F&& field) {
    field(timestamp), field(byte);
  }
};
