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

#include "constraint_sim/engine/id.h"
#include "ros/marker_message.h"

namespace constraint_sim {

/// Id of the markers of a body, within a namespace.
inline std::int32_t marker_id(engine::BodyId id) { return static_cast<std::int32_t>(id.value); }
/// Id of the markers of a constraint, within a namespace.
inline std::int32_t marker_id(engine::JointId id) { return static_cast<std::int32_t>(id.value); }

/// A marker that is kept between messages, so that only changes are set again.
struct ShownMarker : visualization_msgs::Marker {
  /// Parameters for which the points were made, in the marker's own frame.
  std::array<double, 3> drawn_for{};
  double drawn_length = 0.0;  ///< length for which stretched points were made [m]

  /// Returns whether the points were made for `shape`; clears points and colours otherwise.
  bool is_drawn_for(const std::array<double, 3>& shape);

 private:
  friend class MarkerSet;
  std::uint64_t since_ = 0;  // first message with the marker
  std::uint64_t round_ = 0;  // last message with the marker, sent or kept
};

/// Markers that subscribers of one topic see. Each message changes the last state into the present
/// one. Ids are those of the world, which are never reused.
class MarkerSet {
 public:
  /// Markers of one namespace. Lookup is fastest in the order of ids.
  class Namespace {
   public:
    /// Returns a marker that will be sent: as in the last message, or new with only its type set.
    ShownMarker& add(std::int32_t id, std::int32_t type);
    /// Returns the marker as subscribers have it; nullptr where they do not.
    ShownMarker* shown(std::int32_t id) {
      ShownMarker* marker = find(id);
      const bool is_shown =
          marker != nullptr && marker->since_ < set_->round_ && !set_->deletes_all_;
      return is_shown ? marker : nullptr;
    }
    /// Sends a shown marker again.
    ShownMarker& send(ShownMarker* shown) {
      keep(shown);
      shown->header.stamp = set_->stamp_;
      set_->message_.markers.push_back(shown);
      return *shown;
    }
    /// Leaves a shown marker as it is, without sending it.
    void keep(ShownMarker* shown) {
      if (shown->round_ != set_->round_) ++set_->present_;
      shown->round_ = set_->round_;
      ++cursor_;  // lookup continues at the next marker
    }
    /// Returns whether this message already has the marker.
    bool is_added(std::int32_t id);

   private:
    friend class MarkerSet;
    Namespace(MarkerSet* set, std::string name) : set_(set), name_(std::move(name)) {}
    /// Finds a marker and moves the cursor to it, or to where it would be inserted.
    ShownMarker* find(std::int32_t id) {
      if (cursor_ == markers_.size()) cursor_ = 0;  // each message starts at the first marker
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

  /// Returns the namespace with this name; valid as long as the set lives.
  Namespace& in(const std::string& name);

  /// Begins a message. The first message deletes all markers of earlier publishers.
  void begin(const ros::Time& stamp, bool for_newcomer);
  /// Returns whether this message has all markers: once a second, and for a new subscriber.
  bool is_full() const { return full_; }
  /// Returns the message, which deletes markers neither added nor kept. Valid until the next
  /// begin().
  const MarkerMessage& finish();
  /// Makes the next message complete, since no subscriber has seen the last ones.
  void forget() { started_ = false; }

 private:
  std::string frame_;
  ros::Time stamp_;
  ros::Time last_full_;
  bool started_ = false;
  bool full_ = true;
  bool deletes_all_ = false;  // the current message begins with DELETEALL
  std::uint64_t round_ = 0;
  std::size_t shown_ = 0;    // markers of all namespaces, with new ones
  std::size_t present_ = 0;  // markers that this message has or keeps
  std::deque<Namespace> namespaces_;
  visualization_msgs::Marker delete_all_;
  std::vector<std::unique_ptr<ShownMarker>> gone_;  // markers that this message deletes
  MarkerMessage message_;
};

}  // namespace constraint_sim
