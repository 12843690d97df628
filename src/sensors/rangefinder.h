#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "constraint_sim/engine/ray.h"
#include "engine/math/numbers.h"
#include "sensors/noise.h"
#include "sensors/settings.h"

namespace constraint_sim::sensors {

using engine::kPi;

/// Beams that start in the origin of a sensor: mount, limits, rate and noise. Readings are
/// distances [m], +Inf without a body up to the greatest range, and −Inf below the least range (REP
/// 117). The carrying body and the bodies in the parameter `ignore` are transparent. A reading is a
/// function of the world and the seed, without a memory.
class Rangefinder {
 public:
  explicit Rangefinder(const ros::NodeHandle& handle)
      : mount_(mount_of(handle)),
        ignored_(names_of(handle, "ignore")),
        min_(number_between(handle, "range_min", 0.0, 0.0, 1e20)),
        max_(number_between(handle, "range_max", 30.0, 1e-20, 1e20)),
        rate_(not_negative(handle, "rate", 1e9)),
        deviation_(not_negative(handle, "noise", 0.0)),
        noise_(static_cast<std::uint64_t>(handle.param("seed", 0))) {
    if (!(min_ < max_))
      throw std::invalid_argument(handle.getNamespace() + "/range_max: must exceed range_min");
  }

  double min() const { return min_; }
  double max() const { return max_; }
  /// Time between readings [s].
  double period(const engine::World& world) const {
    return std::max(1.0 / rate_, world.options().time_step);
  }

  /// Whether a reading is due at the end of the last step: a multiple of 1/rate is within the step,
  /// so that a run from a snapshot has its readings at equal times.
  bool is_due(const engine::World& world) const {
    if (!world.has_body(mount_.body)) return false;
    constexpr double kRounding = 1e-6;  // rounding of the product of time and rate
    const double h = world.options().time_step;
    if (h * rate_ > 1.0 - kRounding) return true;
    const auto readings_until = [&](double t) { return std::floor(t * rate_ + kRounding); };
    return readings_until(world.time()) > readings_until(world.time() - h);
  }

  /// Returns a reading without noise for each unit direction in the sensor's frame.
  std::vector<double> exact(const engine::World& world,
                            const std::vector<Eigen::Vector3d>& directions) const {
    const engine::BodyId body = world.find_body(mount_.body);
    const engine::BodyState& state = world.state(body);
    std::vector<engine::BodyId> ignored{body};
    for (const std::string& name : ignored_)
      if (world.has_body(name)) ignored.push_back(world.find_body(name));
    const Eigen::Vector3d origin = state.position + state.orientation * mount_.position;
    const Eigen::Quaterniond to_world = state.orientation * mount_.orientation;
    std::vector<engine::Ray> rays;
    rays.reserve(directions.size());
    for (const Eigen::Vector3d& direction : directions)
      rays.push_back({origin, to_world * direction, max_});
    std::vector<double> readings;
    readings.reserve(rays.size());
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    for (const std::optional<engine::RayHit>& hit : engine::cast_rays(world, rays, ignored))
      readings.push_back(!hit                                  ? kInfinity
                         : hit->inside || hit->distance < min_ ? -kInfinity
                                                               : hit->distance);
    return readings;
  }

  /// Adds noise to a reading, which stays within the limits.
  double noisy(const engine::World& world, double reading, std::uint64_t beam) const {
    if (!std::isfinite(reading) || deviation_ == 0.0) return reading;
    return std::clamp(reading + deviation_ * noise_.number(world.step_count(), beam), min_, max_);
  }

 private:
  Mount mount_;
  std::vector<std::string> ignored_;
  double min_, max_;  // [m]
  double rate_;       // [1/s]
  double deviation_;  // [m]
  Noise noise_;
};

}  // namespace constraint_sim::sensors
