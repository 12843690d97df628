// Prints how the box tests of the broadphase grow with the number of bodies.

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <random>

#include "engine/collision/broadphase.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

constexpr double kLargestSlope = 1.3;

Proxy ball(int body, const Eigen::Vector3d& position, double radius) {
  BodyState state;
  state.position = position;
  return {bounds(Sphere{radius}, state), body, true};
}

Proxy floor_plane(int body) { return {bounds(Plane{}, BodyState{}), body, false}; }

/// Balls side by side on a plane, in a square.
List<Proxy> floor_grid(int n) {
  const int side = static_cast<int>(std::ceil(std::sqrt(n)));
  List<Proxy> proxies{floor_plane(n)};
  for (int i = 0; i < n; ++i) {
    const int row = i / side;
    proxies.push_back(ball(i, Eigen::Vector3d(i % side, row, 0.5), 0.5));
  }
  return proxies;
}

/// A column of balls on a plane.
List<Proxy> column(int n) {
  List<Proxy> proxies{floor_plane(n)};
  for (int i = 0; i < n; ++i) proxies.push_back(ball(i, Eigen::Vector3d(0.0, 0.0, i + 0.5), 0.5));
  return proxies;
}

/// A cube of balls on a plane, each shifted by up to half a diameter along each axis and scaled to
/// between half and full size.
List<Proxy> pile(int n) {
  std::mt19937 generator(1);
  const auto random = [&] { return static_cast<double>(generator()) / 4294967296.0; };
  const int side = static_cast<int>(std::ceil(std::cbrt(n)));
  List<Proxy> proxies{floor_plane(n)};
  for (int i = 0; i < n; ++i) {
    const int row = i / side % side;
    const int layer = i / (side * side);
    Eigen::Vector3d position(i % side, row, layer + 0.5);
    for (int axis = 0; axis < 3; ++axis) position[axis] += random() - 0.5;
    proxies.push_back(ball(i, position, 0.25 + 0.25 * random()));
  }
  return proxies;
}

/// Prints a row for each n. Returns the slope from n = 100 to the last.
double measure(const char* name, const std::function<List<Proxy>(int)>& arrangement) {
  std::printf("%s\n%8s %12s %10s %10s %7s\n", name, "n", "tests", "pairs", "tests/n", "slope");
  Broadphase broadphase;
  int previous_n = 0;
  double previous_tests = 0.0;
  double tests_of_100 = 0.0;
  for (const int n : {10, 32, 100, 316, 1000, 3162, 10000}) {
    const std::size_t pairs = broadphase.find_pairs(arrangement(n)).size();
    const double tests = static_cast<double>(broadphase.tests());
    std::printf("%8d %12.0f %10zu %10.2f", n, tests, pairs, tests / n);
    if (previous_n > 0) {
      std::printf(" %7.3f", std::log(tests / previous_tests) / std::log(1.0 * n / previous_n));
    }
    std::printf("\n");
    if (n == 100) tests_of_100 = tests;
    previous_n = n;
    previous_tests = tests;
  }
  const double slope = std::log(previous_tests / tests_of_100) / std::log(previous_n / 100.0);
  std::printf("slope from 100 to %d: %.3f\n\n", previous_n, slope);
  return slope;
}

int run() {
  int failures = 0;
  const auto check = [&](const char* name, double slope) {
    if (slope <= kLargestSlope) return;
    std::printf("%s: the slope %.3f exceeds %.1f\n", name, slope, kLargestSlope);
    ++failures;
  };
  check("floor grid", measure("floor grid", floor_grid));
  check("column", measure("column", column));
  check("pile", measure("pile", pile));
  return failures == 0 ? 0 : 1;
}

}  // namespace
}  // namespace constraint_sim::engine

int main() { return constraint_sim::engine::run(); }
