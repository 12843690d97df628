#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <string>

#include "constraint_sim/engine/world.h"

namespace constraint_sim {

/// Snapshots of a world in memory, by name. Those with a name of a caller stay until they are
/// replaced; of those that are named here the oldest make room for new ones, so that one can be
/// taken again and again. All functions are for any thread.
class Snapshots {
 public:
  static constexpr std::size_t kMostNamed = 100;
  static constexpr std::size_t kMostInRing = 100;
  /// [bytes] of all of them, as written; one that would be beyond is not kept.
  static constexpr std::size_t kMostBytes = std::size_t{1} << 30;
  static constexpr std::size_t kLongestName = 255;

  using Bytes = std::shared_ptr<const std::string>;

  struct Snapshot {
    std::string name;
    bool is_in_ring;
    double time;  ///< simulated [s]
    std::uint64_t step;
    std::uint64_t hash;
    Bytes bytes;
  };
  using List = std::deque<Snapshot>;

  /// Keeps one; without a name in the ring, as `auto_N`. Returns its name. Throws
  /// std::invalid_argument where there is no room for it, or the name is one of the ring or too
  /// long.
  std::string keep(Snapshot snapshot);
  /// The bytes of one. Throws std::invalid_argument where there is none of this name.
  Bytes bytes(const std::string& name) const;
  /// Without bytes, the oldest first.
  List list() const;

 private:
  void drop(const List::iterator& which);
  void drop_oldest_of_ring();

  mutable std::mutex mutex_;
  List snapshots_;          // the oldest first
  std::size_t bytes_ = 0;   // of all
  std::uint64_t last_ = 0;  // number of the last one in the ring
};

}  // namespace constraint_sim
