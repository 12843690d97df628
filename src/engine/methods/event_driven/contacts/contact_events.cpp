#include "engine/methods/event_driven/contacts/contact_events.h"

#include <algorithm>
#include <cmath>

#include "engine/math/same_bits.h"
#include "engine/methods/event_driven/contacts/slow_slips.h"
#include "engine/methods/event_driven/joints/law_events.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr std::uint32_t kMostJams = 4;  // per step
constexpr int kMostMissed = 40;         // substeps repeated per step for missed overlaps

/// Lists the angles of all joints of a group, where the step starts.
void list_angles(const List<JointState>& states, ContactEquations* equations) {
  TurnedAngles& angles = equations->angles;
  angles.clear();
  for (std::size_t j = 0; j < equations->joints.size(); ++j) {
    const ContactEquations::BodyJoint& joint = equations->joints[j];
    const JointKindInfo& kind = info(joint.joint.kind);
    for (int i = 0; i < kind.coordinates; ++i) {
      if (!kind.coordinate[static_cast<std::size_t>(i)].is_angle) continue;
      for (ContactEquations::Coordinate& of : equations->coordinates)
        if (of.joint == j && of.law.coordinate == i) of.angle = static_cast<int>(angles.size());
      angles.add(j, joint.joint.kind, i, joint.a, joint.b);
    }
  }
  angles.begin([&](std::size_t j) -> const JointState& {
    return states[static_cast<std::size_t>(equations->joints[j].index)];
  });
}

}  // namespace

bool ContactEvents::begin(const List<BodyState>& states, bool closes) {
  closes_ = closes;
  done_ = {};
  solver_.begin_step();
  reports_.clear();
  states_.begin_step();
  equations_.gather_state(states);
  equations_.driven_work = 0.0;
  return pairs_.begin(closes, &equations_);
}

bool ContactEvents::has_touched(std::size_t contact) const {
  const ContactEquations::Contact& of = equations_.contacts[contact];
  return of.acts != Acts::kOpen || !of.impulse.isZero(0.0);
}

// ---- an interval

// Starts prescribed motions, and reads positions and yielded displacements of coordinates.
void ContactEvents::begin_joints(const Span& span, const JointStep& step,
                                 const List<JointState>& states) {
  equations_.origin = span.all.t;
  equations_.set_time(0.0);
  if (!done_.spans) list_angles(states, &equations_);
  for (ContactEquations::BodyJoint& joint : equations_.joints) {
    JointState state = states[static_cast<std::size_t>(joint.index)];
    joint.course.begin(joint.joint, step, state);
    joint.is_at_end = state.saturated && has_length(joint.joint.kind);
  }
  for (ContactEquations::Coordinate& of : equations_.coordinates) {
    const ContactEquations::BodyJoint& joint = equations_.joints[of.joint];
    of.reference = 0.0;
    of.state = {};
    if (of.law.is_distance) {
      if (!of.law.soft.is_none()) of.law.soft.R = joint.course.length(span.all.t).value;
      continue;
    }
    const auto i = static_cast<std::size_t>(of.law.coordinate);
    const CoordinateState& now = states[static_cast<std::size_t>(joint.index)].coordinates[i];
    if (!done_.spans) of.braking = now.braking;
    if (of.law.drive == 0.0) continue;
    of.motor = *joint.joint.coordinates[i].motor;
    if (of.motor.timeout > 0.0 && now.expires_at <= span.all.t) of.motor.bias = 0.0;
  }
  if (!done_.spans) reports_.begin_step(equations_);
  done_.spans = true;
}

// Integrates the angles of joints to the present time, or takes their rates where velocities have
// jumped.
void ContactEvents::note_angles() {
  const List<BodyState>& states = equations_.states();
  equations_.angles.integrate(
      equations_.time(), [&](std::size_t body) { return states[body].angular_velocity; },
      [&](const TurnedAngles::Angle& angle) -> Vector3d {
        const JointVectors vectors(equations_.joints[angle.joint].joint, states[angle.a],
                                   states[angle.b]);
        return (angle.is_about_b ? vectors.axes_B : vectors.axes_A).col(2);
      });
}

// Moves a yielding limit of a length along with the length.
void ContactEvents::give_way(std::size_t c) {
  ContactEquations::Coordinate& of = equations_.coordinates[c];
  if (of.state.yield == 0) return;
  of.given_way += equations_.read(of, nullptr).q - equations_.limit(of, of.state.yield > 0).value;
}

IntegrationResult ContactEvents::advance(const Interval& all, const IntegratorOptions& accuracy,
                                         const JointStep& joint_step,
                                         const List<JointState>& joint_states, double most_work,
                                         List<BodyState>* states) {
  solver_.begin_interval(most_work, all.stop);
  Span span{all, accuracy, SubstepSpan(0.0, all.h), {}};
  equations_.gather_state(*states, all.since_tick);
  equations_.gravity = all.gravity;
  for (ContactEquations::Body& body : equations_.bodies) {
    body.force.setZero();
    body.torque.setZero();
    for (const AppliedWrench& load : all.loads) {
      if (load.body != body.index) continue;
      body.force += load.force;
      body.torque += load.torque;
    }
  }
  if (closes_) {
    equations_.prepare_stages();
    begin_joints(span, joint_step, joint_states);
    span.progress.done =
        closing_.close(pairs_.list(), &solver_, &equations_, &span.progress.corrected);
    if (!span.progress.done) return span.progress;
    equations_.scatter_state(states);
    span.progress.done = begin(*states, false);
    if (!span.progress.done) return span.progress;
  } else if (!done_.spans && unchanged_.is_repeated_by(all, equations_, pairs_.list())) {
    done_.spans = true;
    for (ContactPair& pair : pairs_.list()) pair.forget();  // as after reporting
    unchanged_.repeat(&equations_);
    equations_.scatter_state(states);
    return span.progress;
  }
  const bool is_first = !done_.spans && equations_.joints.empty();
  if (is_first) unchanged_.begin(all, equations_, pairs_.list());
  equations_.prepare_stages();
  begin_joints(span, joint_step, joint_states);
  const std::size_t n = equations_.size();
  numbers_.assign(StageMemory::kRows * n, 0.0);
  std::copy(equations_.numbers().begin(), equations_.numbers().end(), numbers_.begin());
  step_ = all.h;
  watched_.is_muted.clear();
  bool is_done = settle(&span, {}, true);
  while (is_done && span.left.left > 0.0) is_done = advance_to_event(&span);
  if (is_done && is_first && span.progress.substeps + span.progress.rejected == 0 &&
      reports_.told().empty() && done_.events == 0)
    unchanged_.end(equations_);
  note_angles();
  reports_.end_interval(equations_);
  for (std::size_t c = 0; c < equations_.coordinates.size(); ++c) give_way(c);
  equations_.scatter_state(states);
  span.progress.done = is_done;
  return span.progress;
}

double* ContactEvents::derivative() {
  return numbers_.data() + StageMemory::kDerivatives * equations_.size();
}

// ---- between events

void ContactEvents::watch(List<Watched>* list) {
  watch_.list(equations_, pairs_, derivative(), has_stages_, list);
}

bool ContactEvents::take(Span* span, SubstepSpan* left, double tolerance, double* step) {
  const auto acting = static_cast<double>(
      std::count_if(equations_.contacts.begin(), equations_.contacts.end(),
                    [](const auto& contact) { return contact.acts != Acts::kOpen; }));
  solver_.add(1.0 + acting * acting / 16.0);
  const StageMemory memory(numbers_.data(), equations_.size());
  const SubstepLimits limits{tolerance, span->accuracy.most_attempts, span->all.stop};
  return span->accuracy.order == 5 ? take_substep<DormandPrince5>(equations_, memory, limits, *left,
                                                                  *step, span->progress)
                                   : take_substep<DormandPrince8>(equations_, memory, limits, *left,
                                                                  *step, span->progress);
}

// Repeats a substep of length h from the start of the last one, at time t. `is_start`: only returns
// to the start.
bool ContactEvents::repeat(Span* span, double t, double h, bool is_start) {
  if (solver_.is_used_up()) return false;
  const std::size_t n = equations_.size();
  std::copy(kept_.begin(), kept_.begin() + static_cast<std::ptrdiff_t>(n), numbers_.begin());
  std::copy(kept_.begin() + static_cast<std::ptrdiff_t>(n), kept_.end(), derivative());
  equations_.restore();
  equations_.set_time(t);
  equations_.place(numbers_.data());
  if (is_start) return true;
  SubstepSpan left(t, h);
  double step = h;
  const int rejected = span->progress.rejected;
  const double error = span->progress.local_error;
  const bool is_taken =
      take(span, &left, 0.0, &step) && left.left == 0.0 && span->progress.rejected == rejected;
  error_ = span->progress.local_error - error;
  return is_taken;
}

// Starts or ends straight slips. Returns false where no velocities meet the rows.
bool ContactEvents::go_straight(bool is_straight) {
  if (is_straight == equations_.is_straight) return true;
  equations_.is_straight = is_straight;
  return equations_.restart(numbers_.data(), derivative(), nullptr);
}

// Makes a substep from the saved state and derivative.
bool ContactEvents::take_first(Span* span, double* step) {
  const double tolerance = span->accuracy.tolerance, first = *step;
  if (equations_.is_straight) {
    const SubstepSpan start = span->left;
    if (take(span, &span->left, tolerance, step) &&
        was_straight(equations_, start.left - span->left.left, tolerance))
      return true;
    const auto n = static_cast<std::ptrdiff_t>(equations_.size());
    std::copy(kept_.begin(), kept_.begin() + n, numbers_.begin());
    equations_.restore();
    equations_.set_time(start.t);
    equations_.place(numbers_.data());
    span->left = start;
    span->progress.is_inconsistent = false;
    *step = first;
    if (!go_straight(false)) return false;
    watch(&watched_.before);
    std::copy(derivative(), derivative() + n, kept_.begin() + n);
  }
  return take(span, &span->left, tolerance, step);
}

bool ContactEvents::advance_to_event(Span* span) {
  if (solver_.is_stopped() || solver_.is_used_up()) return false;
  pairs_.find_features(false, false, &equations_);
  set_directions(&equations_);
  note_angles();
  if (!equations_.has_movers() && !equations_.is_moved_by_motors() &&
      equations_.is_still(derivative())) {  // nothing will move in the interval
    equations_.accept_stillness(span->left.left);
    span->left.left = 0.0;
    return true;
  }
  has_stages_ = false;
  double step = std::min(step_, pairs_.longest_substep(span->left.left, equations_));
  if (!go_straight(span->accuracy.tolerance > 0.0 && turns_fast(equations_, step))) return false;
  watch(&watched_.before);
  const std::size_t n = equations_.size();
  kept_.assign(numbers_.begin(), numbers_.begin() + static_cast<std::ptrdiff_t>(n));
  kept_.insert(kept_.end(), derivative(), derivative() + n);
  equations_.keep();
  const SubstepSpan start = span->left;
  if (!take_first(span, &step)) return end_jam(span);
  const double h = start.left - span->left.left;
  step_ = step;
  const auto look = [&] {
    pairs_.find_features(false, true, &equations_);
    has_stages_ = span->accuracy.order == 8;
    watch(&watched_.after);
  };
  look();
  std::optional<Crossing> event = watched_.earliest(watched_.before, watched_.after, h, true);
  const auto go_to = [&](double share, bool is_start) {
    if (!repeat(span, start.t, share * h, is_start)) return false;
    span->left = is_start ? start : gone_on(start, share * h);
    look();
    return true;
  };
  error_ = 0.0;
  if (event && !watched_.locate(start.t, h, go_to, &event)) return false;
  // Where a slip is about to end or turn, a substep may be accepted by luck; the error of its
  // repeated part shows it.
  const double tolerance = span->accuracy.tolerance;
  const bool is_poor = tolerance > 0.0 && error_ > std::max(tolerance * h, equations_.rounding());
  if (is_poor || pairs_.has_missed(equations_)) {
    step_ = 0.5 * (start.left - span->left.left);
    if (!go_to(0.0, true)) return false;
    return ++done_.missed <= kMostMissed;
  }
  if (event) return finish_event(span, watched_.after[event->which], event->which);
  watched_.is_muted.clear();
  return true;
}

// Handles substeps that become ever shorter: forces grow without bound where friction is about to
// jam.
bool ContactEvents::end_jam(Span* span) {
  const bool any_slips = std::any_of(
      equations_.contacts.begin(), equations_.contacts.end(),
      [](const auto& contact) { return contact.acts == Acts::kSlips && contact.friction > 0.0; });
  if (solver_.is_stopped() || !any_slips || ++done_.jams > kMostJams) return false;
  ++done_.events;
  span->left.failures = 0;
  span->progress.is_inconsistent = false;
  equations_.restore();
  equations_.set_time(span->left.t);
  equations_.place(numbers_.data());
  return settle(span, {}, false, true);
}

bool ContactEvents::finish_event(Span* span, const Watched& watched, std::size_t which) {
  if (++done_.events > kMostEvents) return false;
  note_angles();
  const std::size_t watches = watched_.before.size();
  const std::uint32_t impacts = impacts_.count(), breaks = done_.breaks;
  if (watched.kind == Watched::Kind::kBreak) break_joint(*span, watched.joint);
  if (!settle(span, watched, false)) return false;
  const bool is_changed = impacts != impacts_.count() || breaks != done_.breaks ||
                          watched.kind == Watched::Kind::kSlip || states_.has_changed(equations_);
  if (is_changed) {
    watched_.is_muted.clear();
    return true;
  }
  watched_.is_muted.resize(watches, 0);
  watched_.is_muted[which] = 1;
  return ++done_.unchanged <= kMostUnchanged;
}

// ---- at events

// Decides the states of all contacts and laws at an event. `event`: the watched value that passed
// zero and ended the last substep; kNothing at the start of an interval. `jams`: slipping contacts
// have no motion to continue.
bool ContactEvents::settle(Span* span, const Watched& event, bool is_begin, bool jams) {
  double* const y = numbers_.data();
  const double t = span->all.t + span->left.t;
  has_stages_ = equations_.is_straight = false;
  states_.begin_event(equations_);
  pairs_.find_features(!is_begin && event.kind == Watched::Kind::kMargin, false, &equations_);
  states_.note_bounds(t, span->all.h, event, equations_);
  impacts_.begin_event(equations_);
  const auto decide = [&](const Watched& at) {
    return states_.decide(at, y, pairs_, &solver_, &equations_);
  };
  const auto have_jam = [&] { return impacts_.have_jam(&solver_, &equations_, y); };
  if (jams && !have_jam()) return false;
  if (!impacts_.have_impacts(span->left.left, is_begin, pairs_, &states_, &solver_, &equations_, y))
    return false;
  if (!decide(event) && !(have_jam() && decide({}))) return false;
  states_.hold_coordinates(is_begin, &equations_);
  const double kinetic = equations_.kinetic_energy(), potential = equations_.potential_energy();
  before_projection_.assign(y, y + equations_.size());
  if (!equations_.project(span->left.t, y)) return false;
  const bool is_known = equations_.coordinates.empty() &&
                        have_same_bits(before_projection_.data(), y, equations_.size());
  if (!equations_.restart(y, derivative(), is_known ? states_.derivative() : nullptr)) return false;
  span->progress.projected += kinetic - equations_.kinetic_energy();
  span->progress.corrected += equations_.potential_energy() - potential;
  reports_.add({span->all.t, t, is_begin, states_.acts_before(), states_.coordinates_before(),
                impacts_.impulses(), impacts_.rests_in()},
               equations_, &pairs_);
  return break_overloaded(span);
}

void ContactEvents::break_joint(const Span& span, std::size_t joint) {
  ++done_.breaks;
  equations_.break_joint(joint);
  reports_.add_break(span.all.t + span.left.t, joint);
}

// Breaks joints that are overloaded, as after another joint let go. The most overloaded joint
// breaks first, since it may relieve the others.
bool ContactEvents::break_overloaded(Span* span) {
  List<Watched> loads;
  for (std::size_t j = 0; j < equations_.joints.size(); ++j)
    watch_breaking(equations_, j, false, &loads);
  const auto worst =
      std::min_element(loads.begin(), loads.end(), [](const Watched& left, const Watched& right) {
        return left.value / left.tolerance < right.value / right.tolerance;
      });
  if (worst == loads.end() || worst->value >= -worst->tolerance) return true;
  ++done_.events;
  break_joint(*span, worst->joint);
  return settle(span, {}, false);
}

}  // namespace constraint_sim::engine
