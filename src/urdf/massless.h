#pragma once

#include <urdf_model/model.h>

#include <map>
#include <string>
#include <vector>

#include "urdf/extra.h"
#include "urdf/mesh_shapes.h"

namespace constraint_sim {

/// Mass and inertia of a massless link between joints, relative to the lightest link that it moves.
/// The motion deviates from that without a mass by about this share. sequential_impulses converges
/// slowly for large mass ratios, so the share is not smaller.
constexpr double kMasslessShare = 1e-4;

/// Outcome of treat_massless_links().
struct MasslessLinks {
  bool is_root_fixed = false;  ///< the root has no mass, and only floating joints: it cannot move
  std::map<std::string, double> fixed_joints;  ///< joints made fixed, and their positions
  std::vector<std::string> warnings;           ///< each changed link and joint
};

/// Makes a URDF computable whose moving links lack masses. A joint that moves no mass becomes fixed
/// at its initial position, with the joints that mimic it; its motor and position are removed from
/// `extra`. A massless link between joints gets kMasslessShare of a neighbour's mass. Throws
/// std::invalid_argument where no link that moves has a mass, and where joints can move a massless
/// link although all masses rest.
MasslessLinks treat_massless_links(bool is_fixed, urdf::ModelInterface* model, MeshShapes* meshes,
                                   RobotExtra* extra);

}  // namespace constraint_sim
