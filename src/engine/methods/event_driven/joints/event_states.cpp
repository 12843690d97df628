// Changes of an EventDriven at an event: limits that are hit have impacts, then a complementarity
// problem of accelerations decides how each row acts next. With u = J V the rates of coordinates
// and A = J W Jᵀ, W the response to impulses while the rigid joints hold:
//   impacts    u⁺ = u + A p, and for touching limits  0 ≤ p ⊥ u⁺ + e u⁻ ≥ 0
//   afterwards q̈ − c̈ = b + A λ, and for coordinates that move at c  least ≤ λ ≤ most, with
//              q̈ = c̈, or q̈ > c̈ at the least λ, or q̈ < c̈ at the most λ

#include <algorithm>
#include <cmath>

#include "engine/dynamics/held_response.h"
#include "engine/math/box_lcp.h"
#include "engine/math/dense.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/methods/event_driven/joints/event_span.h"
#include "engine/methods/event_driven/joints/law_events.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr double kNoAcceleration = 1e-10;  // share of the largest acceleration; less is zero
constexpr double kLeast = 1e-12;           // [m/s² or rad/s²] less is zero where nothing pulls
constexpr double kKeepsTravel = 1e-6;      // [m] a motor holds a length that is off by less
constexpr std::size_t kMostVariants = 16;

Index index(std::size_t i) { return static_cast<Index>(i); }

// Adds the impulses on the two bodies of a joint by a unit impulse along J, each body once.
void add_unit(std::pair<std::size_t, std::size_t> ends, const Jacobian& J, BodyImpulse* unit) {
  const auto add = [&](std::size_t body, const Eigen::Vector3d& linear,
                       const Eigen::Vector3d& angular) {
    if (body == 0) return;
    std::size_t i = 0;
    while (unit->body[i] != 0 && unit->body[i] != static_cast<int>(body)) ++i;
    if (unit->body[i] == 0) unit->linear[i] = unit->angular[i] = Eigen::Vector3d::Zero();
    unit->body[i] = static_cast<int>(body);
    unit->linear[i] += linear;
    unit->angular[i] += angular;
  };
  add(ends.first, J.j1, J.j2);
  add(ends.second, J.j3, J.j4);
}

}  // namespace

// ---- complementarity problem

bool EventDriven::load_rows(Span* span, Rows* rows) {
  rows->y.resize(bare_.size());
  rows->dydt.resize(bare_.size());
  bare_.forget_redundant_rows();
  bare_.begin_step(joint_states_);
  gather_state(bare_, *span->states, rows->y.data());
  const double t = span->left.t;
  bare_.begin(t, *span->states, span->all.gravity, span->all.loads, bare_courses_,
              span->all.since_tick + (t - span->all.t));
  const double before = kinetic_energy(bare_, rows->y.data());
  if (!bare_.start(t, rows->y.data(), rows->dydt.data())) return false;
  span->progress.projected += before - kinetic_energy(bare_, rows->y.data());
  bare_.scatter_state(rows->y.data(), span->states);
  read_rows(*span, rows);
  find_responses(rows);
  find_lost(*span, *rows);
  return true;
}

void EventDriven::read_rows(const Span& span, Rows* rows) const {
  Motions rates;
  find_accelerations(bare_, rows->y.data(), rows->dydt.data(), &rates);
  rows->reading.clear();
  for (const OneSidedLaw& law : laws_)
    rows->reading.push_back(read(span, law, span.left.t, bare_, rates));
}

void EventDriven::find_responses(Rows* rows) {
  const std::size_t n = laws_.size();
  rows->response.resize(n);
  rows->joint_impulses.resize(n);
  rows->is_free.assign(n, 0);
  rows->A.setZero(index(n), index(n));
  const List<int>& bodies = bare_.bodies();
  List<BodyImpulse> units;
  for (std::size_t c = 0; c < n; ++c) {
    const std::size_t l = laws_[c].joint;
    BodyImpulse& unit = units.emplace_back();
    if (!laws_[c].is_coupling) {
      add_unit(ends_[l], rows->reading[c].J, &unit);
      continue;
    }
    add_unit(ends_[couplings_[l][0].joint], rows->reading[c].J, &unit);
    add_unit(ends_[couplings_[l][1].joint], rows->reading[c].J_second, &unit);
  }
  const auto rate_of = [&](const BodyImpulse& along, const Motions& motions) {
    double rate = 0.0;
    for (std::size_t k = 0; k < along.body.size() && along.body[k] != 0; ++k) {
      const auto found = std::find(bodies.begin(), bodies.end(), along.body[k]);
      if (found == bodies.end()) continue;
      const auto i = static_cast<std::size_t>(found - bodies.begin());
      rate += along.linear[k].dot(motions.linear[i]) + along.angular[k].dot(motions.angular[i]);
    }
    return rate;
  };
  for (std::size_t c = 0; c < n; ++c) {
    if (is_broken_[laws_[c].joint]) continue;
    rows->response[c] = held_response(bare_, bare_.inputs(), bare_.kinematics(), units[c],
                                      &bare_.delassus(), &rows->joint_impulses[c]);
    for (std::size_t d = 0; d < n; ++d)
      rows->A(index(d), index(c)) = rate_of(units[d], rows->response[c]);
    const bool is_free =
        rows->A(index(c), index(c)) > kHeld * free_response(bare_, bare_.kinematics(), units[c]);
    rows->is_free[c] = is_free ? 1 : 0;
  }
  rows->A = (0.5 * (rows->A + rows->A.transpose())).eval();
}

void EventDriven::apply_impulse(Rows* rows, std::size_t c, double impulse) {
  if (impulse == 0.0) return;
  bare_.add_response(rows->response[c], rows->joint_impulses[c], impulse, rows->y.data());
  for (std::size_t d = 0; d < laws_.size(); ++d)
    rows->reading[d].rate += rows->A(index(d), index(c)) * impulse;
  if (laws_[c].is_coupling)
    coupled_impulses_[laws_[c].joint] += impulse;
  else
    impulses_[laws_[c].joint][laws_[c].function] += impulse;
  rows->hit[c] += impulse;
}

// ---- impacts

// Solves impacts one after the other until no limit is hit. Limits whose bounces are too low to be
// followed lose their restitution; then all impacts are repeated.
bool EventDriven::have_impacts(Span* span, Rows* rows, bool* any) {
  const List<double> start = rows->y;
  const List<RowVector> impulses = impulses_;
  const List<double> coupled = coupled_impulses_;
  List<char> rests(laws_.size(), 0);
  for (bool is_settled = false; !is_settled;) {
    List<char> bounced(laws_.size(), 0);
    int count = 0;
    for (; count < kMostImpacts; ++count) {
      const List<Hit> hits = find_hits(*span, *rows, rests);
      if (hits.empty()) break;
      if (!have_impact(hits, rows)) return false;
      for (const Hit& hit : hits)
        if (hit.restitution > 0.0) bounced[hit.law] = 1;
    }
    if (count == kMostImpacts) return false;
    if (count == 0) return true;
    *any = true;
    if (!go_on_after_impacts(span, rows) || !let_rest(*span, rows, bounced, &rests, &is_settled))
      return false;
    if (is_settled) break;
    impulses_ = impulses;
    coupled_impulses_ = coupled;
    rows->hit.assign(laws_.size(), 0.0);
    bare_.scatter_state(start.data(), span->states);
    if (!load_rows(span, rows)) return false;
  }
  return true;
}

// Continues with the motion after the impacts, and adds the impulses of joints.
bool EventDriven::go_on_after_impacts(Span* span, Rows* rows) {
  for (std::size_t k = 0; k < bare_.joints().size(); ++k) {
    const auto l = static_cast<std::size_t>(bare_.joints()[k]);
    impulses_[l] += bare_.forces().impulse(bare_, k);
    if (!bare_.coupled_rows().empty() && couples(joints_[l].kind))
      coupled_impulses_[l] += bare_.forces().coupled_impulse(bare_, k);
  }
  bare_.scatter_state(rows->y.data(), span->states);
  return load_rows(span, rows);
}

// Limits that take part in the next impact: of the limits with restitution the one that is hit
// fastest, with all others between the same two bodies; and all limits without restitution. Empty
// where no limit is hit.
List<EventDriven::Hit> EventDriven::find_hits(const Span& span, const Rows& rows,
                                              const List<char>& rests) const {
  List<Hit> touching;
  const Hit* fastest = nullptr;
  bool any_hit = false;
  for (std::size_t c = 0; c < laws_.size(); ++c) {
    const OneSidedLaw& law = laws_[c];
    if (is_broken_[law.joint] || std::isfinite(law.limit_force)) continue;
    for (const bool upper_one : {false, true}) {
      if (!std::isfinite(law.limit(upper_one))) continue;
      const Prescribed at_limit = limit(c, upper_one, span.left.t);
      const double direction = upper_one ? -1.0 : 1.0;
      if (direction * (rows.reading[c].q - at_limit.value) > kTouching) continue;
      const double rate = direction * (rows.reading[c].rate - at_limit.rate);
      const bool is_hit = rate < -kResting;
      any_hit = any_hit || is_hit;
      const double restitution = rests[c] ? 0.0 : law.restitution;
      if (is_hit || (restitution == 0.0 && rows.is_free[c]))
        touching.push_back({c, direction, rate, is_hit ? restitution : 0.0});
    }
  }
  if (!any_hit) return {};
  for (const Hit& hit : touching)
    if (hit.restitution > 0.0 && (fastest == nullptr || hit.rate < fastest->rate)) fastest = &hit;
  const auto ends = fastest != nullptr ? ends_[laws_[fastest->law].joint] : Ends::value_type{};
  const auto waits = [&](const Hit& hit) {
    const auto [a, b] = ends_[laws_[hit.law].joint];
    return hit.restitution > 0.0 && std::minmax(a, b) != std::minmax(ends.first, ends.second);
  };
  touching.erase(std::remove_if(touching.begin(), touching.end(), waits), touching.end());
  return touching;
}

// Solves an impact, with less restitution where kinetic energy would rise. Returns false where
// there is no solution.
bool EventDriven::have_impact(const List<Hit>& hits, Rows* rows) {
  const Index n = index(hits.size());
  BoxLcp problem{Eigen::MatrixXd(n, n), VectorXd(n), VectorXd::Zero(n),
                 VectorXd::Constant(n, kInfinity)};
  VectorXd rate(n), impulse;
  for (Index i = 0; i < n; ++i) {
    const Hit& hit = hits[static_cast<std::size_t>(i)];
    // A rigid joint drives the coordinate into its limit.
    if (!rows->is_free[hit.law]) return false;
    rate[i] = hit.rate;
    for (Index j = 0; j < n; ++j) {
      const Hit& other = hits[static_cast<std::size_t>(j)];
      problem.A(i, j) = hit.direction * other.direction * rows->A(index(hit.law), index(other.law));
    }
  }
  for (const double share : {1.0, 0.5, 0.25, 0.0}) {
    for (Index i = 0; i < n; ++i)
      problem.b[i] = (1.0 + share * hits[static_cast<std::size_t>(i)].restitution) * rate[i];
    if (!solve(problem, &impulse)) return false;
    const VectorXd mean = rate + 0.5 * math::product(problem.A, impulse);
    if (math::dot(impulse, mean) <= kNoWork * math::dot(impulse.cwiseAbs(), rate.cwiseAbs())) break;
  }
  for (Index i = 0; i < n; ++i) {
    const Hit& hit = hits[static_cast<std::size_t>(i)];
    apply_impulse(rows, hit.law, hit.direction * impulse[i]);
  }
  return true;
}

// Finds the limits whose bounces are too low to be followed.
bool EventDriven::let_rest(const Span& span, Rows* rows, const List<char>& bounced,
                           List<char>* rests, bool* is_settled) const {
  List<OneSidedState> states;
  *is_settled = true;
  if (std::find(bounced.begin(), bounced.end(), 1) == bounced.end()) return true;
  if (!decide(span, rows, {}, &states)) return false;
  for (std::size_t c = 0; c < laws_.size(); ++c) {
    if (!bounced[c]) continue;
    const Reading& reading = rows->reading[c];
    for (const bool upper_one : {false, true}) {
      if (!std::isfinite(laws_[c].limit(upper_one))) continue;
      const Prescribed at_limit = limit(c, upper_one, span.left.t);
      const double direction = upper_one ? -1.0 : 1.0;
      const double rate = direction * (reading.rate - at_limit.rate);
      const double fall = -direction * (rows->acceleration[index(c)] - at_limit.acceleration);
      if (direction * (reading.q - at_limit.value) > kTouching) continue;
      const std::optional<double> rests_in =
          time_to_rest(rate, fall, laws_[c].restitution, span.left.left);
      if (!rests_in) continue;
      rows->rests_in[c] = *rests_in;
      (*rests)[c] = 1;
      *is_settled = false;
    }
  }
  return true;
}

// ---- states

// Returns the law that may hold a coordinate, with its rate. Sets the other acting forces in
// `state`.
std::optional<EventDriven::Candidate> EventDriven::candidate(const Span& span, std::size_t c,
                                                             const Reading& reading,
                                                             OneSidedState* state) const {
  const OneSidedLaw& law = laws_[c];
  const double t = span.left.t;
  const auto limit_of = [&](bool upper_one) { return limit(c, upper_one, t); };
  const auto zeta_of = [&] { return zeta(span, c, t, reading.q); };
  const bool is_lost = law.goal && braking_[c] > 0.0;
  const std::optional<Hold> hold = find_hold(law, states_[c], reading, limit_of, zeta_of, is_lost,
                                             pressed_.empty() || pressed_[c] == 0, state);
  if (!hold) return std::nullopt;
  const Prescribed at = rate_held_at(*hold, limit_of, zeta_of);
  const double zeta_rate = zeta_of().rate;
  return Candidate{
      c, *hold, at.rate, at.acceleration, zeta_rate, force_bounds(law, *hold, at.rate, zeta_rate)};
}

// State of a candidate that leaves its rate to the given side.
OneSidedState EventDriven::leaving(const Candidate& from, signed char side) const {
  return state_leaving(laws_[from.law], from.hold, from.rate, from.zeta, side);
}

// Decides the next states of all laws and servos, and computes the accelerations of their
// coordinates.
bool EventDriven::decide(const Span& span, Rows* rows, const Release& release,
                         List<OneSidedState>* next) const {
  if (!decide_holds(span, rows, release, next)) return false;
  for (std::size_t c = 0; c < laws_.size(); ++c) {
    if (!laws_[c].has_servo() || is_broken_[laws_[c].joint]) continue;
    Reading now = rows->reading[c];
    now.acceleration = rows->acceleration[index(c)];
    (*next)[c].servo = servo_from(laws_[c], states_[c].servo, now, rest(c, span.left.t));
  }
  return true;
}

// Decides how coordinates are held. A motor that follows its prescribed motion moves its coordinate
// off a limit; where the motor is too weak for the load, the limit holds.
bool EventDriven::decide_holds(const Span& span, Rows* rows, const Release& release,
                               List<OneSidedState>* next) const {
  pressed_.assign(laws_.size(), 0);
  for (std::size_t pass = 0; pass <= laws_.size(); ++pass) {
    if (!decide_once(span, rows, release, next)) return false;
    bool any_pressed = false;
    for (std::size_t c = 0; c < laws_.size(); ++c) {
      if (pressed_[c] || !laws_[c].goal || (*next)[c].drive == 0 || braking_[c] > 0.0) continue;
      for (const bool upper_one : {false, true}) {
        if (!std::isfinite(laws_[c].limit(upper_one))) continue;
        const double direction = upper_one ? -1.0 : 1.0;
        const double gap =
            direction * (rows->reading[c].q - limit(c, upper_one, span.left.t).value);
        if (gap > kTouching || direction * rows->acceleration[index(c)] >= 0.0) continue;
        pressed_[c] = 1;
        any_pressed = true;
      }
    }
    if (!any_pressed) return true;
  }
  return true;
}

bool EventDriven::decide_once(const Span& span, Rows* problem_at, const Release& release,
                              List<OneSidedState>* next) const {
  Rows& rows = *problem_at;
  next->assign(laws_.size(), {});
  List<Candidate> candidates;
  VectorXd force = VectorXd::Zero(index(laws_.size()));
  for (std::size_t c = 0; c < laws_.size(); ++c) {
    if (is_broken_[laws_[c].joint]) continue;
    if (laws_[c].has_servo())
      force[index(c)] = clamped_servo_force(laws_[c], rows.reading[c], rest(c, span.left.t));
    if (!rows.is_free[c]) continue;
    const auto found = candidate(span, c, rows.reading[c], &(*next)[c]);
    if ((*next)[c].yield != 0 && !std::isfinite(laws_[c].limit_force)) return false;
    if (found)
      candidates.push_back(*found);
    else
      force[index(c)] += constant_force(laws_[c], (*next)[c]);
  }
  const Index n = index(candidates.size());
  rows.acceleration.resize(index(laws_.size()));
  for (std::size_t c = 0; c < laws_.size(); ++c)
    rows.acceleration[index(c)] = rows.reading[c].acceleration;
  rows.acceleration += math::product(rows.A, force);
  if (candidates.size() > kMostRows) return false;
  if (n == 0) return true;
  BoxLcp problem{Eigen::MatrixXd(n, n), VectorXd(n), VectorXd(n), VectorXd(n)};
  for (Index i = 0; i < n; ++i) {
    const Candidate& row = candidates[static_cast<std::size_t>(i)];
    for (Index j = 0; j < n; ++j)
      problem.A(i, j) = rows.A(index(row.law), index(candidates[static_cast<std::size_t>(j)].law));
    problem.b[i] = rows.acceleration[index(row.law)] - row.acceleration;
    problem.least[i] = row.bounds.least;
    problem.most[i] = row.bounds.most;
  }
  VectorXd lambda;
  if (!solve(problem, &lambda)) return false;
  const VectorXd a = problem.b + math::product(problem.A, lambda);
  for (Index i = 0; i < n; ++i)
    rows.acceleration += lambda[i] * rows.A.col(index(candidates[static_cast<std::size_t>(i)].law));
  const VectorXd roots = problem.A.diagonal().cwiseSqrt();
  const double largest = problem.b.cwiseQuotient(roots).lpNorm<Eigen::Infinity>();
  const double largest_force = bare_.largest_force();
  List<Index> held;
  List<signed char> sides;
  for (Index i = 0; i < n; ++i) {
    const Candidate& row = candidates[static_cast<std::size_t>(i)];
    const bool is_leaving = std::abs(a[i]) > std::max(kNoAcceleration * largest * roots[i], kLeast);
    signed char side = is_leaving ? sign_of(a[i]) : sign_of(0.0);
    const double bound = release.side < 0 ? row.bounds.least : row.bounds.most;
    if (side == 0 && release.law == static_cast<int>(row.law) &&
        std::abs(lambda[i] - bound) <=
            kAtBound * std::max({std::abs(bound), std::abs(lambda[i]), largest_force}))
      side = static_cast<signed char>(-release.side);
    sides.push_back(side);
    if (side == 0 && lambda[i] > row.bounds.least && lambda[i] < row.bounds.most) held.push_back(i);
  }
  for (Index i = 0; i < n; ++i) {
    const Candidate& row = candidates[static_cast<std::size_t>(i)];
    const signed char side = sides[static_cast<std::size_t>(i)];
    const bool is_bound = !(lambda[i] > row.bounds.least && lambda[i] < row.bounds.most);
    if (side != 0) {
      (*next)[row.law] = leaving(row, side);
    } else if (!is_bound) {
      (*next)[row.law].hold = row.hold;
    } else if (pivot_beside(problem.A, held, i) > kDependent) {
      held.push_back(i);
      (*next)[row.law].hold = row.hold;
    } else {  // dependent on the held rows, which hold the coordinate for now
      (*next)[row.law] = leaving(row, lambda[i] > row.bounds.least ? -1 : 1);
    }
  }
  return true;
}

// ---- changes of rows

// Sets where rows hold their coordinates from now on, and restarts the prescribed motions of
// changed joints.
void EventDriven::hold_rows(const Span& span, const Rows& rows, const List<OneSidedState>& next) {
  const double t = span.left.t;
  List<char> is_changed(joints_.size(), 0);
  for (std::size_t c = 0; c < laws_.size(); ++c) {
    const OneSidedLaw& law = laws_[c];
    const OneSidedState& before = states_[c];
    if (has_started_ && before.hold == Hold::kDrive && !law.is_distance)
      held_[c] = courses_[law.joint].target(law.function, t).value + law.zero;
    if (has_started_ && next[c] == before) continue;
    is_changed[law.joint] = 1;
    const double q = rows.reading[c].q;
    if (!law.is_distance) {
      held_[c] = q;
      if (next[c].hold == Hold::kBrake)
        held_[c] = t + std::sqrt(2.0 * std::abs(q - *law.goal) / braking_[c]);
      continue;
    }
    double& travelled = held_[c] = joint_states_[law.joint].travel = travel(law.joint, t);
    const bool is_limit = next[c].hold == Hold::kUpper || next[c].hold == Hold::kLower;
    double off = 0.0;
    if (next[c].hold == Hold::kDrive)
      off = q - courses_[law.joint].length(t).value;
    else if (before.yield != 0 && (is_limit || next[c].yield != 0 || next[c].hold == Hold::kNone))
      off = q - limit(c, before.yield > 0, t).value;
    if (std::abs(off) > kKeepsTravel || before.yield != 0 || before.drive != 0) {
      travelled += off;
      joint_states_[law.joint].travel = travelled;
      joint_states_[law.joint].closing = false;
    }
  }
  // Motors without force limit continue from their position.
  for (std::size_t l = 0; l < joints_.size(); ++l) {
    if (!is_changed[l]) continue;
    const JointKindInfo& kind = info(joints_[l].kind);
    for (int i = 0; i < kind.coordinates; ++i) {
      const CoordinateLaw& law = joints_[l].coordinates[static_cast<std::size_t>(i)];
      if (!is_held(law)) continue;
      const int function = kind.rows + i;
      const double closing = courses_[l].is_closing() ? joint_states_[l].closing_offset[function] *
                                                            courses_[l].share_to_close(t).value
                                                      : 0.0;
      joint_states_[l].coordinates[static_cast<std::size_t>(i)].held =
          courses_[l].target(function, t).value - closing + law.zero;
    }
  }
  states_ = next;
  for (std::size_t l = 0; l < joints_.size(); ++l) {
    if (!is_changed[l]) continue;
    set_rows(l);
    begin_course(span, l, t);
  }
}

// Reports the events of the change from the current states to the next ones.
void EventDriven::tell(const Span& span, const Rows& rows, const List<OneSidedState>& next) {
  for (std::size_t c = 0; c < laws_.size(); ++c) {
    const OneSidedLaw& law = laws_[c];
    if (is_broken_[law.joint]) continue;
    const double t = span.left.t;
    const Reading& now = rows.reading[c];
    const bool is_new = span.begins && span.all.since_tick == 0.0;  // start of a step
    const bool was =
        is_new ? was_saturated(span, c, now) : is_saturated(span, c, states_[c], t, now.q);
    OneSidedState before = states_[c];
    if (!has_started_) {
      before = state_of_motion(law, now, was, rest(c, t),
                               [&](bool upper_one) { return limit(c, upper_one, t); });
      if (rows.hit[c] != 0.0) before.hold = Hold::kNone;
    }
    const int coordinate = law.is_rope() ? -1 : law.coordinate;
    const auto add = [&](EventKind kind, double impulse) {
      for (Told& told : told_)  // a rest reported for later does not come
        if (told.joint == law.joint && told.coordinate == coordinate)
          told.time = std::min(told.time, t);
      const bool rests = kind == EventKind::kLimitReached || kind == EventKind::kRopeTaut;
      told_.push_back({kind, t + (rests ? rows.rests_in[c] : 0.0), law.joint, coordinate, impulse});
    };
    add_changes(law, before, next[c], rows.hit[c], was, is_saturated(span, c, next[c], t, now.q),
                !has_started_ && span.all.t <= 0.0, add);
  }
}

bool EventDriven::switch_to_states(Span* span) {
  RungeKutta& motion = *span->motion;
  collect(*span->states, &motion);
  if (!(compiled_for_ == states_ && broken_then_ == is_broken_)) {
    const auto found = std::find_if(others_.begin(), others_.end(), [&](const Variant& other) {
      return other.states == states_ && other.is_broken == is_broken_;
    });
    const double step = motion.step();
    least_forces_.reset();
    if (found != others_.end()) {
      std::swap(motion, found->motion);
      std::swap(compiled_for_, found->states);
      std::swap(broken_then_, found->is_broken);
    } else {
      if (others_.size() >= kMostVariants) others_.erase(others_.begin());
      others_.push_back({compiled_for_, broken_then_, std::move(motion)});
      motion = RungeKutta(compile(states_, span->around.masses));
      compiled_for_ = states_;
      broken_then_ = is_broken_;
    }
    motion.restart();
    motion.set_step(step);
  }
  motion.begin_step(joint_states_);
  motion.forget();
  const IntegrationResult begun = motion.begin(rest_of(*span), span->accuracy, *span->states);
  span->progress.projected += begun.projected;
  if (!begun.done) return false;
  motion.equations().scatter_state(motion.state(), span->states);
  has_started_ = true;
  watch(*span, span->left.t, &watched_.before);
  return true;
}

bool EventDriven::settle(Span* span, const Release& release, bool is_changed, bool* had_impacts) {
  Rows rows;
  rows.hit.assign(laws_.size(), 0.0);
  rows.rests_in = rows.hit;
  List<OneSidedState> next;
  if (!load_rows(span, &rows) || !have_impacts(span, &rows, had_impacts) ||
      !decide(*span, &rows, release, &next))
    return false;
  if (!is_changed && !*had_impacts && next == states_) return true;
  tell(*span, rows, next);
  note_lost(rows, next);
  hold_rows(*span, rows, next);
  return switch_to_states(span);
}

}  // namespace constraint_sim::engine
