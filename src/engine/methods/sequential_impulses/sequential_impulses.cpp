#include "engine/methods/sequential_impulses/sequential_impulses.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "engine/constraints/contact.h"
#include "engine/constraints/joint_rows.h"
#include "engine/constraints/law.h"
#include "engine/math/elementary.h"
#include "engine/math/larger.h"
#include "engine/math/list.h"
#include "engine/model/impulse_method.h"

namespace constraint_sim::engine {
namespace {

constexpr double kAtLimit = 1e-9;  // share of Coulomb's limit that is rounding
constexpr double kResidualRounding =
    1e-9;                         // share of the fastest rate that a residual may be without weight
constexpr double kFarRate = 1e3;  // multiple of the fastest rate that no impact reaches
// Times that bounces are made lower which would together raise the energy; the last is to 0.
constexpr int kMostLowerings = 4;

void apply_wrenches(const List<ActingWrench>& wrenches, const List<MassProperties>& masses,
                    List<BodyState>* states) {
  for (const ActingWrench& wrench : wrenches) {
    BodyState& state = (*states)[wrench.body];
    const MassProperties& mass = masses[wrench.body];
    state.linear_velocity += wrench.duration * mass.inverse_mass * wrench.force;
    state.angular_velocity +=
        apply_inertia(mass.inverse_inertia, state.orientation, wrench.duration * wrench.torque);
  }
}

// State of a contact point, from its rows: slipping where the sweeps left friction at its limit.
ContactState contact_state(const Row* rows, std::size_t count) {
  if (count < kMaxContactRows || rows[0].impulse == 0.0) return ContactState::kClosed;
  const double limit = rows[1].friction * rows[0].impulse;
  const double friction = math::hypot(rows[1].impulse, rows[2].impulse);
  return friction < (1.0 - kAtLimit) * limit ? ContactState::kSticking : ContactState::kSlipping;
}

bool moves_by_mean(ImpulseStepKind kind) {
  return kind == ImpulseStepKind::kPart || kind == ImpulseStepKind::kLargePart;
}

double work_at(const ActingWrench& wrench, const Twist& v) {
  return wrench.duration * (wrench.force.dot(v.head<3>()) + wrench.torque.dot(v.tail<3>()));
}

}  // namespace

ContactStep contact_step(const WorldOptions& options, double h) {
  return {h, options.baumgarte, options.gravity.norm(), solves_impulses(options)};
}

ImpulseReport SequentialImpulses::advance(const Model& model, const ImpulseStep& step,
                                          State* state) {
  ImpulseReport report;
  StageTimes* const times = &report.stage_times;
  {  // stage 3: rows of joints and contacts
    const StageTimer timer(step.clock, Stage::kRows, times);
    report.max_penetration = prepare_rows(model, step, state);
    report.rows = static_cast<std::uint32_t>(rows_.size());
    report.contacts = static_cast<std::uint32_t>(contact_rows_.size());
    error_.note_guesses(rows_);
  }
  {  // stage 4: gravity, and impulses of the previous step
    const StageTimer timer(step.clock, Stage::kVelocities, times);
    update_velocities(model, step, state);
  }
  if (!rows_.empty()) {  // stage 5: velocities that the rows allow
    const StageTimer timer(step.clock, Stage::kSolve, times);
    const RowSolver::Outcome solved = solve_rows(model, step, *state, &report);
    report.solver_residual = solved.residual;
    report.driven_work = solved.driven_work;
  }
  {  // stage 6: positions by the final velocities
    const StageTimer timer(step.clock, Stage::kPositions, times);
    const bool is_solved = solves_impulses(model.options);
    if (is_solved && !rows_.empty())
      converged_.find_mean_shares(step.bodies, rows_, rest_speed(step.contacts),
                                  moves_by_mean(step.kind), &solver_);
    if (step.kind == ImpulseStepKind::kWhole) add_errors(model, step, *state, report);
    add_work(step.wrenches, is_solved, &report);
    report.correction_work +=
        solver_.update_positions(step.bodies, model.masses, model.options.gravity, state->states);
    if (is_solved)
      for (const int body : step.bodies)
        state->states[body].position -= step.interval.h * by_mean(to_index(body));
  }
  return report;
}

// Velocity that the mean of both velocities takes from the motion of a body by the last one, where
// impulses are solved [m/s].
Eigen::Vector3d SequentialImpulses::by_mean(std::size_t body) const {
  const double share = rows_.empty() ? 1.0 : converged_.mean_share(body);
  return 0.5 * share * solver_.velocity_change(body).head<3>();
}

Eigen::Vector3d SequentialImpulses::off_mean(std::size_t body) const {
  return 0.5 * solver_.velocity_change(body).head<3>() - by_mean(body);
}

// Adds the errors of a step, before the bodies move. A wrench that acts for a part of the step
// moves its body as if it acted for all of it.
void SequentialImpulses::add_errors(const Model& model, const ImpulseStep& step, const State& state,
                                    const ImpulseReport& report) {
  const double h = step.interval.h;
  const bool is_solved = solves_impulses(model.options);
  error_.note_impulses(rows_);
  for (const int index : step.bodies) {
    const std::size_t body = to_index(index);
    Eigen::Vector3d off = 0.5 * solver_.velocity_change(body).head<3>();
    if (is_solved) off -= by_mean(body);
    error_.measure(body, h, model.masses[body], state.states[body], off, solver_);
  }
  error_.add(step.bodies, !rows_.empty(), &solver_);
  for (const ActingWrench& wrench : step.wrenches)
    if (wrench.duration < h)
      error_.add(wrench.body, 0.5 * h * wrench.duration * model.masses[wrench.body].inverse_mass *
                                  wrench.force.norm());
  if (!has_estimate(model, step, report))
    for (const int body : step.bodies)
      error_.add(to_index(body), std::numeric_limits<double>::quiet_NaN());
}

// Whether impulses are known well enough for an estimate. The residual that sweeps leave must not
// exceed the residual allowed for solved impulses.
bool SequentialImpulses::has_estimate(const Model& model, const ImpulseStep& step,
                                      const ImpulseReport& report) const {
  if (solves_impulses(model.options)) return !report.unsolved_body && !report.has_swept;
  const double rest = rest_speed(step.contacts);
  if (report.solver_residual <= rest) return true;
  double fastest = 0.0;
  for (std::size_t i = 0; i < rows_.size(); ++i)
    fastest = std::max(fastest, std::abs(solver_.rate_before(rows_[i], i)));
  return report.solver_residual <= kResidualRounding * fastest;
}

// Adds the work of wrenches along the motion [J]. Corrections that move a body against a wrench do
// the opposite work, as corrections against its weight do.
void SequentialImpulses::add_work(const List<ActingWrench>& wrenches, bool is_solved,
                                  ImpulseReport* report) const {
  for (const ActingWrench& wrench : wrenches) {
    Twist along = solver_.final_velocity(wrench.body);
    if (is_solved) along.head<3>() -= by_mean(wrench.body);
    report->driven_work += work_at(wrench, along);
    report->correction_work -= work_at(wrench, solver_.correction(wrench.body));
  }
}

RowSolver::Outcome SequentialImpulses::solve_rows(const Model& model, const ImpulseStep& step,
                                                  const State& state, ImpulseReport* report) {
  if (!solves_impulses(model.options)) {
    report->iterations = static_cast<std::uint32_t>(model.options.iterations);
    return solver_.solve(step.bodies, rows_, model.options.iterations, step.stop);
  }
  const double rest = rest_speed(step.contacts);
  const bool by_mean = moves_by_mean(step.kind);
  const auto solve = [&] {
    return converged_.solve(state.states, model.masses,
                            {rest, model.options.iterations, step.kind == ImpulseStepKind::kPart},
                            step.stop, &rows_, &solver_);
  };
  ConvergedRows::Outcome converged = solve();
  for (int round = 0; round < kMostLowerings && !is_set(step.stop); ++round) {
    converged_.allow_gains(step.bodies, rows_, rest, by_mean, &solver_);
    if (!solver_.lower_bounces(step.bodies, round + 1 == kMostLowerings, rows_)) break;
    converged = solve();
  }
  converged_.allow_gains(step.bodies, rows_, rest, by_mean, &solver_);
  const SteppedJoints joints{
      step.joints,        model.joints,  step.joint_ends,
      joint_rows_,        state.states,  model.masses,
      state.joint_states, step.interval, step.kind == ImpulseStepKind::kWhole};
  converged.add(curvature_.correct(joints, rest, step.stop, &converged_, &solver_, &rows_));
  report->iterations = static_cast<std::uint32_t>(converged.iterations);
  report->has_swept = converged.has_swept;
  RowSolver::Outcome outcome = solver_.finish_solve(step.bodies, rows_);
  outcome.residual = larger(outcome.residual, converged.residual);
  // Sweeps leave larger residuals by design; a limit on energy leaves one where it acts.
  const bool is_limited = !converged.has_swept && outcome.residual > larger(rest, converged.solved);
  if (converged.unsolved >= 0 || is_limited)
    report->unsolved_body =
        model.body_ids[converged.unsolved >= 0 ? converged.unsolved : step.bodies.front()];
  return outcome;
}

// ---- 3. rows

// Computes all rows. Returns the depth of the deepest contact [m].
double SequentialImpulses::prepare_rows(const Model& model, const ImpulseStep& step, State* state) {
  rows_.clear();
  joint_rows_.clear();
  contact_rows_.clear();
  loop_rows_.clear();
  for (const int index : step.joints) {
    const std::size_t j = to_index(index);
    const std::size_t first = rows_.size();
    joint_rows_.push_back(first);
    if (!model.options.warm_starting) forget_impulses(&state->joint_states[j]);
    const auto [a, b] = step.joint_ends[j];
    prepare_joint(model.joints[j], state->states[a], state->states[b], step.interval,
                  state->joint_states[j], &rows_);
    const bool is_in_loop =
        model.options.warm_starting && step.is_in_loop[j] && is_always_rigid(model.joints[j]);
    const std::size_t end = rows_.size();
    if (info(model.joints[j].kind).couples) add_coupling(model, step, *state, j);
    for (std::size_t k = first; k < end; ++k) {
      rows_[k].body_a = static_cast<int>(a);
      rows_[k].body_b = static_cast<int>(b);
      if (is_in_loop) loop_rows_.push_back({k, j, static_cast<int>(k - first), 0.0, 0.0});
    }
  }
  joint_rows_.push_back(rows_.size());
  const std::size_t of_joints = rows_.size();

  double deepest = 0.0;
  for (const TouchingPair& pair : state->touching) {
    for (std::size_t k = 0; k < to_index(pair.manifold.count); ++k) {
      deepest = std::max(deepest, pair.manifold.points[k].depth);
      prepare_contact(model, step.contacts, *state, pair, k);
    }
  }
  if (step.kind == ImpulseStepKind::kInstant) bound_open_rows(of_joints, *state);
  return deepest;
}

// Bounds the rates by which gaps of joints could close within an instant. Without a bound they
// would set the scale by which residuals are judged.
void SequentialImpulses::bound_open_rows(std::size_t of_joints, const State& state) {
  double fastest = 0.0;
  for (const Row& row : rows_) {
    const BodyState& a = state.states[row.body_a];
    const BodyState& b = state.states[row.body_b];
    fastest = std::max(fastest, std::abs(row.J.times(a.linear_velocity, a.angular_velocity,
                                                     b.linear_velocity, b.angular_velocity)));
  }
  const double most = kFarRate * fastest;
  for (std::size_t k = 0; k < of_joints; ++k)
    if (rows_[k].lower == 0.0 || rows_[k].upper == 0.0)
      rows_[k].target = std::clamp(rows_[k].target, -most, most);
}

std::array<Jacobian, 2> SequentialImpulses::coupled_jacobians(const Model& model,
                                                              const ImpulseStep& step,
                                                              const State& state, std::size_t j,
                                                              bool at_end) {
  std::array<Jacobian, 2> J;
  const CoupledTerms terms = model.terms_of(j);
  for (std::size_t k = 0; k < 2; ++k) {
    const std::size_t of = terms[k].joint;
    const auto [a, b] = step.joint_ends[of];
    const Jacobian gradient =
        coordinate_jacobian(model.joints[of], state.states[a], state.states[b], step.interval,
                            state.joint_states[of], terms[k].coordinate, at_end);
    J[k] = combined(terms[k].ratio, gradient, 0.0, gradient);
  }
  return J;
}

void SequentialImpulses::add_coupling(const Model& model, const ImpulseStep& step,
                                      const State& state, std::size_t j) {
  prepare_coupling(model.joints[j], step.interval, state.joint_states[j],
                   coupled_jacobians(model, step, state, j, false), &rows_);
  const CoupledTerms terms = model.terms_of(j);
  for (std::size_t k = 0; k < 2; ++k) {
    const auto [a, b] = step.joint_ends[terms[k].joint];
    Row& row = rows_[rows_.size() - 2 + k];
    row.body_a = static_cast<int>(a);
    row.body_b = static_cast<int>(b);
  }
}

void SequentialImpulses::prepare_contact(const Model& model, const ContactStep& contacts,
                                         const State& state, const TouchingPair& pair,
                                         std::size_t point) {
  const ContactSurface surface(model.bodies[pair.a], pair.part_a, model.bodies[pair.b],
                               pair.part_b);
  std::array<Row, kMaxContactRows> written;
  const int count = write_contact_rows(state.states[pair.a], state.states[pair.b],
                                       pair.manifold.normal, pair.manifold.points[point], surface,
                                       contacts, pair.impulses[point], written.data());
  contact_rows_.push_back(rows_.size());
  for (std::size_t k = 0; k < to_index(count); ++k) {
    written[k].body_a = pair.a;
    written[k].body_b = pair.b;
    if (k > 0) written[k].normal_row = static_cast<int>(contact_rows_.back());
    rows_.push_back(written[k]);
  }
}

// ---- 4. velocities

void SequentialImpulses::update_velocities(const Model& model, const ImpulseStep& step,
                                           State* state) {
  solver_.begin(step.bodies, state->states);
  if (!step.wrenches.empty()) apply_wrenches(step.wrenches, model.masses, &state->states);
  solver_.update_velocities(step.bodies, state->states, model.masses, model.options.gravity,
                            step.interval.h, rows_);
  if (!loop_rows_.empty()) lose_self_stress(model.options, state->self_stress);
}

// Lowers the self-stress that redundant joints keep of an impact or an edit to 1/e in kTime, by at
// most a tenth per step: sweeps give back what is not known well yet.
void SequentialImpulses::lose_self_stress(const WorldOptions& options,
                                          const List<SelfStress>& known) {
  constexpr double kTime = 0.1;  // [s]
  const double part = std::min(0.1, options.time_step / kTime);
  for (LoopRow& loop : loop_rows_) {
    const SelfStress& of_joint = known[loop.joint];
    loop.share =
        of_joint.share[loop.component] + rows_[loop.row].impulse - of_joint.impulse[loop.component];
  }
  solver_.lose_self_stress(rows_, &loop_rows_, part, 1 + options.iterations / 10);
  for (LoopRow& loop : loop_rows_) loop.impulse = rows_[loop.row].impulse;
}

// ---- after the step

double SequentialImpulses::finish(const Model& model, const ImpulseStep& step, State* state) {
  for (std::size_t k = 0; k < step.joints.size(); ++k) {
    const std::size_t j = to_index(step.joints[k]);
    const auto [a, b] = step.joint_ends[j];
    const int count = static_cast<int>(joint_rows_[k + 1] - joint_rows_[k]);
    JointData& of_joint = state->joint_states[j];
    const bool is_coupling = info(model.joints[j].kind).couples_joints;
    if (is_coupling) read_coupling(model.terms_of(j), state->joint_states, &of_joint.coupling);
    read_joint(model.joints[j], state->states[a], state->states[b], step.interval,
               rows_.data() + joint_rows_[k], count, of_joint);
    if (is_coupling)
      add_coupled_effort(model.terms_of(j), of_joint.coupling.effort, &state->joint_states);
  }
  read_contacts(&state->touching);
  return solver_.is_to_finish() ? finish_corrections(model, step, state) : 0.0;
}

double SequentialImpulses::finish_corrections(const Model& model, const ImpulseStep& step,
                                              State* state) {
  for (std::size_t k = 0; k < step.joints.size(); ++k) {
    const std::size_t j = to_index(step.joints[k]);
    const auto [a, b] = step.joint_ends[j];
    std::array<Jacobian, kMostRowsOfJoint> J;
    const std::size_t first = joint_rows_[k];
    const int count = static_cast<int>(joint_rows_[k + 1] - first);
    const JointData& of_joint = state->joint_states[j];
    joint_jacobians(model.joints[j], state->states[a], state->states[b], step.interval, of_joint,
                    rows_.data() + first, count, J.data());
    if (info(model.joints[j].kind).couples) {
      const std::array<Jacobian, 2> coupled = coupled_jacobians(model, step, *state, j, true);
      std::copy(coupled.begin(), coupled.end(), J.begin() + count - 2);
    }
    for (std::size_t r = first; r < joint_rows_[k + 1]; ++r)
      solver_.finish_row(r, rows_[r], J[r - first],
                         spring_stretch(model.joints[j], of_joint, rows_[r]));
  }
  state->any_corrections = true;
  return solver_.take_out_corrections(step.bodies, model.masses, state->states,
                                      &state->corrections);
}

void SequentialImpulses::read_contacts(List<TouchingPair>* touching) const {
  std::size_t i = 0;
  for (TouchingPair& pair : *touching) {
    for (std::size_t k = 0; k < to_index(pair.manifold.count); ++k, ++i) {
      const std::size_t first = contact_rows_[i];
      const std::size_t end = i + 1 < contact_rows_.size() ? contact_rows_[i + 1] : rows_.size();
      pair.impulses[k].setZero();
      for (std::size_t r = first; r < end; ++r)
        pair.impulses[k] += rows_[r].impulse * rows_[r].J.j1;
      pair.contact_states[k] = contact_state(rows_.data() + first, end - first);
    }
  }
}

void SequentialImpulses::keep_self_stress(List<SelfStress>* self_stress) const {
  for (const LoopRow& loop : loop_rows_) {
    (*self_stress)[loop.joint].share[loop.component] = loop.share;
    (*self_stress)[loop.joint].impulse[loop.component] = loop.impulse;
  }
}

}  // namespace constraint_sim::engine
