// Times the contact of two boxes by Google Benchmark, and ODE's dBoxBox where the build has ODE: on
// random pairs, half of which touch, on boxes that rest on each other, and on separate boxes.

#include <benchmark/benchmark.h>

#include <cmath>
#include <random>
#include <vector>

#include "engine/collision/narrowphase.h"
#ifdef CONSTRAINT_SIM_BENCH_ODE
#include <ode/ode.h>
#endif

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

struct Boxes {
  Vector3d size_a, size_b;
  BodyState a, b;
};

enum class Pairs { kRandom, kResting, kApart };
constexpr int kPairs = 256;

std::vector<Boxes> make_pairs(Pairs kind) {
  std::mt19937 generator(5);
  const auto between = [&](double low, double high) {
    return low + (high - low) * (static_cast<double>(generator()) / 4294967296.0);
  };
  const auto vector = [&](double low, double high) {
    const double x = between(low, high);
    const double y = between(low, high);
    return Vector3d(x, y, between(low, high));
  };
  const auto rotation = [&](double angle) {
    return Eigen::Quaterniond(Eigen::AngleAxisd(angle, vector(-1.0, 1.0).normalized()));
  };
  std::vector<Boxes> pairs(kPairs);
  for (Boxes& pair : pairs) {
    pair.size_a = vector(0.5, 1.5);
    pair.size_b = vector(0.5, 1.5);
    if (kind == Pairs::kResting) {
      const Eigen::AngleAxisd yaw(between(-M_PI, M_PI), Vector3d::UnitZ());
      pair.a.orientation = rotation(1e-6) * yaw;
      pair.a.position = {between(-0.4, 0.4), between(-0.4, 0.4),
                         0.5 * (pair.size_a.z() + pair.size_b.z()) - 1e-4};
      continue;
    }
    pair.a.orientation = rotation(between(-M_PI, M_PI));
    pair.b.orientation = rotation(between(-M_PI, M_PI));
    pair.a.position = vector(-0.9, 0.9);
    if (kind == Pairs::kApart) pair.a.position = 1.6 * vector(-1.0, 1.0).normalized();
  }
  return pairs;
}

template <Pairs kKind>
void ours(benchmark::State& state) {
  const std::vector<Boxes> pairs = make_pairs(kKind);
  int points = 0;
  for ([[maybe_unused]] auto unused : state)
    for (const Boxes& p : pairs) {
      const Manifold manifold = Collide{p.a, p.b}(Box{p.size_a}, Box{p.size_b});
      benchmark::DoNotOptimize(&manifold);
      points += manifold.count;
    }
  state.SetItemsProcessed(state.iterations() * kPairs);
  state.counters["points"] =
      static_cast<double>(points) / static_cast<double>(state.iterations() * kPairs);
}
BENCHMARK_TEMPLATE(ours, Pairs::kRandom);
BENCHMARK_TEMPLATE(ours, Pairs::kResting);
BENCHMARK_TEMPLATE(ours, Pairs::kApart);

#ifdef CONSTRAINT_SIM_BENCH_ODE
/// Boxes as ODE needs them: rotation matrices are computed before timing.
struct OdeBoxes {
  dVector3 p_a, p_b, size_a, size_b;
  dMatrix3 R_a, R_b;

  explicit OdeBoxes(const Boxes& pair) {
    const auto copy = [](const Vector3d& from, dReal* to) { std::copy_n(from.data(), 3, to); };
    const auto rotate = [](const BodyState& from, dReal* to) {
      const Eigen::Matrix3d R = from.orientation.toRotationMatrix();
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) to[4 * i + j] = R(i, j);
    };
    copy(pair.a.position, p_a);
    copy(pair.b.position, p_b);
    copy(pair.size_a, size_a);
    copy(pair.size_b, size_b);
    rotate(pair.a, R_a);
    rotate(pair.b, R_b);
  }
};

template <Pairs kKind>
void ode(benchmark::State& state) {
  constexpr int kMostPoints = 8;
  std::vector<OdeBoxes> pairs;
  for (const Boxes& pair : make_pairs(kKind)) pairs.emplace_back(pair);
  int points = 0;
  for ([[maybe_unused]] auto unused : state)
    for (const OdeBoxes& p : pairs) {
      dContactGeom contacts[kMostPoints];
      dVector3 normal;
      dReal depth = 0.0;
      int code = 0;
      points += dBoxBox(p.p_a, p.R_a, p.size_a, p.p_b, p.R_b, p.size_b, normal, &depth, &code,
                        kMostPoints, contacts, sizeof(dContactGeom));
      benchmark::DoNotOptimize(&contacts);
    }
  state.SetItemsProcessed(state.iterations() * kPairs);
  state.counters["points"] =
      static_cast<double>(points) / static_cast<double>(state.iterations() * kPairs);
}
BENCHMARK_TEMPLATE(ode, Pairs::kRandom);
BENCHMARK_TEMPLATE(ode, Pairs::kResting);
BENCHMARK_TEMPLATE(ode, Pairs::kApart);
#endif

}  // namespace
}  // namespace constraint_sim::engine

BENCHMARK_MAIN();
