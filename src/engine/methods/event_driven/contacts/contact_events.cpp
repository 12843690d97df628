#include "engine/methods/event_driven/contacts/contact_events.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "engine/collision/box_features.h"
#include "engine/collision/narrowphase.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/joints/law_events.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr std::uint32_t kTaken = std::numeric_limits<std::uint32_t>::max();
constexpr double kFastShare = 0.25;     // share of a thickness that a substep may move by
constexpr double kMostTurn = 1.0;       // [rad] rotation of a box in a substep
constexpr std::uint32_t kMostJams = 4;  // per step
constexpr double kOverlap = 1e-9;       // [m] a deeper overlap was missed
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

// ---- contact features

// Updates the features of all pairs. Acting contacts keep their features, unless `all`. Features of
// two boxes stay unchanged inside a substep (`is_within`).
void ContactEvents::find_features(bool all, bool is_within) {
  List<ContactFeature>& found = found_;
  for (const Pair& pair : pairs_) {
    if (pair.has_fixed_features() || (is_within && pair.is_of_boxes())) continue;
    found.clear();
    add_features(pair.shape_a, equations_.shape_state(pair.a), pair.shape_b,
                 equations_.shape_state(pair.b), &found);
    if (pair.is_of_boxes()) keep_places(pair, all, &found);
    for (std::size_t k = 0; k < pair.count; ++k) {
      ContactEquations::Contact& contact = equations_.contacts[pair.first + k];
      if (all || contact.acts == Acts::kOpen) contact.feature = found[k];
    }
  }
}

// Keeps known edge features in their places in the list of contacts.
void ContactEvents::keep_places(const Pair& pair, bool all, List<ContactFeature>* found) const {
  std::array<ContactFeature, kBoxEdges> edges;
  std::array<char, kBoxEdges> is_free;
  std::copy(found->begin() + kBoxCorners, found->end(), edges.begin());
  is_free.fill(1);
  for (std::size_t k = 0; k < edges.size(); ++k) {
    const ContactEquations::Contact& contact = equations_.contacts[pair.first + kBoxCorners + k];
    if (contact.feature.kind == ContactFeature::Kind::kNothing) continue;
    auto* const same = std::find_if(edges.begin(), edges.end(), [&](const ContactFeature& edge) {
      return edge.id == contact.feature.id;
    });
    if (same == edges.end() && (all || contact.acts == Acts::kOpen)) continue;
    is_free[k] = 0;
    (*found)[kBoxCorners + k] = contact.feature;
    if (same == edges.end()) continue;
    (*found)[kBoxCorners + k] = *same;
    same->id = kTaken;
  }
  auto* next = edges.begin();
  for (std::size_t k = 0; k < edges.size(); ++k) {
    if (!is_free[k]) continue;
    while (next != edges.end() && next->id == kTaken) ++next;
    ContactFeature& place = (*found)[kBoxCorners + k];
    place = {};
    place.kind = ContactFeature::Kind::kNothing;
    if (next != edges.end()) place = *next++;
  }
}

// Whether bodies overlap unnoticed. Two boxes may have met with features that were not watched, and
// no event may be late.
bool ContactEvents::has_missed() {
  bool any = false;
  List<double>& depth = depth_now_;
  depth = depth_;
  for (std::size_t p = 0; p < pairs_.size(); ++p) {
    const Pair& pair = pairs_[p];
    depth[p] = 0.0;
    if (!pair.is_of_boxes()) {
      for (std::size_t c = pair.first; c < pair.first + pair.count; ++c)
        depth[p] = std::max(depth[p], -equations_.motion(equations_.contacts[c]).gap);
      any = any || depth[p] > std::max(kOverlap, depth_[p]);
      continue;
    }
    // Features of only one box: a face separates the boxes.
    const auto is_nothing = [&](std::size_t k) {
      return equations_.contacts[pair.first + k].feature.kind == ContactFeature::Kind::kNothing;
    };
    if (is_nothing(0) != is_nothing(8)) continue;
    depth[p] = -gap_of_boxes(pair);
    any = any || depth[p] > std::max(kOverlap, depth_[p]);
  }
  if (!any) depth_ = depth;
  return any;
}

double ContactEvents::gap_of_boxes(const Pair& pair) const {
  return separation_of_boxes(std::get<Box>(pair.shape_a).size, equations_.shape_state(pair.a),
                             std::get<Box>(pair.shape_b).size, equations_.shape_state(pair.b))
      .gap;
}

std::size_t ContactEvents::most_points(const Shape& a, const Shape& b) {
  const auto is_round = [](const Shape& shape) { return std::holds_alternative<Sphere>(shape); };
  return is_round(a) || is_round(b) ? 1 : 8;
}

// Adds the contacts of all pairs, open.
void ContactEvents::add_contacts() {
  equations_.contacts.clear();
  pair_of_.clear();
  List<ContactFeature>& found = found_;
  for (std::size_t p = 0; p < pairs_.size(); ++p) {
    Pair& pair = pairs_[p];
    found.clear();
    add_features(pair.shape_a, equations_.shape_state(pair.a), pair.shape_b,
                 equations_.shape_state(pair.b), &found);
    pair.first = equations_.contacts.size();
    pair.count = found.size();
    for (const ContactFeature& feature : found) {
      ContactEquations::Contact& contact = equations_.contacts.emplace_back();
      contact.a = pair.a;
      contact.b = pair.b;
      contact.friction = pair.friction;
      contact.restitution = pair.restitution;
      contact.feature = feature;
      pair_of_.push_back(p);
    }
  }
}

bool ContactEvents::begin(const List<BodyState>& states, bool closes) {
  closes_ = closes;
  done_ = {};
  told_.clear();
  for (AtBound* at : {&at_cone_, &at_zero_}) at->contacts.clear();
  equations_.gather_state(states);
  equations_.driven_work = 0.0;
  add_contacts();
  depth_.assign(pairs_.size(), 0.0);
  for (std::size_t p = 0; p < pairs_.size(); ++p) {
    if (pairs_[p].is_of_boxes()) depth_[p] = -gap_of_boxes(pairs_[p]);
    if (!closes && depth_[p] > kMostOverlap) return false;
  }
  for (std::size_t c = 0; c < equations_.contacts.size(); ++c) {
    const double depth = -equations_.motion(equations_.contacts[c]).gap;
    if (!closes && depth > kMostOverlap) return false;
    depth_[pair_of_[c]] = std::max(depth_[pair_of_[c]], depth);
  }
  for (Pair& pair : pairs_) {
    pair.is_still = false;
    for (std::size_t c = pair.first; pair.touched && c < pair.first + pair.count; ++c) {
      const ContactMotion now = equations_.motion(equations_.contacts[c]);
      if (now.gap > kTouching || std::abs(now.gap_rate()) > kResting) continue;
      pair.held = true;
      pair.is_still = pair.is_still || now.slip().norm() <= kResting;
    }
    pair.stuck = pair.stuck && pair.is_still;
  }
  return true;
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
  if (!done_.spans) note_last_states();
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

// Infers the states before the step, as far as the motion shows them.
void ContactEvents::note_last_states() {
  last_states_.clear();
  was_saturated_.clear();
  for (const ContactEquations::Coordinate& of : equations_.coordinates) {
    const ContactEquations::Reading now = equations_.read(of, nullptr);
    const bool was_saturated =
        equations_.joints[of.joint].was_saturated &&
        was_at_force_limit(
            of.law, equations_.coordinates,
            [](const ContactEquations::Coordinate& other) -> const OneSidedLaw& {
              return other.law;
            },
            now, equations_.rest(of), [&] { return equations_.zeta(of); });
    was_saturated_.push_back(was_saturated ? 1 : 0);
    last_states_.push_back(
        state_of_motion(of.law, now, was_saturated, equations_.rest(of),
                        [&](bool upper_one) { return equations_.limit(of, upper_one); }));
  }
}

// Moves a yielding limit of a length along with the length.
void ContactEvents::give_way(std::size_t c) {
  ContactEquations::Coordinate& of = equations_.coordinates[c];
  if (of.state.yield == 0) return;
  of.given_way += equations_.read(of, nullptr).q - equations_.limit(of, of.state.yield > 0).value;
}

void ContactEvents::write(std::size_t c, JointState* state) const {
  const ContactEquations::Coordinate& of = equations_.coordinates[c];
  const OneSidedLaw& law = of.law;
  if (of.is_one_sided) {
    state->saturated = false;
    for (std::size_t d = 0; d < was_saturated_.size(); ++d)
      if (equations_.coordinates[d].joint == of.joint && was_saturated_[d]) state->saturated = true;
  }
  if (law.drive == 0.0 && !std::isfinite(law.limit_force)) return;
  const double q = equations_.read(of, nullptr).q;
  if (!law.is_distance) {
    CoordinateState& coordinate = state->coordinates[static_cast<std::size_t>(law.coordinate)];
    coordinate.braking = of.braking;
    coordinate.held = law.goal && of.braking == 0.0 ? *law.goal : q;
  } else if (law.drive > 0.0)
    state->travel = q - equations_.joints[of.joint].joint.distance.length.value_or(0.0);
  else
    state->travel += of.given_way;
}

IntegrationResult ContactEvents::advance(const Interval& all, const IntegratorOptions& accuracy,
                                         const JointStep& joint_step,
                                         const List<JointState>& joint_states, double most_work,
                                         List<BodyState>* states) {
  most_work_ = most_work;
  stop_ = all.stop;
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
    span.progress.done = close_overlaps(&span, states);
    if (!span.progress.done) return span.progress;
  } else if (is_as_when_still(all)) {
    done_.spans = true;
    go_on_as_when_still(states);
    return span.progress;
  }
  const bool is_first = !done_.spans && equations_.joints.empty();
  if (is_first) note_beginning(all);
  equations_.prepare_stages();
  begin_joints(span, joint_step, joint_states);
  const std::size_t n = equations_.size();
  numbers_.assign(StageMemory::kRows * n, 0.0);
  std::copy(equations_.numbers().begin(), equations_.numbers().end(), numbers_.begin());
  step_ = all.h;
  watched_.is_muted.clear();
  bool is_done = settle(&span, {}, true);
  while (is_done && span.left.left > 0.0) is_done = advance_to_event(&span);
  if (is_done && is_first && span.progress.substeps + span.progress.rejected == 0) note_stillness();
  note_angles();
  for (std::size_t c = 0; c < equations_.coordinates.size(); ++c) {
    last_states_[c] = equations_.coordinates[c].state;
    was_saturated_[c] = is_saturated(c, last_states_[c]) ? 1 : 0;
    give_way(c);
  }
  equations_.scatter_state(states);
  span.progress.done = is_done;
  return span.progress;
}

double* ContactEvents::derivative() {
  return numbers_.data() + StageMemory::kDerivatives * equations_.size();
}

// Longest substep in which no body passes through another and no corner makes a whole turn between
// two evaluations of gaps [s].
double ContactEvents::longest_substep(double left) const {
  double longest = left;
  const double fall = left * equations_.gravity.norm();
  for (std::size_t c = 0; c < equations_.contacts.size(); ++c) {
    const ContactEquations::Contact& contact = equations_.contacts[c];
    const Pair& pair = pairs_[pair_of_[c]];
    if (contact.acts != Acts::kOpen || contact.feature.kind == ContactFeature::Kind::kNothing)
      continue;
    if (!contact.feature.on_a.isZero(0.0) || equations_.is_beside(contact.a))
      longest = std::min(longest, kMostTurn / equations_.state(contact.a).angular_velocity.norm());
    if (pair.is_of_boxes() || equations_.is_beside(contact.b))
      longest = std::min(longest, kMostTurn / equations_.state(contact.b).angular_velocity.norm());
    if (!std::isfinite(pair.thickness)) continue;
    const ContactMotion now = equations_.motion(contact);
    const double way = std::max(now.gap, kFastShare * pair.thickness);
    longest = std::min(longest, way / std::max(now.w.norm() + fall, pair.assumed_speed));
  }
  return longest;
}

void ContactEvents::set_directions() {
  for (ContactEquations::Contact& contact : equations_.contacts) {
    if (contact.acts != Acts::kSlips || contact.friction == 0.0) continue;
    const Vector3d slip = equations_.motion(contact).slip();
    const double speed = slip.norm();
    if (speed > kSlipping) contact.direction = slip / speed;
  }
}

// ---- between events

bool ContactEvents::take(Span* span, SubstepSpan* left, double tolerance, double* step) {
  const auto acting = static_cast<double>(
      std::count_if(equations_.contacts.begin(), equations_.contacts.end(),
                    [](const auto& contact) { return contact.acts != Acts::kOpen; }));
  done_.work += 1.0 + acting * acting / 16.0;
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
  if (done_.work > most_work_) return false;
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

bool ContactEvents::advance_to_event(Span* span) {
  if (is_set(span->all.stop) || done_.work > most_work_) return false;
  find_features(false);
  set_directions();
  note_angles();
  if (!equations_.has_movers() && !equations_.is_moved_by_motors() &&
      equations_.is_still(derivative())) {  // nothing will move in the interval
    equations_.accept_stillness(span->left.left);
    span->left.left = 0.0;
    return true;
  }
  has_stages_ = false;
  double step = std::min(step_, longest_substep(span->left.left));
  if (!go_straight(span->accuracy.tolerance > 0.0 && turns_fast(step))) return false;
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
    find_features(false, true);
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
  if (is_poor || has_missed()) {
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
  if (is_set(span->all.stop) || !any_slips || ++done_.jams > kMostJams) return false;
  ++done_.events;
  span->left.failures = 0;
  span->progress.is_inconsistent = false;
  equations_.restore();
  equations_.set_time(span->left.t);
  equations_.place(numbers_.data());
  return settle(span, {}, false, true);
}

// Whether any state differs from the states before the last event.
bool ContactEvents::has_changed() const {
  for (std::size_t c = 0; c < acts_before_.size(); ++c)
    if (acts_before_[c] != equations_.contacts[c].acts ||
        features_before_[c] != equations_.contacts[c].feature.id)
      return true;
  for (std::size_t c = 0; c < states_before_.size(); ++c)
    if (!(states_before_[c] == equations_.coordinates[c].state)) return true;
  return false;
}

bool ContactEvents::finish_event(Span* span, const Watched& watched, std::size_t which) {
  if (++done_.events > kMostEvents) return false;
  note_angles();
  const std::size_t watches = watched_.before.size();
  const std::uint32_t impacts = done_.impacts, breaks = done_.breaks;
  if (watched.kind == Watched::Kind::kBreak) break_joint(*span, watched.joint);
  if (!settle(span, watched, false)) return false;
  const bool is_changed = impacts != done_.impacts || breaks != done_.breaks ||
                          watched.kind == Watched::Kind::kSlip || has_changed();
  if (is_changed) {
    watched_.is_muted.clear();
    return true;
  }
  watched_.is_muted.resize(watches, 0);
  watched_.is_muted[which] = 1;
  return ++done_.unchanged <= kMostUnchanged;
}

}  // namespace constraint_sim::engine
