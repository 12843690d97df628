#include "engine/methods/event_driven/joints/event_driven.h"

#include <algorithm>
#include <cmath>

#include "engine/constraints/joint_kinds.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/methods/event_driven/joints/event_span.h"
#include "engine/methods/event_driven/joints/law_events.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr std::uint32_t kMostEvents = 5000;  // per step
// Shortest prescribed motion [s]; an event may be at the end of an interval.
constexpr double kShortest = 1e-12;

// Returns a coordinate as the equations have counted it up to their state, or `noted` where the
// joint is not in the equations.
double counted(const EquationsOfMotion& equations, std::size_t joint, int coordinate,
               double noted) {
  const List<int>& joints = equations.joints();
  const auto found = std::find(joints.begin(), joints.end(), static_cast<int>(joint));
  std::array<double, kMaxCoordinates> positions;
  if (found == joints.end() ||
      !equations.coordinates().read(equations, to_index(found - joints.begin()), &positions) ||
      std::isnan(positions[to_index(coordinate)]))
    return noted;
  return positions[to_index(coordinate)];
}

}  // namespace

// ---- compilation

EventDriven::EventDriven(const EventDriven& other) = default;
EventDriven::EventDriven(EventDriven&& other) noexcept = default;
EventDriven& EventDriven::operator=(const EventDriven& other) = default;
EventDriven& EventDriven::operator=(EventDriven&& other) noexcept = default;
EventDriven::~EventDriven() = default;

EventDriven::EventDriven(const List<int>& members, const List<Joint>& all_joints, const Ends& ends,
                         const List<CoupledTerms>& couplings, const List<MassProperties>& masses,
                         const List<char>& open)
    : members_(members), bare_({}, {}, {}, masses) {
  for (const int j : members_) {
    const Joint& joint = all_joints[j];
    const std::size_t l = joints_.size();
    joints_.push_back(joint);
    joints_.back().name.clear();  // copies then allocate nothing
    ends_.push_back(ends[j]);
    if (!open.empty()) open_.push_back(open[j]);
    first_law_.push_back(laws_.size());
    add_one_sided_laws(joint, l, &laws_);
    if ((joint.break_force > 0.0 || joint.break_torque > 0.0) && !couples_joints(joint.kind)) {
      const auto most = [](double force) { return force > 0.0 ? force : kInfinity; };
      breaking_.push_back({l, most(joint.break_force), most(joint.break_torque)});
    }
    if (!couples(joint.kind)) continue;
    couplings_.resize(members_.size());
    couplings_[l] = couplings[j];
    for (CoupledTerm& term : couplings_[l]) {
      const auto found = std::find(members_.begin(), members_.end(), static_cast<int>(term.joint));
      term.joint = static_cast<std::size_t>(found - members_.begin());
    }
  }
  first_law_.push_back(laws_.size());
  is_broken_.assign(joints_.size(), 0);
  states_.resize(laws_.size());
  compiled_for_ = states_;
  broken_then_ = is_broken_;
  held_.assign(laws_.size(), 0.0);
  braking_ = held_;
  joint_states_.resize(joints_.size());
  base_.assign(joints_.size(), 0.0);
  is_at_end_.assign(joints_.size(), 0);
  impulses_.assign(joints_.size(), RowVector::Zero());
  coupled_impulses_.assign(joints_.size(), 0.0);
  for (std::size_t l = 0; l < joints_.size(); ++l) {
    bare_joints_.push_back(joints_[l]);
    switched(l, states_, &bare_joints_.back());
  }
  switched_joints_ = bare_joints_;
  courses_.resize(joints_.size());
  bare_courses_.resize(joints_.size());
  bare_ = compile(states_, masses);
}

std::pair<std::size_t, std::size_t> EventDriven::laws_of(std::size_t joint) const {
  return {first_law_[joint], first_law_[joint + 1] - first_law_[joint]};
}

// Copies a joint with its rows as the states say. Returns false where the joint does not act.
bool EventDriven::switched(std::size_t joint, const List<OneSidedState>& states,
                           Joint* result) const {
  *result = joints_[joint];
  if (is_broken_[joint]) return false;
  const auto [first, count] = laws_of(joint);
  return with_rows_switched(laws_.data() + first, states.data() + first, count, result);
}

EquationsOfMotion EventDriven::compile(const List<OneSidedState>& states,
                                       const List<MassProperties>& masses) const {
  List<Joint> joints = joints_;
  List<int> acting, idle;
  for (std::size_t l = 0; l < joints_.size(); ++l)
    (switched(l, states, &joints[l]) ? acting : idle).push_back(static_cast<int>(l));
  return {acting, joints, ends_, masses, couplings_, idle, open_};
}

// Compiles the bare equations and the equations of the rows that act.
void EventDriven::compile_again(const List<MassProperties>& masses, RungeKutta* motion) {
  bare_ = compile(List<OneSidedState>(laws_.size()), masses);
  std::swap(is_broken_, broken_then_);
  *motion = RungeKutta(compile(compiled_for_, masses));
  std::swap(is_broken_, broken_then_);
}

// ---- kinematics

// State of a body at t. Kinematic bodies are given at the start of the tick.
BodyState EventDriven::body(const Span& span, int body, double t) const {
  BodyState state = (*span.states)[body];
  if (span.around.masses[body].is_movable()) return state;
  const double since = t - (span.all.t - span.all.since_tick);
  state.position += since * state.linear_velocity;
  if (!state.angular_velocity.isZero(0.0))
    state.orientation = rotation(since * state.angular_velocity) * state.orientation;
  return state;
}

EventDriven::Reading EventDriven::read(const Span& span, const OneSidedLaw& law, double t,
                                       const EquationsOfMotion& equations,
                                       const Motions& rates) const {
  if (law.is_coupling) {
    Reading sum;
    for (const CoupledTerm& term : couplings_[law.joint]) {
      const auto i = static_cast<std::size_t>(term.coordinate);
      OneSidedLaw of_term;
      of_term.joint = term.joint;
      of_term.coordinate = term.coordinate;
      of_term.form = info(joints_[term.joint].kind).coordinate[i];
      of_term.zero = joints_[term.joint].coordinates[i].zero;
      const Reading now = read(span, of_term, t, equations, rates);
      sum.q += term.ratio * now.q;
      sum.rate += term.ratio * now.rate;
      sum.acceleration += term.ratio * now.acceleration;
      const bool is_first = &term == couplings_[law.joint].data();
      (is_first ? sum.J : sum.J_second) = combined(term.ratio, now.J, 0.0, now.J);
    }
    return sum;
  }
  const Joint& joint = joints_[law.joint];
  const auto [end_a, end_b] = ends_[law.joint];
  const BodyState a = body(span, static_cast<int>(end_a), t);
  const BodyState b = body(span, static_cast<int>(end_b), t);
  const PrescribedMotion& course = courses_[law.joint];
  MovingFrame frame;
  if (!law.is_distance && course.moves_frame())
    frame = course.frame(t, joint.anchor_b, joint.frame_b->toRotationMatrix());
  const JointVectors vectors(joint, a, b, frame);
  JointMotion motion(vectors, a, b);
  if (frame.moves) motion.add(frame, b.orientation.toRotationMatrix());
  Reading reading;
  const double reference =
      law.is_distance ? 0.0
                      : counted(equations, law.joint, law.coordinate,
                                joint_states_[law.joint].coordinates[law.coordinate].position);
  reading.q = engine::reading(law.form, value(law.form, vectors), law.zero, reference);
  reading.rate = rate(law.form, vectors, motion);
  reading.J = jacobian(law.form, vectors);
  Vector3d linear[2], angular[2];
  const std::size_t of_joint[2] = {end_a, end_b};
  for (int k = 0; k < 2; ++k) {
    linear[k].setZero();
    angular[k].setZero();
    const List<int>& bodies = equations.bodies();
    const auto found = std::find(bodies.begin(), bodies.end(), static_cast<int>(of_joint[k]));
    if (found == bodies.end()) continue;
    linear[k] = rates.linear[static_cast<std::size_t>(found - bodies.begin())];
    angular[k] = rates.angular[static_cast<std::size_t>(found - bodies.begin())];
  }
  reading.acceleration = reading.J.times(linear[0], angular[0], linear[1], angular[1]) +
                         gamma(law.form, vectors, motion);
  return reading;
}

// Takes over the coordinates at the end of a substep, with whole turns.
void EventDriven::note_positions(const Span& span, double t) {
  for (std::size_t l = 0; l < joints_.size(); ++l) {
    const JointKindInfo& kind = info(joints_[l].kind);
    if (kind.coordinates == 0) continue;
    MovingFrame frame;
    if (courses_[l].moves_frame())
      frame = courses_[l].frame(t, joints_[l].anchor_b, joints_[l].frame_b->toRotationMatrix());
    const JointVectors vectors(joints_[l], body(span, static_cast<int>(ends_[l].first), t),
                               body(span, static_cast<int>(ends_[l].second), t), frame);
    for (int i = 0; i < kind.coordinates; ++i) {
      double& position = joint_states_[l].coordinates[i].position;
      const ScalarForm& form = kind.coordinate[i];
      position = reading(form, value(form, vectors), joints_[l].coordinates[i].zero,
                         counted(span.motion->equations(), l, i, position));
    }
  }
}

// Position and motion of a limit. A motor moves the limit of a length; an initial violation is
// closed in time.
Prescribed EventDriven::limit(std::size_t c, bool upper_one, double t) const {
  const OneSidedLaw& law = laws_[c];
  const PrescribedMotion& course = courses_[law.joint];
  const JointState& state = joint_states_[law.joint];
  if (law.is_coupling) {
    Prescribed at_limit = course.coupling(t);
    at_limit.value += state.coupling.constant;
    return at_limit;
  }
  // The offset of a motor with a goal belongs to its prescribed motion.
  const bool has_offset = course.is_closing() && !law.goal;
  const double offset = has_offset ? state.closing_offset[law.function] : 0.0;
  const bool is_open = (upper_one ? offset > 0.0 : offset < 0.0);
  const Prescribed share = course.share_to_close(t);
  Prescribed at_limit;
  if (law.is_distance) {
    at_limit = course.length(t);
    at_limit.value -= base_[law.joint];
    if (offset != 0.0 && !is_open) {
      at_limit.value -= offset * share.value;
      at_limit.rate -= offset * share.rate;
      at_limit.acceleration -= offset * share.acceleration;
    }
  } else if (is_open) {
    at_limit = {offset * share.value, offset * share.rate, offset * share.acceleration};
  }
  at_limit.value += law.limit(upper_one);
  return at_limit;
}

double EventDriven::travel(std::size_t joint, double t) const {
  const PrescribedMotion& course = courses_[joint];
  const double closing =
      course.is_closing() ? joint_states_[joint].closing_offset[0] * course.share_to_close(t).value
                          : 0.0;
  return course.length(t).value - closing - base_[joint];
}

// Sets the rows of a joint to the current states, for its prescribed motion.
void EventDriven::set_rows(std::size_t l) {
  Joint& joint = switched_joints_[l];
  switched(l, states_, &joint);
  const auto [first, count] = laws_of(l);
  if (count > 0 && laws_[first].is_distance) {
    const OneSidedLaw& law = laws_[first];
    const Hold hold = states_[first].hold;
    joint = joints_[l];  // the motor also moves a limit that is not reached
    joint.motor.max_force = 0.0;
    if (joint.distance.is_limited() && !joint.distance.is_soft())
      joint.distance.length = law.limit(hold != Hold::kLower && std::isfinite(law.upper));
    else if (hold == Hold::kUpper || hold == Hold::kLower)
      joint.distance.length = law.limit(hold == Hold::kUpper);
  }
  base_[l] = joint.distance.length.value_or(0.0);
}

// Starts the prescribed motion of a joint at t.
void EventDriven::begin_course(const Span& span, std::size_t l, double t) {
  JointState told = joint_states_[l];
  const auto [first, count] = laws_of(l);
  for (std::size_t c = first; c < first + count; ++c) {
    const OneSidedLaw& law = laws_[c];
    if (law.is_rope()) continue;
    CoordinateState& coordinate = told.coordinates[law.coordinate];
    const Hold hold = states_[c].hold;
    double& offset = told.closing_offset[law.function];
    if (hold == Hold::kUpper || hold == Hold::kLower) {
      coordinate.held = law.limit(hold == Hold::kUpper);
      if (law.goal || (hold == Hold::kUpper ? offset < 0.0 : offset > 0.0)) offset = 0.0;
    } else if (hold == Hold::kBrake) {
      offset = 0.0;
    } else if (hold != Hold::kNone && !(law.goal && hold == Hold::kDrive)) {
      coordinate.held = held_[c];
      offset = 0.0;
    }
  }
  JointStep step = span.around.step;
  step.t = t;
  step.h = std::max(span.left.end - t, kShortest);
  courses_[l].begin(switched_joints_[l], step, told);
  for (std::size_t c = first; c < first + count; ++c)
    if (states_[c].hold == Hold::kBrake && laws_[c].goal)
      courses_[l].brake(laws_[c].coordinate, held_[c],
                        std::copysign(braking_[c], told.coordinates[laws_[c].coordinate].position -
                                                       *laws_[c].goal));
}

// Starts the prescribed motions of an interval. Returns whether all of them continue.
bool EventDriven::begin_courses(const Span& span) {
  bool goes_on = true;
  for (std::size_t l = 0; l < joints_.size(); ++l) {
    const PrescribedMotion before = courses_[l];
    if (!has_started_) set_rows(l);
    begin_course(span, l, span.all.t);
    goes_on = goes_on && courses_[l].is_driven_as(before) &&
              courses_[l].is_closing() == before.is_closing();
    JointState told = joint_states_[l];
    bare_courses_[l].begin(bare_joints_[l], span.around.step, told);
    is_at_end_[l] = has_length(joints_[l].kind) && told.saturated ? 1 : 0;
  }
  return goes_on;
}

// ---- a step

void EventDriven::begin_step(const List<JointState>& joint_states, RungeKutta* motion) {
  for (std::size_t l = 0; l < joints_.size(); ++l) {
    joint_states_[l] = joint_states[members_[l]];
    impulses_[l].setZero();
    coupled_impulses_[l] = 0.0;
  }
  for (std::size_t c = 0; c < laws_.size(); ++c)
    braking_[c] = joint_states_[laws_[c].joint].coordinates[laws_[c].coordinate].braking;
  events_ = 0;
  told_.clear();
  unchanged_ = 0;
  motion->begin_step(joint_states_);
}

void EventDriven::collect(const List<BodyState>& states, RungeKutta* motion) {
  const EquationsOfMotion& equations = motion->equations();
  const bool shares = equations.delassus().redundant() > 0;
  if (shares && !least_forces_) least_forces_.emplace(equations);
  if (shares) least_forces_->share(equations, states);
  const LeastNormForces* const shared = shares ? &*least_forces_ : nullptr;
  for (std::size_t k = 0; k < equations.joints().size(); ++k) {
    const std::size_t l = to_index(equations.joints()[k]);
    impulses_[l] +=
        shared ? shared->impulse(equations, k) : equations.forces().impulse(equations, k);
    if (equations.coupled_rows().empty() || !couples(joints_[l].kind)) continue;
    coupled_impulses_[l] += shared ? shared->coupled_impulse(equations, k)
                                   : equations.forces().coupled_impulse(equations, k);
  }
  motion->begin_step(joint_states_);
}

void EventDriven::write(std::size_t l, JointState* state,
                        std::array<double, kMaxCoordinates>* positions) const {
  for (std::size_t i = 0; i < kMaxCoordinates; ++i)
    (*positions)[i] = joint_states_[l].coordinates[i].position;
  if (is_broken_[l]) state->broken = true;
  const auto [first, count] = laws_of(l);
  for (std::size_t c = first; c < first + count; ++c) {
    const OneSidedLaw& law = laws_[c];
    state->saturated = joint_states_[l].saturated;
    if (law.drive == 0.0 && law.limit_force == kInfinity) continue;
    if (law.is_distance)
      state->travel = held_[c];
    else if (law.goal) {
      state->coordinates[law.coordinate].braking = braking_[c];
      state->coordinates[law.coordinate].held =
          braking_[c] > 0.0 ? joint_states_[l].coordinates[law.coordinate].position : *law.goal;
    } else
      state->coordinates[law.coordinate].held =
          states_[c].hold == Hold::kDrive ? held_[c]
                                          : joint_states_[l].coordinates[law.coordinate].position;
    if (states_[c].is_saturated() && law.is_distance) state->closing = false;
  }
}

Interval EventDriven::rest_of(const Span& span) const {
  return {span.left.t,    span.left.left, span.all.gravity,
          span.all.loads, courses_,       true,
          true,           span.all.stop,  span.all.since_tick + (span.left.t - span.all.t)};
}

IntegrationResult EventDriven::advance(const Interval& all, const IntegratorOptions& accuracy,
                                       const Surroundings& around, RungeKutta* motion,
                                       List<BodyState>* states) {
  Span span{all, accuracy, around, motion, states, SubstepSpan(all.t, all.h), {}};
  bool is_done = begin_span(&span);
  while (is_done && span.left.left > 0.0) is_done = advance_to_event(&span);
  if (is_done) {
    for (std::size_t c = 0; c < laws_.size(); ++c) hold_from(span, c);
    note_saturated(span);
  } else {
    has_started_ = false;
    motion->forget();
  }
  span.progress.done = is_done;
  return span.progress;
}

// Sets the held value of a law for the next interval. A length that has yielded is held where it
// is.
void EventDriven::hold_from(const Span& span, std::size_t c) {
  const OneSidedLaw& law = laws_[c];
  const double t = span.left.end;
  if (!law.is_distance) {
    if (states_[c].hold == Hold::kDrive)
      held_[c] = courses_[law.joint].target(law.function, t).value + law.zero;
    return;
  }
  held_[c] = travel(law.joint, t);
  const OneSidedState& state = states_[c];
  if (state.drive == 0 && state.yield == 0) return;
  const double q = read(span, law, t, span.motion->equations(), rates_).q;
  held_[c] +=
      q - (state.drive != 0 ? courses_[law.joint].length(t) : limit(c, state.yield > 0, t)).value;
}

bool EventDriven::begin_span(Span* span) {
  // A rejected step has broken no joint.
  if (!has_started_ && std::find(is_broken_.begin(), is_broken_.end(), 1) != is_broken_.end()) {
    is_broken_.assign(joints_.size(), 0);
    bare_ = compile(List<OneSidedState>(laws_.size()), span->around.masses);
  }
  if (!has_started_) states_.assign(laws_.size(), {});
  for (std::size_t l = 0; l < joints_.size(); ++l) {  // except the positions of coordinates
    JointState& state = joint_states_[l];
    const auto coordinates_before = state.coordinates;
    state = span->around.joint_states[members_[l]];
    for (std::size_t i = 0; i < kMaxCoordinates; ++i)
      state.coordinates[i].position = coordinates_before[i].position;
    if (!has_started_) continue;
    const auto [first, count] = laws_of(l);
    for (std::size_t c = first; c < first + count; ++c)
      if (laws_[c].is_distance && (laws_[c].drive > 0.0 || std::isfinite(laws_[c].limit_force)))
        state.travel = held_[c];
  }
  const bool goes_on = begin_courses(*span);
  const bool is_settled = has_started_ && goes_on && !span->all.is_disturbed;
  watched_.is_muted.clear();
  if (!is_settled) {
    bool had_impacts = false;
    const bool is_done = settle(span, {}, true, &had_impacts);
    span->begins = false;
    return is_done;
  }
  span->begins = false;
  Interval now = rest_of(*span);
  now.is_disturbed = now.is_edited = false;
  const IntegrationResult begun = span->motion->begin(now, span->accuracy, *span->states);
  span->progress.projected += begun.projected;
  if (begun.done) watch(*span, span->left.t, &watched_.before);
  return begun.done;
}

// ---- between events

// Makes the next substep, or the part of it before an event.
bool EventDriven::advance_to_event(Span* span) {
  RungeKutta& motion = *span->motion;
  const SubstepSpan start = span->left;
  motion.keep_start();
  if (!motion.advance_substep(rest_of(*span), span->accuracy, &span->left, &span->progress))
    return false;
  const double h = start.left - span->left.left;
  motion.equations().scatter_state(motion.state(), span->states);
  watch(*span, span->left.t, &watched_.after);
  std::optional<Crossing> event = watched_.earliest(watched_.before, watched_.after, h, true);
  if (event && !locate(span, start, h, &event)) return false;
  note_positions(*span, span->left.t);
  std::swap(watched_.before, watched_.after);
  if (event) return finish_event(span, event->which);
  watched_.is_muted.clear();
  return true;
}

// ---- at events

bool EventDriven::finish_event(Span* span, std::size_t which) {
  if (++events_ > kMostEvents) return false;
  const Watched watched = watched_.before[which];
  if (watched.breaks >= 0) break_joint(span, static_cast<std::size_t>(watched.breaks));
  const Release release{watched.known == 0 && watched.law >= 0 ? watched.law : -1, watched.side};
  const List<OneSidedState> states = states_;
  bool had_impacts = false;
  if (!settle(span, release, watched.breaks >= 0, &had_impacts)) return false;
  if (had_impacts || watched.breaks >= 0 || !(states == states_)) {
    watched_.is_muted.clear();
    return true;
  }
  watched_.is_muted.resize(watched_.before.size(), 0);
  watched_.is_muted[which] = 1;
  return ++unchanged_ <= kMostUnchanged;
}

void EventDriven::break_joint(Span* span, std::size_t joint) {
  collect(*span->states, span->motion);
  const auto break_one = [&](std::size_t l) {
    if (!is_broken_[l]) told_.push_back({EventKind::kBroken, span->left.t, l, -1, 0.0});
    is_broken_[l] = 1;
  };
  break_one(joint);
  for (std::size_t l = 0; l < joints_.size(); ++l)  // couplings of the joint
    if (couples_joints(joints_[l].kind))
      for (const CoupledTerm& term : couplings_[l])
        if (term.joint == joint) break_one(l);
  bare_ = compile(List<OneSidedState>(laws_.size()), span->around.masses);
}

}  // namespace constraint_sim::engine
