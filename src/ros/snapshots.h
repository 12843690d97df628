#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <string>

#include "constraint_sim/engine/world.h"

namespace constraint_sim {

/// Snapshots of a world in memory, by name. Snapshots named by a caller stay until they are
/// replaced. Automatically named ones form a ring: the oldest make room for new ones. Any thread.
class Snapshots {
 public:
  static constexpr std::size_t kMostNamed = 100;
  static constexpr std::size_t kMostInRing = 100;
  /// Largest total size [bytes]; a snapshot beyond is rejected.
  static constexpr std::size_t kMostBytes = std::size_t{1} << 30;
  static constexpr std::size_t kLongestName = 255;

  using Bytes = std::shared_ptr<const std::string>;

  struct Snapshot {
    std::string name;
    bool is_in_ring;
    double time;  ///< simulated time [s]
    std::uint64_t step;
    std::uint64_t hash;
    Bytes bytes;
  };
  using List = std::deque<Snapshot>;

  /// Keeps a snapshot; an empty name puts it into the ring as `auto_N`. Returns its name. Throws
  /// std::invalid_argument where there is no room, or the name is too long or belongs to the ring.
  std::string keep(Snapshot snapshot);
  /// Returns the bytes of a snapshot. Throws std::invalid_argument for an unknown name.
  Bytes bytes(const std::string& name) const;
  /// Returns all snapshots without their bytes, oldest first.
  List list() const;

 private:
  void drop(const List::iterator& which);
  void drop_oldest_of_ring();

  mutable std::mutex mutex_;
  List snapshots_;          // oldest first
  std::size_t bytes_ = 0;   // total
  std::uint64_t last_ = 0;  // number of the last snapshot in the ring
};

}  // namespace constraint_sim
