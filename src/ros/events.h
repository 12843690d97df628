#pragma once

#include <constraint_sim/Event.h>
#include <ros/node_handle.h>
#include <ros/publisher.h>

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "ros/publishers.h"
#include "sim/stepper.h"

namespace constraint_sim {

/// The topic `events`: what the engine lists with its moment, and of islands that are carried tick
/// by tick what changed from one to the next. On the stepping thread, and nothing while nobody
/// listens.
class EventTopic {
 public:
  EventTopic(ros::NodeHandle& private_handle, const Publishers& publishers);

  void stepped(const World& world);
  /// What an edit changes is no event.
  void edited(const World& world);
  void passed(const World& world, const Stepper& stepper);

 private:
  struct JointSeen {
    bool broken = false, saturated = false, taut = false;
  };
  struct ContactSeen {
    std::string name_a, name_b;
    double force = 0.0;  ///< of all points [N]
  };
  using BodyPair = std::pair<std::uint32_t, std::uint32_t>;  // ids, the lower one first
  using Contacts = std::map<BodyPair, ContactSeen>;

  static JointSeen look_at(const World& world, engine::JointId id);
  static Contacts contacts_of(const World& world);
  void tell_of_listed(const World& world);
  void tell_of_joints(const World& world);
  void tell_of_contacts(const World& world);
  void publish(const World& world, std::uint8_t kind, std::vector<std::string> names,
               double impulse = 0.0);
  void publish(const World& world, std::uint8_t kind, std::vector<std::string> names,
               double impulse, double time);

  const Publishers& publishers_;
  ros::Publisher topic_;
  bool has_looked_ = false;  // what was seen is that of the tick before
  std::map<std::uint32_t, JointSeen> joints_;
  Contacts contacts_;
  std::set<std::uint32_t> listed_joints_;  // by the engine in this tick
  std::set<BodyPair> listed_pairs_;
  bool has_failed_ = false;
};

}  // namespace constraint_sim
