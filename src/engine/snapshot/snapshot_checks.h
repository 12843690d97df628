#pragma once

#include <cstdint>
#include <string>

#include "constraint_sim/engine/world.h"
#include "engine/math/list.h"
#include "engine/model/model.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

// A snapshot may come from a file that somebody has made: nothing in it is used as an index, a size
// or a name before it is checked here. Each throws SnapshotError.

[[noreturn]] void fail_damaged(const char* what);

/// Largest ids that were read, and one more.
struct MostIds {
  std::uint32_t body = 0, joint = 0;
};

void check_model(const Model& model, const State& state);
void check_ids(const Model& model, const MostIds& most);
/// Whether each is the index of a body or joint, or of any list of this size.
void check_indices(const List<int>& indices, std::size_t size);
/// read_snapshot() of bytes that begin as those of this build; for tests also without asking for
/// checksum and hash, which whoever forges bytes can make fit.
World read_world(const std::string& bytes, bool checks_sums);
void check_pairs(const Model& model, const List<TouchingPair>& pairs);

}  // namespace constraint_sim::engine
