#include "engine/constraints/distance.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/math/numbers.h"
#include "engine/model/validate.h"

namespace constraint_sim::engine {
namespace {

// Shortest length that a motor winds to, as a share of the length when added.
constexpr double kShortestShare = 0.01;

// Limits of the length, shifted by the motor's travel; 0 without a lower limit, infinity without an
// upper limit.
struct Limits {
  double min, max;

  Limits(const DistanceJoint& joint, double travel)
      : min(joint.min_length > 0.0 ? joint.min_length + travel : 0.0),
        max(joint.max_length + travel) {}
};

}  // namespace

Eigen::Vector3d direction(const AnchorPair& anchors) {
  const double distance = anchors.d.norm();
  return distance > 0.0 ? Eigen::Vector3d(anchors.d / distance) : Eigen::Vector3d::UnitX();
}

DistanceJoint tension_spring(DistanceJoint rope) {
  check_positive("max_length", rope.max_length);
  rope.length = std::exchange(rope.max_length, kInfinity);
  rope.one_sided = true;
  return rope;
}

double distance_error(const DistanceJoint& joint, double distance, double travel) {
  const double stretch = distance - joint.length.value_or(0.0) - travel;
  if (joint.one_sided) return std::max(stretch, 0.0);
  if (!is_between_limits(joint)) return stretch;
  const Limits limits(joint, travel);
  return std::max(distance - limits.max, 0.0) + std::min(distance - limits.min, 0.0);
}

int write_distance_rows(const DistanceJoint& joint, const AnchorPair& anchors, double travel,
                        Row* rows) {
  const Jacobian J = anchors.along(direction(anchors));
  const double distance = anchors.d.norm();
  int count = 0;
  if (!is_between_limits(joint)) {
    Row& row = rows[count++];
    row.J = J;
    row.C = distance - *joint.length - travel;
  }
  const Limits limits(joint, travel);
  if (limits.max < kInfinity) {
    Row& row = rows[count++];
    row.J = J;
    row.C = distance - limits.max;
    row.upper = 0.0;
  }
  if (limits.min > 0.0) {
    Row& row = rows[count++];
    row.J = J;
    row.C = distance - limits.min;
    row.lower = 0.0;
  }
  return count;
}

double length_of_row(const DistanceJoint& joint, int k) {
  if (!is_between_limits(joint) && k-- == 0) return *joint.length;
  if (joint.max_length < kInfinity && k-- == 0) return joint.max_length;
  return joint.min_length;
}

double least_travel(const DistanceJoint& joint) {
  double length = joint.length.value_or(kInfinity);
  if (joint.min_length > 0.0) length = std::min(length, joint.min_length);
  length = std::min(length, joint.max_length);
  return (kShortestShare - 1.0) * length;
}

}  // namespace constraint_sim::engine
