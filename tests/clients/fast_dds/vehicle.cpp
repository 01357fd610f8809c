// A vehicle on Fast DDS, like PX4 behind its agent, with PX4's QoS: it arms, changes its mode and prints the first
// attitude setpoint in Offboard. Runs until it is ended. Usage: vehicle DOMAIN NAMESPACE
#include <chrono>
#include <cstdio>
#include <thread>

#include "formats.hpp"

constexpr auto period = std::chrono::milliseconds(20);
constexpr uint8_t disarmed_state = 1, armed_state = 2, hold_mode = 4, offboard_mode = 14;
constexpr uint8_t accepted = 0, temporarily_rejected = 1, unsupported = 3;
constexpr uint32_t set_mode_command = 176, arm_command = 400;
constexpr float offboard_main_mode = 6;
constexpr uint8_t quadrotor = 2, rotary_wing = 1;
constexpr uint32_t every_mode = 0x7fffff;

uint64_t unix_us() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return static_cast<uint64_t>(std::chrono::duration_cast<std::chrono::microseconds>(now).count());
}

class Vehicle {
 public:
  Vehicle(uint32_t domain, const std::string& name_space)
      : participant_(domain, name_space),
        formats_(participant_),
        status_out_(participant_.writer<VehicleStatus>("/fmu/out/vehicle_status_v1")),
        attitude_out_(participant_.writer<VehicleAttitude>("/fmu/out/vehicle_attitude")),
        ack_out_(participant_.writer<VehicleCommandAck>("/fmu/out/vehicle_command_ack")),
        command_in_(in<VehicleCommand>("vehicle_command")),
        mode_in_(in<OffboardControlMode>("offboard_control_mode")),
        setpoint_in_(in<VehicleAttitudeSetpoint>("vehicle_attitude_setpoint")) {
    status_.arming_state = disarmed_state;
    status_.nav_state = status_.nav_state_user_intention = hold_mode;
    status_.valid_nav_states_mask = status_.can_set_nav_states_mask = every_mode;
    status_.vehicle_type = rotary_wing;
    status_.system_type = quadrotor;
    status_.system_id = status_.component_id = 1;
    status_.pre_flight_checks_pass = true;
  }

  void step() {
    formats_.answer();
    for (OffboardControlMode mode; take(mode_in_, mode);) streamed_ = mode.attitude;
    for (VehicleCommand command; take(command_in_, command);) execute(command);
    for (VehicleAttitudeSetpoint setpoint; take(setpoint_in_, setpoint);) show(setpoint);
    status_.timestamp = unix_us();
    status_out_->write(&status_);
    VehicleAttitude attitude;
    attitude.timestamp = attitude.timestamp_sample = status_.timestamp;
    attitude_out_->write(&attitude);
  }

 private:
  template <class Message>
  fdds::DataReader* in(const std::string& name) {
    return participant_.reader<Message>("/fmu/in/" + name, fdds::VOLATILE_DURABILITY_QOS);
  }

  // The next valid message of a topic.
  template <class Message>
  bool take(fdds::DataReader* reader, Message& message) {
    fdds::SampleInfo info;
    while (reader->take_next_sample(&message, &info) == eprosima::fastrtps::types::ReturnCode_t::RETCODE_OK) {
      if (info.valid_data) return true;
    }
    return false;
  }

  void execute(const VehicleCommand& command) {
    VehicleCommandAck ack;
    ack.timestamp = unix_us();
    ack.command = command.command;
    ack.result = result_of(command);
    ack.target_system = command.source_system;
    ack.target_component = command.source_component;
    ack_out_->write(&ack);
  }

  uint8_t result_of(const VehicleCommand& command) {
    if (command.command == arm_command) {
      status_.arming_state = command.param1 == 1 ? armed_state : disarmed_state;
      print(status_.arming_state == armed_state ? "armed" : "disarmed");
      return accepted;
    }
    if (command.command != set_mode_command) return unsupported;
    const bool offboard = command.param2 == offboard_main_mode;
    if (offboard && !streamed_) return temporarily_rejected;
    status_.nav_state = status_.nav_state_user_intention = offboard ? offboard_mode : hold_mode;
    print(offboard ? "offboard" : "hold");
    return accepted;
  }

  void show(const VehicleAttitudeSetpoint& setpoint) {
    if (shown_ || status_.nav_state != offboard_mode) return;
    shown_ = true;
    std::printf("setpoint %.2f %.2f %.2f %.2f, thrust %.2f\n", setpoint.q_d[0], setpoint.q_d[1], setpoint.q_d[2],
                setpoint.q_d[3], setpoint.thrust_body[2]);
    std::fflush(stdout);
  }

  static void print(const char* line) {
    std::printf("%s\n", line);
    std::fflush(stdout);
  }

  Participant participant_;
  Formats formats_;
  fdds::DataWriter *status_out_, *attitude_out_, *ack_out_;
  fdds::DataReader *command_in_, *mode_in_, *setpoint_in_;
  VehicleStatus status_;
  bool streamed_ = false, shown_ = false;
};

int main(int count, char** arguments) {
  if (count != 3) {
    std::fprintf(stderr, "usage: vehicle DOMAIN NAMESPACE\n");
    return 2;
  }
  for (Vehicle vehicle(static_cast<uint32_t>(std::stoul(arguments[1])), arguments[2]);;) {
    vehicle.step();
    std::this_thread::sleep_for(period);
  }
}
