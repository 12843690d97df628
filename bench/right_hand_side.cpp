// Times a chain's right-hand side by Google Benchmark, by its kernels and by the general equations,
// and whole steps of a chain of bars and of a net. Items are links, for steps times stages.

#include <benchmark/benchmark.h>

#include <limits>

#include "engine/dynamics/kernels/chain_of_bodies.h"
#include "engine/dynamics/kernels/chain_of_rods.h"
#include "engine/math/list.h"
#include "problems.h"

namespace constraint_sim::engine {
namespace {

void count_items(benchmark::State& state, std::int64_t per_iteration) {
  state.SetItemsProcessed(state.iterations() * per_iteration);
}

/// Equations of a chain from a fixed point along x, with links swinging across it.
struct SwingingChain {
  SwingingChain(int links, bool has_bars)
      : equations(equations_of(links, has_bars)), y(equations.size()), dydt(equations.size()) {
    const Eigen::Vector3d gravity(0.0, 0.0, -problems::kGravity);
    List<BodyState> states(static_cast<std::size_t>(links) + 1);
    for (int i = 1; i <= links; ++i) {
      BodyState& state = states[static_cast<std::size_t>(i)];
      state.position = {has_bars ? i - 0.5 : i, 0.0, 0.0};
      state.linear_velocity = {0.0, std::sin(i), std::cos(i)};
      state.angular_velocity = {0.1, std::cos(i), std::sin(i)};
    }
    gather_state(equations, states, y.data());
    equations.begin(0.0, states, gravity, {}, List<PrescribedMotion>(states.size() - 1));
  }

  static EquationsOfMotion equations_of(int links, bool has_bars) {
    const auto n = static_cast<std::size_t>(links);
    MassProperties mass;
    mass.inverse_mass = 1.0;
    mass.inertia = {0.02, 0.08, 0.08};
    mass.inverse_inertia = mass.inertia.cwiseInverse();
    List<MassProperties> masses(n + 1, mass);
    masses.front() = {};
    List<Joint> joints(n);
    List<int> all(n);
    List<std::pair<std::size_t, std::size_t>> ends(n);
    for (std::size_t i = 0; i < n; ++i) {
      all[i] = static_cast<int>(i);
      ends[i] = {i, i + 1};
      if (!has_bars) continue;
      joints[i].kind = JointKind::kBall;
      joints[i].anchor_a = {i == 0 ? 0.0 : 0.5, 0.0, 0.0};
      joints[i].anchor_b = {-0.5, 0.0, 0.0};
    }
    return {all, joints, ends, masses};
  }

  EquationsOfMotion equations;
  List<double> y, dydt;
};

constexpr bool kMasses = false, kBars = true;

/// Times one evaluation of a chain's right-hand side alone.
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

/// Takes steps of order 8 with one substep each; items are stages times joints.
void count_stages(benchmark::State& state, World world) {
  constexpr int kStages = 12;
  WorldOptions options = world.options();
  options.time_step = 1e-3;
  options.tolerance = 0.0;
  options.method = Method::kRungeKutta;
  options.sleep_after = std::numeric_limits<double>::infinity();
  world.set_options(options);
  for (int i = 0; i < 3; ++i) world.step();
  for ([[maybe_unused]] auto unused : state) world.step();
  count_items(state, static_cast<std::int64_t>(world.joint_ids().size()) * kStages);
}

/// Times one stage for one bar on ball joints, with its share of the rest of the step.
void bar_stage(benchmark::State& state) {
  count_stages(state, problems::chain_of_bars(static_cast<int>(state.range(0))));
}
BENCHMARK(bar_stage)->Arg(10)->Arg(100);

/// Times one stage for one rod of a net of n × n masses, which has loops.
void net_stage(benchmark::State& state) {
  count_stages(state, problems::net(static_cast<int>(state.range(0)), 0.1));
}
BENCHMARK(net_stage)->Arg(8)->Arg(32);

}  // namespace
}  // namespace constraint_sim::engine

BENCHMARK_MAIN();
