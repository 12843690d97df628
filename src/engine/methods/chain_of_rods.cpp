#include "engine/methods/chain_of_rods.h"

#include <algorithm>
#include <array>

#include "engine/constraints/joint_kinds.h"

namespace constraint_sim::engine {
namespace {

std::size_t at(int i) { return static_cast<std::size_t>(i); }

}  // namespace

// Brings joints and bodies into the order of the chain that they are, if they are one: rods between
// centres, or ball joints between bodies that all turn.
bool EquationsOfMotion::order_as_chain(const std::vector<Joint>& all_joints, const Ends& ends,
                                       const std::vector<MassProperties>& masses) {
  const bool is_of_bodies = turning_ > 0;
  if (is_of_bodies && turning_ < bodies_.size()) return false;
  const auto place = [&](std::size_t body) {  // bodies_ is sorted, so far
    const auto found = std::lower_bound(bodies_.begin(), bodies_.end(), static_cast<int>(body));
    return static_cast<std::size_t>(found - bodies_.begin());
  };
  std::vector<std::array<int, 2>> rods_of(bodies_.size(), {-1, -1});  // or ball joints
  for (const int j : joints_) {
    const auto* distance = if_distance(all_joints[at(j)]);
    if ((distance == nullptr) != is_of_bodies) return false;
    if (info(all_joints[at(j)].kind).form == RowsForm::kGeneral) return false;
    if (distance != nullptr && distance->is_soft()) return false;
    for (const std::size_t body : {ends[at(j)].first, ends[at(j)].second}) {
      if (!masses[body].is_movable()) continue;
      auto& [first, second] = rods_of[place(body)];
      if (second >= 0) return false;
      (first < 0 ? first : second) = j;
    }
  }

  const auto is_end = [&](std::size_t body) {
    return !masses[body].is_movable() || rods_of[place(body)][1] < 0;
  };
  const auto first = std::find_if(joints_.begin(), joints_.end(), [&](int j) {
    return is_end(ends[at(j)].first) || is_end(ends[at(j)].second);
  });
  if (first == joints_.end()) return false;  // a ring
  int rod = *first;
  std::size_t body = is_end(ends[at(rod)].first) ? ends[at(rod)].first : ends[at(rod)].second;
  std::vector<int> rods, bodies;
  if (masses[body].is_movable()) bodies.push_back(static_cast<int>(body));
  while (rod >= 0) {
    rods.push_back(rod);
    const auto& [a, b] = ends[at(rod)];
    body = body == a ? b : a;
    if (!masses[body].is_movable()) break;
    bodies.push_back(static_cast<int>(body));
    const auto& both = rods_of[place(body)];
    rod = both[0] == rod ? both[1] : both[0];
  }
  if (bodies.size() < bodies_.size()) return false;  // some are on no rod
  joints_ = rods;
  bodies_ = bodies;
  return true;
}

// All links from one point of the chain to the next; which of its ends is A makes no difference.
void EquationsOfMotion::turn_along_chain() {
  for (std::size_t l = 0; l + 1 < links_.size(); ++l) {
    const Link& next = links_[l + 1];
    Link& link = links_[l];
    if (link.a == next.a || link.a == next.b) std::swap(link.a, link.b);
  }
  if (links_.size() < 2) return;
  Link& last = links_.back();
  if (last.a != links_[links_.size() - 2].b) std::swap(last.a, last.b);
}

}  // namespace constraint_sim::engine
