#pragma once

#include <stdexcept>
#include <string>

#include "constraint_sim/engine/world.h"

namespace constraint_sim::engine {

/// Bytes that are no snapshot, are damaged, or come from another build.
class SnapshotError : public std::invalid_argument {
 public:
  using std::invalid_argument::invalid_argument;
};

/// A world with all that decides its future and all that it tells, as bytes. What is read from
/// them, in this or in another process of the same build, goes on with the same bits: every step
/// has the state_hash() that the world has in it. Clock and stop flag are not in them, and of a
/// world to look at (World::take_snapshot()) what that has not.
std::string write_snapshot(const World& world);

/// Whether bytes begin as snapshots of any build do.
bool is_snapshot(const std::string& bytes);

/// The world of such bytes. Throws SnapshotError, also where the world that they describe has not
/// the hash that it was written with.
World read_snapshot(const std::string& bytes);

}  // namespace constraint_sim::engine
