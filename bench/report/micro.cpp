// Micro benchmarks by Google Benchmark: time per row, link of a factorisation, body and contact, in
// scenes of the report.

#include <benchmark/benchmark.h>

#include "contestant.h"
#include "engine/math/list.h"
#include "engine/math/sparse_ldlt.h"

namespace constraint_sim::report {
namespace {

void count_items(benchmark::State& state, std::int64_t per_iteration) {
  state.SetItemsProcessed(state.iterations() * per_iteration);
}

/// Takes ticks of 1 ms of a scene of this kind; the argument is its size, `items` the items per
/// element.
void ticks(benchmark::State& state, const std::string& kind, const std::string& variant,
           std::int64_t items = 1) {
  constexpr double kTick = 1e-3;
  const Problem& problem = problem_named(kind + "_" + std::to_string(state.range(0)));
  const auto simulation = Contestant::make(problem, {variant}, {kTick});
  for (int i = 0; i < 3; ++i) simulation->advance(1, kTick);
  for ([[maybe_unused]] auto unused : state) simulation->advance(1, kTick);
  count_items(state, state.range(0) * items);
}

/// Times a sweep of sequential impulses over one row, with its share of the rest of the step.
void row_sweep(benchmark::State& state) { ticks(state, "links", "sequential_impulses_10", 10); }
BENCHMARK(row_sweep)->Arg(10)->Arg(1000);

/// Times one stage of order 8 for one link: twelve stages a step.
void link_stage(benchmark::State& state) { ticks(state, "links", "runge_kutta_order_8", 12); }
BENCHMARK(link_stage)->Arg(10)->Arg(1000);

/// Factors and solves a tridiagonal matrix, as in a chain; items are its rows.
void factorisation_of_a_chain(benchmark::State& state) {
  const int n = static_cast<int>(state.range(0));
  engine::List<std::pair<int, int>> entries;
  for (int i = 1; i < n; ++i) entries.emplace_back(i, i - 1);
  engine::SparseLdlt factors;
  factors.analyze(n, entries);
  engine::List<double> b(static_cast<std::size_t>(n), 1.0);
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

/// Times a step of a freely rotating body.
void free_body(benchmark::State& state) { ticks(state, "bodies", "runge_kutta_order_8"); }
BENCHMARK(free_body)->Arg(1)->Arg(1000);

/// Times a step of a ball at rest on a plane: one contact with friction.
void contact(benchmark::State& state) { ticks(state, "contacts", "auto"); }
BENCHMARK(contact)->Arg(1)->Arg(1000);

}  // namespace
}  // namespace constraint_sim::report

BENCHMARK_MAIN();
