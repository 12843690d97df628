#include "engine/methods/event_driven/contacts/group_joint.h"

#include <algorithm>

#include "engine/constraints/joint_kinds.h"

namespace constraint_sim::engine {

void add_coordinates(std::size_t j, GroupJoint* of, List<OneSidedLaw>* scratch,
                     List<GroupCoordinate>* coordinates) {
  const Joint& joint = of->joint;
  List<OneSidedLaw>& laws = *scratch;
  laws.clear();
  add_one_sided_laws(joint, j, &laws);
  const auto add = [&](const OneSidedLaw& law) -> GroupCoordinate& {
    GroupCoordinate& coordinate = coordinates->emplace_back();
    coordinate.joint = j;
    coordinate.law = law;
    return coordinate;
  };
  if (has_length(joint.kind)) {
    const SoftLaw spring = length_spring(joint);
    of->has_rows = laws.empty() && spring.is_none();
    if (of->has_rows) return;
    OneSidedLaw law;
    if (!laws.empty()) law = laws.front();
    law.is_distance = true;
    law.form = ScalarForm(LengthForm{});
    if (!law.has_servo()) law.soft = {spring.K, 0.0, spring.C, 0.0};
    add(law).is_one_sided = !laws.empty();
    return;
  }
  of->has_rows = !joint.coupling.one_sided;
  if (!of->has_rows) {
    add(laws.front()).is_one_sided = true;
    return;
  }
  const JointForms& kind = forms(joint.kind);
  for (int i = 0; i < kind.coordinates; ++i) {
    const CoordinateLaw& from = joint.coordinates[i];
    const auto found = std::find_if(laws.begin(), laws.end(),
                                    [&](const OneSidedLaw& law) { return law.coordinate == i; });
    OneSidedLaw law;
    if (found != laws.end()) {
      law = *found;
    } else {
      law.coordinate = i;
      law.form = kind.coordinate[i];
      law.zero = from.zero;
      law.function = kind.rows + i;
      law.soft = soft_law(from);
    }
    const bool acts = found != laws.end() || is_held(from) || !law.soft.is_none();
    if (!acts) continue;
    GroupCoordinate& coordinate = add(law);
    coordinate.is_prescribed = is_held(from);
    coordinate.is_one_sided = found != laws.end();
  }
}

}  // namespace constraint_sim::engine
