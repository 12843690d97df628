#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstdint>

#include "constraint_sim/engine/convex_hull.h"
#include "engine/collision/manifold_points.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {

/// Collects contact points on a plane, and keeps eight: the deepest point, and the outermost of the
/// others, preferring deep ones.
class PointChoice {
 public:
  PointChoice(const Eigen::Vector3d& normal, double margin) : margin_(margin) {
    manifold_.normal = normal;
  }

  void add(const Eigen::Vector3d& position, double depth, std::uint32_t feature) {
    if (!(depth > -margin_) || count_ == kMostPoints) return;
    points_[count_++] = {position, depth, feature};
  }
  bool is_empty() const { return count_ == 0; }
  double least_gap() const {
    double gap = kInfinity;
    for (std::size_t i = 0; i < count_; ++i) gap = std::min(gap, -points_[i].depth);
    return gap;
  }

  /// Returns the manifold; `u` and `v` are directions along the plane that turn with a body.
  Manifold manifold(const Eigen::Vector3d& u, const Eigen::Vector3d& v) {
    const std::size_t most = manifold_.points.size();
    if (count_ <= most) {
      for (std::size_t i = 0; i < count_; ++i) keep(i);
      return manifold_;
    }
    std::array<bool, kMostPoints> is_kept{};
    std::size_t deepest = 0;
    for (std::size_t i = 1; i < count_; ++i)
      if (points_[i].depth > points_[deepest].depth) deepest = i;
    is_kept[deepest] = true;
    constexpr double kDiagonal = 0.70710678118654752;
    const Eigen::Vector3d p_0 = points_[deepest].position;
    const Eigen::Vector3d directions[] = {
        u, -u, v, -v, kDiagonal * (u + v), -kDiagonal * (u + v), kDiagonal * (u - v)};
    for (const Eigen::Vector3d& direction : directions) {
      std::size_t best = deepest;
      double farthest = -kInfinity;
      for (std::size_t i = 0; i < count_; ++i) {
        if (is_kept[i]) continue;
        // Points above the deepest bear less: each unit of height outweighs ten of distance.
        const double score = direction.dot(points_[i].position - p_0) +
                             10.0 * (points_[i].depth - points_[deepest].depth);
        if (score > farthest) farthest = score, best = i;
      }
      is_kept[best] = true;
    }
    for (std::size_t i = 0; i < count_; ++i)
      if (is_kept[i]) keep(i);
    return manifold_;
  }

 private:
  static constexpr std::size_t kMostPoints = 2 * kMostHullVertices;

  /// A contact point as in Manifold, whose memory is not written before it is used.
  struct Entry {
    Eigen::Vector3d position;
    double depth;
    std::uint32_t feature;
  };

  void keep(std::size_t i) {
    const auto& [position, depth, feature] = points_[i];
    manifold_.points[static_cast<std::size_t>(manifold_.count++)] = {position, depth, feature};
  }

  double margin_;
  Manifold manifold_;
  std::size_t count_ = 0;
  std::array<Entry, kMostPoints> points_;
};

}  // namespace constraint_sim::engine
