#pragma once

namespace constraint_sim::engine {

/// What long tests divide their numbers of cases or steps by: sanitizers look at memory and
/// threads, for which a share of them does, and take ten times as long.
#ifdef CONSTRAINT_SIM_SANITIZED
inline constexpr int kSanitizedShare = 20;
#else
inline constexpr int kSanitizedShare = 1;
#endif

}  // namespace constraint_sim::engine
