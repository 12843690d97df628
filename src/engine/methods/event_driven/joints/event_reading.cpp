#include "engine/methods/event_driven/joints/event_reading.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "engine/constraints/joint_kinds.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

EventReading read_coupling(const EventMotions& motions, const EventBodies& bodies,
                           const OneSidedLaw& law, double t, const EquationsOfMotion& equations,
                           const Motions& rates) {
  const EventJoints& joints = motions.joints();
  EventReading sum;
  for (const CoupledTerm& term : joints.terms(law.joint)) {
    const auto i = static_cast<std::size_t>(term.coordinate);
    OneSidedLaw of_term;
    of_term.joint = term.joint;
    of_term.coordinate = term.coordinate;
    of_term.form = forms(joints[term.joint].kind).coordinate[i];
    of_term.zero = joints[term.joint].coordinates[i].zero;
    const EventReading now = read_law(motions, bodies, of_term, t, equations, rates);
    sum.q += term.ratio * now.q;
    sum.rate += term.ratio * now.rate;
    sum.acceleration += term.ratio * now.acceleration;
    const bool is_first = &term == joints.terms(law.joint).data();
    (is_first ? sum.J : sum.J_second) = combined(term.ratio, now.J, 0.0, now.J);
  }
  return sum;
}

}  // namespace

BodyState EventBodies::at(std::size_t body, double t) const {
  BodyState state = states[body];
  if (masses[body].is_movable()) return state;
  const double since = t - tick_start;
  state.position += since * state.linear_velocity;
  if (!state.angular_velocity.isZero(0.0))
    state.orientation = rotation(since * state.angular_velocity) * state.orientation;
  return state;
}

EventReading read_law(const EventMotions& motions, const EventBodies& bodies,
                      const OneSidedLaw& law, double t, const EquationsOfMotion& equations,
                      const Motions& rates) {
  if (law.is_coupling) return read_coupling(motions, bodies, law, t, equations, rates);
  const auto& ends = motions.joints().ends(law.joint);
  const BodyState a = bodies.at(ends.first, t), b = bodies.at(ends.second, t);
  const MovingFrame frame = law.is_distance ? MovingFrame() : motions.frame(law.joint, t);
  const JointVectors vectors(motions.joints()[law.joint], a, b, frame);
  JointMotion motion(vectors, a, b);
  if (frame.moves) motion.add(frame, b.orientation.toRotationMatrix());
  EventReading reading;
  const double reference = law.is_distance
                               ? 0.0
                               : counted_position(equations, law.joint, law.coordinate,
                                                  motions.position(law.joint, law.coordinate));
  reading.q = engine::reading(law.form, value(law.form, vectors), law.zero, reference);
  reading.rate = rate(law.form, vectors, motion);
  reading.J = jacobian(law.form, vectors);
  Vector3d linear[2], angular[2];
  const std::size_t of_joint[2] = {ends.first, ends.second};
  for (int k = 0; k < 2; ++k) {
    linear[k].setZero();
    angular[k].setZero();
    const List<int>& island = equations.bodies();
    const auto found = std::find(island.begin(), island.end(), static_cast<int>(of_joint[k]));
    if (found == island.end()) continue;
    linear[k] = rates.linear[to_index(found - island.begin())];
    angular[k] = rates.angular[to_index(found - island.begin())];
  }
  reading.acceleration = reading.J.times(linear[0], angular[0], linear[1], angular[1]) +
                         gamma(law.form, vectors, motion);
  return reading;
}

double counted_position(const EquationsOfMotion& equations, std::size_t joint, int coordinate,
                        double noted) {
  const List<int>& joints = equations.joints();
  const auto found = std::find(joints.begin(), joints.end(), static_cast<int>(joint));
  std::array<double, kMaxCoordinates> positions;
  if (found == joints.end() ||
      !equations.coordinates().read(equations, to_index(found - joints.begin()), &positions) ||
      std::isnan(positions[to_index(coordinate)]))
    return noted;
  return positions[to_index(coordinate)];
}

}  // namespace constraint_sim::engine
