#include "ros/view.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "engine/math/numbers.h"

namespace constraint_sim {
namespace {

using Eigen::Vector3d;

constexpr double kSeconds = 3.0;  // time of the motion to be seen [s]
constexpr int kMostSteps = 600;
constexpr double kLegend = 0.2;  // room for lines above the scene, over its diagonal
constexpr double kShare = 0.85;  // largest used share of the window
// Field of view of rviz: 45 degrees from top to bottom, and the aspect of its shipped window.
const double kHalfHeight = std::tan(0.125 * engine::kPi);
constexpr double kAspect = 1.75;
constexpr double kBroadside = 1.1, kLengthwise = 0.47;  // [rad] yaw

// Axes of rviz's orbit view: the eye is at focal point + distance * to_eye.
struct Axes {
  explicit Axes(const View& view)
      : to_eye(std::cos(view.yaw) * std::cos(view.pitch), std::sin(view.yaw) * std::cos(view.pitch),
               std::sin(view.pitch)),
        right(-std::sin(view.yaw), std::cos(view.yaw), 0.0),
        up(to_eye.cross(right)) {}
  Vector3d to_eye, right, up;
};

std::array<Vector3d, 8> corners(const Extent& extent) {
  std::array<Vector3d, 8> all;
  for (std::size_t i = 0; i < all.size(); ++i)
    all[i] = {(i & 1 ? extent.high : extent.low).x(), (i & 2 ? extent.high : extent.low).y(),
              (i & 4 ? extent.high : extent.low).z()};
  return all;
}

}  // namespace

Extent seen_extent(engine::World world) {
  const Extent first = extent_of(world);
  const Vector3d around = Vector3d::Constant((first.high - first.low).norm());
  Extent seen = first;
  const double start = world.time();
  for (int step = 0; step < kMostSteps && world.time() < start + kSeconds; ++step) {
    if (world.step().outcome.failed) break;
    const Extent now = extent_of(world);
    seen.low = seen.low.cwiseMin(now.low.cwiseMax(first.low - around));
    seen.high = seen.high.cwiseMax(now.high.cwiseMin(first.high + around));
  }
  seen.high.z() += kLegend * seen.diagonal();
  return seen;
}

View fitted_view(const Extent& extent) {
  View view;
  const Vector3d size = extent.high - extent.low;
  if (!(size.norm() > 0.0)) return view;
  view.focal_point = 0.5 * (extent.low + extent.high);
  view.yaw = size.y() > size.x() ? kLengthwise : kBroadside;
  view.distance = 0.0;
  const Axes axes(view);
  for (const Vector3d& corner : corners(extent)) {
    const Vector3d p = corner - view.focal_point;
    const double half = std::max(std::abs(p.dot(axes.up)), std::abs(p.dot(axes.right)) / kAspect);
    view.distance = std::max(view.distance, half / (kShare * kHalfHeight) + p.dot(axes.to_eye));
  }
  return view;
}

}  // namespace constraint_sim
