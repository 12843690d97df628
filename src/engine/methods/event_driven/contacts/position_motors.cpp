#include "engine/methods/event_driven/contacts/position_motors.h"

#include "engine/math/box_lcp.h"
#include "engine/methods/event_driven/contacts/contact_responses.h"
#include "engine/methods/event_driven/position_motor.h"

namespace constraint_sim::engine {
namespace {

// Deceleration of a coordinate by half of the force of its motor, while other motors hold; zero
// where joints hold the coordinate.
double braking_of(std::size_t c, const ContactEquations& equations) {
  const GroupJoints& joints = equations.joints();
  ContactResponses responses;
  responses.add_coordinate(c);
  for (std::size_t d = 0; d < joints.coordinates().size(); ++d)
    if (d != c && joints.coordinates()[d].is_one_sided && joints.coordinates()[d].law.drive > 0.0)
      responses.add_coordinate(d);
  responses.find(equations);
  if (!responses.is_free(0)) return 0.0;
  List<Eigen::Index> others;
  const std::size_t n = responses.columns();
  for (std::size_t k = 1; k < n; ++k)
    if (responses.is_free(k)) others.push_back(static_cast<Eigen::Index>(k));
  const auto size = static_cast<Eigen::Index>(n);
  const Eigen::Map<const Eigen::MatrixXd> A(responses.A().data(), size, size);
  return 0.5 * joints.coordinates()[c].law.drive * response_beside(A, others, 0);
}

}  // namespace

void find_lost(ContactEquations* equations) {
  GroupJoints& joints = equations->joints();
  for (std::size_t c = 0; c < joints.coordinates().size(); ++c) {
    GroupCoordinate& of = joints.coordinates()[c];
    if (!of.law.goal) continue;
    const GroupJoints::Reading now = joints.read(equations->bodies(), of, nullptr);
    judge_motion(
        now, joints.motion_to_goal(equations->bodies(), of), *of.law.goal,
        [&] { return braking_of(c, *equations); }, [&] { joints.end_motion_to_goal(of); },
        &of.braking);
  }
}

bool note_lost(ContactEquations* equations) {
  GroupJoints& joints = equations->joints();
  bool any = false;
  for (std::size_t c = 0; c < joints.coordinates().size(); ++c) {
    GroupCoordinate& of = joints.coordinates()[c];
    if (!of.law.goal || of.state.drive == 0 || of.braking > 0.0) continue;
    of.braking = braking_of(c, *equations);
    any = any || of.braking > 0.0;
  }
  return any;
}

bool find_pressed(const ContactEquations& equations, const List<double>& accelerations,
                  List<char>* presses) {
  const GroupBodies& bodies = equations.bodies();
  const GroupJoints& joints = equations.joints();
  bool any = false;
  for (std::size_t c = 0; c < joints.coordinates().size(); ++c) {
    const GroupCoordinate& of = joints.coordinates()[c];
    if ((*presses)[c] || !of.law.goal || of.state.drive == 0 || of.braking > 0.0 ||
        !is_pressed(of.law, joints.read(bodies, of, nullptr).q, accelerations[c],
                    [&](bool upper_one) { return joints.limit(bodies, of, upper_one); }))
      continue;
    (*presses)[c] = 1;
    any = true;
  }
  return any;
}

}  // namespace constraint_sim::engine
