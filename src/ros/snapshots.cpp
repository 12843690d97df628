#include "ros/snapshots.h"

#include <algorithm>
#include <stdexcept>
#include <utility>
#include <vector>

#include "sim/words.h"

namespace constraint_sim {

std::string Snapshots::keep(Snapshot snapshot) {
  const std::lock_guard<std::mutex> lock(mutex_);
  snapshot.is_in_ring = snapshot.name.empty();
  if (snapshot.name.size() > kLongestName)
    throw std::invalid_argument("name: must have at most " + std::to_string(kLongestName) +
                                " characters, got " + std::to_string(snapshot.name.size()));
  if (snapshot.name.compare(0, 5, "auto_") == 0)
    throw std::invalid_argument("name: must not begin with 'auto_', as automatic ones do");
  const auto same = std::find_if(snapshots_.begin(), snapshots_.end(), [&](const Snapshot& known) {
    return known.name == snapshot.name;
  });
  std::size_t most_named = snapshot.bytes->size(), named = 0;  // totals with the new snapshot
  for (const Snapshot& known : snapshots_) {
    if (known.is_in_ring || &known == (same == snapshots_.end() ? nullptr : &*same)) continue;
    most_named += known.bytes->size();
    ++named;
  }
  if (most_named > kMostBytes)
    throw std::invalid_argument("name: there is no room for " +
                                std::to_string(snapshot.bytes->size()) +
                                " bytes beside the snapshots that have names; give a path");
  if (!snapshot.is_in_ring && named >= kMostNamed)
    throw std::invalid_argument("name: there are " + std::to_string(kMostNamed) +
                                " snapshots that have names already; replace one");
  if (same != snapshots_.end()) drop(same);
  if (snapshot.is_in_ring && snapshots_.size() - named >= kMostInRing) drop_oldest_of_ring();
  while (bytes_ + snapshot.bytes->size() > kMostBytes) drop_oldest_of_ring();
  if (snapshot.is_in_ring) snapshot.name = "auto_" + std::to_string(++last_);
  bytes_ += snapshot.bytes->size();
  snapshots_.push_back(std::move(snapshot));
  return snapshots_.back().name;
}

void Snapshots::drop(const List::iterator& which) {
  bytes_ -= which->bytes->size();
  snapshots_.erase(which);
}

void Snapshots::drop_oldest_of_ring() {
  drop(std::find_if(snapshots_.begin(), snapshots_.end(),
                    [](const Snapshot& known) { return known.is_in_ring; }));
}

Snapshots::Bytes Snapshots::bytes(const std::string& name) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  std::vector<std::string> names;
  for (const Snapshot& known : snapshots_) {
    if (known.name == name) return known.bytes;
    names.push_back(known.name);
  }
  throw std::invalid_argument("name: there is no snapshot '" + shortened(name) + "'" +
                              did_you_mean(name, names));
}

Snapshots::List Snapshots::list() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  List list;
  for (const Snapshot& known : snapshots_)
    list.push_back({known.name, known.is_in_ring, known.time, known.step, known.hash, nullptr});
  return list;
}

}  // namespace constraint_sim
