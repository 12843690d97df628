// Impacts of ContactEvents, of contacts and limits that are hit. With w the rates of contacts along
// normals and tangents, and A the response to impulses while the joints hold:
//   w⁺ = w + A p,  0 ≤ p_n ⊥ w_n⁺ + e w_n⁻ ≥ 0,  p in its friction cone
// Coordinates with one-sided laws are rows of the same problem, as in event_states.cpp.

#include <algorithm>
#include <cmath>

#include "engine/math/cone_problem.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/methods/event_driven/contacts/contact_events.h"
#include "engine/methods/event_driven/joints/law_events.h"

namespace constraint_sim::engine {
namespace {

constexpr double kJam = 1e-9;  // [m/s] assumed approach speed of jammed contacts

}  // namespace

// Solves impacts one after the other until nothing is hit. Contacts and limits whose bounces are
// too low to be followed lose their restitution; then all impacts are repeated.
bool ContactEvents::have_impacts(double left, PerRow<double>* hit) {
  PerRow<char>& rests = rests_;
  rests.reset(equations_);
  find_hits(rests, &hits_);
  if (hits_.empty()) return true;
  before_impacts_.numbers.assign(numbers_.data(), numbers_.data() + equations_.size());
  before_impacts_.driven_work = equations_.driven_work;
  before_impacts_.contacts = equations_.contacts;
  before_impacts_.joints = equations_.joints;
  before_impacts_.coordinates = equations_.coordinates;
  for (bool is_settled = false;;) {
    for (int count = 0; !hits_.empty(); ++count) {
      if (count == kMostImpacts || !have_impact(hits_, rests, 0.0, hit)) return false;
      find_hits(rests, &hits_);
    }
    ++done_.impacts;
    if (!let_rest(left, *hit, &rests, &is_settled)) return false;
    if (is_settled) return true;
    std::copy(before_impacts_.numbers.begin(), before_impacts_.numbers.end(), numbers_.begin());
    equations_.driven_work = before_impacts_.driven_work;
    equations_.contacts = before_impacts_.contacts;
    equations_.joints = before_impacts_.joints;
    equations_.coordinates = before_impacts_.coordinates;
    equations_.place(numbers_.data());
    hit->reset(equations_);
    find_hits(rests, &hits_);
  }
}

std::pair<std::size_t, std::size_t> ContactEvents::bodies_of(
    const ContactEquations::Coordinate& of) const {
  const ContactEquations::BodyJoint& joint = equations_.joints[of.joint];
  return std::minmax(joint.a, joint.b);
}

// Lists limits that are reached and not left: hit limits, and limits without restitution.
// `only_slow`: no hit limits.
void ContactEvents::add_touching_limits(const PerRow<char>& rests, bool only_slow,
                                        List<LimitHit>* hits) const {
  for (std::size_t c = 0; c < equations_.coordinates.size(); ++c) {
    const ContactEquations::Coordinate& of = equations_.coordinates[c];
    if (!of.is_one_sided || std::isfinite(of.law.limit_force)) continue;
    for (const bool upper_one : {false, true}) {
      if (!std::isfinite(of.law.limit(upper_one))) continue;
      const ContactEquations::Reading now = equations_.read(of, nullptr);
      const Prescribed at_limit = equations_.limit(of, upper_one);
      const double direction = upper_one ? -1.0 : 1.0;
      const double gap = direction * (now.q - at_limit.value);
      if (gap > kTouching) continue;
      const double rate = direction * (now.rate - at_limit.rate);
      const bool is_hit = rate < -kResting;
      const double restitution = rests.coordinates[c] ? 0.0 : of.law.restitution;
      if (only_slow ? rate > kResting : !is_hit && restitution > 0.0) continue;
      hits->push_back({c, direction, gap, rate, is_hit ? restitution : 0.0});
    }
  }
}

// Whether a contact or limit is hit. At the start of an interval an open gap is no hit, since early
// hits would end bounces too early.
bool ContactEvents::is_hit(double gap, double rate) const {
  return rate < -kResting && (!begins_ || gap <= 0.0);
}

// Lists the hits of the next impact: of contacts and limits with restitution the fastest hit, with
// all others between the same two bodies; and all without restitution. Empty where nothing is hit.
void ContactEvents::find_hits(const PerRow<char>& rests, Hits* found) const {
  Hits& hits = *found;
  hits.clear();
  double fastest_rate = -kResting;
  std::pair<std::size_t, std::size_t> fastest;
  bool any_hit = false, any_bounce = false;
  const auto consider = [&](double gap, double rate, bool bounces, std::size_t a, std::size_t b) {
    any_hit = any_hit || is_hit(gap, rate);
    if (!bounces || !(rate < fastest_rate)) return;
    any_bounce = true;
    fastest_rate = rate;
    fastest = std::minmax(a, b);
  };
  for (std::size_t c = 0; c < equations_.contacts.size(); ++c) {
    const ContactEquations::Contact& contact = equations_.contacts[c];
    const ContactMotion now = equations_.motion(contact);
    if (now.gap > kTouching) continue;
    hits.contacts.push_back({c, now});
    consider(now.gap, now.gap_rate(), contact.restitution > 0.0 && !rests.contacts[c], contact.a,
             contact.b);
  }
  add_touching_limits(rests, false, &hits.limits);
  for (const LimitHit& hit : hits.limits) {
    const auto [a, b] = bodies_of(equations_.coordinates[hit.coordinate]);
    consider(hit.gap, hit.rate, hit.restitution > 0.0, a, b);
  }
  if (!any_hit) {
    hits.clear();
    return;
  }
  const auto waits = [&](const ContactHit& hit) {
    const ContactEquations::Contact& contact = equations_.contacts[hit.contact];
    return contact.restitution > 0.0 && !rests.contacts[hit.contact] &&
           !(any_bounce &&
             std::minmax(contact.a, contact.b) == std::minmax(fastest.first, fastest.second));
  };
  hits.contacts.erase(std::remove_if(hits.contacts.begin(), hits.contacts.end(), waits),
                      hits.contacts.end());
  const auto limit_waits = [&](const LimitHit& hit) {
    return hit.restitution > 0.0 && bodies_of(equations_.coordinates[hit.coordinate]) != fastest;
  };
  hits.limits.erase(std::remove_if(hits.limits.begin(), hits.limits.end(), limit_waits),
                    hits.limits.end());
}

// Solves an impact, with less restitution where kinetic energy would rise, or where joints or
// friction allow no solution. `faster`: approach speed added to contacts at rest [m/s]. Returns
// false where there is no solution.
bool ContactEvents::have_impact(const Hits& hits, const PerRow<char>& rests, double faster,
                                PerRow<double>* hit) {
  ContactEquations::Responses& responses = problem_.responses;
  responses.clear();
  for (const ContactHit& of : hits.contacts) responses.add(of.contact, of.motion);
  for (const LimitHit& of : hits.limits) responses.coordinates.push_back(of.coordinate);
  equations_.find_responses(&responses);
  ConeProblem& problem = problem_.cone;
  problem_.begin(equations_);
  const std::size_t first = responses.of_contacts;
  rate_.resize(responses.columns);
  for (const ContactEquations::Touching& touching : responses.contacts)
    set_rate(touching, touching.frame.transpose() * touching.motion.w, &rate_);
  for (std::size_t k = 0; k < hits.limits.size(); ++k) {
    const LimitHit& of = hits.limits[k];
    rate_[first + k] = of.direction * of.rate;
    // Joints drive the coordinate into its limit.
    if (!responses.is_free[k] && of.rate < -kResting) return false;
    problem.rows.push_back(
        {of.direction > 0.0 ? 0.0 : -kInfinity, of.direction > 0.0 ? kInfinity : 0.0});
    if (!responses.is_free[k]) problem.rows.back() = {};
  }
  for (const double share : {1.0, 0.5, 0.25, 0.0}) {
    problem.b = rate_;
    for (const ContactEquations::Touching& touching : responses.contacts) {
      double& normal = problem.b[touching.column];
      const std::size_t c = touching.contact;
      const double e = rests.contacts[c] ? 0.0 : equations_.contacts[c].restitution;
      if (normal < -kResting)
        normal *= 1.0 + share * e;
      else
        normal = std::max(normal, 0.0) - faster;
    }
    for (std::size_t k = 0; k < hits.limits.size(); ++k)
      problem.b[first + k] *= 1.0 + share * hits.limits[k].restitution;
    if (!solver_.solve(problem, &problem_.force)) {
      if (share == 0.0) return false;
      continue;
    }
    if (!does_work(responses)) break;
  }
  equations_.apply(responses, problem_.force.data(), numbers_.data());
  for (const ContactEquations::Touching& touching : responses.contacts)
    hit->contacts[touching.contact] += problem_.force[touching.column];
  for (std::size_t k = 0; k < hits.limits.size(); ++k)
    hit->coordinates[hits.limits[k].coordinate] += problem_.force[first + k];
  return true;
}

// Whether the impulses add kinetic energy, by the means of rates before and after.
bool ContactEvents::does_work(const ContactEquations::Responses& responses) const {
  const std::size_t n = responses.columns;
  double work = 0.0, exchanged = 0.0;
  for (std::size_t j = 0; j < n; ++j) {
    double change = 0.0;
    for (std::size_t i = 0; i < n; ++i) change += responses.A[n * j + i] * problem_.force[i];
    work += problem_.force[j] * (rate_[j] + 0.5 * change);
    exchanged += std::abs(problem_.force[j]) * std::abs(rate_[j]);
  }
  return !(work <= kNoWork * exchanged);
}

// Ends slips that friction drives into the other body (Painlevé), where no finite force suffices,
// by an impulse without restitution.
bool ContactEvents::have_jam(PerRow<double>* hit) {
  Hits& touching = hits_;
  touching.clear();
  for (std::size_t c = 0; c < equations_.contacts.size(); ++c) {
    const ContactMotion now = equations_.motion(equations_.contacts[c]);
    if (now.gap <= kTouching && now.gap_rate() <= kResting) touching.contacts.push_back({c, now});
  }
  if (touching.contacts.empty()) return false;
  ++done_.impacts;
  PerRow<char>& rests = rests_;
  rests.reset(equations_);
  std::fill(rests.contacts.begin(), rests.contacts.end(), 1);
  std::fill(rests.coordinates.begin(), rests.coordinates.end(), 1);
  add_touching_limits(rests, true, &touching.limits);
  return have_impact(touching, rests, kJam, hit);
}

// Finds the contacts and limits whose bounces are too low to be followed.
bool ContactEvents::let_rest(double left, const PerRow<double>& hit, PerRow<char>* rests,
                             bool* is_settled) {
  *is_settled = true;
  const auto is_bounce = [&](std::size_t c) {
    return hit.contacts[c] > 0.0 && equations_.contacts[c].restitution > 0.0 && !rests->contacts[c];
  };
  const auto is_limit_bounce = [&](std::size_t c) {
    return hit.coordinates[c] != 0.0 && equations_.coordinates[c].law.restitution > 0.0 &&
           !rests->coordinates[c];
  };
  bool any = false;
  for (std::size_t c = 0; c < hit.contacts.size(); ++c) any = any || is_bounce(c);
  for (std::size_t c = 0; c < hit.coordinates.size(); ++c) any = any || is_limit_bounce(c);
  if (!any) return true;
  if (!decide({})) return false;
  for (std::size_t c = 0; c < hit.contacts.size(); ++c) {
    if (!is_bounce(c)) continue;
    const ContactMotion now = equations_.motion(equations_.contacts[c]);
    if (now.gap > kTouching) continue;
    const std::optional<double> rests_in = time_to_rest(now.gap_rate(), -gap_acceleration_[c],
                                                        equations_.contacts[c].restitution, left);
    if (!rests_in) continue;
    rests_in_.contacts[c] = *rests_in;
    rests->contacts[c] = 1;
    *is_settled = false;
  }
  for (std::size_t c = 0; c < hit.coordinates.size(); ++c) {
    if (!is_limit_bounce(c)) continue;
    const ContactEquations::Coordinate& of = equations_.coordinates[c];
    const bool upper_one = hit.coordinates[c] < 0.0;
    const double direction = upper_one ? -1.0 : 1.0;
    const ContactEquations::Reading now = equations_.read(of, nullptr);
    const Prescribed at_limit = equations_.limit(of, upper_one);
    if (direction * (now.q - at_limit.value) > kTouching) continue;
    const std::optional<double> rests_in =
        time_to_rest(direction * (now.rate - at_limit.rate),
                     -direction * (coordinate_acceleration_[c] - at_limit.acceleration),
                     of.law.restitution, left);
    if (!rests_in) continue;
    rests_in_.coordinates[c] = *rests_in;
    rests->coordinates[c] = 1;
    *is_settled = false;
  }
  return true;
}

}  // namespace constraint_sim::engine
