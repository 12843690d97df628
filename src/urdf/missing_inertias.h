#pragma once

#include <urdf_model/model.h>

#include <string>
#include <vector>

#include "urdf/mesh_shapes.h"

namespace constraint_sim {

/// Fills in the inertias of moving links that have a mass and an inertia of 0: that of the link's
/// first collision shape, about the centre of mass, else of a sphere with the density of water.
/// Links stay that get an inertia from links on fixed joints. Returns a sentence for each filled in
/// link.
std::vector<std::string> fill_in_inertias(bool is_root_fixed, MeshShapes* meshes,
                                          urdf::ModelInterface* model);

}  // namespace constraint_sim
