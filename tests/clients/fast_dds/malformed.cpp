// Publishes vehicle statuses that are too short, 20 times a second until it is ended. Usage: malformed DOMAIN NAMESPACE
#include <chrono>
#include <cstdio>
#include <thread>

#include "formats.hpp"

int main(int count, char** arguments) {
  if (count != 3) {
    std::fprintf(stderr, "usage: malformed DOMAIN NAMESPACE\n");
    return 2;
  }
  Participant participant(static_cast<uint32_t>(std::stoul(arguments[1])), arguments[2]);
  auto* writer = participant.writer<MalformedStatus>("/fmu/out/vehicle_status_v1");
  Formats formats(participant);
  for (MalformedStatus status;;) {
    formats.answer();
    writer->write(&status);
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
}
