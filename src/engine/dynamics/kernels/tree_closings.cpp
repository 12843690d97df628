#include "engine/dynamics/kernels/tree_closings.h"

#include <algorithm>
#include <cmath>

#include "engine/math/larger.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Largest turn in a substep whose whole turns are counted by the rates at both ends: below π/2,
// since the count may be off by twice the turn, and has to be nearer than half a turn [rad].
constexpr double kMostCountedTurn = 1.5;

/// End of a closing joint in world axes.
struct PlacedEnd {
  Vector3d origin;  ///< origin of the tree in the world [m]
  Vector3d arm;     ///< from the origin to the anchor [m]
  Matrix3d axes;
  Vector3d spin;      ///< [rad/s]
  Vector3d velocity;  ///< velocity of the anchor [m/s]
};

PlacedEnd placed_end(const TreeInInterval& at, const ClosingJoint::End& end, const Vector3d& root) {
  PlacedEnd placed;
  if (end.body == kNoIndex) {
    placed.origin = at.view.position[end.point];
    placed.arm.setZero();
    placed.velocity = at.view.velocity[end.point];
    placed.axes = end.axes;
    placed.spin.setZero();
    if (!at.equations.fixed_points()[end.point - at.equations.bodies().size()].has_axes)
      return placed;
    placed.axes = at.equations.inputs().fixed_axes(end.point) * end.axes;
    placed.spin = at.equations.inputs().fixed_angular_velocity(end.point);
    return placed;
  }
  const TreeDynamics::Placed& body = at.dynamics.placed(end.body);
  const std::size_t fixed = at.tree.bodies[end.body].fixed;
  placed.origin = fixed == kNoIndex ? root : at.view.position[fixed];
  placed.arm = body.point + body.axes * end.anchor;
  placed.axes = body.axes * end.axes;
  placed.spin = body.motion.angular;
  placed.velocity = body.motion.linear + placed.spin.cross(placed.arm);
  return placed;
}

/// Acceleration of the point of a body at the origin, and of its rotation, with zero ẍ of unknown
/// motions.
SpatialVector free_acceleration(const TreeInInterval& at, const ClosingJoint::End& end) {
  if (end.body == kNoIndex) return {at.view.applied_acceleration[end.point], Vector3d::Zero()};
  const TreeDynamics::Placed& body = at.dynamics.placed(end.body);
  return {body.bias.linear + body.motion.angular.cross(body.motion.linear), body.bias.angular};
}

void add_wrench(const TreeInInterval& at, const ClosingJoint::End& end,
                const SpatialVector& wrench) {
  if (end.body != kNoIndex) at.dynamics.add_wrench(at.tree, end.body, wrench);
}

}  // namespace

TreeClosings::TreeClosings(const JointTree& tree, const IslandModel& island)
    : joints_(tree.closings), motions_(tree.motions.size()) {
  for (std::size_t j = 0; j < joints_.size(); ++j) {
    const std::size_t l = joints_[j].link;
    const IslandModel::Link& link = island.links()[l];
    const JointForms& kind = forms(link.kind);
    for (std::size_t k = 0; k < island.rows_of(l); ++k)
      rows_.push_back({island.row_of(l) + k, j, kind.function[link.function[k]]});
    for (int i = 0; i < kind.coordinates; ++i) {
      const ScalarForm& form = kind.coordinate[to_index(i)];
      Coordinate made{j, i, kNoIndex, form};
      for (std::size_t s = link.first_soft; s < link.first_soft + link.softs; ++s)
        if (island.soft_coordinates()[s].function == kind.rows + i) made.soft = s;
      if (island.is_general(l) && (made.soft != kNoIndex || form.is_angle))
        coordinates_.push_back(made);
    }
  }
  kept_ = rows_.size();
  placed_.resize(joints_.size());
  wrenches_.resize(kept_);
  for (auto* list : {&error_, &missing_, &force_}) list->assign(kept_, 0.0);
  for (auto* list : {&J_, &inverse_J_}) list->assign(kept_ * motions_, 0.0);
  matrix_.assign(kept_ * kept_, 0.0);
  change_.assign(motions_, 0.0);
}

void TreeClosings::select(const List<char>& is_redundant) {
  const auto has_force = [&](const ClosingRow& row) { return is_redundant[row.row] == 0; };
  std::sort(rows_.begin(), rows_.end(), [&](const ClosingRow& i, const ClosingRow& j) {
    if (has_force(i) != has_force(j)) return has_force(i);
    return i.row < j.row;
  });
  kept_ = to_index(std::count_if(rows_.begin(), rows_.end(), has_force));
}

// ---- poses

void TreeClosings::place(const TreeInInterval& at, const Vector3d& root) {
  for (std::size_t j = 0; j < joints_.size(); ++j) {
    const PlacedEnd a = placed_end(at, joints_[j].a, root), b = placed_end(at, joints_[j].b, root);
    auto& [vectors, motion] = placed_[j];
    vectors.r_A = a.arm;
    vectors.r_B = b.arm;
    vectors.d = (b.arm - a.arm) + (b.origin - a.origin);
    vectors.axes_A = a.axes;
    vectors.axes_B = b.axes;
    motion.w_A = a.spin;
    motion.w_B = b.spin;
    motion.d_dot = b.velocity - a.velocity;
    motion.d_bias = b.spin.cross(b.spin.cross(b.arm)) - a.spin.cross(a.spin.cross(a.arm));
  }
  if (!coordinates_.empty()) fastest_ = larger(fastest_, fastest_turn());
}

double TreeClosings::error_of(const TreeInInterval& at, const ClosingRow& row) const {
  const IntervalInputs& inputs = at.equations.inputs();
  const std::size_t l = joints_[row.joint].link;
  const double there = value(row.form, placed_[row.joint].vectors);
  if (at.equations.is_ball(l)) return there;
  if (at.equations.is_rod(l))
    return there - 0.5 * inputs.length()[l].value * inputs.length()[l].value;
  const double off = there - inputs.value_target()[row.row];
  return row.form.is_angle ? unwound(off, 0.0) : off;
}

double TreeClosings::find_errors(const TreeInInterval& at) {
  double largest = 0.0;
  for (std::size_t r = 0; r < rows_.size(); ++r) {
    error_[r] = error_of(at, rows_[r]);
    if (r < kept_)
      largest = larger(largest, std::abs(error_[r]) /
                                    at.equations.inputs().row_length(at.equations, rows_[r].row));
  }
  return largest;
}

bool TreeClosings::redundant_rows_are_met(const TreeInInterval& at) const {
  const IntervalInputs& inputs = at.equations.inputs();
  for (std::size_t r = kept_; r < rows_.size(); ++r) {
    const std::size_t row = rows_[r].row;
    const double error = std::abs(error_[r]) / inputs.row_length(at.equations, row);
    if (!at.equations.redundant().is_within_tolerance(row, error)) return false;
  }
  return true;
}

void TreeClosings::find_correction(const TreeInInterval& at, double* change) {
  factor(at);
  for (std::size_t r = 0; r < kept_; ++r) force_[r] = -error_[r];
  solve(force_.data());
  std::fill_n(change, motions_, 0.0);
  add_changes(force_.data(), change);
}

double TreeClosings::find_rate_correction(const TreeInInterval& at, double* change) {
  factor(at);
  for (std::size_t r = 0; r < kept_; ++r) {
    const auto& [vectors, motion] = placed_[rows_[r].joint];
    force_[r] = missing_[r] =
        at.view.rate_target[rows_[r].row] - rate(rows_[r].form, vectors, motion);
  }
  solve(force_.data());
  double energy = 0.0;
  for (std::size_t r = 0; r < kept_; ++r) energy += 0.5 * force_[r] * missing_[r];
  std::fill_n(change, motions_, 0.0);
  add_changes(force_.data(), change);
  return energy;
}

double TreeClosings::fastest_turn() const {
  double square = 0.0;
  for (const Coordinate& coordinate : coordinates_) {
    const JointMotion& motion = placed_[coordinate.joint].motion;
    if (coordinate.form.is_angle) square = larger(square, (motion.w_B - motion.w_A).squaredNorm());
  }
  return std::sqrt(square);
}

// The integral of a rate and its trapezoid, which counts turns, differ by at most twice the substep
// times the largest rate.
bool TreeClosings::can_count_turns(double h) const { return h * fastest_ <= kMostCountedTurn; }

void TreeClosings::begin_coordinates() {
  fastest_at_start_ = fastest_turn();
  for (Coordinate& coordinate : coordinates_) {
    const auto& [vectors, motion] = placed_[coordinate.joint];
    coordinate.rate = rate(coordinate.form, vectors, motion);
  }
}

void TreeClosings::note_coordinates(const TreeInInterval& at, double h) {
  fastest_at_start_ = fastest_turn();
  CoordinatePositions& noted = *at.view.coordinates;
  for (Coordinate& coordinate : coordinates_) {
    const auto& [vectors, motion] = placed_[coordinate.joint];
    const double before = coordinate.rate;
    coordinate.rate = rate(coordinate.form, vectors, motion);
    const double turned = integrated(0.0, h, before, coordinate.rate);
    if (coordinate.soft == kNoIndex) {
      noted.turn_angle(joints_[coordinate.joint].link, coordinate.index, turned, coordinate.rate);
      continue;
    }
    const IslandModel::SoftCoordinate& soft = at.equations.soft_coordinates()[coordinate.soft];
    noted.note_soft(coordinate.soft,
                    reading(soft.form, value(soft.form, vectors), soft.zero,
                            noted.soft(coordinate.soft) + turned),
                    coordinate.rate);
  }
}

// ---- one evaluation

void TreeClosings::pull(const TreeInInterval& at, double t, double* forces) {
  const CoordinatePositions& noted = *at.view.coordinates;
  for (const Coordinate& coordinate : coordinates_) {
    if (coordinate.soft == kNoIndex) continue;
    const IslandModel::SoftCoordinate& soft = at.equations.soft_coordinates()[coordinate.soft];
    const auto& [vectors, motion] = placed_[coordinate.joint];
    const double now = rate(soft.form, vectors, motion);
    const double expected =
        integrated(noted.soft(coordinate.soft), t - noted.time(), coordinate.rate, now);
    const double force =
        soft.law.force(reading(soft.form, value(soft.form, vectors), soft.zero, expected), now);
    forces[at.equations.forces().of_soft(at.equations, coordinate.soft)] = force;
    const Wrenches unit = wrenches_of(jacobian(soft.form, vectors));
    add_wrench(at, joints_[coordinate.joint].a, unit.on_a * force);
    add_wrench(at, joints_[coordinate.joint].b, unit.on_b * force);
  }
}

void TreeClosings::accelerate(const TreeInInterval& at) {
  factor(at);
  for (std::size_t r = 0; r < kept_; ++r) {
    const auto& [vectors, motion] = placed_[rows_[r].joint];
    const ClosingJoint& joint = joints_[rows_[r].joint];
    double missing = at.view.acceleration_target[rows_[r].row] -
                     gamma(rows_[r].form, vectors, motion) -
                     wrenches_[r].on_a.dot(free_acceleration(at, joint.a)) -
                     wrenches_[r].on_b.dot(free_acceleration(at, joint.b));
    for (std::size_t k = 0; k < motions_; ++k)
      if (!at.tree.motions[k].is_prescribed)
        missing -= J_[r * motions_ + k] * at.dynamics.acceleration(k);
    force_[r] = missing;
  }
  solve(force_.data());
  std::fill(change_.begin(), change_.end(), 0.0);
  add_changes(force_.data(), change_.data());
  at.dynamics.add_to_accelerations(change_.data());
}

void TreeClosings::write_forces(const TreeInInterval& at, double* forces) const {
  for (std::size_t r = 0; r < rows_.size(); ++r) {
    const ClosingJoint& joint = joints_[rows_[r].joint];
    double& written = forces[at.view.unknown[rows_[r].row]] = 0.0;
    if (r >= kept_) continue;
    add_wrench(at, joint.a, wrenches_[r].on_a * force_[r]);
    add_wrench(at, joint.b, wrenches_[r].on_b * force_[r]);
    written = force_[r];
    if (at.equations.is_rod(joint.link))  // the row ½ d·d has a force per length
      written *= at.equations.inputs().length()[joint.link].value;
  }
}

// ---- equations of the rows

void TreeClosings::add_to_jacobian(const TreeInInterval& at, const ClosingJoint::End& end,
                                   const SpatialVector& wrench, double* row) const {
  for (std::size_t i = end.body; i != kNoIndex; i = at.tree.bodies[i].parent)
    for (std::size_t k = at.tree.bodies[i].first; k < at.tree.bodies[i].end; ++k)
      row[k] += at.dynamics.direction(k).dot(wrench);
}

void TreeClosings::find_jacobian(const TreeInInterval& at) {
  std::fill_n(J_.begin(), kept_ * motions_, 0.0);
  for (std::size_t r = 0; r < kept_; ++r) {
    const ClosingJoint& joint = joints_[rows_[r].joint];
    wrenches_[r] = wrenches_of(jacobian(rows_[r].form, placed_[rows_[r].joint].vectors));
    add_to_jacobian(at, joint.a, wrenches_[r].on_a, J_.data() + r * motions_);
    add_to_jacobian(at, joint.b, wrenches_[r].on_b, J_.data() + r * motions_);
  }
}

// Entry of the row in J H⁻¹ Jᵀ where its bodies are on no other joints, with the radius of gyration
// in place of the inertia.
double TreeClosings::free_entry(const TreeInInterval& at, std::size_t row) const {
  const ClosingJoint& joint = joints_[rows_[row].joint];
  double sum = 0.0;
  const auto add = [&](const ClosingJoint::End& end, const SpatialVector& wrench) {
    if (end.body == kNoIndex) return;
    const TreeBody& body = at.tree.bodies[end.body];
    const Vector3d torque =
        wrench.angular - at.dynamics.placed(end.body).centre.cross(wrench.linear);
    sum += (wrench.linear.squaredNorm() + torque.squaredNorm() / body.squared_gyration) / body.mass;
  };
  add(joint.a, wrenches_[row].on_a);
  add(joint.b, wrenches_[row].on_b);
  return sum;
}

// Factors J H⁻¹ Jᵀ = L D Lᵀ.
void TreeClosings::factor(const TreeInInterval& at) {
  find_jacobian(at);
  for (std::size_t r = 0; r < kept_; ++r) {
    double* const of_row = inverse_J_.data() + r * motions_;
    for (std::size_t k = 0; k < motions_; ++k)
      of_row[k] = at.tree.motions[k].is_prescribed ? 0.0 : J_[r * motions_ + k];
    at.dynamics.apply_inverse(at.tree, of_row);
  }
  const auto A = [&](std::size_t i, std::size_t j) -> double& { return matrix_[i * kept_ + j]; };
  least_pivot_ = 1.0;
  for (std::size_t i = 0; i < kept_; ++i) {
    for (std::size_t j = 0; j <= i; ++j) {
      double& entry = A(i, j) = 0.0;
      for (std::size_t k = 0; k < motions_; ++k)
        entry += J_[i * motions_ + k] * inverse_J_[j * motions_ + k];
    }
    for (std::size_t j = 0; j < i; ++j) {
      for (std::size_t k = 0; k < j; ++k) A(i, j) -= A(i, k) * A(j, k);  // A(i, k) is L D so far
    }
    for (std::size_t j = 0; j < i; ++j) {
      const double l = A(i, j) / A(j, j);
      A(i, i) -= l * A(i, j);
      A(i, j) = l;
    }
    const double share = A(i, i) / free_entry(at, i);
    if (!(share >= least_pivot_)) least_pivot_ = share;  // also where it is not a number
  }
}

void TreeClosings::solve(double* numbers) const {
  const auto L = [&](std::size_t i, std::size_t j) { return matrix_[i * kept_ + j]; };
  for (std::size_t i = 0; i < kept_; ++i)
    for (std::size_t j = 0; j < i; ++j) numbers[i] -= L(i, j) * numbers[j];
  for (std::size_t i = kept_; i-- > 0;) {
    numbers[i] /= L(i, i);
    for (std::size_t j = i + 1; j < kept_; ++j) numbers[i] -= L(j, i) * numbers[j];
  }
}

void TreeClosings::add_changes(const double* numbers, double* change) const {
  for (std::size_t r = 0; r < kept_; ++r)
    for (std::size_t k = 0; k < motions_; ++k)
      change[k] += numbers[r] * inverse_J_[r * motions_ + k];
}

}  // namespace constraint_sim::engine
