#pragma once

#include <cstdlib>

namespace constraint_sim::engine {

/// Divisor of steps and cases of long tests: sanitizers check memory and threads, for which a share
/// of the cases suffices, and run ten times as long.
#ifdef CONSTRAINT_SIM_SANITIZED
inline constexpr int kSanitizedShare = 20;
#else
inline constexpr int kSanitizedShare = 1;
#endif

/// Whether all time steps and random seeds are run: `scripts/test --all` sets the variable.
inline const bool kIsLongRun = std::getenv("CONSTRAINT_SIM_TEST_ALL") != nullptr;

/// Divisor of numbers of random seeds. Seeds that once found a fault are listed in their tests and
/// always run.
inline const int kSeedShare = kSanitizedShare > 1 ? kSanitizedShare : kIsLongRun ? 1 : 5;

}  // namespace constraint_sim::engine
