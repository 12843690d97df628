#include "ros/marker_set.h"

#include <algorithm>
#include <cmath>

namespace constraint_sim {
namespace {

using visualization_msgs::Marker;

constexpr double kFullPeriod = 1.0;  // [s]

}  // namespace

bool ShownMarker::is_drawn_for(const std::array<double, 3>& shape) {
  if (drawn_for == shape && !points.empty()) return true;
  drawn_for = shape;
  points.clear();
  colors.clear();
  return false;
}

// ---- a namespace

std::size_t MarkerSet::Namespace::place_of(std::int32_t id) {
  if (cursor_ < entries_.size() && entries_[cursor_]->marker.id == id) return cursor_;
  const auto found = std::lower_bound(
      entries_.begin(), entries_.end(), id,
      [](const std::unique_ptr<Entry>& entry, std::int32_t of) { return entry->marker.id < of; });
  return cursor_ = static_cast<std::size_t>(found - entries_.begin());
}

MarkerSet::Namespace::Entry* MarkerSet::Namespace::find(std::int32_t id) {
  const std::size_t place = place_of(id);
  return place < entries_.size() && entries_[place]->marker.id == id ? entries_[place].get()
                                                                     : nullptr;
}

ShownMarker& MarkerSet::Namespace::add(std::int32_t id, std::int32_t type) {
  Entry* entry = find(id);
  if (entry == nullptr) {
    const auto where = entries_.begin() + static_cast<std::ptrdiff_t>(cursor_);
    entry = entries_.insert(where, std::make_unique<Entry>())->get();
    entry->marker.header.frame_id = set_->frame_;
    entry->marker.ns = name_;
    entry->marker.id = id;
    entry->marker.pose.orientation.w = 1.0;
  }
  ShownMarker& marker = entry->marker;
  if (marker.type != type) {
    marker.type = type;
    marker.points.clear();
    marker.colors.clear();
    marker.pose = geometry_msgs::Pose();
    marker.pose.orientation.w = 1.0;
  }
  if (entry->round != set_->round_) ++count_;
  entry->round = set_->round_;
  ++cursor_;  // where the next one is looked for
  marker.header.stamp = set_->stamp_;
  set_->message_.markers.push_back(&marker);
  return marker;
}

void MarkerSet::Namespace::keep(std::int32_t id) {
  Entry* entry = find(id);
  if (entry == nullptr || entry->round == set_->round_) return;
  entry->round = set_->round_;
  ++count_;
  ++cursor_;
}

const ShownMarker* MarkerSet::Namespace::shown(std::int32_t id) {
  const Entry* entry = find(id);
  return entry != nullptr && entry->is_shown ? &entry->marker : nullptr;
}

bool MarkerSet::Namespace::is_added(std::int32_t id) {
  const Entry* entry = find(id);
  return entry != nullptr && entry->round == set_->round_;
}

void MarkerSet::Namespace::remove_others() {
  if (count_ != entries_.size()) {
    const auto is_of_now = [this](const std::unique_ptr<Entry>& entry) {
      return entry->round == set_->round_;
    };
    const auto others = std::stable_partition(entries_.begin(), entries_.end(), is_of_now);
    for (auto entry = others; entry != entries_.end(); ++entry) {
      if (!(*entry)->is_shown) continue;
      Marker& marker = (*entry)->marker;
      marker.header.stamp = set_->stamp_;
      marker.action = Marker::DELETE;
      marker.points.clear();
      marker.colors.clear();
      set_->message_.markers.push_back(&marker);
      set_->gone_.push_back(std::move(*entry));
    }
    entries_.erase(others, entries_.end());
  }
  for (const std::unique_ptr<Entry>& entry : entries_) entry->is_shown = true;
}

// ---- the set

MarkerSet::Namespace& MarkerSet::in(const std::string& name) {
  const auto found = std::find_if(namespaces_.begin(), namespaces_.end(),
                                  [&](const Namespace& present) { return present.name_ == name; });
  if (found != namespaces_.end()) return *found;
  namespaces_.push_back(Namespace(this, name));
  return namespaces_.back();
}

void MarkerSet::begin(const ros::Time& stamp, bool for_newcomer) {
  stamp_ = stamp;
  const double passed = std::abs(stamp.toSec() - last_full_.toSec());  // time may go back
  full_ = !started_ || for_newcomer || passed >= kFullPeriod;
  if (full_) last_full_ = stamp;
  ++round_;
  message_.markers.clear();
  gone_.clear();
  for (Namespace& each : namespaces_) {
    each.cursor_ = each.count_ = 0;
    if (started_) continue;
    for (const auto& entry : each.entries_) entry->is_shown = false;
  }
  if (!started_) {
    delete_all_.header.stamp = stamp;
    delete_all_.header.frame_id = frame_;
    delete_all_.action = Marker::DELETEALL;
    delete_all_.pose.orientation.w = 1.0;
    message_.markers.push_back(&delete_all_);
  }
  started_ = true;
}

const MarkerMessage& MarkerSet::finish() {
  for (Namespace& each : namespaces_) each.remove_others();
  return message_;
}

}  // namespace constraint_sim
