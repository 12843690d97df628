// Repeats a recorded edit_log from a bag, and compares the hash after each step and edit:
//   rosrun constraint_sim replay FILE.bag [TOPIC] [--plugins "PACKAGE/CLASS ..."]
// With plugins it is a ROS node, since plugins may have topics: a master must be running.

#include <constraint_sim/EditRecord.h>
#include <ros/init.h>
#include <ros/node_handle.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>

#include <algorithm>
#include <cstdio>
#include <exception>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "constraint_sim/engine/snapshot.h"
#include "ros/edit_log.h"
#include "ros/edits.h"
#include "ros/parameters.h"
#include "ros/plugins.h"

namespace constraint_sim {
namespace {

constexpr int kDiffers = 1, kBadInput = 2;

/// A world that applies records.
class Replay {
 public:
  /// Applies a record; returns false, after printing the difference, where the hash differs.
  bool add(const EditRecord& record) {
    if (record.number != last_number_ + 1 && world_)
      throw std::invalid_argument("records " + std::to_string(last_number_ + 1) + " to " +
                                  std::to_string(record.number - 1) + " are missing");
    last_number_ = record.number;
    ++records_;
    const bool is_world = record.service == "snapshot";
    if (!world_ && !is_world)
      throw std::invalid_argument("the first record is no snapshot; record from the start on");
    if (!is_world && !advance_to(record)) return false;
    if (is_world)
      world_ = engine::read_snapshot({record.request.begin(), record.request.end()});
    else if (record.service == "failed_step")
      world_->step();
    else if (!record.service.empty())
      apply_recorded(*world_, record.service, record.request);
    if (world_->state_hash() != record.state_hash) return differs(record, "the hash is another");
    last_equal_ = record.step;
    return true;
  }

  void print() const {
    std::printf("%llu records, %llu steps: the same hash at each record\n",
                static_cast<unsigned long long>(records_), static_cast<unsigned long long>(steps_));
  }

 private:
  bool advance_to(const EditRecord& record) {
    if (world_->step_count() > record.step && record.service != "reset_simulation")
      return differs(record, "it has gone beyond that step");
    check_step(record);
    while (world_->step_count() < record.step && record.service != "reset_simulation") {
      ++steps_;
      if (world_->step().outcome.failed) return differs(record, "a step fails before it");
    }
    return true;
  }

  // Checks the step number: there is a record at least every kCheckEvery steps, so a larger step is
  // damaged.
  void check_step(const EditRecord& record) const {
    const std::uint64_t step = world_->step_count();
    if (record.step <= step || record.step - step <= EditLog::kCheckEvery) return;
    throw std::invalid_argument("record " + std::to_string(record.number) + ": step " +
                                std::to_string(record.step) + " is more than " +
                                std::to_string(EditLog::kCheckEvery) +
                                " steps after the record before, at step " + std::to_string(step));
  }

  bool differs(const EditRecord& record, const char* why) const {
    const std::string what = record.service.empty() ? "" : ", after '" + record.service + "'";
    std::printf(
        "record %llu: differs at step %llu%s: %s; the last one that is equal is step %llu\n",
        static_cast<unsigned long long>(record.number),
        static_cast<unsigned long long>(record.step), what.c_str(), why,
        static_cast<unsigned long long>(last_equal_));
    return false;
  }

  std::optional<World> world_;
  std::uint64_t last_number_ = 0, records_ = 0, steps_ = 0, last_equal_ = 0;
};

int replay(const std::string& path, std::string topic) {
  rosbag::Bag bag(path);
  rosbag::View view(bag, rosbag::TypeQuery(ros::message_traits::datatype<EditRecord>()));
  Replay replay;
  const bool is_named = !topic.empty();
  bool any = false;
  for (const rosbag::MessageInstance& message : view) {
    if (topic.empty()) topic = message.getTopic();
    if (message.getTopic() != topic) {
      if (is_named) continue;
      throw std::invalid_argument("there are several edit logs; name one: " + topic + ", " +
                                  message.getTopic());
    }
    const EditRecord::ConstPtr record = message.instantiate<EditRecord>();
    if (!record) throw std::invalid_argument("a record cannot be read");
    any = true;
    if (!replay.add(*record)) return kDiffers;
  }
  if (!any) throw std::invalid_argument("there is no edit log in it");
  replay.print();
  return 0;
}

}  // namespace
}  // namespace constraint_sim

int main(int argc, char** argv) {
  std::vector<std::string> words(argv + 1, argv + argc);
  constraint_sim::Parameters parameters;
  const auto option = std::find(words.begin(), words.end(), "--plugins");
  const bool has_plugins = option != words.end() && option + 1 != words.end();
  if (has_plugins) {
    parameters.plugins = *(option + 1);
    words.erase(option, option + 2);
  }
  const bool is_option = std::any_of(words.begin(), words.end(), [](const std::string& word) {
    return word.compare(0, 1, "-") == 0;
  });
  if (words.empty() || words.size() > 2 || is_option) {
    std::fprintf(stderr,
                 "usage: rosrun constraint_sim replay FILE.bag [TOPIC] [--plugins \"PACKAGE/CLASS "
                 "...\"]\n");
    return constraint_sim::kBadInput;
  }
  try {
    std::optional<constraint_sim::Plugins> plugins;
    if (has_plugins) {
      ros::init(argc, argv, "replay", ros::init_options::AnonymousName);
      plugins.emplace(parameters, ros::NodeHandle("~"));
    }
    return constraint_sim::replay(words[0], words.size() > 1 ? words[1] : "");
  } catch (const std::exception& error) {
    std::fprintf(stderr, "replay: %s: %s\n", words[0].c_str(), error.what());
    return constraint_sim::kBadInput;
  }
}
