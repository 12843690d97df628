#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/id.h"
#include "constraint_sim/engine/joint.h"
#include "constraint_sim/engine/world.h"
#include "engine/constraints/coupling.h"
#include "engine/math/list.h"
#include "engine/model/joint_data.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {

/// Settings and state to which reset() returns a joint.
struct JointStart {
  /// Motor with the phase of the scene, relative to time 0 even after continue_from().
  Motor motor;
  std::array<CoordinateLaw, kMaxCoordinates> coordinates;  ///< laws with the phases of the scene
  bool broken = false, enabled = true;
  std::optional<JointData> state;  ///< state of a joint that continues from a saved scene
  double time = 0.0;               ///< time of `state` [s]
};

/// Returns the place of an id in a list of ascending ids by bisection; -1 where the list lacks it.
template <class Id>
[[gnu::noinline]] int searched_place_of(Id id, const std::vector<Id>& ids) {
  const auto found = std::lower_bound(ids.begin(), ids.end(), id);
  return found != ids.end() && *found == id ? static_cast<int>(found - ids.begin()) : -1;
}

/// Returns the place of an id in a list of ascending ids; -1 where the list lacks it. Looks first
/// where the id stands if none before it is gone.
template <class Id>
inline int place_of(Id id, const std::vector<Id>& ids) {
  if (!ids.empty()) {
    const std::uint32_t place = id.value - ids.front().value;
    if (place < ids.size() && ids[place] == id) return static_cast<int>(place);
  }
  return searched_place_of(id, ids);
}

/// Bodies and joints of a world. Lists of one kind run in parallel: entry i of each is the same
/// body or joint. Body 0 is the world. Only edits change a model.
struct Model {
  WorldOptions options;
  List<Body> bodies;
  List<MassProperties> masses;
  std::vector<BodyId> body_ids;  ///< ascending
  List<Joint> joints;
  List<JointStart> joint_starts;
  std::vector<JointId> joint_ids;  ///< ascending
  BodyId next_body_id{1};          ///< id of the next body; all issued ids are less
  JointId next_joint_id;           ///< id of the next joint; all issued ids are less
  std::unordered_map<std::string, BodyId> body_by_name;
  std::unordered_map<std::string, JointId> joint_by_name;

  bool is_movable(std::size_t body) const { return masses[body].is_movable(); }
  /// Returns the acceleration by which a movable body falls freely [m/s²].
  Eigen::Vector3d gravity_on(std::size_t body) const {
    return masses[body].weight_share * options.gravity;
  }
  /// Returns the index of a body or joint; -1 for an id that never existed or was removed.
  int find(BodyId id) const { return place_of(id, body_ids); }
  int find(JointId id) const { return place_of(id, joint_ids); }
  bool is_known(BodyId id) const { return find(id) >= 0; }
  /// Returns the index of a body or joint; throws std::invalid_argument for an unknown id.
  std::size_t index(BodyId id) const { return known(find(id), id); }
  std::size_t index(JointId id) const { return known(find(id), id); }
  /// Returns the coordinates that a gear, pulley or screw couples.
  CoupledTerms terms_of(std::size_t joint) const;
  /// Joints that couple a joint with another.
  List<std::size_t> couplings_of(std::size_t joint) const;
  /// The bodies of a joint, or of both joints that it couples; a body may be there twice.
  std::array<BodyId, 4> holders(std::size_t joint) const;

 private:
  template <class Id>
  static std::size_t known(int place, Id id) {
    if (place < 0) refuse_unknown(id);
    return to_index(place);
  }
  // Kept out of line: inlined, each index() would reserve stack for the text.
  [[noreturn]] static void refuse_unknown(BodyId id);
  [[noreturn]] static void refuse_unknown(JointId id);
};

}  // namespace constraint_sim::engine
