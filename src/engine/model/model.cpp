#include "engine/model/model.h"

#include "engine/model/validate.h"

namespace constraint_sim::engine {

void Model::refuse_unknown(BodyId id) {
  refuse("body", "there is none with id " + std::to_string(id.value));
}

void Model::refuse_unknown(JointId id) {
  refuse("constraint", "there is none with id " + std::to_string(id.value));
}

CoupledTerms Model::terms_of(std::size_t j) const {
  const Joint& joint = joints[j];
  if (!info(joint.kind).couples_joints) return {{{j, 0, 1.0}, {j, 1, -lead(joint)}}};
  const Coupling& coupling = joint.coupling;
  return {{{index(coupling.first), 0, 1.0}, {index(coupling.second), 0, coupling.ratio}}};
}

List<std::size_t> Model::couplings_of(std::size_t joint) const {
  List<std::size_t> found;
  for (std::size_t j = joint + 1; j < joints.size(); ++j) {
    if (!info(joints[j].kind).couples_joints) continue;
    const Coupling& coupling = joints[j].coupling;
    if (coupling.first == joint_ids[joint] || coupling.second == joint_ids[joint])
      found.push_back(j);
  }
  return found;
}

std::array<BodyId, 4> Model::holders(std::size_t joint) const {
  const Joint* first = &joints[joint];
  const Joint* second = first;
  if (info(first->kind).couples_joints) {
    first = &joints[index(joints[joint].coupling.first)];
    second = &joints[index(joints[joint].coupling.second)];
  }
  return {first->body_a, first->body_b, second->body_a, second->body_b};
}

}  // namespace constraint_sim::engine
