#include "engine/methods/event_driven/contacts/group_joints.h"

#include <algorithm>
#include <cmath>

#include "engine/constraints/joint_kinds.h"
#include "engine/methods/event_driven/joints/law_events.h"

namespace constraint_sim::engine {

void GroupJoints::add_coordinates(std::size_t j) {
  GroupJoint& of = list_[j];
  const Joint& joint = of.joint;
  laws_.clear();
  add_one_sided_laws(joint, j, &laws_);
  const auto add = [&](const OneSidedLaw& law) -> GroupCoordinate& {
    GroupCoordinate& coordinate = coordinates_.emplace_back();
    coordinate.joint = j;
    coordinate.law = law;
    return coordinate;
  };
  if (has_length(joint.kind)) {
    const SoftLaw spring = length_spring(joint);
    of.has_rows = laws_.empty() && spring.is_none();
    if (of.has_rows) return;
    OneSidedLaw law;
    if (!laws_.empty()) law = laws_.front();
    law.is_distance = true;
    law.form = ScalarForm(LengthForm{});
    if (!law.has_servo()) law.soft = {spring.K, 0.0, spring.C, 0.0};
    add(law).is_one_sided = !laws_.empty();
    return;
  }
  const JointKindInfo& kind = info(joint.kind);
  for (int i = 0; i < kind.coordinates; ++i) {
    const CoordinateLaw& from = joint.coordinates[i];
    const auto found = std::find_if(laws_.begin(), laws_.end(),
                                    [&](const OneSidedLaw& law) { return law.coordinate == i; });
    OneSidedLaw law;
    if (found != laws_.end()) {
      law = *found;
    } else {
      law.coordinate = i;
      law.form = kind.coordinate[i];
      law.zero = from.zero;
      law.function = kind.rows + i;
      law.soft = soft_law(from);
    }
    const bool acts = found != laws_.end() || is_held(from) || !law.soft.is_none();
    if (!acts) continue;
    GroupCoordinate& coordinate = add(law);
    coordinate.is_prescribed = is_held(from);
    coordinate.is_one_sided = found != laws_.end();
  }
}

// ---- an interval

void GroupJoints::begin_interval(const GroupBodies& bodies, const JointStep& step,
                                 const List<JointState>& states, bool is_first) {
  angles_.set_time(0.0);
  if (is_first) list_angles(states);
  const double t = bodies.clock();
  for (GroupJoint& joint : list_) {
    JointState state = states[static_cast<std::size_t>(joint.index)];
    joint.course.begin(joint.joint, step, state);
    joint.is_at_end = state.saturated && has_length(joint.joint.kind);
  }
  for (GroupCoordinate& of : coordinates_) {
    const GroupJoint& joint = list_[of.joint];
    of.reference = 0.0;
    of.state = {};
    if (of.law.is_distance) {
      if (!of.law.soft.is_none()) of.law.soft.R = joint.course.length(t).value;
      continue;
    }
    const auto i = static_cast<std::size_t>(of.law.coordinate);
    const CoordinateState& now = states[static_cast<std::size_t>(joint.index)].coordinates[i];
    if (is_first) of.braking = now.braking;
    if (of.law.drive == 0.0) continue;
    of.motor = *joint.joint.coordinates[i].motor;
    if (of.motor.timeout > 0.0 && now.expires_at <= t) of.motor.bias = 0.0;
  }
}

// Lists the angles of all joints, where the step starts.
void GroupJoints::list_angles(const List<JointState>& states) {
  angles_.clear();
  for (std::size_t j = 0; j < list_.size(); ++j) {
    const GroupJoint& joint = list_[j];
    const JointKindInfo& kind = info(joint.joint.kind);
    for (int i = 0; i < kind.coordinates; ++i) {
      if (!kind.coordinate[static_cast<std::size_t>(i)].is_angle) continue;
      for (GroupCoordinate& of : coordinates_)
        if (of.joint == j && of.law.coordinate == i) of.angle = static_cast<int>(angles_.size());
      angles_.add(j, joint.joint.kind, i, joint.a, joint.b);
    }
  }
  angles_.begin([&](std::size_t j) -> const JointState& {
    return states[static_cast<std::size_t>(list_[j].index)];
  });
}

void GroupJoints::integrate_angles(const GroupBodies& bodies) {
  angles_.integrate(
      bodies.time(), [&](std::size_t body) { return bodies.state(body).angular_velocity; },
      [&](const TurnedAngles::Angle& angle) -> Eigen::Vector3d {
        const JointVectors vectors(list_[angle.joint].joint, bodies.state(angle.a),
                                   bodies.state(angle.b));
        return (angle.is_about_b ? vectors.axes_B : vectors.axes_A).col(2);
      });
}

void GroupJoints::move_yielding_limits(const GroupBodies& bodies) {
  for (GroupCoordinate& of : coordinates_)
    if (of.state.yield != 0)
      of.given_way += read(bodies, of, nullptr).q - limit(bodies, of, of.state.yield > 0).value;
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

bool GroupJoints::is_moved_by_motors() const {
  return std::any_of(list_.begin(), list_.end(),
                     [](const GroupJoint& joint) { return joint.course.is_driven(); }) ||
         std::any_of(coordinates_.begin(), coordinates_.end(),
                     [](const GroupCoordinate& of) { return of.motor.is_moving(); });
}

// ---- coordinates

GroupJoints::Reading GroupJoints::read(const GroupBodies& bodies, const GroupCoordinate& of,
                                       const GroupMotions* rates) const {
  const GroupJoint& joint = list_[of.joint];
  const BodyState &a = bodies.state(joint.a), &b = bodies.state(joint.b);
  const JointVectors vectors(joint.joint, a, b);
  const JointMotion motion(vectors, a, b);
  Reading now;
  now.rate = rate(of.law.form, vectors, motion);
  const double turned =
      of.angle < 0 ? 0.0
                   : angles_.expected(static_cast<std::size_t>(of.angle), bodies.time(), now.rate);
  now.q = reading(of.law.form, value(of.law.form, vectors), of.law.zero, turned);
  now.J = jacobian(of.law.form, vectors);
  now.acceleration = gamma(of.law.form, vectors, motion);
  if (rates != nullptr)
    now.acceleration += now.J.times(rates->linear[joint.a], rates->angular[joint.a],
                                    rates->linear[joint.b], rates->angular[joint.b]);
  return now;
}

Prescribed GroupJoints::limit(const GroupBodies& bodies, const GroupCoordinate& of,
                              bool upper_one) const {
  if (!of.law.is_distance) return {of.law.limit(upper_one), 0.0, 0.0};
  const GroupJoint& joint = list_[of.joint];
  Prescribed at_limit = joint.course.length(bodies.clock());
  at_limit.value +=
      of.law.limit(upper_one) - joint.joint.distance.length.value_or(0.0) + of.given_way;
  return at_limit;
}

Prescribed GroupJoints::zeta(const GroupBodies& bodies, const GroupCoordinate& of) const {
  const double t = bodies.clock();
  if (of.law.is_distance) return list_[of.joint].course.length(t);
  if (of.law.drive == 0.0) return {};
  if (!of.law.goal) return motor_course(of.motor, motor_phase(of.motor, t), 0.0);
  if (of.braking == 0.0) return {*of.law.goal, 0.0, 0.0};
  const double q = read(bodies, of, nullptr).q;
  if (of.state.hold == Hold::kBrake)
    return rate_until(*of.law.goal, std::copysign(of.braking, q - *of.law.goal), of.until - t);
  return rate_to_goal(*of.law.goal, of.braking, q);
}

Prescribed GroupJoints::rest(const GroupBodies& bodies, const GroupCoordinate& of) const {
  return rest_of(of.law,
                 of.law.is_distance ? list_[of.joint].course.length(bodies.clock()) : Prescribed{});
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
    Prescribed at = joint.course.target(of.law.function, t);
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
  at.value = of.held + (of.law.is_distance ? at.value - joint.course.length(of.held_at).value
                                           : motor_travel(of.motor, of.held_at, t - of.held_at));
  return at;
}

// ---- rows

void GroupJoints::add_rows(const GroupBodies& bodies, ContactRows* rows) const {
  for (std::size_t j = 0; j < list_.size(); ++j) {
    const GroupJoint& joint = list_[j];
    if (!joint.has_rows) continue;
    const BodyState &a = bodies.state(joint.a), &b = bodies.state(joint.b);
    const JointVectors vectors(joint.joint, a, b);
    const JointMotion motion(vectors, a, b);
    const JointKindInfo& kind = info(joint.joint.kind);
    const bool is_distance = has_length(joint.joint.kind);
    for (int k = 0; k < kind.rows; ++k) {
      const ScalarForm form =
          is_distance ? ScalarForm(LengthForm{}) : kind.function[static_cast<std::size_t>(k)];
      const Prescribed target = is_distance ? joint.course.length(bodies.clock()) : Prescribed{};
      ContactRow& row = rows->add(bodies, joint.a, joint.b, jacobian(form, vectors));
      row.value = value(form, vectors) - target.value;
      row.rate = rate(form, vectors, motion) - target.rate;
      row.gamma = gamma(form, vectors, motion) - target.acceleration;
      row.joint = static_cast<int>(j);
      row.function = k;
    }
  }
  for (std::size_t c = 0; c < coordinates_.size(); ++c)
    if (coordinates_[c].is_prescribed) add_coordinate_row(bodies, c, rows);
}

void GroupJoints::add_coordinate_row(const GroupBodies& bodies, std::size_t c,
                                     ContactRows* rows) const {
  const GroupCoordinate& of = coordinates_[c];
  const Prescribed at = target(bodies, of);
  const Reading now = read(bodies, of, nullptr);
  ContactRow& row = rows->add(bodies, list_[of.joint].a, list_[of.joint].b, now.J);
  row.value = of.law.form.is_angle ? unwound(now.q - at.value, 0.0) : now.q - at.value;
  row.rate = now.rate - at.rate;
  row.gamma = now.acceleration - at.acceleration;
  row.joint = static_cast<int>(of.joint);
  row.function = of.law.function;
  row.coordinate = static_cast<int>(c);
  row.reference = of.reference;
}

void GroupJoints::add_held_rows(const GroupBodies& bodies, ContactRows* rows) const {
  for (std::size_t c = 0; c < coordinates_.size(); ++c)
    if (coordinates_[c].state.hold != Hold::kNone) add_coordinate_row(bodies, c, rows);
}

}  // namespace constraint_sim::engine
