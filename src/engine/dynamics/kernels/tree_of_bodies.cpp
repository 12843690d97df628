#include "engine/dynamics/kernels/tree_of_bodies.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/math/larger.h"
#include "engine/math/list.h"
#include "engine/math/quaternion_state.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

}  // namespace

TreeOfBodies::TreeOfBodies(EquationsOfMotion& equations)
    : EquationsKernel(equations),
      view_(equations.kernel_view()),
      tree_(*view_.tree),
      nodes_(tree_.nodes),
      bodies_(equations.bodies().size()),
      first_general_(equations.first().general) {}

// ---- kinematics

[[gnu::flatten]] void TreeOfBodies::place(double t, const double* y) {
  *view_.placed_at = t;
  for (std::size_t i = 0; i < bodies_; ++i) {
    view_.position[i] = Vector3d::Map(y + 3 * i);
    view_.orientation[i] = rotation_matrix(y + view_.q_at + 4 * i);
  }
  for (TreeNode& node : nodes_)
    if (node.link != TreeNode::kNone) place_joint(&node);
}

void TreeOfBodies::place_joint(TreeNode* node) {
  const auto& link = equations_.links()[node->link];
  const auto arm = [&](std::size_t point, const Vector3d& anchor) -> Vector3d {
    return turns(point) ? Vector3d(view_.orientation[point] * anchor) : Vector3d(Vector3d::Zero());
  };
  const Vector3d r_A = arm(link.a, link.anchor_a), r_B = arm(link.b, link.anchor_b);
  const Vector3d d = view_.position[link.b] + r_B - view_.position[link.a] - r_A;
  node->to_a = r_A + d;
  node->to_b = r_B;
  node->to_child = node->sense > 0.0 ? node->to_b : node->to_a;
  node->to_parent = node->sense > 0.0 ? node->to_a : node->to_b;
  if (equations_.is_ball(node->link)) {
    view_.separation[node->link] = d;
    return;
  }
  JointVectors& vectors = vectors_of(*node);
  vectors.r_A = r_A;
  vectors.r_B = r_B;
  vectors.d = d;
  const auto axes = [&](std::size_t point, const Matrix3d& frame) -> Matrix3d {
    return turns(point) ? view_.orientation[point] * frame
                        : equations_.inputs().fixed_axes(point) * frame;
  };
  vectors.axes_A = axes(link.a, link.frame_a);
  if (forms(link.kind).alignment != Alignment::kFree) vectors.axes_B = axes(link.b, link.frame_b);
}

void TreeOfBodies::place_directions(TreeNode* node) const {
  for (std::size_t k = 0; k < node->count; ++k) {
    Direction& direction = node->directions[k];
    if (direction.axis > 3) {
      direction.along = Vector3d::Unit(direction.axis - 4);
      continue;
    }
    const JointVectors& vectors = vectors_of(*node);
    direction.along =
        direction.axis < 3 ? vectors.axes_A.col(direction.axis) : vectors.axes_B.col(2);
  }
}

// ---- inertias from the leaves to the root

namespace {

SpatialVector along(const TreeNode::Direction& direction) {
  return direction.turns ? SpatialVector{Vector3d::Zero(), direction.along}
                         : SpatialVector{direction.along, Vector3d::Zero()};
}

/// Vector that d is multiplied with in a row.
VectorRef across(const RowForm& form) {
  return form.u.kind == VectorKind::kSeparation ? form.v : form.u;
}

void ask_nothing(TreeNode* node) {
  node->demanded = {};
  for (TreeNode::Direction& direction : node->directions) direction.force = 0.0;
}

double component(const TreeNode::Direction& direction, const SpatialVector& of) {
  return direction.along.dot(direction.turns ? of.angular : of.linear);
}

}  // namespace

// Factors the inertias at the current pose. Returns false where a pivot is lost in rounding.
[[gnu::flatten]] bool TreeOfBodies::factor() {
  List<SpatialInertia>& inertias = tree_.inertias;
  for (std::size_t i = 0; i < inertias.size(); ++i) {
    SpatialInertia& own = inertias[i];
    own.mass = Matrix3d::Identity() / view_.inverse_mass[i];
    own.mixed.setZero();
    const Matrix3d& R = view_.orientation[i];
    own.angular.noalias() = R * equations_.inertia(i).asDiagonal() * R.transpose();
  }
  for (TreeNode& node : nodes_) {
    place_directions(&node);
    SpatialInertia& I = inertias[node.body];
    I.shift(node.to_child);
    node.whole = I;
    for (std::size_t k = 0; k < node.count; ++k) {
      Direction& direction = node.directions[k];
      if (direction.row != TreeNode::kNone) continue;
      const SpatialVector s = along(direction);
      direction.u = I * s;
      direction.pivot = component(direction, direction.u);
      if (!(direction.pivot > 0.0)) return false;
      I.eliminate(direction.u, direction.pivot);
    }
    if (node.parent >= inertias.size()) continue;
    I.shift(-node.to_parent);
    SpatialInertia& sum = inertias[node.parent];
    sum.mass += I.mass;
    sum.mixed += I.mixed;
    sum.angular += I.angular;
  }
  return true;
}

// Reduces forces from the leaves to the root. In: forces on each body, `demanded` motion of each
// child relative to its parent, and `force` along free directions.
void TreeOfBodies::reduce() {
  List<SpatialVector>& forces = tree_.forces;
  for (TreeNode& node : nodes_) {
    SpatialVector p = forces[node.body];
    p.angular -= node.to_child.cross(p.linear);
    p = p + node.whole * node.demanded;
    for (std::size_t k = 0; k < node.count; ++k) {
      Direction& direction = node.directions[k];
      if (direction.row != TreeNode::kNone) continue;
      direction.force -= component(direction, p);
      p = p + direction.u * (direction.force / direction.pivot);
    }
    if (node.parent >= forces.size()) continue;
    p.angular += node.to_parent.cross(p.linear);
    forces[node.parent] = forces[node.parent] + p;
  }
}

// Computes motions from the root to the leaves. Calls `act` with each node and the motion of its
// body; leaves in tree_.forces the force that causes the motion.
template <class Act>
void TreeOfBodies::substitute(const Act& act) {
  List<SpatialVector>& motions = tree_.motions;
  for (std::size_t i = nodes_.size(); i-- > 0;) {
    const TreeNode& node = nodes_[i];
    SpatialVector a;
    if (node.parent < motions.size()) {
      a = motions[node.parent];
      a.linear += a.angular.cross(node.to_parent);
    }
    for (std::size_t k = node.count; k-- > 0;) {
      const Direction& direction = node.directions[k];
      if (direction.row != TreeNode::kNone) continue;
      const double q = (direction.force - direction.u.dot(a)) / direction.pivot;
      (direction.turns ? a.angular : a.linear) += q * direction.along;
    }
    a = a + node.demanded;
    a.linear -= a.angular.cross(node.to_child);
    motions[node.body] = a;
    act(node.body, a);
  }
}

// Computes row forces of all joints from tree_.forces, which hold the force that moves each body.
void TreeOfBodies::find_forces(double* by_unknown) {
  List<SpatialVector>& forces = tree_.forces;
  for (const TreeNode& node : nodes_) {
    SpatialVector force = forces[node.body];
    force.angular -= node.to_child.cross(force.linear);
    write_forces(node, force, by_unknown);
    if (node.parent >= forces.size()) continue;
    force.angular += node.to_parent.cross(force.linear);
    forces[node.parent] = forces[node.parent] + force;
  }
}

// ---- System

void TreeOfBodies::derivative(std::size_t stage, double t, const double* y, double* dydt) {
  if (equations_.inputs().is_time_dependent()) equations_.move_with_time(t);
  if (!is_lost_) {
    place(t, y);
    is_lost_ = !factor();
  }
  if (is_lost_) return equations_.derivative(stage, t, y, dydt);
  accelerate(stage, y, dydt);
}

void TreeOfBodies::find_spins(const double* y) {
  for (std::size_t i = 0; i < bodies_; ++i) {
    view_.velocity[i] = Vector3d::Map(y + view_.v_at + 3 * i);
    const Matrix3d& R = view_.orientation[i];
    const Vector3d in_body = R.transpose() * Vector3d::Map(y + view_.L_at + 3 * i);
    view_.angular_velocity[i].noalias() = R * in_body.cwiseQuotient(equations_.inertia(i));
  }
}

Vector3d TreeOfBodies::spin(std::size_t point) const {
  return turns(point) ? view_.angular_velocity[point]
                      : equations_.inputs().fixed_angular_velocity(point);
}

// Velocity of B relative to A at the joint's place on B.
SpatialVector TreeOfBodies::relative_velocity(const TreeNode& node) const {
  const auto& link = equations_.links()[node.link];
  const Vector3d w_A = spin(link.a), w_B = spin(link.b);
  return {
      view_.velocity[link.b] + w_B.cross(node.to_b) - view_.velocity[link.a] - w_A.cross(node.to_a),
      w_B - w_A};
}

// Motion of B relative to A demanded by rows that hold a coordinate.
SpatialVector TreeOfBodies::held(const TreeNode& node, const double* of_rows) const {
  SpatialVector sum;
  if (equations_.inputs().motions().empty()) return sum;
  for (std::size_t k = 0; k < node.count; ++k) {
    const Direction& direction = node.directions[k];
    if (direction.row == TreeNode::kNone) continue;
    (direction.turns ? sum.angular : sum.linear) += of_rows[direction.row] * direction.along;
  }
  return sum;
}

// Acceleration of B relative to A at the joint with zero accelerations of A, B and the coordinates.
SpatialVector TreeOfBodies::bias_of(const TreeNode& node, const SpatialVector& relative) const {
  const auto& link = equations_.links()[node.link];
  const Vector3d w_A = spin(link.a), w_B = spin(link.b);
  const auto centripetal = [&](std::size_t point, const Vector3d& w, const Vector3d& arm) {
    Vector3d a = w.cross(w.cross(arm));
    if (!turns(point)) a += view_.applied_acceleration[point];
    return a;
  };
  SpatialVector bias;
  bias.linear = centripetal(link.a, w_A, node.to_a) - centripetal(link.b, w_B, node.to_b);
  const JointForms& kind = forms(link.kind);
  if (kind.separation_rows < 3) bias.linear += 2.0 * w_A.cross(relative.linear);
  if (kind.alignment == Alignment::kParallelZ) {
    bias.angular = w_A.cross(relative.angular);
  } else if (kind.alignment == Alignment::kPerpendicularZ) {
    const Vector3d &z_A = node.directions[0].along, &z_B = node.directions[1].along;
    bias.angular =
        relative.angular.dot(z_A) * w_A.cross(z_A) + relative.angular.dot(z_B) * w_B.cross(z_B);
  }
  return bias;
}

// Evaluates springs, dampers and forces along the coordinates of a joint.
void TreeOfBodies::pull(TreeNode* node, const SpatialVector& relative, double* forces) const {
  for (std::size_t k = 0; k < node->count; ++k) {
    Direction& direction = node->directions[k];
    if (direction.soft == TreeNode::kNone) continue;
    const double rate = component(direction, relative);
    const double position =
        view_.coordinates->soft_at(equations_, equations_.kinematics(), direction.soft, rate);
    const double force = forces[equations_.forces().of_soft(equations_, direction.soft)] =
        equations_.soft_coordinates()[direction.soft].law.force(position, rate);
    direction.force = node->sense * force;
  }
}

[[gnu::flatten]] void TreeOfBodies::accelerate(std::size_t stage, const double* y, double* dydt) {
  find_spins(y);
  double* const forces = view_.stage_forces + stage * view_.unknowns;
  for (std::size_t i = 0; i < bodies_; ++i)
    tree_.forces[i] = {-view_.applied_acceleration[i] / view_.inverse_mass[i],
                       view_.angular_velocity[i].cross(Vector3d::Map(y + view_.L_at + 3 * i)) -
                           view_.applied_torque[i]};
  for (TreeNode& node : nodes_) {
    ask_nothing(&node);
    if (node.link == TreeNode::kNone) continue;
    const SpatialVector relative = relative_velocity(node);
    node.demanded = (bias_of(node, relative) + held(node, view_.acceleration_target)) * node.sense;
    pull(&node, relative, forces);
  }
  reduce();
  substitute([&](std::size_t i, const SpatialVector& a) {
    Vector3d::Map(dydt + 3 * i) = view_.velocity[i];
    Vector3d::Map(dydt + view_.v_at + 3 * i) = a.linear;
    write_quaternion_rate(view_.angular_velocity[i], y + view_.q_at + 4 * i,
                          dydt + view_.q_at + 4 * i);
    const Vector3d L_dot = inertia_times(i, a.angular) +
                           view_.angular_velocity[i].cross(Vector3d::Map(y + view_.L_at + 3 * i));
    Vector3d::Map(dydt + view_.L_at + 3 * i) = L_dot;
    tree_.forces[i] = {(a.linear - view_.applied_acceleration[i]) / view_.inverse_mass[i],
                       L_dot - view_.applied_torque[i]};
  });
  find_forces(forces);
}

Vector3d TreeOfBodies::inertia_times(std::size_t body, const Vector3d& w) const {
  const Matrix3d& R = view_.orientation[body];
  return R * equations_.inertia(body).cwiseProduct(Vector3d(R.transpose() * w));
}

// Notes positions and rates of coordinates, as CoordinatePositions::note() does.
void TreeOfBodies::note_positions() {
  for (const TreeNode& node : nodes_) {
    for (std::size_t k = 0; k < node.count; ++k) {
      if (node.directions[k].soft == TreeNode::kNone) continue;
      const std::size_t soft = node.directions[k].soft;
      const double rate = component(node.directions[k], relative_velocity(node));
      view_.coordinates->note_soft(
          soft, view_.coordinates->soft_at(equations_, equations_.kinematics(), soft, rate), rate);
    }
  }
  view_.coordinates->note_angles(
      *view_.placed_at, [this](std::size_t point) { return spin(point); },
      [this](const TurnedAngles::Angle& angle) {
        const JointVectors& vectors = view_.vectors[angle.joint - first_general_];
        return (angle.is_about_b ? vectors.axes_B : vectors.axes_A).col(2);
      });
}

// Writes the row forces of a joint, from its force and torque on the child.
void TreeOfBodies::write_forces(const TreeNode& node, const SpatialVector& on_child,
                                double* by_unknown) const {
  if (node.link == TreeNode::kNone) return;
  const SpatialVector on_b = on_child * node.sense;
  const std::size_t first = equations_.row_of(node.link);
  const auto write = [&](std::size_t row, double force) { by_unknown[view_.unknown[row]] = force; };
  if (equations_.is_ball(node.link)) {
    for (std::size_t k = 0; k < 3; ++k) write(first + k, on_b.linear[static_cast<Eigen::Index>(k)]);
    return;
  }
  const JointVectors& vectors = vectors_of(node);
  const JointForms& kind = forms(equations_.links()[node.link].kind);
  for (std::size_t k = 0; k < to_index(kind.rows); ++k) {
    const RowForm& form = kind.row[k];
    if (!form.has_separation()) {
      write(first + k, on_b.angular.dot(vectors[form.v].cross(vectors[form.u])));
      continue;
    }
    write(first + k, on_b.linear.dot(vectors[across(form)]));
  }
  for (std::size_t k = 0; k < node.count; ++k)
    if (node.directions[k].row != TreeNode::kNone)
      write(node.directions[k].row, component(node.directions[k], on_b));
}

// Projects velocities onto the joints by the least impulses.
bool TreeOfBodies::restart(double* y, double* dydt) {
  // The projection may have ended with the rows, after a stage in which a pivot was lost.
  place(*view_.placed_at, y);
  is_lost_ = !factor();
  if (is_lost_) return equations_.restart(y, dydt);
  find_spins(y);
  std::fill(tree_.forces.begin(), tree_.forces.end(), SpatialVector{});
  for (TreeNode& node : nodes_) {
    ask_nothing(&node);
    if (node.link != TreeNode::kNone)
      node.demanded = (held(node, view_.rate_target) - relative_velocity(node)) * node.sense;
  }
  reduce();
  double* const solution = view_.solution;
  substitute([&](std::size_t i, const SpatialVector& change) {
    const Vector3d twist = inertia_times(i, change.angular);
    Vector3d::Map(y + view_.v_at + 3 * i) += change.linear;
    Vector3d::Map(y + view_.L_at + 3 * i) += twist;
    tree_.forces[i] = {change.linear / view_.inverse_mass[i], twist};
  });
  find_forces(solution);
  for (std::size_t i = 0; i < equations_.rows(); ++i) view_.impulses[i] += solution[i];
  accelerate(0, y, dydt);
  if (!view_.coordinates->empty()) note_positions();
  return true;
}

// ---- positions

bool TreeOfBodies::project(double t, double* y) {
  if (is_lost_) return equations_.project(t, y);
  return equations_.project_by(
      t, y, [&] { return find_values(t, y); }, [&] { correct(y); });
}

// Evaluates all positions. Returns the largest error of a row [m].
double TreeOfBodies::find_values(double t, double* y) {
  if (!normalize_quaternions(y + view_.q_at, bodies_))
    return std::numeric_limits<double>::quiet_NaN();
  place(t, y);
  double worst = 0.0;
  const auto consider = [&](double error) { worst = larger(worst, error); };
  for (std::size_t l = 0; l < first_general_; ++l)
    consider(view_.separation[l].cwiseAbs().maxCoeff());
  for (const auto& row : equations_.general_rows())
    consider(row.metres * std::abs(equations_.kinematics().value_of(equations_.inputs(), row)));
  return worst;
}

// Displacement of B relative to A that meets the rows; free directions are zero.
SpatialVector TreeOfBodies::opening(const TreeNode& node) const {
  if (equations_.is_ball(node.link)) return {-view_.separation[node.link], Vector3d::Zero()};
  const JointVectors& vectors = vectors_of(node);
  const Vector3d z_A = vectors.axes_A.col(2), z_B = vectors.axes_B.col(2);
  const JointForms& kind = forms(equations_.links()[node.link].kind);
  SpatialVector by;
  for (std::size_t k = 0; k < to_index(kind.separation_rows); ++k) {
    const Vector3d u = vectors[across(kind.row[k])];
    by.linear -= u.dot(vectors.d) * u;
  }
  switch (kind.alignment) {
    case Alignment::kFree:
      break;
    case Alignment::kSame:
      for (int k = 0; k < 3; ++k)
        by.angular += 0.5 * vectors.axes_B.col(k).cross(vectors.axes_A.col(k));
      break;
    case Alignment::kParallelZ:
      by.angular = z_B.cross(z_A);
      break;
    case Alignment::kPerpendicularZ: {
      const Vector3d n = z_B.cross(z_A);
      by.angular = -z_A.dot(z_B) / n.squaredNorm() * n;
      break;
    }
  }
  for (std::size_t k = 0; k < node.count; ++k) {
    const Direction& direction = node.directions[k];
    if (direction.row == TreeNode::kNone) continue;
    const double off = equations_.kinematics().value_of(
        equations_.inputs(),
        equations_.general_rows()[direction.row - equations_.first_general_row()]);
    (direction.turns ? by.angular : by.linear) -= off * direction.along;
  }
  return by;
}

// Makes a Newton step with the inertias of the last factor().
void TreeOfBodies::correct(double* y) {
  std::fill(tree_.forces.begin(), tree_.forces.end(), SpatialVector{});
  for (TreeNode& node : nodes_) {
    ask_nothing(&node);
    if (node.link != TreeNode::kNone) node.demanded = opening(node) * node.sense;
  }
  reduce();
  substitute([&](std::size_t i, const SpatialVector& change) {
    Vector3d::Map(y + 3 * i) += change.linear;
    double* const q = y + view_.q_at + 4 * i;
    double rate[4];
    write_quaternion_rate(change.angular, q, rate);
    for (std::size_t k = 0; k < 4; ++k) q[k] += rate[k];
  });
}

}  // namespace constraint_sim::engine
