#include "engine/methods/event_driven/contacts/position_motors.h"

#include <cmath>

#include "engine/math/box_lcp.h"
#include "engine/methods/event_driven/contacts/contact_responses.h"
#include "engine/methods/event_driven/joints/law_events.h"

namespace constraint_sim::engine {

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

void find_lost(ContactEquations* equations) {
  GroupJoints& joints = equations->joints();
  for (std::size_t c = 0; c < joints.coordinates().size(); ++c) {
    GroupCoordinate& of = joints.coordinates()[c];
    if (!of.law.goal) continue;
    const GroupJoints::Reading now = joints.read(equations->bodies(), of, nullptr);
    const auto follows = [&](const Prescribed& course) {
      return std::abs(now.q - course.value) <= kTouching &&
             std::abs(now.rate - course.rate) <= kResting;
    };
    if (follows(joints.course_of(equations->bodies(), of))) {
      of.braking = 0.0;
    } else if (of.braking == 0.0) {
      of.braking = braking_of(c, *equations);
    } else if (follows(
                   {*of.law.goal, 0.0, 0.0})) {  // it arrived before the motion that it had lost
      of.braking = 0.0;
      joints.end_course(of);
    }
  }
}

bool find_pressed(const ContactEquations& equations, const List<double>& accelerations,
                  List<char>* is_pressed) {
  const GroupBodies& bodies = equations.bodies();
  const GroupJoints& joints = equations.joints();
  bool any = false;
  for (std::size_t c = 0; c < joints.coordinates().size(); ++c) {
    const GroupCoordinate& of = joints.coordinates()[c];
    if ((*is_pressed)[c] || !of.law.goal || of.state.drive == 0 || of.braking > 0.0) continue;
    const double q = joints.read(bodies, of, nullptr).q;
    for (const bool upper_one : {false, true}) {
      if (!std::isfinite(of.law.limit(upper_one))) continue;
      const double direction = upper_one ? -1.0 : 1.0;
      const double gap = direction * (q - joints.limit(bodies, of, upper_one).value);
      if (gap > kTouching || direction * accelerations[c] >= 0.0) continue;
      (*is_pressed)[c] = 1;
      any = true;
    }
  }
  return any;
}

}  // namespace constraint_sim::engine
