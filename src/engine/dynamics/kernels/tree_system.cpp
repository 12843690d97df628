#include "engine/dynamics/kernels/tree_system.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "engine/dynamics/kernels/tree_reading.h"
#include "engine/math/embedded_pairs.h"
#include "engine/math/larger.h"
#include "engine/math/numbers.h"
#include "engine/math/quaternion_state.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

// A pivot below this share of its diagonal entry has lost half of its digits to the masses of the
// subtree.
constexpr double kLeastPivot = 1e-8;
// An estimate of this many sizes of the tree is no error of a step but a step far beyond stability.
constexpr double kMostSizes = 1.0;
constexpr double kTurn = 6.283185307179586;            // [rad]
constexpr double kTurnBelow = 2.4492935982947064e-16;  // the rest of a turn [rad]

/// For each stage, whether the impulses of a step need its forces; the stage after the last is the
/// first of the next step.
template <class Pair>
struct StagesWithForces {
  bool needed[Pair::kStages + 1] = {};

  constexpr StagesWithForces() {
    for (std::size_t s = 0; s < Pair::kStages; ++s) needed[s] = Pair::kA[Pair::kStages][s] != 0.0;
    needed[0] = needed[Pair::kStages] = true;
  }
};
constexpr StagesWithForces<DormandPrince5> kForcesOfOrder5;
constexpr StagesWithForces<DormandPrince8> kForcesOfOrder8;

}  // namespace

TreeSystem::TreeSystem(EquationsOfMotion& equations, ArticulatedTree& tree)
    : equations_(equations),
      view_(equations.kernel_view()),
      state_(tree),
      tree_(tree.tree()),
      dynamics_(tree.dynamics()) {
  place_roots();
}

TreeSystem TreeSystem::for_impulses(EquationsOfMotion& equations, ArticulatedTree& tree,
                                    int order) {
  TreeSystem system(equations, tree);
  system.needs_forces_ = order == 5 ? kForcesOfOrder5.needed : kForcesOfOrder8.needed;
  return system;
}

// ---- the state

void TreeSystem::place_roots() {
  for (std::size_t i = 0; i < tree_.bodies.size(); ++i) {
    const std::size_t fixed = tree_.bodies[i].fixed;
    if (fixed == kNoIndex) continue;
    TreeRoot& root = state_.roots()[i];
    root.velocity = view_.velocity[fixed];
    root.acceleration = view_.applied_acceleration[fixed];
    // A ball joint turns against axes of the world.
    if (!equations_.fixed_points()[fixed - equations_.bodies().size()].has_axes) continue;
    root.axes = equations_.inputs().fixed_axes(fixed);
    root.angular_velocity = equations_.inputs().fixed_angular_velocity(fixed);
  }
}

// Moves the roots and prescribed coordinates of y to time t [s].
void TreeSystem::move_with_time(double t, double* y) {
  if (equations_.inputs().is_time_dependent()) {
    equations_.move_with_time(t);
    place_roots();
  }
  prescribe(y);
}

// Writes positions and rates that motors prescribe, as of the last move_with_time().
void TreeSystem::prescribe(double* y) const {
  for (std::size_t k = 0; k < tree_.motions.size(); ++k) {
    const TreeMotion& motion = tree_.motions[k];
    if (motion.row == kNoIndex) continue;
    y[motion.position] = motion.sense * equations_.inputs().value_target()[motion.row];
    y[tree_.rate_at + k] = motion.sense * view_.rate_target[motion.row];
    dynamics_.acceleration(k) = motion.sense * view_.acceleration_target[motion.row];
  }
  for (const TreeCoupling& coupling : tree_.couplings) {
    const double share = -coupling.to_ratio / coupling.from_ratio;
    const TreeMotion &from = tree_.motions[coupling.from], &to = tree_.motions[coupling.to];
    y[from.position] =
        share * y[to.position] +
        (view_.coordinates->constant(coupling.coupled) - coupling.zero) / coupling.from_ratio;
    y[tree_.rate_at + coupling.from] = share * y[tree_.rate_at + coupling.to];
    if (from.is_prescribed)
      dynamics_.acceleration(coupling.from) = share * dynamics_.acceleration(coupling.to);
  }
}

bool TreeSystem::is_prescribing() const {
  return equations_.inputs().is_time_dependent() || !tree_.couplings.empty();
}

bool TreeSystem::read(double t) {
  const StageMemory memory = state_.memory();
  std::fill_n(memory.state(), tree_.size, 0.0);
  read_tree(equations_, tree_, state_.roots(), memory.state());
  move_with_time(t, memory.state());
  place_start(t);
  if (!(dynamics_.least_pivot(tree_) > kLeastPivot)) {
    state_.set_ill_conditioned();
    return false;
  }
  write_derivative(memory.state(), memory.derivatives());
  write_forces(0);
  state_.note_size();
  if (tree_.is_free()) state_.momentum() = TreeMomentum(tree_, dynamics_);
  state_.set_current();
  return true;
}

void TreeSystem::begin(double t) {
  time_ = t;
  double* const y = state_.memory().state();
  // Also constant ones: a tree that was read from a snapshot has not seen them.
  if (tree_.independent.size() < tree_.motions.size()) prescribe(y);
  if (is_prescribing()) {
    move_with_time(t, y);
    state_.set_placed(false);
  }
  drop_whole_turns(y);
  for (std::size_t k = 0; k < tree_.motions.size(); ++k)
    state_.noted()[k] = y[tree_.motions[k].position];
}

// Angles that no force reads are kept small, so that their rounding is. The turns that were made
// are noted with the coordinates of the joints.
void TreeSystem::drop_whole_turns(double* y) const {
  for (const TreeMotion& motion : tree_.motions) {
    const bool is_read = motion.soft != kNoIndex || motion.row != kNoIndex;
    if (!motion.turns || motion.coordinate < 0 || is_read || !tree_.couplings.empty()) continue;
    double& x = y[motion.position];
    if (std::abs(x) <= kTurn) continue;
    const double turns = std::round(x / kTurn);
    x = (x - turns * kTurn) - turns * kTurnBelow;
  }
}

double TreeSystem::position_of(const TreeMotion& motion, double x) const {
  return motion.sense * x + equations_.soft_coordinates()[motion.soft].zero;
}

void TreeSystem::note_coordinates() {
  const double* const y = state_.memory().state();
  for (const TreeBody& body : tree_.bodies) {
    for (std::size_t k = body.first; k < body.end; ++k) {
      const TreeMotion& motion = tree_.motions[k];
      if (motion.coordinate < 0) continue;
      const double x = y[motion.position], rate = motion.sense * y[tree_.rate_at + k];
      if (motion.soft != kNoIndex)
        view_.coordinates->note_soft(motion.soft, position_of(motion, x), rate);
      else if (motion.turns)
        view_.coordinates->turn_angle(body.link, motion.coordinate,
                                      motion.sense * (x - state_.noted()[k]), rate);
    }
  }
  for (const TreeCoupling& coupling : tree_.couplings) {
    const auto& terms = equations_.coupled_rows()[coupling.coupled].terms;
    const std::array<std::size_t, 2> motions{coupling.from_term == 0 ? coupling.from : coupling.to,
                                             coupling.from_term == 0 ? coupling.to : coupling.from};
    for (std::size_t k = 0; k < 2; ++k) {
      const TreeMotion& motion = tree_.motions[motions[k]];
      view_.coordinates->note_term(coupling.coupled, k,
                                   motion.sense * y[motion.position] + terms[k].zero,
                                   motion.sense * y[tree_.rate_at + motions[k]]);
    }
  }
  view_.coordinates->set_time(time_);
}

Vector3d TreeSystem::origin(const TreeBody& body) const {
  return tree_.is_free() ? Vector3d(Vector3d::Map(state_.memory().state()))
                         : view_.position[body.fixed];
}

void TreeSystem::scatter(List<BodyState>* states) {
  for (std::size_t i = 0; i < tree_.bodies.size(); ++i) {
    const TreeDynamics::Placed& at = dynamics_.placed(i);
    const TreeBody& body = tree_.bodies[i];
    BodyState& state = (*states)[equations_.bodies()[body.body]];
    state.position = origin(body) + at.centre;
    state.linear_velocity = dynamics_.velocity(i);
    state.angular_velocity = at.motion.angular;
    Quaterniond q(Matrix3d(at.axes * body.axes_of_body));
    if (q.coeffs().dot(state.orientation.coeffs()) < 0.0) q.coeffs() = -q.coeffs();
    normalize_quaternions(q.coeffs().data(), 1);
    state.orientation = q;
  }
}

void TreeSystem::write_state(double* y) {
  for (std::size_t i = 0; i < tree_.bodies.size(); ++i) {
    const TreeDynamics::Placed& at = dynamics_.placed(i);
    const TreeBody& body = tree_.bodies[i];
    const Matrix3d axes = at.axes * body.axes_of_body;
    const std::size_t b = body.body;
    Vector3d::Map(y + 3 * b) = origin(body) + at.centre;
    Vector3d::Map(y + view_.v_at + 3 * b) = dynamics_.velocity(i);
    Eigen::Map<Eigen::Vector4d>(y + view_.q_at + 4 * b) = Quaterniond(axes).coeffs();
    Vector3d::Map(y + view_.L_at + 3 * b) =
        axes * equations_.inertia(b).cwiseProduct(Vector3d(axes.transpose() * at.motion.angular));
  }
}

void TreeSystem::place_start(double t) {
  find_accelerations(0, prescribed(t, state_.memory().state()));
  state_.set_placed(true);
}

void TreeSystem::write_start(double t, double* y) {
  place_start(t);
  write_state(y);
}

// ---- one evaluation

// Springs, dampers and forces along coordinates.
void TreeSystem::pull(std::size_t stage, const double* y) {
  double* const forces = view_.stage_forces + stage * view_.unknowns;
  for (std::size_t k = 0; k < tree_.motions.size(); ++k) {
    const TreeMotion& motion = tree_.motions[k];
    if (motion.soft == kNoIndex) continue;
    const double force = equations_.soft_coordinates()[motion.soft].law.force(
        position_of(motion, y[motion.position]), motion.sense * y[tree_.rate_at + k]);
    forces[equations_.forces().of_soft(equations_, motion.soft)] = force;
    dynamics_.force(k) = motion.sense * force;
  }
}

void TreeSystem::find_accelerations(std::size_t stage, const double* y) {
  dynamics_.place(tree_, state_.roots(), y);
  if (!equations_.soft_coordinates().empty()) pull(stage, y);
  dynamics_.evaluate(tree_, view_.applied_acceleration, view_.applied_torque);
  dynamics_.solve(tree_);
}

// Returns y with what is prescribed at time t [s].
const double* TreeSystem::prescribed(double t, const double* y) {
  if (!is_prescribing()) return y;
  double* const work = state_.work().data();
  std::copy_n(y, tree_.size, work);
  move_with_time(t, work);
  return work;
}

void TreeSystem::derivative(std::size_t stage, double t, const double* y, double* dydt) {
  y = prescribed(t, y);
  find_accelerations(stage, y);
  write_derivative(y, dydt);
  if (needs_forces_ == nullptr || needs_forces_[stage]) write_forces(stage);
}

void TreeSystem::write_forces(std::size_t stage) {
  dynamics_.find_transmitted(tree_);
  double* const forces = view_.stage_forces + stage * view_.unknowns;
  for (std::size_t i = 0; i < tree_.bodies.size(); ++i) write_row_forces(i, forces);
  write_motor_forces(forces);
}

void TreeSystem::write_derivative(const double* y, double* dydt) {
  const double* const rates = y + tree_.rate_at;
  dydt[tree_.rate_at - 1] = dydt[tree_.size - 1] = 0.0;  // where the number of entries is odd
  for (const TreeBody& body : tree_.bodies) {
    for (std::size_t k = body.first; k < body.end; ++k) {
      if (!body.is_of_rotation(k)) dydt[tree_.motions[k].position] = rates[k];
      dydt[tree_.rate_at + k] = dynamics_.acceleration(k);
    }
    if (body.turns_freely)
      write_rate_of_rotation(y + body.quaternion, rates + body.end - 3, dydt + body.quaternion);
  }
}

// Writes the forces of the rows of a joint, from what it transmits to the child.
void TreeSystem::write_row_forces(std::size_t i, double* forces) const {
  const TreeBody& body = tree_.bodies[i];
  const TreeDynamics::Placed& at = dynamics_.placed(i);
  const SpatialVector& transmitted = dynamics_.transmitted(i);
  const Vector3d& on_b = body.is_a ? at.point_before : at.point;
  const Vector3d torque = transmitted.angular - on_b.cross(transmitted.linear);
  for (std::size_t k = body.first_row; k < body.end_row; ++k) {
    const TransmittedRow& row = tree_.rows[k];
    const Vector3d& of = row.is_torque ? torque : transmitted.linear;
    double component = 0.0;
    switch (row.along) {
      case TransmittedRow::Along::kWorld:
        component = of[row.axis];
        break;
      case TransmittedRow::Along::kBefore:
        component = at.axes_before.col(row.axis).dot(of);
        break;
      case TransmittedRow::Along::kNode:
        component = at.axes.col(row.axis).dot(of);
        break;
      case TransmittedRow::Along::kAcross:
        component = dynamics_.direction(body.first + 1)
                        .angular.cross(dynamics_.direction(body.first).angular)
                        .dot(of);
        break;
    }
    forces[view_.unknown[row.row]] = row.sign * component;
  }
}

// Writes the forces of couplings and of motors that prescribe a motion: what a joint transmits
// along a motion, less what springs and dampers do. Couplings are gone through towards their
// sources.
void TreeSystem::write_motor_forces(double* forces) {
  if (tree_.independent.size() == tree_.motions.size()) return;
  double* const left = state_.work().data();  // per motion
  for (const TreeBody& body : tree_.bodies) {
    const SpatialVector& transmitted =
        dynamics_.transmitted(static_cast<std::size_t>(&body - tree_.bodies.data()));
    for (std::size_t k = body.first; k < body.end; ++k)
      left[k] = dynamics_.direction(k).dot(transmitted) - dynamics_.force(k);
  }
  for (std::size_t c = tree_.couplings.size(); c-- > 0;) {
    const TreeCoupling& coupling = tree_.couplings[c];
    const double force = left[coupling.from] / coupling.from_ratio;
    left[coupling.to] -= coupling.to_ratio * force;
    forces[view_.unknown[equations_.coupled_rows()[coupling.coupled].row]] = force;
  }
  for (std::size_t k = 0; k < tree_.motions.size(); ++k)
    if (tree_.motions[k].row != kNoIndex)
      forces[view_.unknown[tree_.motions[k].row]] = tree_.motions[k].sense * left[k];
}

// ---- the end of a substep

bool TreeSystem::project(double t, double* y) {
  time_ = t;
  if (is_prescribing()) move_with_time(t, y);
  for (const TreeBody& body : tree_.bodies)
    if (body.turns_freely && !normalize_quaternions(y + body.quaternion, 1)) return false;
  return true;
}

bool TreeSystem::restart(double* y, double* dydt) {
  if (tree_.is_free())
    state_.momentum().keep(tree_, state_.roots(),
                           {view_.applied_acceleration, view_.applied_torque}, substep_,
                           state_.memory().state(), &dynamics_, y);
  if (next_stage_ > 0 && !tree_.has_quaternions) {  // the last stage was at this state
    std::copy_n(dydt + next_stage_ * tree_.size, tree_.size, dydt);
    std::copy_n(view_.stage_forces + next_stage_ * view_.unknowns, view_.unknowns,
                view_.stage_forces);
  } else {
    derivative(0, time_, y, dydt);
  }
  state_.note_size();
  state_.set_placed(true);
  if (!(dynamics_.least_pivot(tree_) > kLeastPivot)) state_.set_ill_conditioned();
  return !state_.is_ill_conditioned();
}

double TreeSystem::rounding() const { return 4.0 * kEpsilon * state_.size(); }

// The largest displacement of a body, and of a point at its radius of gyration by its turn.
// Infinite where stages have left the size of the tree far behind, as with dampers that are far too
// stiff for the step, so that such a step is rejected also without a tolerance.
double TreeSystem::squared_size_of(const double* dy, double h) const {
  double* const change = state_.work().data();
  const double* const rates = dy + tree_.rate_at;
  for (const TreeBody& body : tree_.bodies) {
    for (std::size_t k = body.first; k < body.end; ++k)
      if (!body.is_of_rotation(k)) change[k] = dy[tree_.motions[k].position];
    if (!body.turns_freely) continue;
    write_turn(state_.memory().candidate() + body.quaternion, dy + body.quaternion,
               change + body.end - 3);
  }
  const double square = larger(dynamics_.squared_size_of(tree_, change),
                               h * h * dynamics_.squared_size_of(tree_, rates));
  const double most = kMostSizes * state_.size() / h;
  return square <= most * most ? square : kInfinity;
}

}  // namespace constraint_sim::engine
