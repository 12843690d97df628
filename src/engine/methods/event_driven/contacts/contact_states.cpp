#include "engine/methods/event_driven/contacts/contact_states.h"

#include <algorithm>
#include <cmath>

#include "engine/math/numbers.h"
#include "engine/methods/event_driven/contacts/position_motors.h"
#include "engine/methods/event_driven/law_events.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kAtRest = 1e-8;      // share of the largest acceleration; less is zero
constexpr double kLeastScale = 0.01;  // [m/s²] least largest acceleration, where nothing pulls
constexpr double kSameTime = 1e-6;    // share of an interval

}  // namespace

void ContactStates::begin_step() {
  for (AtBound* at : {&at_cone_, &at_zero_}) at->contacts.clear();
}

void ContactStates::begin_event(const ContactEquations& equations) {
  indeterminate_ = 0.0;
  acts_before_.clear();
  features_before_.clear();
  for (const ContactEquations::Contact& contact : equations.contacts()) {
    acts_before_.push_back(contact.acts);
    features_before_.push_back(contact.feature.id);
  }
  coordinates_before_.clear();
  for (const GroupCoordinate& of : equations.joints().coordinates())
    coordinates_before_.push_back(of.state);
}

bool ContactStates::has_changed(const ContactEquations& equations) const {
  for (std::size_t c = 0; c < acts_before_.size(); ++c)
    if (acts_before_[c] != equations.contacts()[c].acts ||
        features_before_[c] != equations.contacts()[c].feature.id)
      return true;
  for (std::size_t c = 0; c < coordinates_before_.size(); ++c)
    if (!(coordinates_before_[c] == equations.joints().coordinates()[c].state)) return true;
  return false;
}

void ContactStates::note_bounds(double t, double h, const ContactWatched& event,
                                const ContactPairs& pairs, const ContactEquations& equations) {
  interval_ = h;
  const auto note = [&](ContactWatched::Kind kind, bool is_over, AtBound* at) {
    const auto is_done = [&](std::size_t c) {
      const ContactEquations::Contact& contact = equations.contacts()[c];
      return kind != ContactWatched::Kind::kCone || contact.acts != Acts::kSlips ||
             equations.motion(contact).slip().norm() > pairs.tolerances().end_of_slip;
    };
    List<std::size_t>& contacts = at->contacts;
    if (is_over)
      contacts.clear();
    else if (t - at->since > kSameTime * h)
      contacts.erase(std::remove_if(contacts.begin(), contacts.end(), is_done), contacts.end());
    if (event.kind != kind) return;
    if (contacts.empty()) at->since = t;
    if (!at->has(event.contact)) contacts.push_back(event.contact);
  };
  note(ContactWatched::Kind::kCone, event.kind != ContactWatched::Kind::kCone, &at_cone_);
  note(ContactWatched::Kind::kForce, false, &at_zero_);
}

bool ContactStates::decide(const ContactWatched& event, const double* y, const ContactPairs& pairs,
                           CountedSolver* solver, ContactEquations* equations) {
  const ContactTolerances& within = pairs.tolerances();
  // Near the end of a slip its direction turns ever faster; contacts that can stick then stick.
  if (event.kind == ContactWatched::Kind::kSlip &&
      decide(event, within.end_of_slip, y, pairs, solver, equations)) {
    bool all_stick = true;
    for (const ContactEquations::Contact& contact : equations->contacts()) {
      const double speed = equations->motion(contact).slip().norm();
      all_stick = all_stick && (contact.acts != Acts::kSlips || contact.friction == 0.0 ||
                                speed <= within.resting || speed > within.end_of_slip);
    }
    if (all_stick) return true;
  }
  return decide(event, within.resting, y, pairs, solver, equations);
}

// Chooses which contacts open, stick and slip after an event. A contact that slips by at most
// `least_slip` [m/s] counts as sticking.
bool ContactStates::decide(const ContactWatched& event, double least_slip, const double* y,
                           const ContactPairs& pairs, CountedSolver* solver,
                           ContactEquations* equations) {
  find_lost(equations);
  is_pressed_.assign(equations->joints().coordinates().size(), 0);
  do {
    if (!decide_once(event, least_slip, y, pairs, solver, equations)) return false;
  } while (find_pressed(*equations, coordinate_acceleration_, &is_pressed_) ||
           note_lost(equations));
  choose_servos(equations);
  return true;
}

bool ContactStates::decide_once(const ContactWatched& event, double least_slip, const double* y,
                                const ContactPairs& pairs, CountedSolver* solver,
                                ContactEquations* equations) {
  has_derivative_ = false;
  for (GroupJoint& joint : equations->joints().list()) joint.reference = {};
  for (ContactEquations::Contact& contact : equations->contacts()) {
    contact.acts = Acts::kOpen;
    contact.normal_share = contact.tangent_share = 1.0;
  }
  equations->joints().look_ahead(interval_);
  const bool is_possible =
      find_candidates(std::max(kResting, pairs.tolerances().resting), equations);
  if (is_possible) find_free_motion(y, pairs.tolerances(), equations);
  equations->joints().look_now();
  if (!is_possible) return false;
  ContactResponses& responses = problem_.responses;
  if (!responses.contacts().empty() || !candidates_.empty()) {
    for (const Candidate& row : candidates_) responses.add_coordinate(row.coordinate);
    responses.find(*equations);
    set_problem(least_slip, *equations);
    if (!solver->solve(problem_.cone, &problem_.force)) return false;
    choose_acts(equations);
    choose_holds(event, equations);
    has_derivative_ = is_within_bounds(y, equations);
    if (!has_derivative_) {
      indeterminate_ =
          std::max(indeterminate_, sharing_.share(pairs, solver, &problem_, equations));
      take_forces(equations);
    }
  }
  return true;
}

const GroupMotions& ContactStates::accelerations(const double* y, ContactEquations* equations) {
  if (!has_derivative_) equations->derivative(0, equations->bodies().time(), y, derivative_.data());
  equations->bodies().find_accelerations(derivative_.data(), &rates_);
  return rates_;
}

// Finds the accelerations without acting rows, and the contacts that touch and do not part.
void ContactStates::find_free_motion(const double* y, const ContactTolerances& within,
                                     ContactEquations* equations) {
  const GroupBodies& bodies = equations->bodies();
  GroupJoints& joints = equations->joints();
  derivative_.resize(equations->size());
  equations->derivative(0, bodies.time(), y, derivative_.data());
  bodies.find_accelerations(derivative_.data(), &rates_);
  free_forces_.clear();
  for (std::size_t j = 0; j < joints.list().size(); ++j)
    free_forces_.push_back(equations->joint_force(j, 0));
  gap_acceleration_.assign(equations->contacts().size(), 0.0);
  problem_.responses.clear();
  for (std::size_t c = 0; c < equations->contacts().size(); ++c) {
    const ContactEquations::Contact& contact = equations->contacts()[c];
    if (contact.feature.kind == ContactFeature::Kind::kNothing) continue;
    const ContactMotion now = equations->motion(contact);
    gap_acceleration_[c] =
        now.n_dot.dot(now.w) + now.n.dot(ContactEquations::slip_acceleration(now, contact, rates_));
    if (now.gap > within.touching || std::abs(now.gap_rate()) > within.resting) continue;
    const std::ptrdiff_t twin = problem_.responses.find_twin(c, now, within.touching, *equations);
    if (twin < 0 ||
        std::abs(gap_acceleration_[c] - gap_acceleration_[to_index(twin)]) > kAtRest * kLeastScale)
      problem_.responses.add(c, now);
  }
  coordinate_acceleration_.clear();
  for (const GroupCoordinate& of : joints.coordinates())
    coordinate_acceleration_.push_back(joints.read(bodies, of, &rates_).acceleration);
}

// Sets up the problem of accelerations, as if contacts with a slip up to `least_slip` [m/s] did not
// slip.
void ContactStates::set_problem(double least_slip, const ContactEquations& equations) {
  problem_.begin(equations);
  for (const TouchingContact& touching : problem_.responses.contacts()) {
    const ContactMotion& now = touching.motion;
    Vector3d b =
        touching.frame.transpose() *
        ContactEquations::slip_acceleration(now, equations.contacts()[touching.contact], rates_);
    b[0] += now.n_dot.dot(now.w);
    // Joints alone move what they hold; rounding of that is not an approach.
    if (problem_.responses.is_held(touching.column) && std::abs(b[0]) <= kAtRest * kLeastScale)
      b[0] = 0.0;
    set_rate(touching, b, &problem_.cone.b);
    const Vector3d slip = now.slip();
    const double speed = slip.norm();
    if (!touching.is_rough || !(speed > least_slip)) continue;
    ConeContact& cone = problem_.cone.contacts[touching.column / 3];
    cone.slips = true;
    cone.direction = touching.frame.rightCols<2>().transpose() * slip / speed;
  }
  for (std::size_t k = 0; k < candidates_.size(); ++k) {
    problem_.cone.b[problem_.responses.of_contacts() + k] =
        coordinate_acceleration_[candidates_[k].coordinate] - candidates_[k].acceleration;
    problem_.cone.rows.push_back({candidates_[k].bounds.least, candidates_[k].bounds.most});
    if (!problem_.responses.is_free(k)) problem_.cone.rows.back() = {};
  }
}

void ContactStates::choose_servos(ContactEquations* equations) const {
  const GroupBodies& bodies = equations->bodies();
  GroupJoints& joints = equations->joints();
  for (std::size_t c = 0; c < joints.coordinates().size(); ++c) {
    GroupCoordinate& of = joints.coordinates()[c];
    if (!of.law.has_servo()) continue;
    GroupJoints::Reading now = joints.read(bodies, of, nullptr);
    now.acceleration = coordinate_acceleration_[c];
    of.state.servo = servo_from(of.law, coordinates_before_[c].servo, now, joints.rest(bodies, of));
  }
}

// Lists the coordinates that move at the rate of a law that may hold them, to `resting`, and sets
// the acting forces of the others. Returns false where a coordinate passes a limit without force
// limit.
bool ContactStates::find_candidates(double resting, ContactEquations* equations) {
  const GroupBodies& bodies = equations->bodies();
  GroupJoints& joints = equations->joints();
  candidates_.clear();
  for (std::size_t c = 0; c < joints.coordinates().size(); ++c) {
    GroupCoordinate& of = joints.coordinates()[c];
    of.state = {};
    of.reference = 0.0;
    if (!of.is_one_sided) continue;
    const GroupJoints::Reading now = joints.read(bodies, of, nullptr);
    const auto limit = [&](bool upper_one) { return joints.limit(bodies, of, upper_one); };
    const auto zeta = [&] { return joints.zeta(bodies, of); };
    OneSidedState state;
    const HoldRules rules{resting, of.law.goal ? of.braking : 0.0, is_pressed_[c] == 0};
    const std::optional<Hold> hold =
        find_hold(of.law, coordinates_before_[c], now, limit, zeta, rules, &state);
    if (hold) {
      const Prescribed at = *hold == Hold::kBrake ? braking_from(*of.law.goal, now.rate, of.braking)
                                                  : rate_held_at(*hold, limit, zeta);
      candidates_.push_back(
          {c, *hold, at.rate, at.acceleration, force_bounds(of.law, *hold, at, zeta())});
      continue;
    }
    if (state.yield != 0 && !std::isfinite(of.law.limit_force)) return false;
    of.state = state;
  }
  return true;
}

// Decides how contacts act by the solved accelerations, and stores accelerations of all touching
// contacts.
void ContactStates::choose_acts(ContactEquations* equations) {
  find_solved_accelerations();
  double scale = kLeastScale, largest = 0.0;
  for (std::size_t i = 0; i < problem_.force.size(); ++i) {
    scale = std::max(scale, std::abs(problem_.cone.b[i]));
    largest = std::max(largest, std::abs(problem_.force[i]));
  }
  const double largest_force = equations->largest_force();
  for (const TouchingContact& touching : problem_.responses.contacts()) {
    const Vector3d f = touching.of(problem_.force.data()), a = touching.of(solved_.data());
    const std::size_t c = touching.contact;
    ContactEquations::Contact& contact = equations->contacts()[c];
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
void ContactStates::find_solved_accelerations() {
  const std::size_t n = problem_.force.size();
  solved_ = problem_.cone.b;
  for (std::size_t j = 0; j < n; ++j)
    for (std::size_t i = 0; i < n; ++i)
      solved_[i] += problem_.cone.A[n * j + i] * problem_.force[j];
}

// Decides how coordinates are held by the solved accelerations.
void ContactStates::choose_holds(const ContactWatched& event, ContactEquations* equations) {
  GroupJoints& joints = equations->joints();
  if (candidates_.empty()) return;
  const std::size_t n = problem_.force.size();
  const auto root = [&](std::size_t i) {
    return std::sqrt(std::max(problem_.cone.A[n * i + i], 0.0));
  };
  double largest = 0.0;
  for (std::size_t i = 0; i < n; ++i)
    if (root(i) > 0.0) largest = std::max(largest, std::abs(problem_.cone.b[i]) / root(i));
  const double largest_force = equations->largest_force();
  for (std::size_t k = 0; k < candidates_.size(); ++k) {
    const Candidate& row = candidates_[k];
    const std::size_t i = problem_.responses.of_contacts() + k;
    GroupCoordinate& of = joints.coordinates()[row.coordinate];
    coordinate_acceleration_[row.coordinate] = solved_[i] + row.acceleration;
    if (!problem_.responses.is_free(k)) continue;
    const double least = std::max(kAtRest * largest * root(i), kAtRest * kLeastScale);
    signed char side = std::abs(solved_[i]) > least ? sign_of(solved_[i]) : sign_of(0.0);
    const double bound = event.side < 0 ? row.bounds.least : row.bounds.most;
    const bool yields_here =
        event.kind == ContactWatched::Kind::kHeld && event.coordinate == row.coordinate;
    if (side == 0 && yields_here &&
        std::abs(problem_.force[i] - bound) <=
            kAtBound * std::max({std::abs(bound), std::abs(problem_.force[i]), largest_force}))
      side = static_cast<signed char>(-event.side);
    if (side == 0)
      of.state.hold = row.hold;
    else
      of.state = state_leaving(of.law, row.hold, row.rate,
                               joints.zeta(equations->bodies(), of).rate, side);
  }
}

// Takes over the forces of the solution, where least-norm forces violate their bounds. Contacts and
// laws at a bound yield.
void ContactStates::take_forces(ContactEquations* equations) const {
  GroupJoints& joints = equations->joints();
  for (std::size_t j = 0; j < joints.list().size(); ++j)
    joints.list()[j].reference = free_forces_[j];
  for (GroupCoordinate& of : joints.coordinates())
    if (of.is_prescribed) of.reference = joints.list()[of.joint].reference.at(of.law);
  problem_.responses.refer_joints(problem_.force.data(), &joints);
  for (std::size_t k = 0; k < candidates_.size(); ++k)
    joints.coordinates()[candidates_[k].coordinate].reference =
        problem_.force[problem_.responses.of_contacts() + k];
  for (const TouchingContact& touching : problem_.responses.contacts()) {
    ContactEquations::Contact& contact = equations->contacts()[touching.contact];
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
bool ContactStates::is_within_bounds(const double* y, ContactEquations* equations) {
  GroupJoints& joints = equations->joints();
  derivative_.resize(equations->size());
  equations->derivative(0, equations->bodies().time(), y, derivative_.data());
  List<ContactWatched>& forces = forces_;
  forces.clear();
  for (std::size_t c = 0; c < equations->contacts().size(); ++c)
    if (equations->contacts()[c].acts != Acts::kOpen)
      watch_contact_forces(*equations, c, {}, &forces);
  for (std::size_t c = 0; c < joints.coordinates().size(); ++c)
    if (joints.coordinates()[c].state.hold != Hold::kNone) watch_held(*equations, c, {}, &forces);
  return std::all_of(forces.begin(), forces.end(), [](const ContactWatched& watched) {
    return watched.value >= -watched.tolerance;
  });
}

// Sets where coordinates are held from now on.
void ContactStates::hold_coordinates(bool is_begin, ContactEquations* equations) const {
  const GroupBodies& bodies = equations->bodies();
  GroupJoints& joints = equations->joints();
  for (std::size_t c = 0; c < joints.coordinates().size(); ++c) {
    GroupCoordinate& of = joints.coordinates()[c];
    const OneSidedState& before = coordinates_before_[c];
    if (!of.is_one_sided || (!is_begin && of.state == before)) continue;
    const GroupJoints::Reading now = joints.read(bodies, of, nullptr);
    of.held = now.q;
    of.held_at = bodies.clock();
    if (of.state.hold == Hold::kBrake) {
      of.held = *of.law.goal - 0.5 * now.rate * std::abs(now.rate) / of.braking;
      of.until = of.held_at + std::abs(now.rate) / of.braking;
    }
    if (before.yield != 0)
      of.yield_displacement += of.held - joints.limit(bodies, of, before.yield > 0).value;
  }
}

}  // namespace constraint_sim::engine
