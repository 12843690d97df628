#include "ros/plot_topics.h"

#include <constraint_sim/JointReading.h>
#include <openssl/evp.h>
#include <ros/serialization.h>
#include <sensor_msgs/JointState.h>
#include <std_msgs/Header.h>
#include <topic_tools/shape_shifter.h>

#include <algorithm>
#include <cctype>
#include <cstddef>
#include <cstdint>
#include <set>
#include <utility>

#include "ros/actuator_efforts.h"
#include "ros/constraint_state.h"
#include "ros/conversions.h"

namespace constraint_sim {
namespace {

// Returns a name that a field or a type of a message may have: letters, digits and underscores, a
// letter first.
std::string field_of(const std::string& name) {
  std::string field;
  for (const char c : name)
    field += std::isalnum(static_cast<unsigned char>(c)) != 0 && c >= 0 ? c : '_';
  if (field.empty() || std::isalpha(static_cast<unsigned char>(field[0])) == 0)
    field = "joint_" + field;
  return field;
}

// Returns fields that differ from each other, of names that do.
std::vector<std::string> fields_of(const std::vector<std::string>& names) {
  std::vector<std::string> fields;
  std::set<std::string> taken{"header"};
  for (const std::string& name : names) {
    const std::string wanted = field_of(name);
    std::string field = wanted;
    for (int i = 2; !taken.insert(field).second; ++i) field = wanted + "_" + std::to_string(i);
    fields.push_back(field);
  }
  return fields;
}

std::string md5_of(const std::string& text) {
  unsigned char digest[EVP_MAX_MD_SIZE];
  unsigned int size = 0;
  if (EVP_Digest(text.data(), text.size(), digest, &size, EVP_md5(), nullptr) != 1) return "*";
  std::string hex;
  for (unsigned int i = 0; i < size; ++i)
    for (const int half : {digest[i] >> 4, digest[i] & 15}) hex += "0123456789abcdef"[half];
  return hex;
}

// Returns the text that a definition has for a message type that it uses.
template <class Message>
std::string part_of_definition() {
  namespace traits = ros::message_traits;
  return "\n" + std::string(80, '=') + "\nMSG: " + traits::datatype<Message>() + "\n" +
         traits::definition<Message>();
}

}  // namespace

PlotTopics::PlotTopics(const ros::NodeHandle& private_handle, ros::SubscriberStatusCallback welcome)
    : handle_(private_handle, "robots"), welcome_(std::move(welcome)) {}

PlotTopics::Topic PlotTopics::topic_of(const RobotDescription& robot,
                                       const engine::World& world) const {
  Topic topic;
  sensor_msgs::JointState coordinates;
  for (const engine::JointId id : world.joint_ids()) {
    if (robot.joints->count(world.joint(id).name) == 0) continue;
    const std::size_t before = coordinates.name.size();
    add_coordinates(world.joint(id), world.joint_state(id), {}, &coordinates);
    if (coordinates.name.size() > before) topic.joints.push_back(id);
  }
  namespace traits = ros::message_traits;
  // ROS takes the MD5 sum of this text, where types of fields are replaced by theirs.
  std::string summed = std::string(traits::md5sum<std_msgs::Header>()) + " header";
  topic.definition = "std_msgs/Header header\n";
  for (const std::string& field : fields_of(coordinates.name)) {
    summed += "\n" + std::string(traits::md5sum<JointReading>()) + " " + field;
    topic.definition += "constraint_sim/JointReading " + field + "\n";
  }
  topic.definition += part_of_definition<std_msgs::Header>();
  if (!topic.joints.empty()) topic.definition += part_of_definition<JointReading>();
  topic.md5 = md5_of(summed);
  topic.type = "constraint_sim/Plot_" + field_of(robot.name);
  return topic;
}

void PlotTopics::update(const std::vector<RobotDescription>& robots, const engine::World& world) {
  Topics next;
  for (const RobotDescription& robot : robots) {
    Topic topic = topic_of(robot, world);
    const auto known = topics_.find(robot.name);
    if (known != topics_.end() && known->second.md5 == topic.md5) {
      topic.publisher = known->second.publisher;
    } else {
      if (known != topics_.end()) known->second.publisher.shutdown();
      ros::AdvertiseOptions options(robot.name + "/plot", 100, topic.md5, topic.type,
                                    topic.definition, welcome_);
      options.has_header = true;
      topic.publisher = handle_.advertise(options);
    }
    next.emplace(robot.name, std::move(topic));
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  std::swap(topics_, next);
}

bool PlotTopics::anybody_listens() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return std::any_of(topics_.begin(), topics_.end(), [](const auto& entry) {
    return entry.second.publisher.getNumSubscribers() > 0;
  });
}

void PlotTopics::publish(const engine::World& world, const ros::Time& stamp,
                         const std::string& frame) const {
  namespace io = ros::serialization;
  const ActuatorEfforts efforts(world);
  std_msgs::Header header;
  header.stamp = stamp;
  header.frame_id = frame;
  for (const auto& [name, topic] : topics_) {
    if (topic.publisher.getNumSubscribers() == 0) continue;
    std::vector<JointReading> readings;
    for (const engine::JointId id : topic.joints) {
      sensor_msgs::JointState coordinates;
      add_coordinates(world.joint(id), world.joint_state(id), efforts.of(id), &coordinates);
      JointReading reading;
      reading.error = to_msg(world, id).error;
      for (std::size_t i = 0; i < coordinates.name.size(); ++i) {
        reading.position = coordinates.position[i];
        reading.velocity = coordinates.velocity[i];
        reading.effort = coordinates.effort[i];
        readings.push_back(reading);
      }
    }
    std::vector<std::uint8_t> bytes(io::serializationLength(header) +
                                    readings.size() * io::serializationLength(JointReading()));
    io::OStream out(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
    out.next(header);
    for (const JointReading& reading : readings) out.next(reading);
    topic_tools::ShapeShifter message;
    message.morph(topic.md5, topic.type, topic.definition, "0");
    io::IStream in(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
    message.read(in);
    topic.publisher.publish(message);
  }
}

}  // namespace constraint_sim
