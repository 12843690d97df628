#pragma once

#include <stdexcept>
#include <string>

#include "constraint_sim/engine/world.h"

namespace constraint_sim::engine {

/// Error of bytes that are no snapshot, are damaged, or come from another build.
class SnapshotError : public std::invalid_argument {
 public:
  using std::invalid_argument::invalid_argument;
};

/// Writes a world with all that decides its future and all that it reports, as bytes. A world read
/// from them, by any process of the same build, continues with the same bits and the same
/// state_hash(). The bytes leave out clock and stop flag, and whatever a copy by
/// World::take_snapshot() lacks.
std::string write_snapshot(const World& world);

/// Whether bytes begin as snapshots of any build do.
bool is_snapshot(const std::string& bytes);

/// Reads a world from the bytes of write_snapshot(). Throws SnapshotError, also where the hash of
/// the world differs from the hash in the bytes.
World read_snapshot(const std::string& bytes);

}  // namespace constraint_sim::engine
