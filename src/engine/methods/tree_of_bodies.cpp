#include "engine/methods/tree_of_bodies.h"

#include <algorithm>
#include <cmath>

#include "engine/methods/quaternion_state.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

std::size_t at(int i) { return static_cast<std::size_t>(i); }

double dot(const SpatialVector& a, const SpatialVector& b) {
  return a.linear.dot(b.linear) + a.angular.dot(b.angular);
}

}  // namespace

// with [r] x = r × x: M [r], which is added to H, and Hᵀ [r] − [r] (H + M [r]), which is to J
void SpatialInertia::shift(const Vector3d& by) {
  angular += mixed.transpose().rowwise().cross(by.transpose());
  mixed += mass.rowwise().cross(by.transpose());
  angular += mixed.colwise().cross(by);
}

void SpatialInertia::eliminate(const SpatialVector& u, double d) {
  const Vector3d linear = u.linear / d, turning = u.angular / d;
  mass -= u.linear * linear.transpose();
  mixed -= u.linear * turning.transpose();
  angular -= u.angular * turning.transpose();
}

// ---- what is compiled

namespace {

/// Of B against A along what the kind leaves free, with the coordinates first.
std::size_t directions_of(const JointKindInfo& kind, std::array<TreeNode::Direction, 6>* to) {
  std::size_t count = 0;
  const auto add = [&](bool turns, int axis) {
    (*to)[count].turns = turns;
    (*to)[count++].axis = static_cast<std::uint8_t>(axis);
  };
  bool has_turned = false;
  for (int i = 0; i < kind.coordinates; ++i) {
    const ScalarForm& form = kind.coordinate[at(i)];
    if (form.is_angle)
      add(true, has_turned ? 3 : 2);
    else
      add(false, form.product.u.axis);
    has_turned = has_turned || form.is_angle;
  }
  if (kind.alignment == Alignment::kFree)
    for (int k = 0; k < 3; ++k) add(true, 4 + k);
  return count;
}

std::size_t free_directions(const std::vector<TreeNode>& tree) {
  std::size_t count = 0;
  for (const TreeNode& node : tree)
    for (std::size_t k = 0; k < node.count; ++k)
      count += node.directions[k].row == TreeNode::kNone ? 1 : 0;
  return count;
}

}  // namespace

// Bodies and joints from the leaves on; nothing where they are no tree, or have what a tree cannot.
void EquationsOfMotion::find_tree() {
  const std::size_t bodies = bodies_.size();
  if (bodies == 0 || turning_ != bodies || first_ball_ > 0 || first_spring_ < links_.size() ||
      !coupled_.empty())
    return;
  const auto is_fixed = [&](std::size_t point) { return point >= bodies; };
  const auto holds_on =
      static_cast<std::size_t>(std::count_if(links_.begin(), links_.end(), [&](const Link& link) {
        return is_fixed(link.a) || is_fixed(link.b);
      }));
  if (holds_on > 1 || links_.size() + 1 != bodies + holds_on) return;
  for (const Link& link : links_)
    if (info(link.kind).form == RowsForm::kDistance || info(link.kind).function[0].is_length ||
        couples(link.kind))
      return;

  std::vector<char> is_placed(bodies, 0), is_used(links_.size(), 0);
  const auto place = [&](const TreeNode& node) {
    is_placed[node.body] = 1;
    tree_.push_back(node);
  };
  const auto hang = [&](std::size_t l, bool is_b) {
    const Link& link = links_[l];
    TreeNode node;
    node.link = l;
    node.body = is_b ? link.b : link.a;
    node.parent = is_b ? link.a : link.b;
    node.sense = is_b ? 1.0 : -1.0;
    node.count = directions_of(info(link.kind), &node.directions);
    const int rows = info(link.kind).rows;
    for (int k = rows; k < link.rows; ++k)
      node.directions[link.function[at(k)] - at(rows)].row = first_row(l) + at(k);
    for (std::size_t s = link.first_soft; s < link.first_soft + link.softs; ++s)
      node.directions[at(softs_[s].function - rows)].soft = s;
    is_used[l] = 1;
    place(node);
  };
  const auto is_there = [&](std::size_t point) { return is_fixed(point) || is_placed[point] != 0; };
  if (holds_on == 0) {  // in free space the first body is the root
    TreeNode root;
    for (std::size_t k = 0; k < 6; ++k) {
      root.directions[k].turns = k >= 3;
      root.directions[k].axis = static_cast<std::uint8_t>(4 + k % 3);
    }
    root.count = 6;
    place(root);
  }
  for (bool has_grown = true; has_grown;) {
    has_grown = false;
    for (std::size_t l = 0; l < links_.size(); ++l) {
      if (is_used[l] != 0 || is_there(links_[l].a) == is_there(links_[l].b)) continue;
      hang(l, is_there(links_[l].a));
      has_grown = true;
    }
  }
  // parts that are not joined, or more that is free than what rows hold
  if (tree_.size() != bodies || free_directions(tree_) >= rows_.size()) tree_.clear();
  std::reverse(tree_.begin(), tree_.end());
  tree_inertias_.resize(tree_.size());
  tree_forces_.resize(tree_.size());
  tree_motions_.resize(tree_.size());
}

bool EquationsOfMotion::is_tree() const {
  return !tree_.empty() && std::none_of(frames_.begin(), frames_.end(),
                                        [](const MovingFrame& frame) { return frame.moves; });
}

TreeOfBodies::TreeOfBodies(EquationsOfMotion& equations)
    : equations_(equations), nodes_(equations.tree_) {}

// ---- where all is

[[gnu::flatten]] void TreeOfBodies::place(double t, const double* y) {
  EquationsOfMotion& e = equations_;
  e.placed_at_ = t;
  for (std::size_t i = 0; i < e.turning_; ++i) {
    e.position_[i] = Vector3d::Map(y + 3 * i);
    e.orientation_[i] = rotation_matrix(y + e.q_at_ + 4 * i);
  }
  for (TreeNode& node : nodes_)
    if (node.link != TreeNode::kNone) place_joint(&node);
}

void TreeOfBodies::place_joint(TreeNode* node) {
  EquationsOfMotion& e = equations_;
  const auto& link = e.links_[node->link];
  const auto arm = [&](std::size_t point, const Vector3d& anchor) -> Vector3d {
    return e.turns(point) ? Vector3d(e.orientation_[point] * anchor) : Vector3d(Vector3d::Zero());
  };
  const Vector3d r_A = arm(link.a, link.anchor_a), r_B = arm(link.b, link.anchor_b);
  const Vector3d d = e.position_[link.b] + r_B - e.position_[link.a] - r_A;
  node->to_a = r_A + d;
  node->to_b = r_B;
  node->to_child = node->sense > 0.0 ? node->to_b : node->to_a;
  node->to_parent = node->sense > 0.0 ? node->to_a : node->to_b;
  if (e.is_ball(node->link)) {
    e.d_[node->link] = d;
    return;
  }
  JointVectors& vectors = e.vectors_[node->link - e.first_general_];
  vectors.r_A = r_A;
  vectors.r_B = r_B;
  vectors.d = d;
  const auto axes = [&](std::size_t point, const Matrix3d& frame) -> Matrix3d {
    return e.turns(point) ? e.orientation_[point] * frame : e.fixed_axes(point) * frame;
  };
  vectors.axes_A = axes(link.a, link.frame_a);
  if (info(link.kind).alignment != Alignment::kFree) vectors.axes_B = axes(link.b, link.frame_b);
}

void TreeOfBodies::place_directions(TreeNode* node) const {
  for (std::size_t k = 0; k < node->count; ++k) {
    Direction& direction = node->directions[k];
    if (direction.axis > 3) {
      direction.along = Vector3d::Unit(direction.axis - 4);
      continue;
    }
    const JointVectors& vectors = equations_.vectors_[node->link - equations_.first_general_];
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

/// What d is multiplied with in a row.
VectorRef across(const RowForm& form) {
  return form.u.kind == VectorKind::kSeparation ? form.v : form.u;
}

void ask_nothing(TreeNode* node) {
  node->asked = {};
  for (TreeNode::Direction& direction : node->directions) direction.force = 0.0;
}

double component(const TreeNode::Direction& direction, const SpatialVector& of) {
  return direction.along.dot(direction.turns ? of.angular : of.linear);
}

}  // namespace

// Of the poses that are placed. False where a pivot is lost in rounding: a body that is far lighter
// than what it holds.
[[gnu::flatten]] bool TreeOfBodies::factor() {
  std::vector<SpatialInertia>& inertias = equations_.tree_inertias_;
  for (std::size_t i = 0; i < inertias.size(); ++i) {
    SpatialInertia& own = inertias[i];
    own.mass = Matrix3d::Identity() / equations_.inverse_mass_[i];
    own.mixed.setZero();
    const Matrix3d& R = equations_.orientation_[i];
    own.angular.noalias() = R * equations_.inertia_[i].asDiagonal() * R.transpose();
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

// Forces at rest from the leaves to the root: in tree_forces_ what each body asks for by itself, in
// `asked` how a child is to move against its parent, in `force` what acts along free directions.
void TreeOfBodies::reduce() {
  std::vector<SpatialVector>& forces = equations_.tree_forces_;
  for (TreeNode& node : nodes_) {
    SpatialVector p = forces[node.body];
    p.angular -= node.to_child.cross(p.linear);
    p = p + node.whole * node.asked;
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

// Motions from the root to the leaves: `act` takes each node and how its body moves, and leaves in
// tree_forces_ what makes it do so.
template <class Act>
void TreeOfBodies::substitute(const Act& act) {
  std::vector<SpatialVector>& motions = equations_.tree_motions_;
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
      const double q = (direction.force - dot(direction.u, a)) / direction.pivot;
      (direction.turns ? a.angular : a.linear) += q * direction.along;
    }
    a = a + node.asked;
    a.linear -= a.angular.cross(node.to_child);
    motions[node.body] = a;
    act(node.body, a);
  }
}

// From what makes each body move, in tree_forces_, what each joint does to its child; by rows.
void TreeOfBodies::find_forces(double* by_unknown) {
  std::vector<SpatialVector>& forces = equations_.tree_forces_;
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
  if (equations_.varies()) equations_.move_with_time(t);
  if (!is_lost_) {
    place(t, y);
    is_lost_ = !factor();
  }
  if (is_lost_) return equations_.derivative(stage, t, y, dydt);
  accelerate(stage, y, dydt);
}

void TreeOfBodies::find_spins(const double* y) {
  const EquationsOfMotion& e = equations_;
  for (std::size_t i = 0; i < e.turning_; ++i) {
    equations_.velocity_[i] = Vector3d::Map(y + e.v_at_ + 3 * i);
    const Matrix3d& R = e.orientation_[i];
    const Vector3d in_body = R.transpose() * Vector3d::Map(y + e.L_at_ + 3 * i);
    equations_.spin_[i].noalias() = R * in_body.cwiseQuotient(e.inertia_[i]);
  }
}

Vector3d TreeOfBodies::spin(std::size_t point) const {
  const EquationsOfMotion& e = equations_;
  return e.turns(point) ? e.spin_[point]
                        : e.fixed_points_[point - e.bodies_.size()].start.angular_velocity;
}

// of B against A at the joint's place on B
SpatialVector TreeOfBodies::relative_velocity(const TreeNode& node) const {
  const EquationsOfMotion& e = equations_;
  const auto& link = e.links_[node.link];
  const Vector3d w_A = spin(link.a), w_B = spin(link.b);
  return {e.velocity_[link.b] + w_B.cross(node.to_b) - e.velocity_[link.a] - w_A.cross(node.to_a),
          w_B - w_A};
}

// what rows that hold a coordinate, or a ball joint that closes, ask of B against A
SpatialVector TreeOfBodies::held(const TreeNode& node, const std::vector<double>& of_rows) const {
  const EquationsOfMotion& e = equations_;
  SpatialVector sum;
  if (e.courses_.empty()) return sum;
  if (e.is_ball(node.link)) sum.linear = Vector3d::Map(of_rows.data() + e.first_row(node.link));
  for (std::size_t k = 0; k < node.count; ++k) {
    const Direction& direction = node.directions[k];
    if (direction.row == TreeNode::kNone) continue;
    (direction.turns ? sum.angular : sum.linear) += of_rows[direction.row] * direction.along;
  }
  return sum;
}

// how B accelerates against A while neither accelerates and no coordinate does
SpatialVector TreeOfBodies::bias_of(const TreeNode& node, const SpatialVector& relative) const {
  const EquationsOfMotion& e = equations_;
  const auto& link = e.links_[node.link];
  const Vector3d w_A = spin(link.a), w_B = spin(link.b);
  const auto centripetal = [&](std::size_t point, const Vector3d& w, const Vector3d& arm) {
    Vector3d a = w.cross(w.cross(arm));
    if (!e.turns(point)) a += e.load_acceleration_[point];
    return a;
  };
  SpatialVector bias;
  bias.linear = centripetal(link.a, w_A, node.to_a) - centripetal(link.b, w_B, node.to_b);
  const JointKindInfo& kind = info(link.kind);
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

// of springs, dampers and forces along its coordinates
void TreeOfBodies::pull(TreeNode* node, const SpatialVector& relative, double* forces) const {
  EquationsOfMotion& e = equations_;
  for (std::size_t k = 0; k < node->count; ++k) {
    Direction& direction = node->directions[k];
    if (direction.soft == TreeNode::kNone) continue;
    const auto& soft = e.softs_[direction.soft];
    const double force = forces[e.soft_force(direction.soft)] =
        soft.law.force(e.reading_of(soft), component(direction, relative));
    direction.force = node->sense * force;
  }
}

[[gnu::flatten]] void TreeOfBodies::accelerate(std::size_t stage, const double* y, double* dydt) {
  EquationsOfMotion& e = equations_;
  find_spins(y);
  double* const forces = e.stage_forces_.data() + stage * e.impulses_.size();
  for (std::size_t i = 0; i < e.turning_; ++i)
    e.tree_forces_[i] = {-e.load_acceleration_[i] / e.inverse_mass_[i],
                         e.spin_[i].cross(Vector3d::Map(y + e.L_at_ + 3 * i)) - e.load_torque_[i]};
  for (TreeNode& node : nodes_) {
    ask_nothing(&node);
    if (node.link == TreeNode::kNone) continue;
    const SpatialVector relative = relative_velocity(node);
    node.asked = (bias_of(node, relative) + held(node, e.acceleration_target_)) * node.sense;
    pull(&node, relative, forces);
  }
  reduce();
  substitute([&](std::size_t i, const SpatialVector& a) {
    Vector3d::Map(dydt + 3 * i) = e.velocity_[i];
    Vector3d::Map(dydt + e.v_at_ + 3 * i) = a.linear;
    write_quaternion_rate(e.spin_[i], y + e.q_at_ + 4 * i, dydt + e.q_at_ + 4 * i);
    const Vector3d L_dot =
        inertia_times(i, a.angular) + e.spin_[i].cross(Vector3d::Map(y + e.L_at_ + 3 * i));
    Vector3d::Map(dydt + e.L_at_ + 3 * i) = L_dot;
    e.tree_forces_[i] = {(a.linear - e.load_acceleration_[i]) / e.inverse_mass_[i],
                         L_dot - e.load_torque_[i]};
  });
  find_forces(forces);
}

Vector3d TreeOfBodies::inertia_times(std::size_t body, const Vector3d& w) const {
  const Matrix3d& R = equations_.orientation_[body];
  return R * equations_.inertia_[body].cwiseProduct(Vector3d(R.transpose() * w));
}

// as the equations note them
void TreeOfBodies::note_positions() {
  EquationsOfMotion& e = equations_;
  for (const TreeNode& node : nodes_) {
    for (std::size_t k = 0; k < node.count; ++k) {
      if (node.directions[k].soft == TreeNode::kNone) continue;
      auto& soft = e.softs_[node.directions[k].soft];
      soft.position = e.reading_of(soft);
      soft.rate = component(node.directions[k], relative_velocity(node));
    }
  }
  e.noted_at_ = e.placed_at_;
}

// of its rows, from the joint's force and torque on the child
void TreeOfBodies::write_forces(const TreeNode& node, const SpatialVector& on_child,
                                double* by_unknown) const {
  if (node.link == TreeNode::kNone) return;
  const EquationsOfMotion& e = equations_;
  const SpatialVector on_b = on_child * node.sense;
  const std::size_t first = e.first_row(node.link);
  const auto write = [&](std::size_t row, double force) {
    by_unknown[e.rows_[row].unknown] = force;
  };
  if (e.is_ball(node.link)) {
    for (std::size_t k = 0; k < 3; ++k) write(first + k, on_b.linear[static_cast<Eigen::Index>(k)]);
    return;
  }
  const JointVectors& vectors = e.vectors_[node.link - e.first_general_];
  const JointKindInfo& kind = info(e.links_[node.link].kind);
  for (std::size_t k = 0; k < at(kind.rows); ++k) {
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

// velocities that fit the joints, by the least impulses that do so
bool TreeOfBodies::restart(double* y, double* dydt) {
  EquationsOfMotion& e = equations_;
  is_lost_ = !factor();
  if (is_lost_) return e.restart(y, dydt);
  find_spins(y);
  std::fill(e.tree_forces_.begin(), e.tree_forces_.end(), SpatialVector{});
  for (TreeNode& node : nodes_) {
    ask_nothing(&node);
    if (node.link != TreeNode::kNone)
      node.asked = (held(node, e.rate_target_) - relative_velocity(node)) * node.sense;
  }
  reduce();
  double* const solution = e.solution_.data();
  substitute([&](std::size_t i, const SpatialVector& change) {
    const Vector3d twist = inertia_times(i, change.angular);
    Vector3d::Map(y + e.v_at_ + 3 * i) += change.linear;
    Vector3d::Map(y + e.L_at_ + 3 * i) += twist;
    e.tree_forces_[i] = {change.linear / e.inverse_mass_[i], twist};
  });
  find_forces(solution);
  for (std::size_t i = 0; i < e.rows_.size(); ++i) e.impulses_[i] += solution[i];
  if (!e.softs_.empty()) {
    find_spins(y);
    note_positions();
  }
  accelerate(0, y, dydt);
  return true;
}

// ---- positions

bool TreeOfBodies::project(double t, double* y) {
  if (is_lost_) return equations_.project(t, y);
  return equations_.project_by(
      t, y, [&] { return find_values(t, y); }, [&] { correct(y); });
}

// places all; returns how far the worst row is off [m]
double TreeOfBodies::find_values(double t, double* y) {
  EquationsOfMotion& e = equations_;
  for (std::size_t i = 0; i < e.turning_; ++i)
    Eigen::Map<Eigen::Vector4d>(y + e.q_at_ + 4 * i).normalize();
  place(t, y);
  double worst = 0.0;
  const auto consider = [&](double error) {
    if (!(error <= worst)) worst = error;  // a NaN stays
  };
  for (std::size_t l = 0; l < e.first_general_; ++l)
    consider((e.d_[l] - ball_offset(l)).cwiseAbs().maxCoeff());
  for (const auto& row : e.general_rows_) consider(row.metres * std::abs(e.value_of(row)));
  return worst;
}

Vector3d TreeOfBodies::ball_offset(std::size_t l) const {
  return equations_.courses_.empty() ? Vector3d(Vector3d::Zero())
                                     : Vector3d(equations_.offset(l).head<3>());
}

// how B has to be moved against A that the rows are met, but for what is free
SpatialVector TreeOfBodies::opening(const TreeNode& node) const {
  const EquationsOfMotion& e = equations_;
  if (e.is_ball(node.link)) return {ball_offset(node.link) - e.d_[node.link], Vector3d::Zero()};
  const JointVectors& vectors = e.vectors_[node.link - e.first_general_];
  const Vector3d z_A = vectors.axes_A.col(2), z_B = vectors.axes_B.col(2);
  const JointKindInfo& kind = info(e.links_[node.link].kind);
  SpatialVector by;
  for (std::size_t k = 0; k < at(kind.separation_rows); ++k) {
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
    const double off = e.value_of(e.general_rows_[direction.row - e.first_general_row()]);
    (direction.turns ? by.angular : by.linear) -= off * direction.along;
  }
  return by;
}

// one of Newton's steps, with the inertias of the last factor()
void TreeOfBodies::correct(double* y) {
  EquationsOfMotion& e = equations_;
  std::fill(e.tree_forces_.begin(), e.tree_forces_.end(), SpatialVector{});
  for (TreeNode& node : nodes_) {
    ask_nothing(&node);
    if (node.link != TreeNode::kNone) node.asked = opening(node) * node.sense;
  }
  reduce();
  substitute([&](std::size_t i, const SpatialVector& change) {
    Vector3d::Map(y + 3 * i) += change.linear;
    double* const q = y + e.q_at_ + 4 * i;
    double rate[4];
    write_quaternion_rate(change.angular, q, rate);
    for (std::size_t k = 0; k < 4; ++k) q[k] += rate[k];
  });
}

}  // namespace constraint_sim::engine
