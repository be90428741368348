// A peer with Fast DDS that knows nothing of the program: it receives the messages of ROS 2 and digests every
// field, or sends commands whose values follow from their number.
//
// peer read DOMAIN RELIABILITY DURABILITY TOPIC=TYPE...   prints "TOPIC DIGEST STAMP_NS ARRIVAL_NS" until its
//                                                         standard input is closed
// peer send DOMAIN KIND TOPIC COUNT PERIOD_MS FIRST               KIND is Twist, TwistStamped or Bool
// peer drive DOMAIN SPEED_M_S BYTES                       sends Twist each 50 ms; from SIGUSR1 on their payloads are
//                                                         longer by BYTES of 0xff, or shorter
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/publisher/qos/DataWriterQos.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/subscriber/qos/DataReaderQos.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>

#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <tuple>
#include <vector>

#include "RosTypes.h"
#include "RosTypesPubSubTypes.h"

using namespace eprosima::fastdds::dds;

// FNV-1a over the little-endian bytes of all fields in their order.
struct Digest {
  uint64_t value = 14695981039346656037ULL;
  void bytes(const void* data, size_t size) {
    const auto* byte = static_cast<const unsigned char*>(data);
    for (size_t i = 0; i < size; ++i) {
      value = (value ^ byte[i]) * 1099511628211ULL;
    }
  }
};
inline void add(Digest& digest, double number) { digest.bytes(&number, 8); }
inline void add(Digest& digest, float number) { digest.bytes(&number, 4); }
inline void add(Digest& digest, int32_t number) { digest.bytes(&number, 4); }
inline void add(Digest& digest, uint32_t number) { digest.bytes(&number, 4); }
inline void add(Digest& digest, uint8_t number) { digest.bytes(&number, 1); }
inline void add(Digest& digest, bool truth) {
  const uint8_t byte = truth ? 1 : 0;
  digest.bytes(&byte, 1);
}
inline void add(Digest& digest, const std::string& text) {
  add(digest, static_cast<uint32_t>(text.size()));
  digest.bytes(text.data(), text.size());
}

#include "digest.hpp"

int64_t now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

template <typename T>
auto stamp_of(const T& message, int) -> decltype(message.header().stamp().sec(), int64_t()) {
  return message.header().stamp().sec() * 1000000000LL + message.header().stamp().nanosec();
}
template <typename T>
int64_t stamp_of(const T&, long) {
  return 0;
}

std::mutex output;

template <typename T>
class Listener : public DataReaderListener {
 public:
  explicit Listener(std::string topic) : topic_(std::move(topic)) {}
  void on_data_available(DataReader* reader) override {
    T message;
    SampleInfo info;
    while (reader->take_next_sample(&message, &info) == ReturnCode_t::RETCODE_OK) {
      if (!info.valid_data) {
        continue;
      }
      const int64_t arrival_ns = now_ns();
      Digest digest;
      add(digest, message);
      const std::lock_guard<std::mutex> guard(output);
      std::printf("%s %016llx %lld %lld\n", topic_.c_str(), static_cast<unsigned long long>(digest.value),
                  static_cast<long long>(stamp_of(message, 0)), static_cast<long long>(arrival_ns));
    }
  }

 private:
  std::string topic_;
};

DomainParticipant* participant(int domain) {
  DomainParticipantQos qos;
  // The loopback alone, and no shared memory: as between containers or programs of other vendors.
  auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  udp->interfaceWhiteList.push_back("127.0.0.1");
  qos.transport().use_builtin_transports = false;
  qos.transport().user_transports.push_back(udp);
  return DomainParticipantFactory::get_instance()->create_participant(domain, qos);
}

template <size_t I = 0>
Topic* make_topic(DomainParticipant* member, const std::string& kind, const std::string& name) {
  if constexpr (I < std::tuple_size<Types>::value) {
    if (kind == NAMES[I]) {
      TypeSupport type(new std::tuple_element_t<I, Supports>());
      type.register_type(member);
      return member->create_topic(name, type.get_type_name(), TOPIC_QOS_DEFAULT);
    }
    return make_topic<I + 1>(member, kind, name);
  }
  std::fprintf(stderr, "unknown type %s\n", kind.c_str());
  std::exit(2);
}

template <size_t I = 0>
void listen(Subscriber* subscriber, Topic* topic, const std::string& kind, const DataReaderQos& qos) {
  if constexpr (I < std::tuple_size<Types>::value) {
    if (kind == NAMES[I]) {
      subscriber->create_datareader(topic, qos,
                                    new Listener<std::tuple_element_t<I, Types>>(topic->get_name()));
      return;
    }
    listen<I + 1>(subscriber, topic, kind, qos);
  }
}

int read(int argc, char** argv) {
  DomainParticipant* member = participant(std::atoi(argv[2]));
  Subscriber* subscriber = member->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
  DataReaderQos qos = DATAREADER_QOS_DEFAULT;
  qos.reliability().kind =
      std::string(argv[3]) == "reliable" ? RELIABLE_RELIABILITY_QOS : BEST_EFFORT_RELIABILITY_QOS;
  qos.durability().kind =
      std::string(argv[4]) == "transient_local" ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
  qos.history().kind = KEEP_LAST_HISTORY_QOS;
  qos.history().depth = 100;
  for (int i = 5; i < argc; ++i) {
    const std::string pair(argv[i]);
    const auto at = pair.find('=');
    const std::string kind = pair.substr(at + 1);
    listen(subscriber, make_topic(member, kind, pair.substr(0, at)), kind, qos);
  }
  std::printf("ready\n");
  std::fflush(stdout);
  std::thread flusher([] {
    while (true) {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
      const std::lock_guard<std::mutex> guard(output);
      std::fflush(stdout);
    }
  });
  while (std::getchar() != EOF) {
  }
  const std::lock_guard<std::mutex> guard(output);
  std::fflush(stdout);
  std::_Exit(0);
}

int send(char** argv) {
  DomainParticipant* member = participant(std::atoi(argv[2]));
  const std::string kind(argv[3]);
  Topic* topic = make_topic(member, kind, argv[4]);
  DataWriterQos qos = DATAWRITER_QOS_DEFAULT;
  qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
  DataWriter* writer =
      member->create_publisher(PUBLISHER_QOS_DEFAULT)->create_datawriter(topic, qos);
  PublicationMatchedStatus status;
  do {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    writer->get_publication_matched_status(status);
  } while (status.current_count == 0);
  // Until all readers there are found, not only the first.
  std::this_thread::sleep_for(std::chrono::milliseconds(2000));
  const int count = std::atoi(argv[5]), period_ms = std::atoi(argv[6]), first = std::atoi(argv[7]);
  geometry_msgs::msg::dds_::Twist_ twist;
  geometry_msgs::msg::dds_::TwistStamped_ stamped;
  std_msgs::msg::dds_::Bool_ truth;
  auto due = std::chrono::steady_clock::now();
  for (int number = first; number < first + count; ++number) {
    twist.linear().x(0.05 + 1e-6 * number);
    twist.linear().y(1e-3 * number);
    twist.angular().z(-1e-6 * number);
    stamped.header().stamp().sec(static_cast<int32_t>(now_ns() / 1000000000LL));
    stamped.header().stamp().nanosec(static_cast<uint32_t>(now_ns() % 1000000000LL));
    stamped.twist(twist);
    truth.data(number % 2 == 1);
    if (kind == "Twist") {
      writer->write(&twist);
    } else if (kind == "TwistStamped") {
      writer->write(&stamped);
    } else {
      writer->write(&truth);
    }
    due += std::chrono::milliseconds(period_ms);
    std::this_thread::sleep_until(due);
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  std::_Exit(0);
}

volatile std::sig_atomic_t is_struck = 0;

class OtherLength : public geometry_msgs::msg::dds_::Twist_PubSubType {
 public:
  explicit OtherLength(int longer) : longer_(longer) { m_typeSize += longer > 0 ? longer : 0; }
  bool serialize(void* data, eprosima::fastrtps::rtps::SerializedPayload_t* payload) override {
    const bool is_good = Twist_PubSubType::serialize(data, payload);
    if (is_good && is_struck) {
      if (longer_ > 0) {
        std::memset(payload->data + payload->length, 0xff, longer_);
      }
      payload->length += longer_;
    }
    return is_good;
  }

 private:
  int longer_;
};

int drive(char** argv) {
  std::signal(SIGUSR1, [](int) { is_struck = 1; });
  DomainParticipant* member = participant(std::atoi(argv[2]));
  TypeSupport type(new OtherLength(std::atoi(argv[4])));
  type.register_type(member);
  Topic* topic = member->create_topic("rt/cmd_vel", type.get_type_name(), TOPIC_QOS_DEFAULT);
  DataWriter* writer = member->create_publisher(PUBLISHER_QOS_DEFAULT)->create_datawriter(topic, DATAWRITER_QOS_DEFAULT);
  geometry_msgs::msg::dds_::Twist_ twist;
  twist.linear().x(std::atof(argv[3]));
  while (true) {
    writer->write(&twist);
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
}

int main(int argc, char** argv) {
  if (argc >= 6 && std::string(argv[1]) == "read") {
    return read(argc, argv);
  }
  if (argc == 8 && std::string(argv[1]) == "send") {
    return send(argv);
  }
  if (argc == 5 && std::string(argv[1]) == "drive") {
    return drive(argv);
  }
  std::fprintf(stderr, "peer read DOMAIN RELIABILITY DURABILITY TOPIC=TYPE... | peer send DOMAIN KIND "
                       "TOPIC COUNT PERIOD_MS FIRST | peer drive DOMAIN SPEED_M_S BYTES\n");
  return 2;
}
