#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <random>

namespace constraint_sim::engine {

/// Random numbers that are equal with every standard library.
class Draw {
 public:
  explicit Draw(unsigned seed) : generator_(seed) {}

  double share() { return static_cast<double>(generator_()) / 4294967296.0; }
  int below(int n) { return static_cast<int>(share() * n); }
  double between(double low, double high) { return low + (high - low) * share(); }
  Eigen::Vector3d vector_between(double low, double high) {
    const double x = between(low, high);
    const double y = between(low, high);
    return {x, y, between(low, high)};
  }
  double operator()() { return 2.0 * share() - 1.0; }
  Eigen::Vector3d vector() {
    const double x = (*this)();
    const double y = (*this)();
    return {x, y, (*this)()};
  }
  Eigen::Quaterniond turn() {
    Eigen::Quaterniond q;
    q.w() = (*this)();
    q.vec() = vector();
    return q.normalized();
  }

 private:
  std::mt19937 generator_;
};

}  // namespace constraint_sim::engine
