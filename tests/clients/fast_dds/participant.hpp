// A Fast DDS participant on the loopback interface, without multicast, and its writers and readers.
#pragma once

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

#include <memory>
#include <stdexcept>
#include <string>

#include "px4_messages.hpp"

namespace fdds = eprosima::fastdds::dds;

constexpr int participants_searched = 40;

template <class Entity>
Entity* made(Entity* entity, const char* what) {
  if (entity == nullptr) throw std::runtime_error(std::string("Fast DDS cannot create ") + what);
  return entity;
}

class Participant {
 public:
  Participant(uint32_t domain, std::string name_space) : prefix_("rt/" + name_space) {
    fdds::DomainParticipantQos qos;
    auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
    udp->interfaceWhiteList.push_back("127.0.0.1");
    qos.transport().use_builtin_transports = false;
    qos.transport().user_transports.push_back(udp);
    eprosima::fastrtps::rtps::Locator_t loopback;
    eprosima::fastrtps::rtps::IPLocator::setIPv4(loopback, 127, 0, 0, 1);
    auto& builtin = qos.wire_protocol().builtin;
    builtin.metatrafficUnicastLocatorList.push_back(loopback);
    for (uint32_t n = 0; n < participants_searched; ++n) {  // ports: DDSI-RTPS 2.5, 9.6.2
      loopback.port = 7400 + 250 * domain + 10 + 2 * n;
      builtin.initialPeersList.push_back(loopback);
    }
    auto* factory = fdds::DomainParticipantFactory::get_instance();
    participant_ = made(factory->create_participant(domain, qos), "a participant");
    publisher_ = made(participant_->create_publisher(fdds::PUBLISHER_QOS_DEFAULT), "a publisher");
    subscriber_ = made(participant_->create_subscriber(fdds::SUBSCRIBER_QOS_DEFAULT), "a subscriber");
  }

  ~Participant() {
    participant_->delete_contained_entities();
    fdds::DomainParticipantFactory::get_instance()->delete_participant(participant_);
  }

  template <class Message>
  fdds::DataWriter* writer(const std::string& name) {
    fdds::DataWriterQos qos;
    qos.reliability().kind = fdds::BEST_EFFORT_RELIABILITY_QOS;
    qos.durability().kind = fdds::TRANSIENT_LOCAL_DURABILITY_QOS;
    return made(publisher_->create_datawriter(topic<Message>(name), qos), "a writer");
  }

  template <class Message>
  fdds::DataReader* reader(const std::string& name,
                           fdds::DurabilityQosPolicyKind durability = fdds::TRANSIENT_LOCAL_DURABILITY_QOS) {
    fdds::DataReaderQos qos;
    qos.reliability().kind = fdds::BEST_EFFORT_RELIABILITY_QOS;
    qos.durability().kind = durability;
    return made(subscriber_->create_datareader(topic<Message>(name), qos), "a reader");
  }

 private:
  template <class Message>
  fdds::Topic* topic(const std::string& name) {
    fdds::TypeSupport type(new Px4Type<Message>());
    type.register_type(participant_);
    return made(participant_->create_topic(prefix_ + name, type.get_type_name(), fdds::TOPIC_QOS_DEFAULT), "a topic");
  }

  std::string prefix_;
  fdds::DomainParticipant* participant_ = nullptr;
  fdds::Publisher* publisher_ = nullptr;
  fdds::Subscriber* subscriber_ = nullptr;
};
