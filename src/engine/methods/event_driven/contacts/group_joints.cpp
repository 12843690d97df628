#include "engine/methods/event_driven/contacts/group_joints.h"

#include <algorithm>
#include <cmath>

#include "engine/constraints/joint_kinds.h"
#include "engine/methods/event_driven/law_events.h"

namespace constraint_sim::engine {
namespace {

constexpr ScalarForm kLength{LengthForm{}};

/// Vectors of a joint of the group and their motion, with the frame on B that moves while the joint
/// closes.
struct PlacedJoint {
  PlacedJoint(const GroupBodies& bodies, const GroupJoint& of)
      : a(bodies.state(of.a)),
        b(bodies.state(of.b)),
        vectors(of.joint, a, b),
        motion(vectors, a, b) {
    if (!of.motion.moves_frame()) return;
    const MovingFrame frame = of.motion.frame(
        bodies.clock(), of.joint.anchor_b,
        of.joint.frame_b.value_or(Eigen::Quaterniond::Identity()).toRotationMatrix());
    vectors = JointVectors(of.joint, a, b, frame);
    motion = JointMotion(vectors, a, b);
    motion.add(frame, b.orientation.toRotationMatrix());
  }

  const BodyState &a, &b;
  JointVectors vectors;
  JointMotion motion;
};

Prescribed operator-(const Prescribed& a, const Prescribed& b) {
  return {a.value - b.value, a.rate - b.rate, a.acceleration - b.acceleration};
}

}  // namespace

void GroupJoints::Reading::add(double weight, const Reading& other) {
  q += weight * other.q;
  rate += weight * other.rate;
  acceleration += weight * other.acceleration;
}

bool GroupJoints::set_terms(std::size_t j, const CoupledTerms& terms) {
  for (std::size_t k = 0; k < terms.size(); ++k) {
    const auto found = std::find_if(list_.begin(), list_.end(), [&](const GroupJoint& joint) {
      return to_index(joint.index) == terms[k].joint;
    });
    if (found == list_.end()) return false;
    list_[j].terms[k] = terms[k];
    list_[j].terms[k].joint = to_index(found - list_.begin());
  }
  return true;
}

// ---- an interval

void GroupJoints::begin_interval(const GroupBodies& bodies, const JointStep& step,
                                 const List<JointData>& states, bool is_first) {
  angles_.set_time(0.0);
  closing_time_ = step.closing_time;
  has_custom_forces_ = std::any_of(list_.begin(), list_.end(), [](const GroupJoint& joint) {
    return is_custom_force(joint.joint.kind);
  });
  if (is_first) list_angles(states);
  const double t = bodies.clock();
  for (GroupJoint& joint : list_) {
    JointData state = states[static_cast<std::size_t>(joint.index)];
    joint.motion.begin(joint.joint, step, state);
    joint.to_close = joint.motion.to_close();
    joint.constant = state.coupling.constant;
    joint.is_at_end = state.saturated && has_length(joint.joint.kind);
  }
  for (GroupCoordinate& of : coordinates_) {
    const GroupJoint& joint = list_[of.joint];
    of.reference = 0.0;
    of.state = {};
    if (of.law.is_distance) {
      if (!of.law.soft.is_none()) of.law.soft.R = joint.motion.length(t).value;
      continue;
    }
    const auto i = static_cast<std::size_t>(of.law.coordinate);
    const CoordinateState& now = states[static_cast<std::size_t>(joint.index)].coordinates[i];
    if (is_first) of.braking = now.braking;
    if (of.law.drive == 0.0) continue;
    of.motor = motor_rate(*joint.joint.coordinates[i].motor, now.expires_at, t);
  }
}

// Lists the angles of all joints, where the step starts.
void GroupJoints::list_angles(const List<JointData>& states) {
  angles_.clear();
  for (std::size_t j = 0; j < list_.size(); ++j) {
    const GroupJoint& joint = list_[j];
    const JointForms& kind = forms(joint.joint.kind);
    for (int i = 0; i < kind.coordinates; ++i) {
      if (!kind.coordinate[static_cast<std::size_t>(i)].is_angle) continue;
      for (GroupCoordinate& of : coordinates_)
        if (of.joint == j && of.law.coordinate == i) of.angle = static_cast<int>(angles_.size());
      for (GroupJoint& coupling : list_)
        for (std::size_t k = 0; k < 2 && info(coupling.joint.kind).couples; ++k)
          if (coupling.terms[k].joint == j && coupling.terms[k].coordinate == i)
            coupling.term_angles[k] = static_cast<int>(angles_.size());
      angles_.add(j, joint.joint.kind, i, joint.a, joint.b);
    }
  }
  angles_.begin([&](std::size_t j) -> const JointData& {
    return states[static_cast<std::size_t>(list_[j].index)];
  });
}

void GroupJoints::integrate_angles(const GroupBodies& bodies) {
  angles_.integrate(
      bodies.time(), [&](std::size_t body) { return bodies.state(body).angular_velocity; },
      [&](const TurnedAngles::Angle& angle) -> Eigen::Vector3d {
        const JointVectors vectors = PlacedJoint(bodies, list_[angle.joint]).vectors;
        return (angle.is_about_b ? vectors.axes_B : vectors.axes_A).col(2);
      });
}

void GroupJoints::move_yielding_limits(const GroupBodies& bodies) {
  for (GroupCoordinate& of : coordinates_)
    if (of.state.yield != 0)
      of.yield_displacement +=
          read(bodies, of, nullptr).q - limit(bodies, of, of.state.yield > 0).value;
}

void GroupJoints::break_joint(std::size_t j) {
  list_[j].is_broken = true;
  list_[j].has_rows = false;
  for (GroupCoordinate& of : coordinates_) {
    if (of.joint != j) continue;
    of.is_prescribed = of.is_one_sided = false;
    of.state = {};
    of.law.soft = of.law.servo = {};
    of.law.servo_most = 0.0;
    of.law.only_pulls = false;
    of.law.goal.reset();
  }
}

bool GroupJoints::depends_on_time() const {
  return has_custom_forces_ ||
         std::any_of(list_.begin(), list_.end(),
                     [](const GroupJoint& joint) { return !joint.motion.is_constant(); }) ||
         std::any_of(coordinates_.begin(), coordinates_.end(),
                     [](const GroupCoordinate& of) { return of.motor.is_moving(); });
}

bool GroupJoints::are_at_rest() const {
  return !depends_on_time() &&
         std::none_of(list_.begin(), list_.end(),
                      [](const GroupJoint& joint) { return info(joint.joint.kind).is_custom; });
}

void GroupJoints::add_numbers(const GroupBodies& bodies, List<double>* numbers) const {
  const double t = bodies.clock();
  for (const GroupJoint& joint : list_) {
    const double length = has_length(joint.joint.kind) ? joint.motion.length(t).value : 0.0;
    for (const double number :
         {length, joint.constant, joint.was_saturated ? 1.0 : 0.0, joint.is_at_end ? 1.0 : 0.0})
      numbers->push_back(number);
  }
  for (const GroupCoordinate& of : coordinates_) {
    const double prescribed =
        of.is_prescribed ? list_[of.joint].motion.target(of.law.function, t).value : 0.0;
    for (const double number : {prescribed, of.braking, of.motor.bias}) numbers->push_back(number);
  }
  for (std::size_t i = 0; i < angles_.size(); ++i)
    for (const double number : {angles_[i].position, angles_[i].rate}) numbers->push_back(number);
}

// ---- coordinates

GroupJoints::Reading GroupJoints::read(const GroupBodies& bodies, const GroupCoordinate& of,
                                       const GroupMotions* rates) const {
  if (of.law.is_coupling) return read_coupling(bodies, of.joint, rates);
  return read_form(bodies, of.joint, of.law.form, of.law.zero, of.angle, rates);
}

GroupJoints::Reading GroupJoints::read_form(const GroupBodies& bodies, std::size_t j,
                                            const ScalarForm& form, double zero, int angle,
                                            const GroupMotions* rates) const {
  const GroupJoint& joint = list_[j];
  const PlacedJoint at(bodies, joint);
  Reading now;
  now.rate = rate(form, at.vectors, at.motion);
  const double turned =
      angle < 0 ? 0.0 : angles_.expected(to_index(angle), bodies.time(), now.rate);
  now.q = reading(form, value(form, at.vectors), zero, turned);
  now.J = jacobian(form, at.vectors);
  now.acceleration = gamma(form, at.vectors, at.motion);
  if (rates != nullptr)
    now.acceleration += now.J.times(rates->linear[joint.a], rates->angular[joint.a],
                                    rates->linear[joint.b], rates->angular[joint.b]);
  return now;
}

GroupJoints::Reading GroupJoints::read_coupling(const GroupBodies& bodies, std::size_t j,
                                                const GroupMotions* rates) const {
  const GroupJoint& coupling = list_[j];
  Reading sum;
  for (std::size_t k = 0; k < coupling.terms.size(); ++k) {
    const CoupledTerm& term = coupling.terms[k];
    const Joint& joint = list_[term.joint].joint;
    const auto i = to_index(term.coordinate);
    const Reading now = read_form(bodies, term.joint, forms(joint.kind).coordinate[i],
                                  joint.coordinates[i].zero, coupling.term_angles[k], rates);
    sum.add(term.ratio, now);
    (k == 0 ? sum.J : sum.J_second) = combined(term.ratio, now.J, 0.0, now.J);
  }
  return sum;
}

Prescribed GroupJoints::limit(const GroupBodies& bodies, const GroupCoordinate& of,
                              bool upper_one) const {
  const GroupJoint& joint = list_[of.joint];
  if (of.law.is_coupling) {
    Prescribed at_limit =
        read_prescribed(bodies, [&](double t) { return joint.motion.closing(t).coupling(); });
    at_limit.value += joint.constant;
    return at_limit;
  }
  // A limit that is open moves to its place.
  const double offset = joint.motion.is_closing() ? of.law.beyond_at_start(joint.to_close) : 0.0;
  const bool is_open = upper_one ? offset > 0.0 : offset < 0.0;
  const Prescribed error = offset == 0.0 ? Prescribed{} : read_prescribed(bodies, [&](double t) {
    return error_of_limit(of.law, offset, joint.motion.closing(joint.to_close, t));
  });
  Prescribed at_limit;
  if (of.law.is_distance) {
    at_limit = read_prescribed(bodies, [&](double t) { return joint.motion.length(t); });
    if (!is_open) at_limit = at_limit - error;
    at_limit.value += of.yield_displacement - joint.joint.distance.length.value_or(0.0);
  } else if (is_open) {
    at_limit = error;
  }
  at_limit.value += of.law.limit(upper_one);
  return at_limit;
}

// Motion of a motor with a force limit to its position.
Prescribed GroupJoints::motion_to_goal(const GroupBodies& bodies, const GroupCoordinate& of) const {
  const GroupJoint& joint = list_[of.joint];
  Prescribed motion = read_prescribed(bodies, [&](double t) {
    return joint.motion.closing(joint.to_close, t).of(of.law.function);
  });
  motion.value += *of.law.goal;
  return motion;
}

void GroupJoints::end_motion_to_goal(const GroupCoordinate& of) {
  ErrorsToClose& errors = list_[of.joint].to_close;
  errors.offset[of.law.function] = 0.0;
  errors.moving[to_index(of.law.coordinate)] = {};
}

Prescribed GroupJoints::zeta(const GroupBodies& bodies, const GroupCoordinate& of,
                             double back) const {
  const double t = bodies.clock();
  if (of.law.is_distance)
    return read_prescribed(bodies, [&](double at) { return list_[of.joint].motion.length(at); });
  if (of.law.drive == 0.0) return {};
  if (!of.law.goal) return motor_motion(of.motor, motor_phase(of.motor, t - back), 0.0);
  if (of.braking == 0.0) return motion_to_goal(bodies, of);
  if (of.state.hold == Hold::kBrake)
    return rate_until(*of.law.goal, std::copysign(of.braking, of.held - *of.law.goal),
                      of.until - t);
  return rate_to_goal(*of.law.goal, of.braking, read(bodies, of, nullptr).q);
}

Prescribed GroupJoints::rest(const GroupBodies& bodies, const GroupCoordinate& of) const {
  return rest_of(of.law,
                 of.law.is_distance ? list_[of.joint].motion.length(bodies.clock()) : Prescribed{});
}

double GroupJoints::free_force(const GroupBodies& bodies, const GroupCoordinate& of,
                               const Reading& now) const {
  double force = of.law.soft.force(now.q, now.rate) + constant_force(of.law, of.state);
  switch (of.state.servo) {
    case Servo::kNone:  // undecided
      if (of.law.has_servo()) force += clamped_servo_force(of.law, now, rest(bodies, of));
      break;
    case Servo::kFollows:
      force += servo_force(of.law, now, rest(bodies, of));
      break;
    case Servo::kSlack:
    case Servo::kRetracts:
      break;
    case Servo::kMost:
    case Servo::kLeast:
      force += of.state.servo == Servo::kMost ? of.law.servo_most : -of.law.servo_most;
      break;
  }
  return force;
}

// Returns position, rate and acceleration of a held coordinate.
Prescribed GroupJoints::target(const GroupBodies& bodies, const GroupCoordinate& of) const {
  const GroupJoint& joint = list_[of.joint];
  const double t = bodies.clock();
  if (of.is_prescribed) {
    Prescribed at = read_prescribed(
        bodies, [&](double at) { return joint.motion.target(of.law.function, at); });
    at.value += of.law.zero;
    return at;
  }
  Prescribed at = rate_held_at(
      of.state.hold, [&](bool upper_one) { return limit(bodies, of, upper_one); },
      [&] { return zeta(bodies, of); });
  if (of.state.hold == Hold::kStill) at.value = of.held;
  if (of.state.hold == Hold::kBrake) at.value += 0.5 * at.rate * at.rate / at.acceleration;
  if (of.law.goal) return at;
  if (of.state.hold != Hold::kDrive) return at;
  at.value = of.held + (of.law.is_distance ? at.value - joint.motion.length(of.held_at).value
                                           : motor_travel(of.motor, of.held_at, t - of.held_at));
  return at;
}

// ---- rows

void GroupJoints::add_rows(const GroupBodies& bodies, ContactRows* rows) const {
  for (std::size_t j = 0; j < list_.size(); ++j) {
    const GroupJoint& joint = list_[j];
    if (!joint.has_rows) continue;
    const PlacedJoint at(bodies, joint);
    const JointForms& kind = forms(joint.joint.kind);
    const bool is_distance = has_length(joint.joint.kind);
    for (int k = 0; k < kind.rows; ++k) {
      const ScalarForm& form = is_distance ? kLength : kind.function[to_index(k)];
      const Prescribed target = read_prescribed(bodies, [&](double t) {
        return is_distance ? joint.motion.length(t) : joint.motion.closing(t).of(k);
      });
      ContactRow& row = rows->add(bodies, joint.a, joint.b, jacobian(form, at.vectors));
      row.value = value(form, at.vectors) - target.value;
      row.rate = rate(form, at.vectors, at.motion) - target.rate;
      row.gamma = gamma(form, at.vectors, at.motion) - target.acceleration;
      row.joint = static_cast<int>(j);
      row.function = k;
      row.reference = joint.reference.rows[k];
    }
    if (info(joint.joint.kind).couples) add_coupling_row(bodies, j, rows);
  }
  for (std::size_t c = 0; c < coordinates_.size(); ++c)
    if (coordinates_[c].is_prescribed) add_coordinate_row(bodies, c, rows);
}

ContactRow& GroupJoints::add_row(const GroupBodies& bodies, const GroupCoordinate& of,
                                 const Reading& now, ContactRows* rows) const {
  const GroupJoint& joint = list_[of.joint];
  const GroupJoint& first = of.law.is_coupling ? list_[joint.terms[0].joint] : joint;
  ContactRow& row = rows->add(bodies, first.a, first.b, now.J);
  if (!of.law.is_coupling) return row;
  const GroupJoint& second = list_[joint.terms[1].joint];
  row.second.emplace(bodies, second.a, second.b, now.J_second);
  return row;
}

void GroupJoints::add_coupling_row(const GroupBodies& bodies, std::size_t j,
                                   ContactRows* rows) const {
  GroupCoordinate of;
  of.joint = j;
  of.law.is_coupling = true;
  const Reading now = read_coupling(bodies, j, nullptr);
  const Prescribed target =
      read_prescribed(bodies, [&](double t) { return list_[j].motion.closing(t).coupling(); });
  ContactRow& row = add_row(bodies, of, now, rows);
  row.value = now.q - list_[j].constant - target.value;
  row.rate = now.rate - target.rate;
  row.gamma = now.acceleration - target.acceleration;
  row.joint = static_cast<int>(j);
  row.function = kOfCoupling;
  row.reference = list_[j].reference.coupling;
}

void GroupJoints::add_coordinate_row(const GroupBodies& bodies, std::size_t c,
                                     ContactRows* rows) const {
  const GroupCoordinate& of = coordinates_[c];
  const Prescribed at = target(bodies, of);
  const Reading now = read(bodies, of, nullptr);
  ContactRow& row = add_row(bodies, of, now, rows);
  row.value = of.law.form.is_angle ? unwound(now.q - at.value, 0.0) : now.q - at.value;
  row.rate = now.rate - at.rate;
  row.gamma = now.acceleration - at.acceleration;
  row.joint = static_cast<int>(of.joint);
  row.function = function_of(of.law);
  row.coordinate = static_cast<int>(c);
  row.reference = of.reference;
}

void GroupJoints::add_held_rows(const GroupBodies& bodies, ContactRows* rows) const {
  for (std::size_t c = 0; c < coordinates_.size(); ++c)
    if (coordinates_[c].state.hold != Hold::kNone) add_coordinate_row(bodies, c, rows);
}

}  // namespace constraint_sim::engine
