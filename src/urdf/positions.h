#pragma once

#include <urdf_model/model.h>

#include <map>
#include <string>
#include <vector>

namespace constraint_sim {

/// Whether a joint has one coordinate, which a URDF names after it.
bool has_position(const urdf::Joint& joint);

/// The joint that one mimics. Throws std::invalid_argument where there is none with a position.
const urdf::Joint& leader_of(const urdf::ModelInterface& model, const urdf::Joint& joint);

/// What joints read at first [m or rad]: as given, or bound to those that they mimic, or 0, or the
/// limit that is next to it, which is told. Throws std::invalid_argument for what cannot be.
std::map<std::string, double> first_positions(const urdf::ModelInterface& model,
                                              const std::map<std::string, double>& given,
                                              std::vector<std::string>* warnings);

}  // namespace constraint_sim
