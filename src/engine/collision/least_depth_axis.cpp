// The depth along a unit vector n is the extent of both shapes minus the distance of their centres
// along n. It is least where n is normal to a face or cap, or to two edges or sides, or lies on one
// of a few circles at right angles to an edge or axis. Two rims are treated by Newton's method.

#include "engine/collision/least_depth_axis.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "engine/math/elementary.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

/// Share of the product of curvatures below which their matrix counts as singular: Newton's method
/// would step by rounding, and a step along the negative gradient is taken.
constexpr double kSingularShare = 1e-12;

}  // namespace

void LeastDepthAxis::find(double margin) {
  find_flat();
  if (depth_ <= -margin) return;
  find_corners();
  if (depth_ <= -margin) return;
  find_circles();
  if (depth_ <= -margin || !a_.is_round || a_.radius() == 0.0) return;
  find_rims();
}

void LeastDepthAxis::take_face() {
  double most = std::sqrt(1.0 - kFlatSine * kFlatSine);
  Vector3d face = Vector3d::Zero();
  for (const Solid* solid : {&a_, &b_}) {
    for (int i = solid->is_round ? 2 : 0; i < 3; ++i) {
      const double cosine = normal_.dot(solid->axes.col(i));
      if (std::abs(cosine) <= most) continue;
      most = std::abs(cosine) * (1.0 + kLaterFaceShare);
      face = cosine < 0.0 ? Vector3d(-solid->axes.col(i)) : Vector3d(solid->axes.col(i));
    }
  }
  if (face.isZero(0.0)) return;
  normal_ = face;
  depth_ = depth_along(face);
}

void LeastDepthAxis::try_axis(const Vector3d& direction, double least_length) {
  const double length = direction.norm();
  if (!(length > least_length)) return;
  const Vector3d n = direction / (direction.dot(t_) < 0.0 ? -length : length);
  const double depth = depth_along(n);
  if (!(depth < depth_ - kTieShare * size_)) return;
  depth_ = depth;
  normal_ = n;
}

// Tries normals of faces and caps, and of two edges or sides.
void LeastDepthAxis::find_flat() {
  for (const Solid* solid : {&a_, &b_})
    for (int i = solid->is_round ? 2 : 0; i < 3; ++i) try_axis(solid->axes.col(i));
  for (int i = a_.is_round ? 2 : 0; i < 3; ++i)
    try_axis(a_.axes.col(i).cross(b_.axis()), kParallelSine);
}

// Tries vertices of a box against the side and the rims of B.
void LeastDepthAxis::find_corners() {
  if (a_.is_round) {  // A is a cylinder or line: tries the direction between the parallel axes
    try_axis(t_ - b_.axis() * b_.axis().dot(t_), kParallelSine * size_);
    return;
  }
  for (int k = 0; k < 8; ++k) {
    const Vector3d arm((k & 1) != 0 ? a_.half.x() : -a_.half.x(),
                       (k & 2) != 0 ? a_.half.y() : -a_.half.y(),
                       (k & 4) != 0 ? a_.half.z() : -a_.half.z());
    const Vector3d p = b_.axes.transpose() * (t_ + a_.axes * arm);
    const double across = math::hypot(p.x(), p.y());
    if (across == 0.0) continue;
    const Vector3d radial(p.x() / across, p.y() / across, 0.0);
    try_axis(b_.axes * radial);
    const double beyond = std::abs(p.z()) - b_.half.z();
    if (across > b_.radius() && beyond > 0.0)
      try_axis(b_.axes * Vector3d((across - b_.radius()) * radial.x(),
                                  (across - b_.radius()) * radial.y(),
                                  std::copysign(beyond, p.z())));
  }
}

void LeastDepthAxis::find_circles() {
  for (int i = a_.is_round ? 2 : 0; i < 3; ++i)
    find_across(a_.axes.col(i), a_.axes.col((i + 1) % 3));
  if (a_.is_round) find_across(b_.axis(), b_.axes.col(0));
}

// Tries the least depth along directions at right angles to `axis`, n = ((1 − s²) p + 2 s q) / (1 +
// s²).
void LeastDepthAxis::find_across(const Vector3d& axis, const Vector3d& beside) {
  constexpr int kSamples = 24;
  const Vector3d q = axis.cross(beside).normalized();
  const Vector3d p = q.cross(axis);
  const auto direction = [&](double s) {
    return Vector3d(((1.0 - s * s) * p + 2.0 * s * q) / (1.0 + s * s));
  };
  const auto depth = [&](double s) {
    const Vector3d n = direction(s);
    return a_.support_extent(n) + b_.support_extent(n) - std::abs(n.dot(t_));
  };
  const auto slope = [&](double s) {
    const Vector3d n = direction(s);
    const Vector3d along = (1.0 - s * s) * q - 2.0 * s * p;
    return along.dot(a_.farthest(n) + b_.farthest(n) - (n.dot(t_) < 0.0 ? -t_ : t_));
  };
  const auto place = [](int k) { return 2.0 * k / kSamples - 1.0; };  // samples of a half circle
  std::array<double, kSamples> depths;
  for (int k = 0; k < kSamples; ++k) depths[k] = depth(place(k));
  for (int k = 0; k < kSamples; ++k) {
    const double here = depths[k];
    // Between samples the depth is lower by at most the square of their distance.
    if (here > depth_ + 0.02 * size_ || here > depths[(k + 1) % kSamples] ||
        here > depths[(k + kSamples - 1) % kSamples])
      continue;
    double low = place(k - 1), high = place(k + 1);
    for (int i = 0; i < kMostBisections && high - low > kAngleRounding; ++i) {
      const double middle = 0.5 * (low + high);
      (slope(middle) > 0.0 ? high : low) = middle;
    }
    try_axis(direction(0.5 * (low + high)));
  }
}

// Tries a rim of each cylinder, from several starts.
void LeastDepthAxis::find_rims() {
  for (const int side_a : {-1, 1})
    for (const int side_b : {-1, 1})
      for (const double turn : {0.0, -1.5, 1.5}) find_rims(side_a, side_b, turn);
}

void LeastDepthAxis::find_rims(int side_a, int side_b, double turn) {
  const Vector3d c_a = a_.cap_centre(side_a), c_b = b_.cap_centre(side_b);
  const auto toward = [](const Solid& solid, const Vector3d& d) -> Vector3d {
    const Vector3d across = d - solid.axis() * solid.axis().dot(d);
    const double length = across.norm();
    return length > kParallelSine * solid.radius() ? Vector3d(across / length)
                                                   : Vector3d(solid.axes.col(0));
  };
  Vector3d e_a = toward(a_, c_b - c_a);
  e_a = (e_a + turn * a_.axis().cross(e_a)).normalized();
  Vector3d e_b = toward(b_, c_a + a_.radius() * e_a - c_b);
  for (int i = 0; i < 12; ++i) {
    const Vector3d along_a = a_.radius() * a_.axis().cross(e_a);  // derivative by the angle
    const Vector3d along_b = b_.radius() * b_.axis().cross(e_b);
    const Vector3d d = (c_a + a_.radius() * e_a) - (c_b + b_.radius() * e_b);
    const double g_a = d.dot(along_a), g_b = -d.dot(along_b);
    const double h_aa = along_a.squaredNorm() - a_.radius() * d.dot(e_a);
    const double h_bb = along_b.squaredNorm() + b_.radius() * d.dot(e_b);
    const double h_ab = -along_a.dot(along_b);
    const double determinant = h_aa * h_bb - h_ab * h_ab;
    double turn_a, turn_b;
    if (h_aa > 0.0 && determinant > kSingularShare * h_aa * std::abs(h_bb)) {
      turn_a = -(h_bb * g_a - h_ab * g_b) / determinant;
      turn_b = -(h_aa * g_b - h_ab * g_a) / determinant;
    } else {  // step along the negative gradient
      turn_a = -g_a / along_a.squaredNorm();
      turn_b = -g_b / along_b.squaredNorm();
    }
    const double most = std::max(std::abs(turn_a), std::abs(turn_b));
    const double share = most > 0.5 ? 0.5 / most : 1.0;
    e_a = (e_a + share * turn_a * a_.axis().cross(e_a)).normalized();
    e_b = (e_b + share * turn_b * b_.axis().cross(e_b)).normalized();
    if (most < kAngleRounding) break;
  }
  try_axis(a_.axis().cross(e_a).cross(b_.axis().cross(e_b)), kParallelSine);
  try_axis((c_a + a_.radius() * e_a) - (c_b + b_.radius() * e_b), kParallelSine * size_);
}

}  // namespace constraint_sim::engine
