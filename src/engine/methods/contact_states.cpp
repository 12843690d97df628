// What ContactEvents does at an event: contacts and limits that are hit have impacts
// (contact_impacts.cpp), and then the cone problem of the accelerations says what each contact and
// each coordinate does from there on.
//
// With w the rates of contacts along their normals and tangents, and A what impulses do to these
// while the joints hold: ẇ = b + A f of contacts that touch and do not part, f in its cone; along
// the slip of those that slip.
// Coordinates with one-sided laws are rows of the same problems, as event_states.cpp has them.

#include <algorithm>
#include <cmath>

#include "engine/linear/cone_problem.h"
#include "engine/methods/contact_events.h"
#include "engine/methods/law_events.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Index;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kAtRest = 1e-8;     // of the largest acceleration: less is none
constexpr double kAtBound = 1e-6;    // of the force that gives way
constexpr double kSameTime = 1e-6;   // of a span
constexpr double kEndOfSlip = 1e-7;  // [m/s] a slip that ends there is off by no more than rounding

Index index(std::size_t i) { return static_cast<Index>(i); }

}  // namespace

// `event`: what the last substep ended with; of a span that begins nothing. `jams`: what slips has
// no motion to go on with.
bool ContactEvents::settle(Span* span, const Watched& event, bool is_begin, bool jams) {
  double* const y = numbers_.data();
  has_stages_ = false;
  find_features(!is_begin && event.kind == Watched::Kind::kMargin);
  std::vector<Acts> before;
  for (const ContactEquations::Contact& contact : equations_.contacts)
    before.push_back(contact.acts);
  note_bounds(*span, event);
  states_before_.clear();
  for (const ContactEquations::Coordinate& of : equations_.coordinates)
    states_before_.push_back(of.state);
  Of<double> hit(equations_.contacts.size(), equations_.coordinates.size());
  if ((jams && !have_jam(&hit)) || !have_impacts(&hit)) return false;
  if (!decide(event) && !(have_jam(&hit) && decide({}))) return false;
  hold_coordinates(is_begin);
  const double kinetic = equations_.kinetic_energy(), potential = equations_.potential_energy();
  if (!equations_.project(span->left.t, y) || !equations_.restart(y, derivative())) return false;
  span->progress.projected += kinetic - equations_.kinetic_energy();
  span->progress.corrected += equations_.potential_energy() - potential;
  tell(span->all.t + span->left.t, before, hit, is_begin);
  return break_overloaded(span);
}

void ContactEvents::break_joint(const Span& span, std::size_t joint) {
  ++breaks_;
  equations_.break_joint(joint);
  told_.push_back(
      {EventKind::kBroken, span.all.t + span.left.t, -1, -1, 0.0, static_cast<int>(joint)});
}

// What bears more than it can from one moment to the next, as where something else lets go, breaks
// then: the one that is farthest beyond first, for it may spare the others.
bool ContactEvents::break_overloaded(Span* span) {
  std::vector<Watched> loads;
  for (std::size_t j = 0; j < equations_.joints.size(); ++j) watch_breaking(j, &loads);
  const auto worst =
      std::min_element(loads.begin(), loads.end(), [](const Watched& left, const Watched& right) {
        return left.value / left.tolerance < right.value / right.tolerance;
      });
  if (worst == loads.end() || worst->value >= -worst->tolerance) return true;
  ++events_;
  break_joint(*span, worst->joint);
  return settle(span, {}, false);
}

// Contacts that share a force have their bounds at the same time: one after the other gives way,
// and none that has takes it up again.
void ContactEvents::note_bounds(const Span& span, const Watched& event) {
  const double t = span.all.t + span.left.t;
  const auto note = [&](Watched::Kind kind, bool is_over, AtBound* at) {
    if (is_over || t - at->since > kSameTime * span.all.h) at->contacts.clear();
    if (event.kind != kind) return;
    if (at->contacts.empty()) at->since = t;
    at->contacts.push_back(event.contact);
  };
  note(Watched::Kind::kCone, event.kind != Watched::Kind::kCone, &at_cone_);
  note(Watched::Kind::kForce, false, &at_zero_);
}

// ---- states

// What contacts do with where the bodies are and how they move. One whose force has left its bounds
// gives way, as `event` says, where the force is still there to rounding.
bool ContactEvents::decide(const Watched& event) {
  // near the end of a slip its direction turns ever faster: what can stick there does
  if (event.kind == Watched::Kind::kSlip && decide(event, kEndOfSlip)) {
    bool all_stick = true;
    for (const ContactEquations::Contact& contact : equations_.contacts) {
      const double speed = equations_.motion(contact).slip().norm();
      all_stick = all_stick && (contact.acts != Acts::kSlips || contact.friction == 0.0 ||
                                speed <= kResting || speed > kEndOfSlip);
    }
    if (all_stick) return true;
  }
  return decide(event, kResting);
}

// Of contacts that slip no faster than `least_slip` as if they did not.
bool ContactEvents::decide(const Watched& event, double least_slip) {
  std::vector<std::size_t> candidates;
  for (std::size_t c = 0; c < equations_.contacts.size(); ++c) {
    ContactEquations::Contact& contact = equations_.contacts[c];
    contact.acts = Acts::kOpen;
    const ContactMotion now = equations_.motion(contact);
    if (now.gap <= kTouching && now.gap_rate() <= kResting) candidates.push_back(c);
  }
  std::vector<Candidate> held;
  if (!find_candidates(&held)) return false;
  std::vector<double> free(equations_.size());
  equations_.derivative(0, equations_.time(), numbers_.data(), free.data());
  equations_.find_accelerations(free.data(), &rates_);
  const auto acceleration_of = [&](std::size_t c) {
    const ContactEquations::Contact& contact = equations_.contacts[c];
    return ContactEquations::slip_acceleration(equations_.motion(contact), contact, rates_);
  };
  acceleration_.clear();
  for (std::size_t c = 0; c < equations_.contacts.size(); ++c)
    acceleration_.push_back(acceleration_of(c));
  coordinate_acceleration_.clear();
  for (const ContactEquations::Coordinate& of : equations_.coordinates)
    coordinate_acceleration_.push_back(equations_.read(of, &rates_).acceleration);
  if (candidates.empty() && held.empty()) return true;

  std::vector<std::size_t> coordinates;
  for (const Candidate& row : held) coordinates.push_back(row.coordinate);
  const ContactEquations::Responses responses = equations_.responses(candidates, coordinates);
  ConeProblem problem;
  problem.A = responses.A;
  const Index first = 3 * index(candidates.size());
  problem.b.resize(first + index(held.size()));
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    const ContactEquations::Contact& contact = equations_.contacts[candidates[i]];
    const ContactMotion now = equations_.motion(contact);
    Vector3d b = responses.frames[i].transpose() * acceleration_[candidates[i]];
    b[0] += now.n_dot.dot(now.w);
    problem.b.segment<3>(3 * index(i)) = b;
    const Vector3d slip = now.slip();
    const double speed = slip.norm();
    const bool slips = speed > least_slip;
    Eigen::Vector2d direction = Eigen::Vector2d::Zero();
    if (slips) direction = responses.frames[i].rightCols<2>().transpose() * slip / speed;
    problem.contacts.push_back({contact.friction, slips, direction});
  }
  for (std::size_t k = 0; k < held.size(); ++k) {
    problem.b[first + index(k)] =
        coordinate_acceleration_[held[k].coordinate] - held[k].acceleration;
    problem.rows.push_back({held[k].bounds.least, held[k].bounds.most});
    if (!responses.is_free[k]) problem.rows.back() = {};
  }
  VectorXd force;
  if (!solve_counted(problem, &force)) return false;
  choose_acts(responses, problem, force);
  choose_holds(event, held, responses, problem, force);
  if (!is_within_bounds()) take_forces(held, responses, force);
  return true;
}

// Coordinates that move as something that may hold them; of the others sets what acts. False where
// one goes beyond a limit of any force.
bool ContactEvents::find_candidates(std::vector<Candidate>* candidates) {
  for (std::size_t c = 0; c < equations_.coordinates.size(); ++c) {
    ContactEquations::Coordinate& of = equations_.coordinates[c];
    of.state = {};
    of.reference = 0.0;
    if (!of.is_one_sided) continue;
    const ContactEquations::Reading now = equations_.read(of, nullptr);
    const auto limit = [&](bool upper_one) { return equations_.limit(of, upper_one); };
    const auto zeta = [&] { return equations_.zeta(of); };
    OneSidedState state;
    const std::optional<Hold> hold = find_hold(of.law, states_before_[c], now, limit, zeta, &state);
    if (hold) {
      const Prescribed at = rate_held_at(*hold, limit, zeta);
      candidates->push_back(
          {c, *hold, at.rate, at.acceleration, force_bounds(of.law, *hold, at.rate, zeta().rate)});
      continue;
    }
    if (state.yield != 0 && !std::isfinite(of.law.limit_force)) return false;
    of.state = state;
  }
  return true;
}

// By the solution of the problem of the accelerations; also finds these for all that touch.
void ContactEvents::choose_acts(const ContactEquations::Responses& responses,
                                const ConeProblem& problem, const VectorXd& force) {
  const std::vector<std::size_t>& candidates = responses.contacts;
  const VectorXd a = problem.b + problem.A * force;
  const double scale = problem.b.lpNorm<Eigen::Infinity>();
  const double largest = force.size() > 0 ? force.lpNorm<Eigen::Infinity>() : 0.0;
  const double largest_force = equations_.largest_force();
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    const Vector3d f = force.segment<3>(3 * index(i));
    const Vector3d a_i = a.segment<3>(3 * index(i));
    ContactEquations::Contact& contact = equations_.contacts[candidates[i]];
    const ContactMotion now = equations_.motion(contact);
    acceleration_[candidates[i]] = responses.frames[i] * a_i - now.n * now.n_dot.dot(now.w);
    if (f[0] <= kAtRest * largest && a_i[0] > kAtRest * scale) continue;
    if (at_zero_.has(candidates[i]) && f[0] <= kAtBound * largest_force) continue;
    contact.acts = Acts::kSlips;
    contact.reference.setZero();
    contact.direction.setZero();
    const ConeContact& cone = problem.contacts[i];
    const Eigen::Vector2d a_t = a_i.tail<2>();
    if (cone.slips)
      contact.direction = responses.frames[i].rightCols<2>() * cone.direction;
    else if (contact.friction > 0.0 && a_t.norm() > kAtRest * scale)
      contact.direction = responses.frames[i].rightCols<2>() * a_t.normalized();
    else if (contact.friction > 0.0)
      contact.acts = Acts::kSticks;
  }
}

// The same of coordinates.
void ContactEvents::choose_holds(const Watched& event, const std::vector<Candidate>& candidates,
                                 const ContactEquations::Responses& responses,
                                 const ConeProblem& problem, const VectorXd& force) {
  if (candidates.empty()) return;
  const VectorXd a = problem.b + problem.A * force;
  const VectorXd roots = problem.A.diagonal().cwiseMax(0.0).cwiseSqrt();
  double largest = 0.0;
  for (Index i = 0; i < a.size(); ++i)
    if (roots[i] > 0.0) largest = std::max(largest, std::abs(problem.b[i]) / roots[i]);
  const double largest_force = equations_.largest_force();
  for (std::size_t k = 0; k < candidates.size(); ++k) {
    const Candidate& row = candidates[k];
    const Index i = 3 * index(responses.contacts.size()) + index(k);
    ContactEquations::Coordinate& of = equations_.coordinates[row.coordinate];
    coordinate_acceleration_[row.coordinate] = a[i] + row.acceleration;
    if (!responses.is_free[k]) continue;
    signed char side = std::abs(a[i]) > kAtRest * largest * roots[i] ? sign_of(a[i]) : sign_of(0.0);
    const double bound = event.side < 0 ? row.bounds.least : row.bounds.most;
    const bool gives_way = event.kind == Watched::Kind::kHeld && event.coordinate == row.coordinate;
    if (side == 0 && gives_way &&
        std::abs(force[i] - bound) <=
            kAtBound * std::max({std::abs(bound), std::abs(force[i]), largest_force}))
      side = static_cast<signed char>(-event.side);
    if (side == 0)
      of.state.hold = row.hold;
    else
      of.state = state_leaving(of.law, row.hold, row.rate, equations_.zeta(of).rate, side);
  }
}

// The forces of least norm are not within their bounds: those of the solution, and what is at its
// bound gives way.
void ContactEvents::take_forces(const std::vector<Candidate>& held,
                                const ContactEquations::Responses& responses,
                                const VectorXd& force) {
  const std::vector<std::size_t>& candidates = responses.contacts;
  for (std::size_t k = 0; k < held.size(); ++k)
    equations_.coordinates[held[k].coordinate].reference =
        force[3 * index(candidates.size()) + index(k)];
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    ContactEquations::Contact& contact = equations_.contacts[candidates[i]];
    if (contact.acts == Acts::kOpen) continue;
    const Vector3d f = force.segment<3>(3 * index(i));
    contact.reference = responses.frames[i] * f;
    const Eigen::Vector2d f_t = f.tail<2>();
    if (!at_cone_.has(candidates[i]) || contact.acts != Acts::kSticks ||
        !(f_t.norm() >= (1.0 - kAtBound) * contact.friction * f[0]))
      continue;
    contact.acts = Acts::kSlips;
    contact.direction = -(responses.frames[i].rightCols<2>() * f_t.normalized());
  }
}

// whether the forces of all that acts now are, to rounding
bool ContactEvents::is_within_bounds() {
  std::vector<double> unused(equations_.size());
  equations_.derivative(0, equations_.time(), numbers_.data(), unused.data());
  std::vector<Watched> forces;
  for (std::size_t c = 0; c < equations_.contacts.size(); ++c)
    if (equations_.contacts[c].acts != Acts::kOpen) watch_forces(c, &forces);
  for (std::size_t c = 0; c < equations_.coordinates.size(); ++c)
    if (equations_.coordinates[c].state.hold != Hold::kNone) watch_held(c, &forces);
  return std::all_of(forces.begin(), forces.end(),
                     [](const Watched& watched) { return watched.value >= -watched.tolerance; });
}

// Where coordinates are held from now on.
void ContactEvents::hold_coordinates(bool is_begin) {
  for (std::size_t c = 0; c < equations_.coordinates.size(); ++c) {
    ContactEquations::Coordinate& of = equations_.coordinates[c];
    const OneSidedState& before = states_before_[c];
    if (!of.is_one_sided || (!is_begin && of.state == before)) continue;
    of.held = equations_.read(of, nullptr).q;
    of.held_at = equations_.clock();
    if (before.yield != 0) of.given_way += of.held - equations_.limit(of, before.yield > 0).value;
  }
}

// ---- what is told

void ContactEvents::tell(double t, const std::vector<Acts>& before, const Of<double>& hit,
                         bool is_begin) {
  for (std::size_t c = 0; c < equations_.coordinates.size(); ++c) {
    const ContactEquations::Coordinate& of = equations_.coordinates[c];
    if (!of.is_one_sided) continue;
    const OneSidedState& then = is_begin ? of.state : states_before_[c];
    add_changes(of.law, then, of.state, hit.coordinates[c], is_begin,
                [&](EventKind kind, double impulse) {
                  told_.push_back({kind, t, -1, static_cast<int>(c), impulse});
                });
  }
  for (std::size_t p = 0; p < pairs_.size(); ++p) {
    const Pair& pair = pairs_[p];
    bool was = false, is = false, stuck = false, sticks = false;
    double impulse = 0.0;
    for (std::size_t c = pair.first; c < pair.first + pair.count; ++c) {
      const Acts now = equations_.contacts[c].acts, then = is_begin ? now : before[c];
      was = was || then != Acts::kOpen;
      stuck = stuck || then == Acts::kSticks;
      is = is || now != Acts::kOpen;
      sticks = sticks || now == Acts::kSticks;
      impulse += hit.contacts[c];
    }
    if (is_begin && impulse > 0.0) was = false;
    if (!was && (is || impulse > 0.0))
      told_.push_back({EventKind::kContactBegan, t, static_cast<int>(p), -1, impulse});
    if (was && impulse > 0.0)
      told_.push_back({EventKind::kHit, t, static_cast<int>(p), -1, impulse});
    if ((was || impulse > 0.0) && !is)
      told_.push_back({EventKind::kContactEnded, t, static_cast<int>(p), -1, 0.0});
    if (was && is && stuck != sticks && pair.friction > 0.0)
      told_.push_back(
          {sticks ? EventKind::kSticks : EventKind::kSlips, t, static_cast<int>(p), -1, 0.0});
  }
}

}  // namespace constraint_sim::engine
