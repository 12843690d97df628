// Changes of ContactEvents at an event: contacts and limits that are hit have impacts
// (contact_impacts.cpp), then the cone problem of accelerations decides how each contact and
// coordinate acts next. With w the rates of contacts along normals and tangents, and A the response
// to impulses while the joints hold: ẇ = b + A f for touching contacts that do not part, with f in
// its cone, or along the slip for slipping contacts. Coordinates with one-sided laws are rows of
// the same problem, as in event_states.cpp.

#include <algorithm>
#include <cmath>

#include "engine/math/box_lcp.h"
#include "engine/math/cone_problem.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/math/same_bits.h"
#include "engine/methods/event_driven/contacts/contact_events.h"
#include "engine/methods/event_driven/joints/law_events.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kAtRest = 1e-8;      // share of the largest acceleration; less is zero
constexpr double kLeastScale = 0.01;  // [m/s²] least largest acceleration, where nothing pulls
constexpr double kSameTime = 1e-6;    // share of an interval

}  // namespace

// Decides the states of all contacts and laws at an event. `event`: the watched value that passed
// zero and ended the last substep; kNothing at the start of an interval. `jams`: slipping contacts
// have no motion to continue.
bool ContactEvents::settle(Span* span, const Watched& event, bool is_begin, bool jams) {
  double* const y = numbers_.data();
  has_stages_ = equations_.is_straight = false;
  begins_ = is_begin;
  acts_before_.clear();
  features_before_.clear();
  for (const ContactEquations::Contact& contact : equations_.contacts) {
    acts_before_.push_back(contact.acts);
    features_before_.push_back(contact.feature.id);
  }
  pairs_.find_features(!is_begin && event.kind == Watched::Kind::kMargin, false, &equations_);
  note_bounds(*span, event);
  states_before_.clear();
  for (const ContactEquations::Coordinate& of : equations_.coordinates)
    states_before_.push_back(of.state);
  PerRow<double>& hit = hit_;
  hit.reset(equations_);
  rests_in_.reset(equations_);
  if ((jams && !have_jam(&hit)) || !have_impacts(span->left.left, &hit)) return false;
  if (!decide(event) && !(have_jam(&hit) && decide({}))) return false;
  hold_coordinates(is_begin);
  const double kinetic = equations_.kinetic_energy(), potential = equations_.potential_energy();
  before_projection_.assign(y, y + equations_.size());
  if (!equations_.project(span->left.t, y)) return false;
  const bool is_known = has_derivative_ && equations_.coordinates.empty() &&
                        have_same_bits(before_projection_.data(), y, equations_.size());
  if (!equations_.restart(y, derivative(), is_known ? free_.data() : nullptr)) return false;
  span->progress.projected += kinetic - equations_.kinetic_energy();
  span->progress.corrected += equations_.potential_energy() - potential;
  reports_.add({span->all.t, span->all.t + span->left.t, is_begin, acts_before_, states_before_,
                hit, rests_in_},
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

// Notes contacts that reach a bound. Contacts that share a force reach their bounds together or
// shortly after each other; each yields in turn, and none sticks again before it has slipped.
void ContactEvents::note_bounds(const Span& span, const Watched& event) {
  const double t = span.all.t + span.left.t;
  const auto note = [&](Watched::Kind kind, bool is_over, AtBound* at) {
    const auto is_done = [&](std::size_t c) {
      const ContactEquations::Contact& contact = equations_.contacts[c];
      return kind != Watched::Kind::kCone || contact.acts != Acts::kSlips ||
             equations_.motion(contact).slip().norm() > kEndOfSlip;
    };
    List<std::size_t>& contacts = at->contacts;
    if (is_over)
      contacts.clear();
    else if (t - at->since > kSameTime * span.all.h)
      contacts.erase(std::remove_if(contacts.begin(), contacts.end(), is_done), contacts.end());
    if (event.kind != kind) return;
    if (contacts.empty()) at->since = t;
    if (!at->has(event.contact)) contacts.push_back(event.contact);
  };
  note(Watched::Kind::kCone, event.kind != Watched::Kind::kCone, &at_cone_);
  note(Watched::Kind::kForce, false, &at_zero_);
}

// ---- states

// Decides how contacts act at the current pose and velocities. A contact whose force has left its
// bounds yields, as `event` says, where the force is still at the bound to rounding.
bool ContactEvents::decide(const Watched& event) {
  // Near the end of a slip its direction turns ever faster; contacts that can stick then stick.
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

// Decides as if contacts with a slip up to `least_slip` [m/s] did not slip.
bool ContactEvents::decide(const Watched& event, double least_slip) {
  has_derivative_ = false;
  ContactEquations::Responses& responses = problem_.responses;
  responses.clear();
  gap_acceleration_.assign(equations_.contacts.size(), 0.0);
  for (ContactEquations::Contact& contact : equations_.contacts) {
    contact.acts = Acts::kOpen;
    contact.normal_share = contact.tangent_share = 1.0;
  }
  find_lost();
  if (!find_candidates(&held_)) return false;
  free_.resize(equations_.size());
  equations_.derivative(0, equations_.time(), numbers_.data(), free_.data());
  equations_.find_accelerations(free_.data(), &rates_);
  for (std::size_t c = 0; c < equations_.contacts.size(); ++c) {
    const ContactEquations::Contact& contact = equations_.contacts[c];
    if (contact.feature.kind == ContactFeature::Kind::kNothing) continue;
    const ContactMotion now = equations_.motion(contact);
    gap_acceleration_[c] =
        now.n_dot.dot(now.w) + now.n.dot(ContactEquations::slip_acceleration(now, contact, rates_));
    if (now.gap <= kTouching && std::abs(now.gap_rate()) <= kResting) responses.add(c, now);
  }
  coordinate_acceleration_.clear();
  for (const ContactEquations::Coordinate& of : equations_.coordinates)
    coordinate_acceleration_.push_back(equations_.read(of, &rates_).acceleration);
  if (responses.contacts.empty() && held_.empty()) {
    choose_servos();
    return true;
  }

  for (const Candidate& row : held_) responses.coordinates.push_back(row.coordinate);
  equations_.find_responses(&responses);
  set_problem(least_slip);
  if (!solver_.solve(problem_.cone, &problem_.force)) return false;
  choose_acts();
  choose_holds(event);
  has_derivative_ = is_within_bounds();
  if (!has_derivative_) {
    sharing_.share(pairs_, &solver_, &problem_, &equations_);
    take_forces();
  }
  choose_servos();
  return true;
}

// Sets up the problem of accelerations, as if contacts with a slip up to `least_slip` [m/s] did not
// slip.
void ContactEvents::set_problem(double least_slip) {
  problem_.begin(equations_);
  for (const ContactEquations::Touching& touching : problem_.responses.contacts) {
    const ContactMotion& now = touching.motion;
    Vector3d b =
        touching.frame.transpose() *
        ContactEquations::slip_acceleration(now, equations_.contacts[touching.contact], rates_);
    b[0] += now.n_dot.dot(now.w);
    set_rate(touching, b, &problem_.cone.b);
    const Vector3d slip = now.slip();
    const double speed = slip.norm();
    if (!touching.is_rough || !(speed > least_slip)) continue;
    ConeContact& cone = problem_.cone.contacts[touching.column / 3];
    cone.slips = true;
    cone.direction = touching.frame.rightCols<2>().transpose() * slip / speed;
  }
  for (std::size_t k = 0; k < held_.size(); ++k) {
    problem_.cone.b[problem_.responses.of_contacts + k] =
        coordinate_acceleration_[held_[k].coordinate] - held_[k].acceleration;
    problem_.cone.rows.push_back({held_[k].bounds.least, held_[k].bounds.most});
    if (!problem_.responses.is_free[k]) problem_.cone.rows.back() = {};
  }
}

// Finds the motors that are not at rest at their goals, and their braking decelerations.
// EventDriven compares with prescribed motions instead.
void ContactEvents::find_lost() {
  for (std::size_t c = 0; c < equations_.coordinates.size(); ++c) {
    ContactEquations::Coordinate& of = equations_.coordinates[c];
    if (!of.law.goal) continue;
    const ContactEquations::Reading now = equations_.read(of, nullptr);
    if (std::abs(now.q - *of.law.goal) <= kTouching && std::abs(now.rate) <= kResting)
      of.braking = 0.0;
    else if (of.braking == 0.0)
      of.braking = braking_of(c);
  }
}

// Deceleration of a coordinate by half of the force of its motor, while other motors hold.
double ContactEvents::braking_of(std::size_t c) {
  ContactEquations::Responses responses;
  responses.coordinates = {c};
  for (std::size_t d = 0; d < equations_.coordinates.size(); ++d)
    if (d != c && equations_.coordinates[d].is_one_sided &&
        equations_.coordinates[d].law.drive > 0.0)
      responses.coordinates.push_back(d);
  equations_.find_responses(&responses);
  List<Eigen::Index> others;
  const std::size_t n = responses.columns;
  for (std::size_t k = 1; k < n; ++k)
    if (responses.is_free[k]) others.push_back(static_cast<Eigen::Index>(k));
  const auto size = static_cast<Eigen::Index>(n);
  const Eigen::Map<const Eigen::MatrixXd> A(responses.A.data(), size, size);
  return 0.5 * equations_.coordinates[c].law.drive * response_beside(A, others, 0);
}

void ContactEvents::choose_servos() {
  for (std::size_t c = 0; c < equations_.coordinates.size(); ++c) {
    ContactEquations::Coordinate& of = equations_.coordinates[c];
    if (!of.law.has_servo()) continue;
    ContactEquations::Reading now = equations_.read(of, nullptr);
    now.acceleration = coordinate_acceleration_[c];
    of.state.servo = servo_from(of.law, states_before_[c].servo, now, equations_.rest(of));
  }
}

// Lists the coordinates that move at the rate of a law that may hold them, and sets the acting
// forces of the others. Returns false where a coordinate passes a limit without force limit.
bool ContactEvents::find_candidates(List<Candidate>* candidates) {
  candidates->clear();
  for (std::size_t c = 0; c < equations_.coordinates.size(); ++c) {
    ContactEquations::Coordinate& of = equations_.coordinates[c];
    of.state = {};
    of.reference = 0.0;
    if (!of.is_one_sided) continue;
    const ContactEquations::Reading now = equations_.read(of, nullptr);
    const auto limit = [&](bool upper_one) { return equations_.limit(of, upper_one); };
    const auto zeta = [&] { return equations_.zeta(of); };
    OneSidedState state;
    const bool is_lost = of.law.goal && of.braking > 0.0;
    const std::optional<Hold> hold =
        find_hold(of.law, states_before_[c], now, limit, zeta, is_lost, false, &state);
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

// Decides how contacts act by the solved accelerations, and stores accelerations of all touching
// contacts.
void ContactEvents::choose_acts() {
  find_solved_accelerations();
  double scale = kLeastScale, largest = 0.0;
  for (std::size_t i = 0; i < problem_.force.size(); ++i) {
    scale = std::max(scale, std::abs(problem_.cone.b[i]));
    largest = std::max(largest, std::abs(problem_.force[i]));
  }
  const double largest_force = equations_.largest_force();
  for (const ContactEquations::Touching& touching : problem_.responses.contacts) {
    const Vector3d f = touching.of(problem_.force.data()), a = touching.of(solved_.data());
    const std::size_t c = touching.contact;
    ContactEquations::Contact& contact = equations_.contacts[c];
    gap_acceleration_[c] = a[0];
    if (f[0] <= kAtRest * largest && a[0] > kAtRest * scale) continue;
    if (at_zero_.has(c) && f[0] <= kAtBound * largest_force) continue;
    contact.acts = Acts::kSlips;
    contact.reference.setZero();
    contact.direction.setZero();
    if (!touching.is_rough) continue;
    const ConeContact& cone = problem_.cone.contacts[touching.column / 3];
    const Eigen::Vector2d a_t = a.tail<2>();
    if (cone.slips)
      contact.direction = touching.frame.rightCols<2>() * cone.direction;
    else if (a_t.norm() > kAtRest * scale)
      contact.direction = touching.frame.rightCols<2>() * a_t.normalized();
    else
      contact.acts = Acts::kSticks;
  }
}

// Computes b + A p of the problem.
void ContactEvents::find_solved_accelerations() {
  const std::size_t n = problem_.force.size();
  solved_ = problem_.cone.b;
  for (std::size_t j = 0; j < n; ++j)
    for (std::size_t i = 0; i < n; ++i)
      solved_[i] += problem_.cone.A[n * j + i] * problem_.force[j];
}

// Decides how coordinates are held by the solved accelerations.
void ContactEvents::choose_holds(const Watched& event) {
  if (held_.empty()) return;
  const std::size_t n = problem_.force.size();
  const auto root = [&](std::size_t i) {
    return std::sqrt(std::max(problem_.cone.A[n * i + i], 0.0));
  };
  double largest = 0.0;
  for (std::size_t i = 0; i < n; ++i)
    if (root(i) > 0.0) largest = std::max(largest, std::abs(problem_.cone.b[i]) / root(i));
  const double largest_force = equations_.largest_force();
  for (std::size_t k = 0; k < held_.size(); ++k) {
    const Candidate& row = held_[k];
    const std::size_t i = problem_.responses.of_contacts + k;
    ContactEquations::Coordinate& of = equations_.coordinates[row.coordinate];
    coordinate_acceleration_[row.coordinate] = solved_[i] + row.acceleration;
    if (!problem_.responses.is_free[k]) continue;
    const double least = std::max(kAtRest * largest * root(i), kAtRest * kLeastScale);
    signed char side = std::abs(solved_[i]) > least ? sign_of(solved_[i]) : sign_of(0.0);
    const double bound = event.side < 0 ? row.bounds.least : row.bounds.most;
    const bool gives_way = event.kind == Watched::Kind::kHeld && event.coordinate == row.coordinate;
    if (side == 0 && gives_way &&
        std::abs(problem_.force[i] - bound) <=
            kAtBound * std::max({std::abs(bound), std::abs(problem_.force[i]), largest_force}))
      side = static_cast<signed char>(-event.side);
    if (side == 0)
      of.state.hold = row.hold;
    else
      of.state = state_leaving(of.law, row.hold, row.rate, equations_.zeta(of).rate, side);
  }
}

// Takes over the forces of the solution, where least-norm forces violate their bounds. Contacts and
// laws at a bound yield.
void ContactEvents::take_forces() {
  for (std::size_t k = 0; k < held_.size(); ++k)
    equations_.coordinates[held_[k].coordinate].reference =
        problem_.force[problem_.responses.of_contacts + k];
  for (const ContactEquations::Touching& touching : problem_.responses.contacts) {
    ContactEquations::Contact& contact = equations_.contacts[touching.contact];
    if (contact.acts == Acts::kOpen) continue;
    const Vector3d f = touching.of(problem_.force.data());
    contact.reference = touching.frame * f;
    const Eigen::Vector2d f_t = f.tail<2>();
    if (!at_cone_.has(touching.contact) || contact.acts != Acts::kSticks ||
        !(f_t.norm() >= (1.0 - kAtBound) * contact.friction * f[0]))
      continue;
    contact.acts = Acts::kSlips;
    contact.direction = -(touching.frame.rightCols<2>() * f_t.normalized());
  }
}

// Whether the forces of all acting rows are within their bounds, to rounding.
bool ContactEvents::is_within_bounds() {
  free_.resize(equations_.size());
  equations_.derivative(0, equations_.time(), numbers_.data(), free_.data());
  List<Watched>& forces = forces_;
  forces.clear();
  for (std::size_t c = 0; c < equations_.contacts.size(); ++c)
    if (equations_.contacts[c].acts != Acts::kOpen)
      watch_contact_forces(equations_, c, false, &forces);
  for (std::size_t c = 0; c < equations_.coordinates.size(); ++c)
    if (equations_.coordinates[c].state.hold != Hold::kNone)
      watch_held(equations_, c, false, &forces);
  return std::all_of(forces.begin(), forces.end(),
                     [](const Watched& watched) { return watched.value >= -watched.tolerance; });
}

// Sets where coordinates are held from now on.
void ContactEvents::hold_coordinates(bool is_begin) {
  for (std::size_t c = 0; c < equations_.coordinates.size(); ++c) {
    ContactEquations::Coordinate& of = equations_.coordinates[c];
    const OneSidedState& before = states_before_[c];
    if (!of.is_one_sided || (!is_begin && of.state == before)) continue;
    of.held = equations_.read(of, nullptr).q;
    of.held_at = equations_.clock();
    if (of.law.goal && of.state.drive != 0 && of.braking == 0.0) of.braking = braking_of(c);
    if (of.state.hold == Hold::kBrake)
      of.until = of.held_at + std::sqrt(2.0 * std::abs(of.held - *of.law.goal) / of.braking);
    if (before.yield != 0) of.given_way += of.held - equations_.limit(of, before.yield > 0).value;
  }
}

}  // namespace constraint_sim::engine
