#pragma once

#include <array>
#include <cstddef>
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
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {

/// What reset() returns a joint to, beside what never changes.
struct JointStart {
  Motor motor;  ///< also after continue_from() with the phase of the scene, right from time 0
  std::array<CoordinateLaw, kMaxCoordinates> coordinates;  ///< the same
  bool broken = false, enabled = true;
  std::optional<JointState> state;  ///< of a joint that goes on as saved
  double time = 0.0;                ///< when it had that state [s]
};

/// What was added to a world. Lists of one kind run in parallel: entry i of each is the same body,
/// or the same joint. Body 0 is the world. Only edits change a model.
struct Model {
  WorldOptions options;
  List<Body> bodies;
  List<MassProperties> masses;
  std::vector<BodyId> body_ids;
  List<Joint> joints;
  List<JointStart> joint_starts;
  std::vector<JointId> joint_ids;
  List<int> body_index;   ///< by id; -1 once removed
  List<int> joint_index;  ///< by id; -1 once removed
  std::unordered_map<std::string, BodyId> body_by_name;
  std::unordered_map<std::string, JointId> joint_by_name;

  bool is_movable(std::size_t body) const { return masses[body].is_movable(); }
  bool is_known(BodyId id) const { return body_index[id.value] >= 0; }
  /// The index of a body or joint; throws std::invalid_argument where there is none of this id.
  std::size_t index(BodyId id) const;
  std::size_t index(JointId id) const;
  /// What a joint of a kind that couples joins.
  CoupledTerms terms_of(std::size_t joint) const;
  /// Joints that couple a joint with another.
  List<std::size_t> couplings_of(std::size_t joint) const;
  /// The bodies of a joint, or of both joints that it couples; a body may be there twice.
  std::array<BodyId, 4> holders(std::size_t joint) const;
};

}  // namespace constraint_sim::engine
