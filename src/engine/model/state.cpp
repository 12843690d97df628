#include "engine/model/state.h"

#include <algorithm>
#include <cmath>

namespace constraint_sim::engine {

Failure failure_of(const BodyState& body) {
  Eigen::Matrix<double, 13, 1> numbers;
  numbers << body.position, body.linear_velocity, body.angular_velocity, body.orientation.coeffs();
  const double off_unit = body.orientation.squaredNorm() - 1.0;
  if (!numbers.allFinite() || std::abs(off_unit) > kMostOffUnit) return Failure::kNotFinite;
  return numbers.lpNorm<Eigen::Infinity>() <= kMostMagnitude ? Failure::kNone
                                                             : Failure::kOutOfRange;
}

bool are_in_range(const State& state, const List<int>& bodies) {
  return std::all_of(bodies.begin(), bodies.end(), [&](int body) {
    return failure_of(state.states[to_index(body)]) == Failure::kNone;
  });
}

}  // namespace constraint_sim::engine
