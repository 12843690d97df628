#include "engine/islands/borrowers.h"

namespace constraint_sim::engine {

IntegrationResult Borrowers::advance(Integration integration, const Interval& interval,
                                     const IntegratorOptions& options, EquationsOfMotion* equations,
                                     List<BodyState>* states) {
  IntegrationResult result;
  for_each_line([&](auto& line) {
    if (line.kIntegration != integration) return;
    if (!line.method) line.method.emplace(*equations);
    result = line.method->advance(interval, options, equations, states);
  });
  return result;
}

bool Borrowers::have_started() const {
  bool have = false;
  for_each_line([&](const auto& line) { have |= line.method && line.method->has_started(); });
  return have;
}

void Borrowers::forget() {
  for_each_line([](auto& line) {
    if (line.method) line.method->forget();
  });
}

void Borrowers::restart() {
  for_each_line([](auto& line) {
    if (line.method) line.method->restart();
  });
}

}  // namespace constraint_sim::engine
