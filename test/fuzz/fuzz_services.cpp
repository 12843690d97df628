// Service bytes: any bytes are requests of services and messages of topics, read as the node reads
// them, and changes of a world by the node's own conversions and edits. A rejected edit changes
// nothing; an edit is replayed from its bytes with the same bits; responses can be sent. Needs ROS,
// and no master: queues, threads and files of the node are left out.
//
// An input is a sequence of records: one byte that chooses the service or topic, two bytes for the
// length, and the bytes of the request or message. Records that the mutator adds are valid ones.

#include <console_bridge/console.h>
#include <constraint_sim/Step.h>
#include <ros/console.h>
#include <std_srvs/Empty.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <functional>
#include <iterator>
#include <random>
#include <type_traits>
#include <utility>
#include <vector>

#include "custom_types.h"
#include "ros/received.h"
#include "service_node.h"
#include "service_samples.h"

extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t most);

using namespace constraint_sim;

namespace {

using fuzz::Bytes;
using fuzz::serialized;
using Node = fuzz::ServiceNode;

constexpr std::size_t kMostRecords = 12;

// ---- records

struct Record {
  std::uint8_t kind = 0;
  Bytes bytes;
};

std::vector<Record> records_of(const std::uint8_t* data, std::size_t size) {
  std::vector<Record> records;
  for (std::size_t at = 0; at + 3 <= size && records.size() < kMostRecords;) {
    const std::size_t announced = data[at + 1] + 256U * data[at + 2];
    const std::size_t count = std::min(announced, size - at - 3);
    records.push_back({data[at], Bytes(data + at + 3, data + at + 3 + count)});
    at += 3 + count;
  }
  return records;
}

Bytes bytes_of(const std::vector<Record>& records) {
  Bytes bytes;
  for (const Record& record : records) {
    bytes.push_back(record.kind);
    bytes.push_back(static_cast<std::uint8_t>(record.bytes.size() % 256));
    bytes.push_back(static_cast<std::uint8_t>(record.bytes.size() / 256));
    bytes.insert(bytes.end(), record.bytes.begin(), record.bytes.end());
  }
  return bytes;
}

/// Reads bytes as roscpp does for guarded_service() and guarded_subscribe().
template <class Message>
Message read(Bytes bytes) {
  Received<Message> received;
  ros::serialization::IStream stream(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
  ros::serialization::deserialize(stream, received);
  return std::move(received.message);
}

// ---- kinds of records

struct Kind {
  std::function<void(Node&, const Bytes&)> take;
  std::vector<Bytes> samples;  // valid requests or messages
};

/// Adds a service or topic; `act` is called with the node and the message.
template <class Message, class Act>
void add(std::vector<Kind>* kinds, const std::vector<Message>& samples, Act act) {
  Kind& kind = kinds->emplace_back();
  kind.take = [act](Node& node, const Bytes& bytes) { act(node, read<Message>(bytes)); };
  for (const Message& sample : samples) kind.samples.push_back(serialized(sample));
}

template <class Type>
auto samples_of() {
  return fuzz::samples(static_cast<Type*>(nullptr));
}

void add_edits(std::vector<Kind>* kinds) {
  visit_edits([&](const char* name, auto* service) {
    using Service = std::remove_pointer_t<decltype(service)>;
    add(kinds, fuzz::samples(service),
        [name](Node& node, const typename Service::Request& request) {
          node.edit<typename Service::Response>(name, request);
        });
  });
}

void add_services(std::vector<Kind>* kinds) {
  StepRequest steps;
  steps.steps = 2;
  add(kinds, std::vector<StepRequest>{steps},
      [](Node& node, const StepRequest& request) { node.step(request.steps); });
  add(kinds, samples_of<GetBodyState>(),
      [](Node& node, const auto& request) { node.get_body_state(request); });
  add(kinds, samples_of<LoadScene>(),
      [](Node& node, const auto& request) { node.load_scene(request); });
  add(kinds, samples_of<LoadUrdf>(),
      [](Node& node, const auto& request) { node.load_urdf(request); });
}

void add_topics(std::vector<Kind>* kinds) {
  add(kinds, samples_of<trajectory_msgs::JointTrajectory>(),
      [](Node& node, const auto& message) { node.take_trajectory(message); });
  add(kinds, samples_of<std_msgs::Float64>(),
      [](Node& node, const auto& message) { node.take_command(message); });
  add(kinds, samples_of<geometry_msgs::Twist>(),
      [](Node& node, const auto& message) { node.take_twist(message); });
  add(kinds, samples_of<geometry_msgs::WrenchStamped>(),
      [](Node& node, const auto& message) { node.take_wrench(message); });
  add(kinds, samples_of<MotorBias>(),
      [](Node& node, const auto& message) { node.take_bias(message); });
  add(kinds, samples_of<tf2_msgs::TFMessage>(),
      [](Node& node, const auto& message) { node.take_frames(message, false); });
  add(kinds, samples_of<tf2_msgs::TFMessage>(),
      [](Node& node, const auto& message) { node.take_frames(message, true); });
  rosgraph_msgs::Clock clock;
  clock.clock = ros::Time(5.0);
  add(kinds, std::vector<rosgraph_msgs::Clock>{clock},
      [](Node& node, const auto& message) { node.take_clock(message); });
  add(kinds, samples_of<visualization_msgs::InteractiveMarkerFeedback>(),
      [](Node& node, const auto& message) { node.take_feedback(message); });
}

void add_saving(std::vector<Kind>* kinds) {
  add(kinds, std::vector<SaveSceneRequest>(1),
      [](Node& node, const SaveSceneRequest&) { node.save_scene(); });
  add(kinds, samples_of<SaveSnapshot>(),
      [](Node& node, const auto& request) { node.save_snapshot(request); });
  add(kinds, samples_of<RestoreSnapshot>(),
      [](Node& node, const auto& request) { node.restore_snapshot(request); });
  add(kinds, samples_of<EditRecord>(), [](Node& node, const auto& record) { node.replay(record); });
}

void add_runs(std::vector<Kind>* kinds) {
  VerifyRequest ticks;
  ticks.steps = 1;
  add(kinds, std::vector<VerifyRequest>{ticks},
      [](Node& node, const VerifyRequest& request) { node.verify(request.steps); });
  add(kinds, std::vector<std_srvs::EmptyRequest>(1),
      [](Node& node, const std_srvs::EmptyRequest&) { node.reset_world(); });
  add(kinds, std::vector<std_srvs::EmptyRequest>(1),
      [](Node& node, const std_srvs::EmptyRequest&) { node.reset_simulation(); });
#ifdef CONSTRAINT_SIM_DYNAMIC_RECONFIGURE
  dynamic_reconfigure::ReconfigureRequest options;
  options.config = config_of(engine::WorldOptions(), {});
  add(kinds, std::vector<dynamic_reconfigure::ReconfigureRequest>{options},
      [](Node& node, const auto& request) { node.set_parameters(request.config); });
#endif
  add(kinds, samples_of<CastRay>(),
      [](Node& node, const auto& request) { node.cast_ray(request); });
  add(kinds, samples_of<ClosestPoints>(),
      [](Node& node, const auto& request) { node.closest_points(request); });
  add(kinds, samples_of<BodiesIn>(),
      [](Node& node, const auto& request) { node.bodies_in(request); });
}

const std::vector<Kind>& kinds() {
  static const std::vector<Kind> all = [] {
    std::vector<Kind> kinds;
    add_edits(&kinds);
    add_services(&kinds);
    add_topics(&kinds);
    add_saving(&kinds);
    add_runs(&kinds);
    return kinds;
  }();
  return all;
}

const Kind& kind_of(const Record& record) { return kinds()[record.kind % kinds().size()]; }

// ---- mutation

/// Writes a number as attackers choose it, at any place.
void put_number(std::mt19937* random, Bytes* bytes) {
  static const double kNumbers[] = {0.0,    -0.0,   1.0, -1.0,   1e-9,  1e20,     -1e20,     1e300,
                                    -1e300, 1e-310, 1e9, 3.1416, 1e150, HUGE_VAL, -HUGE_VAL, NAN};
  static const std::uint32_t kCounts[] = {0, 1, 255, 65536, 0x20000001, 0x7fffffff, 0xffffffff};
  const bool is_count = (*random)() % 4 == 0;
  const double number = kNumbers[(*random)() % std::size(kNumbers)];
  const std::uint32_t count = kCounts[(*random)() % std::size(kCounts)];
  const std::size_t size = is_count ? sizeof count : sizeof number;
  if (bytes->size() < size) return;
  std::uint8_t* to = bytes->data() + (*random)() % (bytes->size() - size + 1);
  if (is_count)
    std::memcpy(to, &count, size);
  else
    std::memcpy(to, &number, size);
}

void mutate(std::mt19937* random, Bytes* bytes) {
  if ((*random)() % 2 == 0) return put_number(random, bytes);
  const std::size_t size = bytes->size();
  bytes->resize(std::min<std::size_t>(size + 64, 60000));
  bytes->resize(LLVMFuzzerMutate(bytes->data(), size, bytes->size()));
}

/// Drops the text that tf2 and urdfdom print about each bad input.
class Silence : public console_bridge::OutputHandler {
  void log(const std::string&, console_bridge::LogLevel, const char*, int) override {}
};

}  // namespace

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
  fuzz::initialize(*argc, *argv);
  static Silence silence;
  console_bridge::useOutputHandler(&silence);
  engine::example_types::register_all();
  ros::Time::init();
  // guards warn of each rejected input; the first use would set the level anew
  ros::console::initialize();
  ros::console::set_logger_level(ROSCONSOLE_DEFAULT_NAME, ros::console::levels::Fatal);
  ros::console::notifyLoggerLevelsChanged();
  return 0;
}

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size,
                                               std::size_t most, unsigned seed) {
  std::mt19937 random(seed);
  std::vector<Record> records = records_of(data, size);
  const auto any = [&] { return static_cast<std::ptrdiff_t>(random() % records.size()); };
  for (unsigned k = 0; k < 1 + seed % 3; ++k) {
    const unsigned choice = random() % 8;
    if (records.empty() || (choice < 3 && records.size() < kMostRecords)) {
      Record record;
      record.kind = static_cast<std::uint8_t>(random() % kinds().size());
      const std::vector<Bytes>& samples = kind_of(record).samples;
      record.bytes = samples[random() % samples.size()];
      records.insert(records.begin() + static_cast<std::ptrdiff_t>(random() % (records.size() + 1)),
                     std::move(record));
    } else if (choice == 3) {
      records.erase(records.begin() + any());
    } else {
      mutate(&random, &records[static_cast<std::size_t>(any())].bytes);
    }
  }
  const Bytes bytes = bytes_of(records);
  if (bytes.size() > most) return LLVMFuzzerMutate(data, size, most);
  std::copy(bytes.begin(), bytes.end(), data);
  return bytes.size();
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const fuzz::TimeLimit limit;
  Node node(fuzz::digest(data, size));
  for (const Record& record : records_of(data, size)) {
    try {
      kind_of(record).take(node, record.bytes);
    } catch (const ros::serialization::StreamOverrunException&) {
    }
  }
  node.end();
  return 0;
}
