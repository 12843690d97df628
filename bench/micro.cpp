// Micro figures by Google Benchmark: time per row, link of a factorisation, body and contact.

#include <benchmark/benchmark.h>

#include <limits>

#include "engine/linear/sparse_ldlt.h"
#include "engine/methods/chain_of_bodies.h"
#include "engine/methods/chain_of_rods.h"
#include "problems.h"

namespace constraint_sim::engine {
namespace {

constexpr int kSweeps = 10;

void set_method(Method method, World* world) {
  WorldOptions options = world->options();
  options.method = method;
  options.time_step = 1e-3;
  options.tolerance = 0.0;
  options.iterations = kSweeps;
  options.sleep_after = std::numeric_limits<double>::infinity();
  world->set_options(options);
  for (int i = 0; i < 3; ++i) world->step();
}

void count_items(benchmark::State& state, std::int64_t per_iteration) {
  state.SetItemsProcessed(state.iterations() * per_iteration);
}

/// A sweep of sequential impulses over one row, with its share of the rest of the step.
void row_sweep(benchmark::State& state) {
  World world = problems::chain(static_cast<int>(state.range(0)));
  set_method(Method::kSequentialImpulses, &world);
  for ([[maybe_unused]] auto unused : state) world.step();
  count_items(state, state.range(0) * kSweeps);
}
BENCHMARK(row_sweep)->Arg(10)->Arg(1000);

/// One stage of order 8 for one link: twelve stages a step.
void link_stage(benchmark::State& state) {
  constexpr int kStages = 12;
  World world = problems::chain(static_cast<int>(state.range(0)));
  set_method(Method::kRungeKutta, &world);
  for ([[maybe_unused]] auto unused : state) world.step();
  count_items(state, state.range(0) * kStages);
}
BENCHMARK(link_stage)->Arg(10)->Arg(1000);

/// The same of a bar on ball joints.
void bar_stage(benchmark::State& state) {
  constexpr int kStages = 12;
  World world = problems::chain_of_bars(static_cast<int>(state.range(0)));
  set_method(Method::kRungeKutta, &world);
  for ([[maybe_unused]] auto unused : state) world.step();
  count_items(state, state.range(0) * kStages);
}
BENCHMARK(bar_stage)->Arg(10)->Arg(100);

/// The equations of a chain from a fixed point along x, its links swinging across it.
struct SwingingChain {
  SwingingChain(int links, bool has_bars)
      : equations(equations_of(links, has_bars)), y(equations.size()), dydt(equations.size()) {
    const Eigen::Vector3d gravity(0.0, 0.0, -problems::kGravity);
    std::vector<BodyState> states(static_cast<std::size_t>(links) + 1);
    for (int i = 1; i <= links; ++i) {
      BodyState& state = states[static_cast<std::size_t>(i)];
      state.position = {has_bars ? i - 0.5 : i, 0.0, 0.0};
      state.linear_velocity = {0.0, std::sin(i), std::cos(i)};
      state.angular_velocity = {0.1, std::cos(i), std::sin(i)};
    }
    equations.load(states, y.data());
    equations.begin(0.0, states, gravity, {}, std::vector<JointCourse>(states.size() - 1));
  }

  static EquationsOfMotion equations_of(int links, bool has_bars) {
    const auto n = static_cast<std::size_t>(links);
    MassProperties mass;
    mass.inverse_mass = 1.0;
    mass.inertia = {0.02, 0.08, 0.08};
    mass.inverse_inertia = mass.inertia.cwiseInverse();
    std::vector<MassProperties> masses(n + 1, mass);
    masses.front() = {};
    std::vector<Joint> joints(n);
    std::vector<int> all(n);
    std::vector<std::pair<std::size_t, std::size_t>> ends(n);
    for (std::size_t i = 0; i < n; ++i) {
      all[i] = static_cast<int>(i);
      ends[i] = {i, i + 1};
      if (!has_bars) continue;
      joints[i].type = BallJoint{};
      joints[i].anchor_a = {i == 0 ? 0.0 : 0.5, 0.0, 0.0};
      joints[i].anchor_b = {-0.5, 0.0, 0.0};
    }
    return {all, joints, ends, masses};
  }

  EquationsOfMotion equations;
  std::vector<double> y, dydt;
};

constexpr bool kMasses = false, kBars = true;

/// One evaluation of a chain's right-hand side, with nothing else of a step.
template <class System, bool kHasBars>
void right_hand_side(benchmark::State& state) {
  SwingingChain chain(static_cast<int>(state.range(0)), kHasBars);
  System system{chain.equations};
  for ([[maybe_unused]] auto unused : state) {
    system.derivative(1, 0.0, chain.y.data(), chain.dydt.data());
    benchmark::DoNotOptimize(chain.dydt.data());
  }
  count_items(state, state.range(0));
}
BENCHMARK_TEMPLATE(right_hand_side, ChainOfRods, kMasses)->Arg(10)->Arg(100)->Arg(1000);
BENCHMARK_TEMPLATE(right_hand_side, ChainOfBodies, kBars)->Arg(10)->Arg(100)->Arg(1000);
BENCHMARK_TEMPLATE(right_hand_side, EquationsOfMotion&, kMasses)->Arg(100);
BENCHMARK_TEMPLATE(right_hand_side, EquationsOfMotion&, kBars)->Arg(100);

/// Factors and solves a tridiagonal matrix, as a chain has it; items are its rows.
void factorisation_of_a_chain(benchmark::State& state) {
  const int n = static_cast<int>(state.range(0));
  std::vector<std::pair<int, int>> entries;
  for (int i = 1; i < n; ++i) entries.emplace_back(i, i - 1);
  SparseLdlt factors;
  factors.analyze(n, entries);
  std::vector<double> b(static_cast<std::size_t>(n), 1.0);
  for ([[maybe_unused]] auto unused : state) {
    for (int i = 0; i < n; ++i) {
      factors.values()[factors.slot(i, i)] = 2.1;
      if (i > 0) factors.values()[factors.slot(i, i - 1)] = -1.0;
    }
    factors.factor(1e-8);
    std::fill(b.begin(), b.end(), 1.0);
    factors.solve(b.data());
    benchmark::DoNotOptimize(b.data());
  }
  count_items(state, n);
}
BENCHMARK(factorisation_of_a_chain)->Arg(10)->Arg(1000);

/// A step of a body that turns freely.
void free_body(benchmark::State& state) {
  World world;
  for (int i = 0; i < state.range(0); ++i) {
    Body body;
    body.name = "body_" + std::to_string(i);
    body.mass = 1.0;
    body.inertia = {0.1, 0.2, 0.3};
    body.state.angular_velocity = {1.0, 2.0, 3.0};
    world.add_body(body);
  }
  set_method(Method::kRungeKutta, &world);
  for ([[maybe_unused]] auto unused : state) world.step();
  count_items(state, state.range(0));
}
BENCHMARK(free_body)->Arg(1)->Arg(1000);

/// A step of a ball at rest on a plane, one contact with friction.
void contact(benchmark::State& state) {
  World world;
  Body plane;
  plane.name = "plane";
  plane.type = BodyType::kStatic;
  plane.shape = Plane{};
  plane.friction = 0.5;
  world.add_body(plane);
  for (int i = 0; i < state.range(0); ++i) {
    Body ball;
    ball.name = "ball_" + std::to_string(i);
    ball.shape = Sphere{0.5};
    ball.mass = 1.0;
    ball.friction = 0.5;
    ball.state.position = {2.0 * i, 0.0, 0.5};
    world.add_body(ball);
  }
  set_method(Method::kAuto, &world);
  for ([[maybe_unused]] auto unused : state) world.step();
  count_items(state, state.range(0));
}
BENCHMARK(contact)->Arg(1)->Arg(1000);

}  // namespace
}  // namespace constraint_sim::engine

BENCHMARK_MAIN();
