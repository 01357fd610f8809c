// Flies PX4 over its ROS 2 topics with Fast DDS: offboard, arm, climb to 2 m, land. Usage: offboard DOMAIN NAMESPACE
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <thread>

#include "participant.hpp"

using Clock = std::chrono::steady_clock;
constexpr auto period = std::chrono::milliseconds(50);
constexpr uint8_t armed_state = 2, offboard_mode = 14, land_mode = 18;
constexpr uint32_t set_mode_command = 176, arm_command = 400, land_command = 21;
constexpr int climb_steps = 100;  // 5 s
constexpr float climb_to_z_m = -2.0F;

class Flight {
 public:
  Flight(uint32_t domain, const std::string& name_space)
      : participant_(domain, name_space),
        status_(participant_.reader<VehicleStatus>("/fmu/out/vehicle_status_v1")),
        mode_(participant_.writer<OffboardControlMode>("/fmu/in/offboard_control_mode")),
        setpoint_(participant_.writer<TrajectorySetpoint>("/fmu/in/trajectory_setpoint")),
        command_(participant_.writer<VehicleCommand>("/fmu/in/vehicle_command")) {}

  // Repeats an action every 50 ms until the vehicle's status shows the result; false after the time limit.
  bool until(const char* what, double limit_s, const std::function<bool(const VehicleStatus&)>& reached,
             const std::function<void(int)>& action) {
    const auto end = Clock::now() + std::chrono::duration<double>(limit_s);
    for (int n = 0; Clock::now() < end; ++n) {
      fdds::SampleInfo info;
      while (status_->take_next_sample(&last_, &info) == eprosima::fastrtps::types::ReturnCode_t::RETCODE_OK) known_ = known_ || info.valid_data;
      if (known_ && reached(last_)) {
        std::printf("%s: nav_state %d, arming_state %d\n", what, last_.nav_state, last_.arming_state);
        std::fflush(stdout);
        return true;
      }
      action(n);
      std::this_thread::sleep_for(period);
    }
    std::fprintf(stderr, "%s: not within %.0f s; a status was %sreceived\n", what, limit_s, known_ ? "" : "not ");
    return false;
  }

  void stream() {
    OffboardControlMode mode;
    mode.position = true;
    mode_->write(&mode);
    TrajectorySetpoint setpoint;
    setpoint.position = {0.0F, 0.0F, climb_to_z_m};
    setpoint.velocity = setpoint.acceleration = {NAN, NAN, NAN};
    setpoint.yawspeed = NAN;
    setpoint_->write(&setpoint);
  }

  void command(uint32_t number, float param1 = 0, float param2 = 0) {
    VehicleCommand command;
    command.command = number;
    command.param1 = param1;
    command.param2 = param2;
    command_->write(&command);
  }

 private:
  Participant participant_;
  fdds::DataReader* status_;
  fdds::DataWriter *mode_, *setpoint_, *command_;
  VehicleStatus last_;
  bool known_ = false;
};

bool fly(Flight& flight) {
  const auto often = [](int n) { return n % 10 == 9; };  // twice a second
  const auto is_armed = [](const VehicleStatus& status) { return status.arming_state == armed_state; };
  return flight.until("ready", 60, [](auto& status) { return status.pre_flight_checks_pass; }, [](int) {}) &&
         flight.until("offboard", 15, [](auto& status) { return status.nav_state == offboard_mode; },
                      [&](int n) {
                        flight.stream();
                        if (n > 20 && often(n)) flight.command(set_mode_command, 1, 6);
                      }) &&
         flight.until("armed", 15, is_armed,
                      [&](int n) {
                        flight.stream();
                        if (often(n)) flight.command(arm_command, 1);
                      }) &&
         flight.until("airborne", 15, [](auto& status) { return status.takeoff_time != 0; },
                      [&](int) { flight.stream(); }) &&
         flight.until("landing", 30, [](auto& status) { return status.nav_state == land_mode; },
                      [&](int n) {
                        if (n < climb_steps) flight.stream();
                        if (n >= climb_steps && often(n)) flight.command(land_command);
                      }) &&
         flight.until("landed", 60, [&](auto& status) { return !is_armed(status); }, [](int) {});
}

int main(int count, char** arguments) {
  if (count != 3) {
    std::fprintf(stderr, "usage: offboard DOMAIN NAMESPACE\n");
    return 2;
  }
  try {
    Flight flight(static_cast<uint32_t>(std::stoul(arguments[1])), arguments[2]);
    return fly(flight) ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
