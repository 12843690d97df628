#include "engine/methods/endpoint_estimate.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace constraint_sim::engine {

using Eigen::Vector3d;

double EndpointEstimate::first(double h, bool is_order_4, int parts) {
  return keep(h, largest(last_, middle_, end_, 0.5 * h, is_order_4, std::max(parts / 2, 1)));
}

double EndpointEstimate::next(double h, bool is_order_4, int parts) {
  const bool is_equal = std::abs(h - tick_) <= 1e-9 * h;
  return keep(h, is_equal ? largest(before_, last_, end_, h, is_order_4, parts) : estimate_);
}

double EndpointEstimate::largest(const Points& a, const Points& b, const Points& c, double h,
                                 bool is_order_4, int parts) const {
  const double share =
      is_order_4 ? 1.0 / (1.0 * parts * parts * parts * parts) : h / (6.0 * parts * parts);
  double square = 0.0;
  for (const Points* points : {&a, &b, &c})
    if (points->position.size() != c.position.size() ||
        points->velocity.size() != c.position.size())
      return estimate_;  // of a snapshot that somebody has changed
  for (std::size_t i = 0; i < c.position.size(); ++i) {
    const Vector3d ends = a.velocity[i] + c.velocity[i];
    const Vector3d error =
        is_order_4
            ? Vector3d(c.position[i] - a.position[i] - h / 3.0 * (ends + 4.0 * b.velocity[i]))
            : Vector3d(ends - 2.0 * b.velocity[i]);
    square = std::max(square, error.squaredNorm());
  }
  return share * std::sqrt(square);
}

double EndpointEstimate::keep(double h, double estimate) {
  std::swap(before_, last_);
  std::swap(last_, end_);
  tick_ = h;
  return estimate_ = estimate;
}

}  // namespace constraint_sim::engine
