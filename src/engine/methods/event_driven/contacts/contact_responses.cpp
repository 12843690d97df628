#include "engine/methods/event_driven/contacts/contact_responses.h"

#include <algorithm>

#include "engine/constraints/contact.h"
#include "engine/methods/event_driven/law_events.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;
using Vector = Eigen::Map<Vector3d>;
using ConstVector = Eigen::Map<const Vector3d>;

constexpr double kSameNormal = 1e-10;  // [rad]

}  // namespace

void ContactResponses::clear() {
  contacts_.clear();
  coordinates_.clear();
}

std::ptrdiff_t ContactResponses::find_twin(std::size_t contact, const ContactMotion& motion,
                                           double within, const ContactEquations& equations) const {
  const ContactEquations::Contact& of = equations.contacts()[contact];
  for (const TouchingContact& other : contacts_) {
    const ContactEquations::Contact& there = equations.contacts()[other.contact];
    if (of.a == there.a && of.b == there.b && of.shape_index_a == there.shape_index_a &&
        of.shape_index_b == there.shape_index_b &&
        (motion.p - other.motion.p).squaredNorm() <= within * within &&
        (motion.n - other.motion.n).squaredNorm() <= kSameNormal * kSameNormal)
      return static_cast<std::ptrdiff_t>(other.contact);
  }
  return -1;
}

// Numbers the columns, and adds a unit impulse for each column to directions_.
void ContactResponses::add_directions(const ContactEquations& equations) {
  const GroupBodies& bodies = equations.bodies();
  directions_.clear();
  for (const bool is_rough : {true, false}) {
    for (TouchingContact& touching : contacts_) {
      const ContactEquations::Contact& contact = equations.contacts()[touching.contact];
      if ((contact.friction > 0.0) != is_rough) continue;
      const Vector3d& n = touching.motion.n;
      touching.is_rough = is_rough;
      touching.column = directions_.list().size();
      touching.frame.col(0) = n;
      directions_.add(bodies, contact.a, contact.b, touching.motion.along(n));
      if (!is_rough) continue;
      touching.frame.col(1) = tangent_to(n);
      touching.frame.col(2) = n.cross(Vector3d(touching.frame.col(1)));
      for (int k = 1; k < 3; ++k)
        directions_.add(bodies, contact.a, contact.b, touching.motion.along(touching.frame.col(k)));
    }
  }
  of_contacts_ = directions_.list().size();
  const GroupJoints& joints = equations.joints();
  for (const std::size_t c : coordinates_) {
    const GroupCoordinate& of = joints.coordinates()[c];
    joints.add_row(bodies, of, joints.read(bodies, of, nullptr), &directions_);
  }
  columns_ = directions_.list().size();
}

void ContactResponses::find(const ContactEquations& equations) {
  const GroupBodies& bodies = equations.bodies();
  const std::size_t movable = bodies.movable();
  add_directions(equations);
  held_.clear();
  equations.joints().add_rows(bodies, &held_);
  const List<ContactRow>& directions = directions_.list();
  const std::size_t n = columns_, held = held_.list().size();
  for (ContactRow& row : held_.list()) row.reference = 0.0;
  if (held > 0) held_.factor(bodies, true);
  is_free_.clear();
  velocity_.resize(6 * movable * n);
  joints_.resize(held * n);
  A_.resize(n * n);
  for (std::size_t j = 0; j < n; ++j) {
    motions_.set_zero(movable);
    directions[j].push(1.0, movable, &motions_);
    const double free = directions[j].times(motions_, movable);
    if (held > 0) {
      lambda_.resize(held);
      for (std::size_t i = 0; i < held; ++i) lambda_[i] = -held_.list()[i].times(motions_, movable);
      held_.solve(movable, &lambda_);
      for (std::size_t i = 0; i < held; ++i) held_.list()[i].push(lambda_[i], movable, &motions_);
      std::copy(lambda_.begin(), lambda_.end(),
                joints_.begin() + static_cast<std::ptrdiff_t>(held * j));
    }
    double* const velocity = velocity_.data() + 6 * movable * j;
    for (std::size_t i = 0; i < movable; ++i) {
      Vector(velocity + 6 * i) = motions_.linear[i];
      Vector(velocity + 6 * i + 3) = motions_.angular[i];
    }
    for (std::size_t i = 0; i < n; ++i) A_[n * j + i] = directions[i].times(motions_, movable);
    is_free_.push_back(A_[n * j + j] > kHeld * free ? 1 : 0);
  }
  for (std::size_t j = 0; j < n; ++j)
    for (std::size_t i = 0; i < j; ++i)
      A_[n * j + i] = A_[n * i + j] = 0.5 * (A_[n * j + i] + A_[n * i + j]);
  for (std::size_t j = 0; j < of_contacts_; ++j)
    for (std::size_t i = 0; i < n && is_held(j); ++i) A_[n * j + i] = A_[n * i + j] = 0.0;
}

void ContactResponses::refer_joints(const double* p, GroupJoints* joints) const {
  const std::size_t held = held_.list().size();
  for (std::size_t i = 0; i < held; ++i) {
    const ContactRow& row = held_.list()[i];
    double force = 0.0;
    for (std::size_t j = 0; j < columns_; ++j) force += p[j] * joints_[held * j + i];
    (row.coordinate >= 0 ? joints->coordinates()[to_index(row.coordinate)].reference
                         : joints->list()[to_index(row.joint)].reference.at(row.function)) += force;
  }
}

void ContactResponses::displace(const double* p, ContactEquations* equations, double* y) const {
  GroupBodies& bodies = equations->bodies();
  for (std::size_t i = 0; i < bodies.movable(); ++i) {
    Vector3d moved = Vector3d::Zero(), turned = Vector3d::Zero();
    for (std::size_t j = 0; j < columns_; ++j) {
      const double* const velocity = velocity_.data() + 6 * (bodies.movable() * j + i);
      moved += p[j] * ConstVector(velocity);
      turned += p[j] * ConstVector(velocity + 3);
    }
    GroupBodies::displace(i, moved, turned, y);
  }
  bodies.place(y);
}

void ContactResponses::apply(const double* p, ContactEquations* equations, double* y) {
  GroupBodies& bodies = equations->bodies();
  List<GroupJoint>& joints = equations->joints().list();
  const List<ContactRow>&rows = held_.list(), &directions = directions_.list();
  const std::size_t movable = bodies.movable(), held = columns_ > 0 ? joints_.size() / columns_ : 0;
  const auto add = [&](std::size_t joint, int function, double impulse) {
    joints[joint].impulse.at(function) += impulse;
    joints[joint].impact.at(function) += impulse;
  };
  GroupMotions& change = motions_;
  change.set_zero(movable);
  for (std::size_t j = 0; j < columns_; ++j) {
    const double* const velocity = velocity_.data() + 6 * movable * j;
    for (std::size_t i = 0; i < movable; ++i) {
      change.linear[i] += p[j] * ConstVector(velocity + 6 * i);
      change.angular[i] += p[j] * ConstVector(velocity + 6 * i + 3);
    }
    for (std::size_t i = 0; i < held; ++i)
      add(to_index(rows[i].joint), rows[i].function, p[j] * joints_[held * j + i]);
    if (!bodies.has_movers()) continue;
    equations->add_driven_work(p[j] * directions[j].driven_power(bodies));
    for (std::size_t i = 0; i < held; ++i)
      equations->add_driven_work(p[j] * joints_[held * j + i] * rows[i].driven_power(bodies));
  }
  bodies.add_velocities(change, y);
  for (std::size_t k = 0; k < coordinates_.size(); ++k) {
    const GroupCoordinate& of = equations->joints().coordinates()[coordinates_[k]];
    add(of.joint, function_of(of.law), p[of_contacts_ + k]);
  }
  for (const TouchingContact& touching : contacts_) {
    ContactEquations::Contact& contact = equations->contacts()[touching.contact];
    contact.impulse += touching.frame * touching.of(p);
    contact.touched = contact.feature;
  }
  bodies.place(y);
}

}  // namespace constraint_sim::engine
