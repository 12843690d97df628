#include "engine/methods/event_driven/contacts/contact_events.h"

#include <algorithm>
#include <cmath>

#include "engine/constraints/joint_load.h"
#include "engine/math/same_bits.h"
#include "engine/methods/event_driven/contacts/slow_slips.h"
#include "engine/methods/event_driven/law_events.h"

namespace constraint_sim::engine {
namespace {

constexpr std::uint32_t kMostJams = 4;  // per step
constexpr int kMostMissed = 40;         // substeps repeated per step for missed overlaps

// Longest substep that the motors of a group allow [s].
double longest_substep(const GroupJoints& joints) {
  double longest = kInfinity;
  for (const GroupCoordinate& of : joints.coordinates()) {
    const MotorRate length = motor_rate(joints[of.joint].joint.motor);
    const MotorRate motor = of.law.is_distance ? length : of.motor;
    longest = std::min(longest, longest_substep(of.law, of.state.hold, motor));
  }
  return longest;
}

}  // namespace

bool ContactEvents::begin(const List<BodyState>& states, bool closes) {
  closes_ = closes;
  done_ = {};
  solver_.begin_step();
  stepper_.begin_step();
  rattling_.begin_step();
  reports_.clear();
  states_.begin_step();
  equations_.bodies().gather(states, 0.0);
  equations_.set_driven_work(0.0);
  return pairs_.begin(closes, &equations_);
}

// ---- an interval

// Starts the prescribed motions of joints.
void ContactEvents::begin_joints(const JointStep& step, const List<JointData>& states) {
  equations_.joints().begin_interval(equations_.bodies(), step, states, !done_.has_advanced);
  if (!done_.has_advanced) reports_.begin_step(equations_);
  done_.has_advanced = true;
}

IntegrationResult ContactEvents::advance(const Interval& interval, const IntegratorOptions& options,
                                         const JointStep& joint_step,
                                         const List<JointData>& joint_states, double most_work,
                                         List<BodyState>* states) {
  solver_.begin_interval(most_work, interval.stop);
  Run run{interval, options, RemainingInterval(0.0, interval.h), {}};
  const bool has_closed = closes_;
  equations_.bodies().gather(*states, interval.since_tick);
  equations_.bodies().begin_interval(interval.t, interval.gravity, interval.loads);
  if (closes_) {
    equations_.prepare_stages();
    begin_joints(joint_step, joint_states);
    run.progress.done = closing_.close(pairs_, &solver_, &equations_, &run.progress.corrected);
    if (!run.progress.done) return run.progress;
    equations_.bodies().scatter(states);
    run.progress.done = begin(*states, false);
    if (!run.progress.done) return run.progress;
  }
  const bool is_first = !done_.has_advanced && !has_closed;  // closing overlaps is work of its own
  equations_.prepare_stages();
  begin_joints(joint_step, joint_states);
  if (is_first && unchanged_.is_repeated_by(interval, equations_, pairs_.list())) {
    states_.begin_event(equations_);
    impacts_.begin_event(equations_);
    unchanged_.repeat(&equations_);
    report(interval.t, interval.t, true);
    run.progress = unchanged_.progress();
    solver_.add(unchanged_.work());
  } else {
    if (is_first) unchanged_.begin(interval, equations_, pairs_.list());
    integrate(&run);
    if (is_first && run.progress.done && run.progress.substeps + run.progress.rejected == 0 &&
        reports_.list().empty() && stepper_.events() == 0)
      unchanged_.end(equations_, run.progress, solver_.work());
  }
  equations_.joints().integrate_angles(equations_.bodies());
  reports_.end_interval(equations_);
  equations_.joints().move_yielding_limits(equations_.bodies());
  equations_.bodies().scatter(states);
  return run.progress;
}

// Integrates from the start of an interval to its end.
void ContactEvents::integrate(Run* run) {
  const std::size_t n = equations_.size();
  numbers_.assign(StageMemory::kRows * n, 0.0);
  std::copy(equations_.bodies().numbers().begin(), equations_.bodies().numbers().end(),
            numbers_.begin());
  step_ = run->interval.h;
  kept_at_ = -1.0;
  stepper_.begin_interval();
  bool is_done = settle(run, {}, true);
  double t = 0.0;
  while (is_done && run->left.left > 0.0) {
    t = run->left.t;
    is_done = advance_to_event(run);
  }
  run->progress.done = is_done;
  if (!is_done && t > 0.0 && done_.breaks == 0) return_to_found(t, run);
}

// Returns to the time `t` in the interval, at which the last substep began and could not be ended.
void ContactEvents::return_to_found(double t, Run* run) {
  run->progress.found = t;
  if (kept_at_ != t) return;  // the substep was not begun
  equations_.restore();
  equations_.bodies().set_time(t);
  equations_.bodies().place(kept_.data());
  reports_.keep(reports_kept_);
}

double* ContactEvents::derivative() {
  return numbers_.data() + StageMemory::kDerivatives * equations_.size();
}

// ---- between events

void ContactEvents::watch(List<Watched>* list) {
  watch_.list(equations_, pairs_, derivative(), last_, list);
}

bool ContactEvents::advance_to_event(Run* run) {
  if (solver_.is_stopped() || solver_.is_used_up()) return false;
  pairs_.find_features(false, false, &equations_);
  set_directions(pairs_.tolerances(), &equations_);
  equations_.joints().integrate_angles(equations_.bodies());
  if (!equations_.bodies().has_movers() && !equations_.joints().depends_on_time() &&
      equations_.bodies().is_still(derivative())) {  // nothing will move in the interval
    equations_.accept_without_motion(run->left.left);
    run->left.left = 0.0;
    return true;
  }
  last_ = {};
  double step = std::min({step_, pairs_.longest_substep(run->left.left, equations_),
                          longest_substep(equations_.joints())});
  if (!go_straight(run->options.tolerance > 0.0 && turns_fast(equations_, step))) return false;
  watch(stepper_.before());
  const std::size_t n = equations_.size();
  kept_.assign(numbers_.begin(), numbers_.begin() + static_cast<std::ptrdiff_t>(n));
  kept_.insert(kept_.end(), derivative(), derivative() + n);
  equations_.keep();
  kept_at_ = run->left.t;
  reports_kept_ = reports_.list().size();
  const RemainingInterval start = run->left;
  const auto take_part = [&](RemainingInterval* part) { return take_first(run, part, &step); };
  if (!stepper_.take_substep(run->options, run->progress, take_part, &run->left, &step))
    return end_jam(run);
  step_ = step;
  error_ = 0.0;
  const auto repeat_to = [&](double length) { return repeat(run, start.t, length); };
  const auto look = [&](List<Watched>* list) {
    pairs_.find_features(false, true, &equations_);
    last_ = {start.left - run->left.left, order_};
    watch(list);
  };
  const auto accept = [&](double length) {
    // Where a slip is about to end or turn, a substep may be accepted by luck; the error of its
    // repeated part shows it.
    const double tolerance = run->options.tolerance;
    const bool is_poor =
        tolerance > 0.0 && error_ > std::max(tolerance * length, equations_.rounding());
    if (!is_poor && !pairs_.has_missed(equations_)) return true;
    step_ = 0.5 * (start.left - run->left.left);
    ++done_.missed;
    return false;
  };
  const auto change = [&](const Watched& event, bool* is_changed) {
    return change_states(run, event, is_changed);
  };
  return stepper_.end_substep(start, repeat_to, look, accept, change, &run->left) &&
         done_.missed <= kMostMissed;
}

// Handles substeps that become ever shorter: forces grow without bound where friction is about to
// jam.
bool ContactEvents::end_jam(Run* run) {
  const bool any_slips = std::any_of(
      equations_.contacts().begin(), equations_.contacts().end(),
      [](const auto& contact) { return contact.acts == Acts::kSlips && contact.friction > 0.0; });
  if (solver_.is_stopped() || !any_slips || ++done_.jams > kMostJams) return false;
  stepper_.count_event();
  run->left.failures = 0;
  run->progress.is_inconsistent = false;
  equations_.restore();
  equations_.bodies().set_time(run->left.t);
  equations_.bodies().place(numbers_.data());
  return settle(run, {}, false, true);
}

// ---- at events

// Changes the states at the event of a watched value.
bool ContactEvents::change_states(Run* run, const Watched& event, bool* is_changed) {
  solver_.add(1.0);
  equations_.joints().integrate_angles(equations_.bodies());
  end_rattling(run, event);
  const std::uint32_t impacts = impacts_.count(), breaks = done_.breaks;
  if (event.kind == Watched::Kind::kBreak) break_joint(*run, event.joint);
  if (!settle(run, event, false)) return false;
  *is_changed = impacts != impacts_.count() || breaks != done_.breaks ||
                states_.has_changed(equations_) ||
                (event.kind == Watched::Kind::kSlip && !pairs_.tolerances().is_coarsest());
  return true;
}

// Looks whether events go on without end, at speeds that no longer matter.
void ContactEvents::end_rattling(Run* run, const Watched& event) {
  double speed = 0.0;
  switch (event.kind) {
    case Watched::Kind::kLimit:
      speed = std::abs(event.rate);
      break;
    case Watched::Kind::kGap:
    case Watched::Kind::kForce:
    case Watched::Kind::kCone:
    case Watched::Kind::kSlip: {
      const ContactMotion now = equations_.motion(equations_.contacts()[event.contact]);
      speed = event.kind == Watched::Kind::kGap ? std::abs(now.gap_rate()) : now.slip().norm();
      break;
    }
    case Watched::Kind::kHeld:
    case Watched::Kind::kRate:
      break;
    case Watched::Kind::kNothing:
    case Watched::Kind::kMargin:
    case Watched::Kind::kBreak:
      return;
  }
  const ContactTolerances& within = pairs_.tolerances();
  coarsen(
      rattling_.zero_speed(run->interval.t + run->left.t, speed, within.resting, within.rattling),
      run);
}

// Counts speeds up to `least` [m/s] as zero. Velocities are then off by as much. Returns false
// where that is too much, or no more than before.
bool ContactEvents::coarsen(double least, Run* run) {
  if (least <= pairs_.tolerances().resting || !pairs_.coarsen(least)) return false;
  run->progress.local_error += least * run->left.left;
  return true;
}

// Decides the states of all contacts and laws at an event. `event`: the watched value that passed
// zero and ended the last substep; kNothing at the start of an interval. `jams`: slipping contacts
// have no motion to continue.
bool ContactEvents::settle(Run* run, const Watched& event, bool is_begin, bool jams) {
  double* const y = numbers_.data();
  const double t = run->interval.t + run->left.t;
  last_ = {};
  may_be_uniform_ = true;
  equations_.set_straight(false);
  for (GroupJoint& joint : equations_.joints().list()) joint.impact = {};
  if (is_begin && !equations_.joints().list().empty()) {  // else rates may be those of no motion
    const std::optional<double> lost = equations_.fit_joints(y, pairs_.tolerances().resting);
    if (!lost) return false;
    run->progress.projected += *lost;
  }
  states_.begin_event(equations_);
  pairs_.find_features(!is_begin && event.kind == Watched::Kind::kMargin, false, &equations_);
  states_.note_bounds(t, run->interval.h, event, pairs_, equations_);
  impacts_.begin_event(equations_);
  const auto decide = [&](const Watched& at) {
    return states_.decide(at, y, pairs_, &solver_, &equations_);
  };
  const auto have_jam = [&] { return impacts_.have_jam(pairs_, &solver_, &equations_, y); };
  if (jams && !have_jam()) return false;
  const FollowedBounces followed(run->left.left, run->interval.h, run->options.tolerance,
                                 pairs_.tolerances().touching);
  const auto have_impacts = [&] {
    return impacts_.have_impacts(followed, is_begin, pairs_, &states_, &solver_, &equations_, y);
  };
  if (!have_impacts() && !(coarsen(impacts_.approach(), run) && have_impacts())) return false;
  if (followed.error > 0.0 && impacts_.any_rests()) run->progress.local_error += followed.error;
  if (!decide(event) && !(have_jam() && decide({}))) return false;
  run->progress.local_error += impacts_.indeterminate() * run->interval.h;
  run->progress.local_error += 0.5 * states_.indeterminate() * run->left.left * run->left.left;
  states_.hold_coordinates(is_begin, &equations_);
  const double kinetic = equations_.bodies().kinetic_energy(),
               potential = equations_.potential_energy();
  before_projection_.assign(y, y + equations_.size());
  if (!equations_.project(run->left.t, y)) return false;
  const bool is_known = equations_.joints().coordinates().empty() &&
                        have_same_bits(before_projection_.data(), y, equations_.size());
  if (!equations_.restart(y, derivative(), is_known ? states_.derivative() : nullptr)) return false;
  run->progress.projected += kinetic - equations_.bodies().kinetic_energy();
  run->progress.corrected += equations_.potential_energy() - potential;
  report(run->interval.t, t, is_begin);
  return break_hit(run) ? settle(run, {}, false) : break_overloaded(run);
}

// Reports changes since begin_event() of the contacts and impacts.
void ContactEvents::report(double interval_start, double t, bool is_begin) {
  reports_.add({interval_start, t, is_begin, states_.acts_before(), states_.coordinates_before(),
                impacts_.impulses(), impacts_.rests_in()},
               equations_, &pairs_);
}

// Breaks a joint and the couplings on it.
void ContactEvents::break_joint(const Run& run, std::size_t joint) {
  GroupJoints& joints = equations_.joints();
  const auto break_one = [&](std::size_t j) {
    if (joints[j].is_broken) return;
    ++done_.breaks;
    joints.break_joint(j);
    reports_.add_break(run.interval.t + run.left.t, j);
  };
  break_one(joint);
  for (std::size_t j = 0; j < joints.list().size(); ++j)
    if (info(joints[j].joint.kind).couples_joints)
      for (const CoupledTerm& term : joints[j].terms)
        if (term.joint == joint) break_one(j);
}

// Breaks joints whose impulses by impacts are more than they bear. Returns whether any broke.
bool ContactEvents::break_hit(Run* run) {
  const GroupBodies& bodies = equations_.bodies();
  const List<GroupJoint>& joints = equations_.joints().list();
  bool any = false;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const GroupJoint& of = joints[j];
    if (!of.may_break()) continue;
    const JointLoad load = load_of(of.joint, bodies.state(of.a), bodies.state(of.b), of.impact.rows,
                                   of.impact.coupling);
    if (!load.breaks(of.joint, 1.0 / kImpactDuration)) continue;
    break_joint(*run, j);
    any = true;
  }
  if (any) stepper_.count_event();
  return any;
}

// Breaks joints that are overloaded, as after another joint let go. The most overloaded joint
// breaks first, since it may relieve the others.
bool ContactEvents::break_overloaded(Run* run) {
  List<Watched> loads;
  for (std::size_t j = 0; j < equations_.joints().list().size(); ++j)
    watch_breaking(equations_, j, {}, &loads);
  const auto worst =
      std::min_element(loads.begin(), loads.end(), [](const Watched& left, const Watched& right) {
        return left.value / left.tolerance < right.value / right.tolerance;
      });
  if (worst == loads.end() || worst->value >= -worst->tolerance) return true;
  stepper_.count_event();
  break_joint(*run, worst->joint);
  return settle(run, {}, false);
}

}  // namespace constraint_sim::engine
