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

ShownMarker* MarkerSet::Namespace::search(std::int32_t id) {
  const auto found = std::lower_bound(
      markers_.begin(), markers_.end(), id,
      [](const std::unique_ptr<ShownMarker>& marker, std::int32_t of) { return marker->id < of; });
  cursor_ = static_cast<std::size_t>(found - markers_.begin());
  return found != markers_.end() && (*found)->id == id ? found->get() : nullptr;
}

ShownMarker& MarkerSet::Namespace::add(std::int32_t id, std::int32_t type) {
  ShownMarker* marker = find(id);
  if (marker == nullptr) {
    const auto where = markers_.begin() + static_cast<std::ptrdiff_t>(cursor_);
    marker = markers_.insert(where, std::make_unique<ShownMarker>())->get();
    marker->header.frame_id = set_->frame_;
    marker->ns = name_;
    marker->id = id;
    marker->pose.orientation.w = 1.0;
    marker->since_ = set_->round_;
    ++set_->shown_;
  }
  if (marker->type != type) {
    marker->type = type;
    marker->points.clear();
    marker->colors.clear();
    marker->pose = geometry_msgs::Pose();
    marker->pose.orientation.w = 1.0;
  }
  return send(marker);
}

bool MarkerSet::Namespace::is_added(std::int32_t id) {
  const ShownMarker* marker = find(id);
  return marker != nullptr && marker->round_ == set_->round_;
}

void MarkerSet::Namespace::remove_others() {
  const auto is_of_now = [this](const std::unique_ptr<ShownMarker>& marker) {
    return marker->round_ == set_->round_;
  };
  const auto others = std::stable_partition(markers_.begin(), markers_.end(), is_of_now);
  for (auto each = others; each != markers_.end(); ++each) {
    --set_->shown_;
    if (set_->deletes_all_) continue;
    ShownMarker& marker = **each;
    marker.header.stamp = set_->stamp_;
    marker.action = Marker::DELETE;
    marker.points.clear();
    marker.colors.clear();
    set_->message_.markers.push_back(&marker);
    set_->gone_.push_back(std::move(*each));
  }
  markers_.erase(others, markers_.end());
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
  const double passed =
      std::abs(stamp.toSec() - last_full_.toSec());  // absolute, since time may go back
  full_ = !started_ || for_newcomer || passed >= kFullPeriod;
  if (full_) last_full_ = stamp;
  ++round_;
  message_.markers.clear();
  gone_.clear();
  present_ = 0;
  deletes_all_ = !started_;
  if (deletes_all_) {
    delete_all_.header.stamp = stamp;
    delete_all_.header.frame_id = frame_;
    delete_all_.action = Marker::DELETEALL;
    delete_all_.pose.orientation.w = 1.0;
    message_.markers.push_back(&delete_all_);
  }
  started_ = true;
}

const MarkerMessage& MarkerSet::finish() {
  if (present_ != shown_)
    for (Namespace& each : namespaces_) each.remove_others();
  return message_;
}

}  // namespace constraint_sim
