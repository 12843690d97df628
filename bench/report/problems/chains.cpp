// Pendulums and chains of point masses in the x-z plane.

#include "common.h"

namespace constraint_sim::report {
namespace {

Problem released_chain(const std::string& name, int links, double duration) {
  return with_chain(problem(name, "smooth", duration, links), chain_of(links), 1.0 / 32.0);
}

/// A hanging chain with links of 0.1 kg and 1 m; only the load, one link further, moves at 1 m/s.
/// The links vibrate with ω = 2 √(T/ml), which the reference follows.
PlanarChain loaded_chain(double load) {
  PlanarChain chain = chain_of(11, -kPi / 2.0, 0.1);
  chain.masses.back() = load;
  chain.rates.back() = 1.0;
  return chain;
}

double step_for(double load) { return 3.0 / (2.0 * std::sqrt(load * kGravity / 0.1)); }

Problem heavy_chain(const std::string& name, double load) {
  Problem made = problem(name, "stiff", 5.0, 11.0);
  made.measured = {10};
  made = with_chain(std::move(made), loaded_chain(load), std::min(1.0 / 32.0, step_for(load)));
  return made;
}

constexpr int kCount = 1000;  // number of pendulums

/// A thousand pendulums side by side, to measure an engine's overhead.
Problem many_pendulums() {
  Problem made = problem("pendula_1000", "smooth", 2.0);
  for (int i = 0; i < kCount; ++i) {
    const Eigen::Vector3d support(0.0, 2.0 * i, 0.0);
    made.bodies.push_back(point_mass(support + Eigen::Vector3d::UnitX()));
    made.joints.push_back(rod(kWorld, i, support));
  }
  const auto one = chain_motion(made, chain_of(1), 1.0 / 32.0);
  made.source = "angle of one in long double, by extrapolation";
  made.reference = [one](int refinement) {
    Trajectory all;
    for (const States& states : one(refinement)) {
      all.emplace_back(kCount, states.front());
      for (int i = 0; i < kCount; ++i)
        all.back()[static_cast<std::size_t>(i)].position.y() = 2.0 * i;
    }
    return all;
  };
  return made;
}

std::vector<Problem> make() {
  return {released_chain("pendulum", 1, 10.0), released_chain("double_pendulum", 2, 3.0),
          released_chain("chain_10", 10, 2.0), released_chain("chain_100", 100, 2.0),
          heavy_chain("heavy_chain_1e3", 1e3), heavy_chain("heavy_chain_1e4", 1e4),
          heavy_chain("heavy_chain_1e6", 1e6), many_pendulums()};
}

const Registration kRegistration(make);

}  // namespace
}  // namespace constraint_sim::report
