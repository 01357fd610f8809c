// PX4's answers to the question which layout a topic has (message_format_request), with the hashes of v1.16.
#pragma once

#include <algorithm>
#include <map>
#include <string>

#include "participant.hpp"

struct MessageFormatRequest {
  static constexpr const char* name = "MessageFormatRequest";
  uint64_t timestamp = 0;
  uint16_t protocol_version = 0;
  std::array<uint8_t, 50> topic_name{};

  template <class F>
  void fields(F&& field) {
    field(timestamp), field(protocol_version), field(topic_name);
  }
};

struct MessageFormatResponse {
  static constexpr const char* name = "MessageFormatResponse";
  uint64_t timestamp = 0;
  uint16_t protocol_version = 1;
  std::array<uint8_t, 50> topic_name{};
  bool success = false;
  uint32_t message_hash = 0;

  template <class F>
  void fields(F&& field) {
    field(timestamp), field(protocol_version), field(topic_name), field(success), field(message_hash);
  }
};

class Formats {
 public:
  explicit Formats(Participant& participant)
      : requests_(participant.reader<MessageFormatRequest>("/fmu/in/message_format_request",
                                                           fdds::VOLATILE_DURABILITY_QOS)),
        responses_(participant.writer<MessageFormatResponse>("/fmu/out/message_format_response")) {}

  void answer() {
    MessageFormatRequest request;
    fdds::SampleInfo info;
    while (requests_->take_next_sample(&request, &info) == eprosima::fastrtps::types::ReturnCode_t::RETCODE_OK) {
      if (!info.valid_data) continue;
      MessageFormatResponse response;
      response.topic_name = request.topic_name;
      const std::string name(request.topic_name.begin(), std::find(request.topic_name.begin(), request.topic_name.end(), 0));
      const auto hash = hashes().find(name.substr(name.rfind('/') + 1));
      response.success = hash != hashes().end();
      if (response.success) response.message_hash = hash->second;
      responses_->write(&response);
    }
  }

 private:
  static const std::map<std::string, uint32_t>& hashes() {
    static const std::map<std::string, uint32_t> known{
        {"vehicle_status", 0xf779fa65},        {"vehicle_attitude", 0x0ac1f7cd},
        {"vehicle_command_ack", 0xa47749fe},   {"vehicle_command", 0xcba514af},
        {"offboard_control_mode", 0x2ff32960}, {"vehicle_attitude_setpoint", 0x2032c575}};
    return known;
  }

  fdds::DataReader* requests_;
  fdds::DataWriter* responses_;
};
