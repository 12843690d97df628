#pragma once

#include <cstdlib>

namespace constraint_sim::engine {

/// Divisor of the steps and cases of long tests: sanitizers look at memory and threads, for which a
/// share of the cases does, and take ten times as long.
#ifdef CONSTRAINT_SIM_SANITIZED
inline constexpr int kSanitizedShare = 20;
#else
inline constexpr int kSanitizedShare = 1;
#endif

/// Whether every time step and every random seed is to run: `scripts/test --all` sets the variable.
inline const bool kIsLongRun = std::getenv("CONSTRAINT_SIM_TEST_ALL") != nullptr;

/// Divisor of numbers of random seeds. Seeds that once found a fault are listed in their tests, and
/// run always.
inline const int kSeedShare = kSanitizedShare > 1 ? kSanitizedShare : kIsLongRun ? 1 : 5;

}  // namespace constraint_sim::engine
