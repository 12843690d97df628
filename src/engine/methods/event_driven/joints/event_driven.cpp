#include "engine/methods/event_driven/joints/event_driven.h"

#include <algorithm>
#include <cmath>

#include "engine/methods/event_driven/followed_bounces.h"
#include "engine/methods/event_driven/joints/event_impacts.h"
#include "engine/methods/event_driven/law_events.h"
#include "engine/methods/event_driven/staged_substep.h"

namespace constraint_sim::engine {

EventDriven::EventDriven(const EventDriven& other) = default;
EventDriven::EventDriven(EventDriven&& other) noexcept = default;
EventDriven& EventDriven::operator=(const EventDriven& other) = default;
EventDriven& EventDriven::operator=(EventDriven&& other) noexcept = default;
EventDriven::~EventDriven() = default;

EventDriven::EventDriven(const List<int>& members, const List<Joint>& all_joints, const Ends& ends,
                         const List<CoupledTerms>& couplings, const List<MassProperties>& masses,
                         const List<char>& open)
    : motions_(EventJoints(members, all_joints, ends, couplings, open)),
      variants_(motions_.joints(), masses),
      impulses_(members.size()) {}

bool EventDriven::follow_laws(const List<Joint>& all_joints, RungeKutta* motion) {
  return motions_.follow_laws(all_joints) &&
         variants_.follow_laws(motions_.joints(), motions_.broken(), motion);
}

// ---- a step

void EventDriven::begin_step(const List<JointData>& joint_states, RungeKutta* motion) {
  motions_.begin_step(joint_states);
  impulses_.begin_step(joints().size());
  stepper_.begin_step();
  rattling_.begin_step();
  resting_ = kResting;
  reported_.clear();
  motion->begin_step(motions_.joint_states());
}

void EventDriven::collect(const List<BodyState>& states, RungeKutta* motion) {
  impulses_.collect(motions_.joints(), motion->equations(), states);
  motion->begin_step(motions_.joint_states());
}

Interval EventDriven::remaining(const Run& run) const {
  const Interval& whole = run.interval;
  const double since_tick = whole.since_tick + (run.left.t - whole.t);
  return {run.left.t, run.left.left, whole.gravity, whole.loads, motions_.prescribed(),
          true,       true,          whole.stop,    since_tick};
}

IntegrationResult EventDriven::advance(const Interval& interval, const IntegratorOptions& options,
                                       const Surroundings& around, RungeKutta* motion,
                                       List<BodyState>* states) {
  Run run{interval, options, around, motion, states, RemainingInterval(interval.t, interval.h), {}};
  bool is_done = begin_run(&run);
  const auto is_used_up = [&] { return stepper_.work(run.progress) > options.most_work; };
  while (is_done && run.left.left > 0.0 && !is_used_up()) is_done = advance_to_event(&run);
  const bool is_ended = is_done && run.left.left <= 0.0;
  if (is_done)
    motions_.finish(run.bodies(), motion->equations(), rates_,
                    is_ended ? run.left.end : run.left.t);
  const List<char>& broken = motions_.broken();
  if (is_done && !is_ended && std::find(broken.begin(), broken.end(), 1) == broken.end())
    run.progress.found = run.left.t - interval.t;
  stepper_.end_interval(run.progress);
  if (!is_ended) {
    motions_.set_started(false);
    motion->forget();
  }
  run.progress.done = is_ended;
  return run.progress;
}

bool EventDriven::begin_run(Run* run) {
  if (motions_.mend_rejected())
    variants_.compile_bare(motions_.joints(), motions_.broken(), run->around.masses);
  const bool goes_on = motions_.begin_interval(run->around.joint_states, run->around.step,
                                               run->interval.t, run->left.end);
  stepper_.begin_interval();
  const bool is_pushed =
      run->motion->has_other_forces() ||
      (run->interval.is_disturbed && !run->motion->equations().has_loads(run->interval.loads));
  const auto decide_again = [&] {
    bool had_impacts = false;
    const bool is_done = settle(run, {}, true, &had_impacts);
    run->begins = false;
    return is_done;
  };
  if (!motions_.has_started() || !goes_on || run->interval.is_edited) return decide_again();
  if (is_pushed && !motions_.joints().breaking().empty()) return decide_again();
  Interval now = remaining(*run);
  now.is_disturbed = is_pushed;
  now.is_edited = false;
  const IntegrationResult begun = run->motion->begin(now, run->options, *run->states);
  run->progress.projected += begun.projected;
  if (!begun.done) return false;
  watch(*run, 0.0, stepper_.before());
  // Other forces change how laws act only where a value reaches its bound.
  if (is_pushed && !std::all_of(stepper_.before()->begin(), stepper_.before()->end(), is_clear))
    return decide_again();
  run->begins = false;
  return true;
}

// ---- between events

// Watches at the end of a substep of length h [s], or with h = 0 at a start.
void EventDriven::watch(const Run& run, double h, List<WatchedByJoints>* list) {
  const StagedSubstep last(h, stepper_.of_substep(run.options).order);
  watch_joints(motions_, run.bodies(), run.t(), last, run.motion, &rates_, list);
}

// Makes the next substep, or the part of it before an event.
bool EventDriven::advance_to_event(Run* run) {
  RungeKutta& motion = *run->motion;
  const RemainingInterval start = run->left;
  motion.keep_start();
  double* const step = motion.next_step();
  *step = std::min(*step, longest_substep(motions_));
  const auto take = [&](RemainingInterval* part) {
    const Interval now = remaining(*run);
    if (const int order = stepper_.order_to_try(motion.longest_shift(rates_, *run->states))) {
      IntegratorOptions options = run->options;
      options.order = order;
      const bool is_taken = motion.try_substep(now, options, part, &run->progress);
      stepper_.note_try(order, is_taken);
      if (is_taken) return true;
    }
    return motion.advance_substep(now, stepper_.of_substep(run->options), part, &run->progress);
  };
  if (!stepper_.take_substep(run->options, run->progress, take, &run->left, step)) return false;
  motion.scatter(run->states);
  const double length = start.left - run->left.left;
  const auto repeat = [&](double h) {
    const double shift = h - (start.left - run->left.left);
    if (h > 0.0 && run->options.tolerance > 0.0 &&
        std::abs(shift) <= motion.longest_shift(rates_, *run->states) &&
        motion.shift_end(remaining(*run), run->options, run->t(), shift, &run->progress)) {
      motion.scatter(run->states);
      return true;
    }
    stepper_.note_repeat(h, length);
    const bool is_done = motion.repeat_substep(remaining(*run), stepper_.of_substep(run->options),
                                               start.t, h, &run->progress);
    motion.scatter(run->states);
    return is_done;
  };
  const auto list_watched = [&](auto* list) { watch(*run, start.left - run->left.left, list); };
  const auto accept = [&](double) {
    motions_.note_positions(run->bodies(), run->t(), motion.equations());
    return true;
  };
  const auto change = [&](const auto& at, bool* changed) {
    return change_states(run, at, changed);
  };
  return stepper_.end_substep(start, repeat, list_watched, accept, change, &run->left);
}

// ---- at events

bool EventDriven::change_states(Run* run, const WatchedByJoints& watched, bool* is_changed) {
  const bool breaks = watched.breaks >= 0;
  end_rattling(run, watched);
  if (breaks) break_joint(run, static_cast<std::size_t>(watched.breaks));
  const EventRelease release{watched.known == 0 && watched.law >= 0 ? watched.law : -1,
                             watched.side};
  const List<OneSidedState> states = motions_.states();
  bool had_impacts = false;
  if (!settle(run, release, breaks, &had_impacts)) return false;
  *is_changed = had_impacts || breaks || !(states == motions_.states());
  return true;
}

// Looks whether events go on without end, at speeds that no longer matter. Velocities are then off
// by the speed that counts as zero.
void EventDriven::end_rattling(Run* run, const WatchedByJoints& watched) {
  const double speed =
      watched.known == 2 ? std::abs(watched.rate) : 0.0;  // only gaps close at a speed
  const double least = rattling_.zero_speed(run->t(), speed, resting_, Rattling::kMostOfLaws);
  if (least <= resting_) return;
  resting_ = least;
  run->progress.local_error += least * run->left.left;
}

// Decides how the laws act from now on, after the impacts of limits that are hit.
bool EventDriven::settle(Run* run, const EventRelease& release, bool is_changed,
                         bool* had_impacts) {
  EventProblem problem(motions_.laws().size(), resting_);
  EventImpulses::Sums before;
  if (!motions_.joints().breaking().empty()) before = impulses_.sums();
  bool any = false;
  if (!load(run, &problem) || !have_impacts(run, &problem, &any)) return false;
  *had_impacts = *had_impacts || any;
  const std::optional<EventDecision> next = decide_states(*run, problem, release);
  if (!next) return false;
  if (!is_changed && !any && next->states == motions_.states()) return true;
  List<std::size_t> broken = any ? broken_by_impacts(*run, before) : List<std::size_t>();
  report(*run, problem, next->states);
  motions_.change_states(problem, next->states, run->t());
  if (!switch_to_states(run)) return false;
  if (broken.empty()) add_overloaded(&broken);
  if (broken.empty()) return true;
  for (const std::size_t joint : broken) break_joint(run, joint);
  return settle(run, {}, true, had_impacts);
}

// Decides how the laws act next. Motors that lose their prescribed motions take the direction to
// their positions at once.
std::optional<EventDecision> EventDriven::decide_states(const Run& run, const EventProblem& problem,
                                                        const EventRelease& release) {
  while (true) {
    std::optional<EventDecision> next =
        decide(motions_, problem, run.t(), release, bare().largest_force());
    if (!next || !motions_.note_lost(problem, *next)) return next;
  }
}

bool EventDriven::load(Run* run, EventProblem* problem) {
  if (!problem->load(motions_, run->interval, run->bodies(), run->t(), &variants_.bare(),
                     run->states, &run->progress))
    return false;
  motions_.find_lost(*problem, run->t());
  return true;
}

// Solves impacts one after the other until no limit is hit. Limits whose bounces are too low to be
// followed lose their restitution; then all impacts are repeated.
bool EventDriven::have_impacts(Run* run, EventProblem* problem, bool* any) {
  const List<OneSidedLaw>& laws = motions_.laws();
  const List<double> start = problem->state();
  const EventImpulses::Sums impulses = impulses_.sums();
  EquationsOfMotion& bare = variants_.bare();
  List<char> rests(laws.size(), 0);
  int passes = 0;
  for (bool is_settled = false; !is_settled;) {
    List<char> bounced(laws.size(), 0);
    int count = 0;
    for (; count < kMostImpacts; ++count) {
      const List<EventHit> hits = find_hits(motions_, *problem, run->t(), rests);
      if (hits.empty()) break;
      List<double> impulse;
      if (!solve_impact(*problem, hits, &impulse)) return false;
      for (std::size_t i = 0; i < hits.size(); ++i) {
        if (hits[i].restitution > 0.0) bounced[hits[i].law] = 1;
        if (impulse[i] == 0.0) continue;
        problem->add_impulse(hits[i].law, impulse[i], &bare);
        impulses_.add(laws[hits[i].law], impulse[i]);
      }
    }
    if (count == kMostImpacts) return false;
    if (count == 0) return true;
    *any = true;
    // Continue with the motion after the impacts.
    impulses_.collect_bare(motions_.joints(), bare);
    bare.scatter_state(problem->state().data(), run->states);
    if (!load(run, problem) || !let_rest(*run, bounced, problem, &rests, &is_settled)) return false;
    if (is_settled) {
      // Projection turns the rounding of heavy bodies into rates of light ones, which hit again.
      is_settled =
          ++passes == kMostImpactPasses || find_hits(motions_, *problem, run->t(), rests).empty();
      continue;
    }
    const FollowedBounces followed(run->left.left, run->interval.h, run->options.tolerance);
    run->progress.local_error += followed.error;
    impulses_.restore(impulses);
    problem->clear_hits();
    bare.scatter_state(start.data(), run->states);
    if (!load(run, problem)) return false;
  }
  return true;
}

// Finds the limits whose bounces are too low to be followed.
bool EventDriven::let_rest(const Run& run, const List<char>& bounced, EventProblem* problem,
                           List<char>* rests, bool* is_settled) {
  *is_settled = true;
  if (std::find(bounced.begin(), bounced.end(), 1) == bounced.end()) return true;
  const std::optional<EventDecision> next = decide_states(run, *problem, {});
  if (!next) return false;
  const List<OneSidedLaw>& laws = motions_.laws();
  const FollowedBounces followed(run.left.left, run.interval.h, run.options.tolerance);
  for (std::size_t c = 0; c < laws.size(); ++c) {
    if (!bounced[c]) continue;
    const EventReading& reading = problem->reading(c);
    for (const bool upper_one : {false, true}) {
      if (!std::isfinite(laws[c].limit(upper_one))) continue;
      const Prescribed at_limit = motions_.limit(c, upper_one, run.t());
      const double direction = upper_one ? -1.0 : 1.0;
      const double rate = direction * (reading.rate - at_limit.rate);
      const double fall = -direction * (next->acceleration[eigen_index(c)] - at_limit.acceleration);
      if (direction * (reading.q - at_limit.value) > kTouching) continue;
      const std::optional<double> rests_in =
          time_to_rest(rate, fall, laws[c].restitution, followed);
      if (!rests_in) continue;
      problem->set_rests_in(c, *rests_in);
      (*rests)[c] = 1;
      *is_settled = false;
    }
  }
  return true;
}

// Whether the law was saturated at the end of the last step, as reported.
bool EventDriven::was_saturated(const Run& run, std::size_t c, const EventReading& now) const {
  const double t = run.t();
  return run.around.reported[joints()[motions_.laws()[c].joint]].saturated &&
         was_at_force_limit(
             motions_.laws()[c], motions_.laws(),
             [](const OneSidedLaw& law) -> const OneSidedLaw& { return law; }, now,
             motions_.rest(c, t), [&] { return motions_.zeta(c, t, now.q); });
}

// Reports the events of the change from the current states to the next ones.
void EventDriven::report(const Run& run, const EventProblem& problem,
                         const List<OneSidedState>& next) {
  const double t = run.t();
  const bool is_new = run.begins && run.interval.since_tick == 0.0;  // start of a step
  for (std::size_t c = 0; c < motions_.laws().size(); ++c) {
    const OneSidedLaw& law = motions_.laws()[c];
    if (motions_.is_broken(law.joint)) continue;
    const EventReading& now = problem.reading(c);
    OneSidedState before = motions_.states()[c];
    const bool was =
        is_new ? was_saturated(run, c, now) : motions_.is_saturated(c, before, t, now.q);
    if (!motions_.has_started()) {
      before = state_of_motion(law, now, was, motions_.rest(c, t),
                               [&](bool upper_one) { return motions_.limit(c, upper_one, t); });
      if (problem.hit(c) != 0.0) before.hold = Hold::kNone;
    }
    const int coordinate = law.is_rope() ? -1 : law.coordinate;
    const auto add = [&](EventKind kind, double impulse) {
      for (Reported& reported : reported_)  // a rest reported for later does not come
        if (reported.joint == law.joint && reported.coordinate == coordinate)
          reported.time = std::min(reported.time, t);
      const bool rests = kind == EventKind::kLimitReached || kind == EventKind::kRopeTaut;
      reported_.push_back(
          {kind, t + (rests ? problem.rests_in(c) : 0.0), law.joint, coordinate, impulse});
    };
    add_changes(law, before, next[c], problem.hit(c), was,
                motions_.is_saturated(c, next[c], t, now.q),
                !motions_.has_started() && run.interval.t <= 0.0, add);
  }
}

// Continues with the equations of the rows that act now.
bool EventDriven::switch_to_states(Run* run) {
  RungeKutta& motion = *run->motion;
  collect(*run->states, &motion);
  if (variants_.switch_to(motions_.joints(), motions_.states(), motions_.broken(),
                          run->around.masses, &motion))
    impulses_.forget_equations();
  motion.begin_step(motions_.joint_states());
  motion.forget();
  const IntegrationResult begun = motion.begin(remaining(*run), run->options, *run->states);
  run->progress.projected += begun.projected;
  if (!begun.done) return false;
  motion.scatter(run->states);
  motions_.set_started(true);
  watch(*run, 0.0, stepper_.before());
  return true;
}

}  // namespace constraint_sim::engine
