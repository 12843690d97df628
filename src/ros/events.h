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

/// The topic `events`: events that the engine lists with their moment, and for islands without
/// listed events the changes from one tick to the next. Stepping thread only; does nothing without
/// subscribers.
class EventTopic {
 public:
  EventTopic(ros::NodeHandle& private_handle, const Publishers& publishers);

  void stepped(const World& world);
  /// Takes the present state as known, so that an edit makes no event.
  void edited(const World& world);
  void passed(const World& world, const Stepper& stepper);

 private:
  struct JointSeen {
    bool broken = false, saturated = false, taut = false;
  };
  struct ContactSeen {
    std::string name_a, name_b;
    double force = 0.0;  ///< sum over all points [N]
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
  bool has_looked_ = false;  // joints_ and contacts_ hold the previous tick
  std::map<std::uint32_t, JointSeen> joints_;
  Contacts contacts_;
  std::set<std::uint32_t> listed_joints_;  // joints in events of this tick
  std::set<BodyPair> listed_pairs_;
  bool has_failed_ = false;
};

}  // namespace constraint_sim
