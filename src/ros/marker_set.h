#pragma once

#include <ros/time.h>
#include <visualization_msgs/Marker.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "ros/marker_message.h"

namespace constraint_sim {

/// A marker that stays from message to message, so that only what changed is set again.
struct ShownMarker : visualization_msgs::Marker {
  /// What its points were made for, in its own frame.
  std::array<double, 3> drawn_for{};
  double drawn_length = 0.0;  ///< of what stretches [m]

  /// Whether its points are those for this; else they and their colours are taken away.
  bool is_drawn_for(const std::array<double, 3>& shape);

 private:
  friend class MarkerSet;
  std::uint64_t since_ = 0;  // the first message that had it
  std::uint64_t round_ = 0;  // the last one that had or kept it
};

/// The markers that listeners of one topic see: each message brings them from the last one to the
/// present. Ids are those of the world, which are never reused.
class MarkerSet {
 public:
  /// The markers of one namespace, asked for in the order of their ids where it is to be quick.
  class Namespace {
   public:
    /// The marker, which is sent: as the last message left it, or with nothing set but its type.
    ShownMarker& add(std::int32_t id, std::int32_t type);
    /// The marker as listeners have it; nullptr where they do not.
    ShownMarker* shown(std::int32_t id) {
      ShownMarker* marker = find(id);
      const bool is_shown =
          marker != nullptr && marker->since_ < set_->round_ && !set_->deletes_all_;
      return is_shown ? marker : nullptr;
    }
    /// What is shown is sent again, or stays without that.
    ShownMarker& send(ShownMarker* shown) {
      keep(shown);
      shown->header.stamp = set_->stamp_;
      set_->message_.markers.push_back(shown);
      return *shown;
    }
    void keep(ShownMarker* shown) {
      if (shown->round_ != set_->round_) ++set_->present_;
      shown->round_ = set_->round_;
      ++cursor_;  // where the next one is looked for
    }
    /// Whether this message has it already.
    bool is_added(std::int32_t id);

   private:
    friend class MarkerSet;
    Namespace(MarkerSet* set, std::string name) : set_(set), name_(std::move(name)) {}
    /// Puts the cursor there as well, or where it would be inserted.
    ShownMarker* find(std::int32_t id) {
      if (cursor_ == markers_.size()) cursor_ = 0;  // where each message begins
      const bool is_there = cursor_ < markers_.size() && markers_[cursor_]->id == id;
      return is_there ? markers_[cursor_].get() : search(id);
    }
    ShownMarker* search(std::int32_t id);
    void remove_others();

    MarkerSet* set_;
    std::string name_;
    std::vector<std::unique_ptr<ShownMarker>> markers_;  // by id
    std::size_t cursor_ = 0;
  };

  explicit MarkerSet(std::string frame) : frame_(std::move(frame)) {}
  MarkerSet(const MarkerSet&) = delete;
  MarkerSet& operator=(const MarkerSet&) = delete;

  /// The namespace with this name, for as long as the set lives.
  Namespace& in(const std::string& name);

  /// Begins a message; the first one deletes all that others have left.
  void begin(const ros::Time& stamp, bool for_newcomer);
  /// Whether this message has everything: once a second, and for a newcomer.
  bool is_full() const { return full_; }
  /// The message, which deletes what is neither added nor kept; good until the next begin().
  const MarkerMessage& finish();
  /// Nobody has seen the last messages: the next one has everything again.
  void forget() { started_ = false; }

 private:
  std::string frame_;
  ros::Time stamp_;
  ros::Time last_full_;
  bool started_ = false;
  bool full_ = true;
  bool deletes_all_ = false;  // this message, first of all
  std::uint64_t round_ = 0;
  std::size_t shown_ = 0;    // markers of all namespaces, with those that are new
  std::size_t present_ = 0;  // those that this message has or keeps
  std::deque<Namespace> namespaces_;
  visualization_msgs::Marker delete_all_;
  std::vector<std::unique_ptr<ShownMarker>> gone_;  // with this message
  MarkerMessage message_;
};

}  // namespace constraint_sim
