#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/joint.h"
#include "urdf/lumps.h"

namespace constraint_sim {

/// Names of two links.
using LinkPair = std::pair<std::string, std::string>;

/// Pairs of a robot's bodies that do not collide, beside pairs that a joint connects.
struct ContactExceptions {
  std::vector<std::pair<std::size_t, std::size_t>> pairs;  ///< indices of lumps, first < second
  std::vector<std::string> warnings;  ///< overlapping links, and pairs that are too many
};

/// Finds the exceptions of a robot whose bodies and joints have the ids of an empty world. Links on
/// fixed joints count as one: a joint to one of them makes all of them neighbours. Excepted are
/// neighbours, bodies that overlap in their present states, and the `listed` pairs of links. Two
/// links that are in different `models` may overlap and collide.
ContactExceptions contact_exceptions(const Lumps& lumps, const std::vector<engine::Body>& bodies,
                                     const std::vector<engine::Joint>& joints,
                                     const std::vector<LinkPair>& listed,
                                     const std::map<std::string, std::size_t>& models);

/// Returns the joint that keeps two bodies from colliding and holds nothing: a free distance. Its
/// name is `<prefix>no_contact/<link>/<link>`.
engine::Joint no_contact_joint(const std::string& prefix, const LinkPair& links, engine::BodyId a,
                               engine::BodyId b);

/// Returns whether no_contact_joint() made the joint, judged by its kind and name.
bool is_contact_exception(const engine::Joint& joint);

/// Reads the pairs of `<disable_collisions link1="" link2=""/>` in an SRDF. Throws
/// std::invalid_argument where one has no two links.
std::vector<LinkPair> disabled_collisions(const std::string& srdf);

}  // namespace constraint_sim
