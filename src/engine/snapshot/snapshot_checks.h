#pragma once

#include <cstdint>
#include <string>

#include "constraint_sim/engine/world.h"
#include "engine/math/list.h"
#include "engine/model/model.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

// A snapshot may come from a forged file. These functions check each index, size and name of a
// snapshot before its use, and throw SnapshotError.

[[noreturn]] void fail_damaged(const char* what);

/// One more than the largest ids that were read.
struct MostIds {
  std::uint32_t body = 0, joint = 0;
};

void check_model(const Model& model, const State& state);
void check_ids(const Model& model, const MostIds& most);
/// Checks that all indices are in [0, size).
void check_indices(const List<int>& indices, std::size_t size);
/// Reads a snapshot whose first line is the line of this build. `checks_sums`: checks checksum and
/// hash; tests of forged bytes do not, since a forger can make both fit.
World read_world(const std::string& bytes, bool checks_sums);
void check_pairs(const Model& model, const List<TouchingPair>& pairs);

}  // namespace constraint_sim::engine
