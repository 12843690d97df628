#include "engine/dynamics/kernels/tree_system.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "engine/dynamics/kernels/tree_forces.h"
#include "engine/dynamics/kernels/tree_reading.h"
#include "engine/dynamics/kernels/tree_writing.h"
#include "engine/math/embedded_pairs.h"
#include "engine/math/larger.h"
#include "engine/math/numbers.h"
#include "engine/math/quaternion_state.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// Pivots below which the rows go on, near a singular pose of a loop, and from which the tree takes
// over again. Pivots fall as squares of angles; the gap keeps the choice from alternating.
constexpr double kLeastPivotOfLoops = 1e-6;
constexpr double kPivotToReturn = 1e-4;
constexpr int kMostNewtonSteps = 8;  // corrections of the poses of a loop
// A step far beyond stability, which is rejected also without a tolerance: one whose estimate is
// this many sizes of the tree, that opens a loop by this share of the size, or leaves rates from
// which closing joints change the fastest speed by this share.
constexpr double kMostSizes = 1.0;
constexpr double kMostOpening = 1e-2;
constexpr double kMostRateChange = 1e-3;
// Rate changes below this many sizes of the tree per second are not checked [1/s].
constexpr double kSlowest = 1e-6;
constexpr double kTurn = 2.0 * kPi;                    // [rad]
constexpr double kTurnBelow = 2.4492935982947064e-16;  // the rest of a turn [rad]

constexpr StagesWithForces<DormandPrince5> kForcesOfOrder5;
constexpr StagesWithForces<DormandPrince8> kForcesOfOrder8;

}  // namespace

TreeSystem::TreeSystem(EquationsOfMotion& equations, ArticulatedTree& tree)
    : equations_(equations),
      view_(equations.kernel_view()),
      state_(tree),
      tree_(tree.tree()),
      dynamics_(tree.dynamics()),
      closings_(tree.closings()) {
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
  closings_.select(equations_.redundant().is_redundant());
  place_start(t);
  if (!(dynamics_.least_pivot(tree_) > DelassusMatrix::kLeastPivot)) state_.set_ill_conditioned();
  if (!closings_.empty() && !are_loops_regular(kPivotToReturn)) state_.leave_step_to_rows();
  if (state_.is_left_to_rows()) return false;
  start(t);
  state_.note_size();
  if (tree_.keeps_momenta()) state_.momentum() = TreeMomentum(tree_, dynamics_);
  state_.set_current();
  return true;
}

void TreeSystem::start(double t) {
  if (!state_.is_placed()) place_start(t);
  write_derivative(state_.memory().state(), state_.memory().derivatives());
  write_forces(0);
}

void TreeSystem::begin(double t) {
  time_ = t;
  double* const y = state_.memory().state();
  // Constant motions are prescribed too: a tree that was read from a snapshot has not seen them.
  if (tree_.independent.size() < tree_.motions.size()) prescribe(y);
  if (is_prescribing()) {
    move_with_time(t, y);
    state_.set_placed(false);
  }
  drop_whole_turns(y);
  if (!closings_.empty()) {
    closings_.select(equations_.redundant().is_redundant());
    if (!state_.is_placed()) place_start(t);
    closings_.begin_coordinates();
  }
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

void TreeSystem::scatter(List<BodyState>* states) {
  scatter_tree(in_interval(), root(state_.memory().state()), states);
}

void TreeSystem::place_start(double t) {
  find_accelerations(0, t, prescribed(t, state_.memory().state()));
  state_.set_placed(true);
}

void TreeSystem::write_start(double t, double* y) {
  place_start(t);
  write_state(y);
}

void TreeSystem::write_state(double* y) {
  write_tree_state(in_interval(), root(state_.memory().state()), y);
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

void TreeSystem::find_accelerations(std::size_t stage, double t, const double* y) {
  place(y);
  if (!equations_.soft_coordinates().empty()) pull(stage, y);
  dynamics_.evaluate(tree_, view_.applied_acceleration, view_.applied_torque);
  if (closings_.empty()) return dynamics_.solve(tree_);
  closings_.pull(in_interval(), t, view_.stage_forces + stage * view_.unknowns);
  dynamics_.solve(tree_);
  closings_.accelerate(in_interval());
}

void TreeSystem::place(const double* y) {
  dynamics_.place(tree_, state_.roots(), y);
  if (!closings_.empty()) closings_.place(in_interval(), root(y));
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
  if (stage == 1) closings_.begin_substep();
  y = prescribed(t, y);
  find_accelerations(stage, t, y);
  write_derivative(y, dydt);
  if (needs_forces_ == nullptr || needs_forces_[stage]) write_forces(stage);
}

void TreeSystem::write_forces(std::size_t stage) {
  double* const forces = view_.stage_forces + stage * view_.unknowns;
  if (!closings_.empty()) closings_.write_forces(in_interval(), forces);
  dynamics_.find_transmitted(tree_);
  write_transmitted_forces(in_interval(), state_.work().data(), forces);
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

// ---- the end of a substep

bool TreeSystem::project(double t, double* y) {
  time_ = t;
  if (is_prescribing()) move_with_time(t, y);
  return normalize(y) && (closings_.empty() || close_loops(y));
}

bool TreeSystem::normalize(double* y) const {
  for (const TreeBody& body : tree_.bodies)
    if (body.turns_freely && !normalize_quaternions(y + body.quaternion, 1)) return false;
  return true;
}

// Meets the rows of closing joints and their rates, by Newton steps with H of the last stage.
bool TreeSystem::close_loops(double* y) {
  double* const change = state_.work().data();
  double before = kInfinity;
  const double rounding = kEpsilon * std::max(state_.size(), view_.scale);
  const double most_open = kMostOpening * state_.size();
  for (int i = 0;; ++i) {
    place(y);
    const double error = closings_.find_errors(in_interval());
    if (error <= rounding || (error > 0.5 * before && error <= 16.0 * rounding)) break;
    if (!(error <= std::min(0.5 * before, most_open)) || i == kMostNewtonSteps) return false;
    before = error;
    closings_.find_correction(in_interval(), change);
    move(change, y);
    if (!normalize(y)) return false;
  }
  return meet_rates(y);
}

// Gives closing joints their rates. Returns false where that changes the motion.
bool TreeSystem::meet_rates(double* y) {
  double* const change = state_.work().data();
  substep_projected_ = closings_.find_rate_correction(in_interval(), change);
  const double* const before = state_.memory().state() + tree_.rate_at;
  const double square = larger(dynamics_.squared_size_of(tree_, y + tree_.rate_at),
                               dynamics_.squared_size_of(tree_, before));
  const double slowest = kSlowest * state_.size();
  const double changed = dynamics_.squared_size_of(tree_, change);
  if (!(changed <= kMostRateChange * kMostRateChange * square + slowest * slowest)) return false;
  for (std::size_t k = 0; k < tree_.motions.size(); ++k) y[tree_.rate_at + k] += change[k];
  return true;
}

// Adds a small change of all motions to the positions of y.
void TreeSystem::move(const double* change, double* y) const {
  for (const TreeBody& body : tree_.bodies) {
    for (std::size_t k = body.first; k < body.end; ++k)
      if (!body.is_of_rotation(k)) y[tree_.motions[k].position] += change[k];
    if (!body.turns_freely) continue;
    double rate[4];
    write_rate_of_rotation(y + body.quaternion, change + body.end - 3, rate);
    for (std::size_t e = 0; e < 4; ++e) y[body.quaternion + e] += rate[e];
  }
}

bool TreeSystem::restart(double* y, double* dydt) {
  projected_ += substep_projected_;
  if (tree_.keeps_momenta())
    state_.momentum().keep(tree_, state_.roots(),
                           {view_.applied_acceleration, view_.applied_torque}, substep_,
                           state_.memory().state(), &dynamics_, y);
  const bool has_moved = tree_.has_quaternions || !closings_.empty();
  if (next_stage_ > 0 && !has_moved) {  // the last stage was at this state
    std::copy_n(dydt + next_stage_ * tree_.size, tree_.size, dydt);
    std::copy_n(view_.stage_forces + next_stage_ * view_.unknowns, view_.unknowns,
                view_.stage_forces);
  } else {
    derivative(0, time_, y, dydt);
  }
  state_.note_size();
  state_.set_placed(true);
  if (!(dynamics_.least_pivot(tree_) > DelassusMatrix::kLeastPivot)) state_.set_ill_conditioned();
  if (!closings_.empty()) {
    if (!closings_.can_count_turns(substep_) || !are_loops_regular(kLeastPivotOfLoops))
      state_.leave_step_to_rows();
    closings_.note_coordinates(in_interval(), substep_);
    view_.coordinates->set_time(time_);
  }
  return !state_.is_left_to_rows();
}

// Whether the rows of closing joints are independent, and determine the redundant rows.
bool TreeSystem::are_loops_regular(double least_pivot) {
  closings_.find_errors(in_interval());
  return closings_.least_pivot() > least_pivot && closings_.redundant_rows_are_met(in_interval());
}

double TreeSystem::rounding() const { return 4.0 * kEpsilon * state_.size(); }

// The largest displacement of a body, and of a point at its radius of gyration by its turn.
// Infinite where stages have left the size of the tree far behind, as with dampers that are far too
// stiff for the step, so that such a step is rejected also without a tolerance. Coordinates err by
// as much as their rates, times h, by order 3; quaternions may err by more.
double TreeSystem::squared_size_of(const double* dy, double h, bool is_of_rates) const {
  const double* const rates = dy + tree_.rate_at;
  double square = h * h * dynamics_.squared_size_of(tree_, rates);
  if (!is_of_rates || tree_.has_quaternions) {
    double* const change = state_.work().data();
    for (const TreeBody& body : tree_.bodies) {
      for (std::size_t k = body.first; k < body.end; ++k)
        if (!body.is_of_rotation(k)) change[k] = dy[tree_.motions[k].position];
      if (!body.turns_freely) continue;
      write_turn(state_.memory().candidate() + body.quaternion, dy + body.quaternion,
                 change + body.end - 3);
    }
    square = larger(dynamics_.squared_size_of(tree_, change), square);
  }
  const double most = kMostSizes * state_.size() / h;
  return square <= most * most ? square : kInfinity;
}

}  // namespace constraint_sim::engine
