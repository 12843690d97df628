// Impacts of ContactEvents: contacts and limits that are hit.
//
// With w the rates of contacts along their normals and tangents, and A what impulses do to these
// while the joints hold: w⁺ = w + A p,  w_n⁺ + e w_n⁻ ≥ 0 and p_n ≥ 0, one of them 0, p in its
// cone. Coordinates with one-sided laws are rows of the same problem, as event_states.cpp has them.

#include <algorithm>
#include <cmath>

#include "engine/linear/cone_problem.h"
#include "engine/methods/contact_events.h"
#include "engine/methods/law_events.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr double kNoWork = 1e-12;  // of the energy that impulses exchange: rounding
constexpr double kJam = 1e-9;      // [m/s] that what jams is taken to approach with
constexpr double kBounce = 1e-10;  // [m] of height: a lower bounce is none
constexpr int kMostImpacts = 2000;

Index index(std::size_t i) { return static_cast<Index>(i); }

}  // namespace

// Impacts one after the other until nothing is hit any more. What would bounce too low to be seen
// has no restitution: then all is done again.
bool ContactEvents::have_impacts(Of<double>* hit) {
  const std::vector<double> start(numbers_.begin(), numbers_.begin() + index(equations_.size()));
  const std::vector<ContactEquations::Contact> contacts = equations_.contacts;
  const std::vector<ContactEquations::BodyJoint> joints = equations_.joints;
  const std::vector<ContactEquations::Coordinate> coordinates = equations_.coordinates;
  Of<char> rests(contacts.size(), coordinates.size());
  for (bool is_settled = false; !is_settled;) {
    int count = 0;
    for (; count < kMostImpacts; ++count) {
      const Hits hits = find_hits(rests);
      if (hits.empty()) break;
      if (!have_impact(hits, rests, 0.0, hit)) return false;
    }
    if (count == kMostImpacts) return false;
    if (count == 0) return true;
    ++impacts_;
    if (!let_rest(*hit, &rests, &is_settled)) return false;
    if (is_settled) break;
    std::copy(start.begin(), start.end(), numbers_.begin());
    equations_.contacts = contacts;
    equations_.joints = joints;
    equations_.coordinates = coordinates;
    equations_.place(numbers_.data());
    *hit = Of<double>(contacts.size(), coordinates.size());
  }
  return true;
}

std::pair<std::size_t, std::size_t> ContactEvents::bodies_of(
    const ContactEquations::Coordinate& of) const {
  const ContactEquations::BodyJoint& joint = equations_.joints[of.joint];
  return std::minmax(joint.a, joint.b);
}

// Limits that are reached, and not left: those that are hit, and those without restitution.
// `only_slow`: none that is hit.
void ContactEvents::add_touching_limits(const Of<char>& rests, bool only_slow,
                                        std::vector<LimitHit>* hits) const {
  for (std::size_t c = 0; c < equations_.coordinates.size(); ++c) {
    const ContactEquations::Coordinate& of = equations_.coordinates[c];
    if (!of.is_one_sided || std::isfinite(of.law.limit_force)) continue;
    for (const bool upper_one : {false, true}) {
      if (!std::isfinite(of.law.limit(upper_one))) continue;
      const ContactEquations::Reading now = equations_.read(of, nullptr);
      const Prescribed at_limit = equations_.limit(of, upper_one);
      const double direction = upper_one ? -1.0 : 1.0;
      if (direction * (now.q - at_limit.value) > kTouching) continue;
      const double rate = direction * (now.rate - at_limit.rate);
      const bool is_hit = rate < -kResting;
      const double restitution = rests.coordinates[c] ? 0.0 : of.law.restitution;
      if (only_slow ? rate > kResting : !is_hit && restitution > 0.0) continue;
      hits->push_back({c, direction, rate, is_hit ? restitution : 0.0});
    }
  }
}

// What takes part in the next impact: of contacts and limits with a restitution the one that is hit
// fastest with all others between the same two bodies, and all without. None where none is hit.
ContactEvents::Hits ContactEvents::find_hits(const Of<char>& rests) const {
  Hits hits;
  double fastest_rate = -kResting;
  std::pair<std::size_t, std::size_t> fastest;
  bool any_hit = false, any_bounce = false;
  const auto consider = [&](double rate, bool bounces, std::size_t a, std::size_t b) {
    any_hit = any_hit || rate < -kResting;
    if (!bounces || !(rate < fastest_rate)) return;
    any_bounce = true;
    fastest_rate = rate;
    fastest = std::minmax(a, b);
  };
  for (std::size_t c = 0; c < equations_.contacts.size(); ++c) {
    const ContactEquations::Contact& contact = equations_.contacts[c];
    const ContactMotion now = equations_.motion(contact);
    if (now.gap > kTouching) continue;
    hits.contacts.push_back(c);
    consider(now.gap_rate(), contact.restitution > 0.0 && !rests.contacts[c], contact.a, contact.b);
  }
  add_touching_limits(rests, false, &hits.limits);
  for (const LimitHit& hit : hits.limits) {
    const auto [a, b] = bodies_of(equations_.coordinates[hit.coordinate]);
    consider(hit.rate, hit.restitution > 0.0, a, b);
  }
  if (!any_hit) return {};
  const auto waits = [&](std::size_t c) {
    const ContactEquations::Contact& contact = equations_.contacts[c];
    return contact.restitution > 0.0 && !rests.contacts[c] &&
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
  return hits;
}

// With less restitution where kinetic energy would rise, and where joints or friction leave no
// answer with it. `faster` [m/s] than they are, contacts at rest approach. False where there is
// none.
bool ContactEvents::have_impact(const Hits& hits, const Of<char>& rests, double faster,
                                Of<double>* hit) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  std::vector<std::size_t> limits;
  for (const LimitHit& of : hits.limits) limits.push_back(of.coordinate);
  const ContactEquations::Responses responses = equations_.responses(hits.contacts, limits);
  ConeProblem problem;
  problem.A = responses.A;
  const Index first = 3 * index(hits.contacts.size());
  VectorXd rate(first + index(limits.size())), impulse;
  for (std::size_t i = 0; i < hits.contacts.size(); ++i) {
    const ContactEquations::Contact& contact = equations_.contacts[hits.contacts[i]];
    rate.segment<3>(3 * index(i)) = responses.frames[i].transpose() * equations_.motion(contact).w;
    problem.contacts.push_back({contact.friction, false, Eigen::Vector2d::Zero()});
  }
  for (std::size_t k = 0; k < limits.size(); ++k) {
    const LimitHit& of = hits.limits[k];
    rate[first + index(k)] = of.direction * of.rate;
    if (!responses.is_free[k] && of.rate < -kResting) return false;  // joints drive it in
    problem.rows.push_back(
        {of.direction > 0.0 ? 0.0 : -kInfinity, of.direction > 0.0 ? kInfinity : 0.0});
    if (!responses.is_free[k]) problem.rows.back() = {};
  }
  for (const double share : {1.0, 0.5, 0.25, 0.0}) {
    problem.b = rate;
    for (std::size_t i = 0; i < hits.contacts.size(); ++i) {
      double& normal = problem.b[3 * index(i)];
      const std::size_t c = hits.contacts[i];
      const double e = rests.contacts[c] ? 0.0 : equations_.contacts[c].restitution;
      if (normal < -kResting)
        normal *= 1.0 + share * e;
      else
        normal = std::max(normal, 0.0) - faster;
    }
    for (std::size_t k = 0; k < limits.size(); ++k)
      problem.b[first + index(k)] *= 1.0 + share * hits.limits[k].restitution;
    if (!solve_counted(problem, &impulse)) {
      if (share == 0.0) return false;
      continue;
    }
    const VectorXd mean = rate + 0.5 * problem.A * impulse;
    if (impulse.dot(mean) <= kNoWork * impulse.cwiseAbs().dot(rate.cwiseAbs())) break;
  }
  equations_.apply(responses, impulse, numbers_.data());
  for (std::size_t i = 0; i < hits.contacts.size(); ++i)
    hit->contacts[hits.contacts[i]] += impulse[3 * index(i)];
  for (std::size_t k = 0; k < limits.size(); ++k)
    hit->coordinates[limits[k]] += impulse[first + index(k)];
  return true;
}

// Not solved where the work of the step is done, or it is to stop.
bool ContactEvents::solve_counted(const ConeProblem& problem, VectorXd* p) {
  SolveEffort effort{most_work_ - work_, stop_};
  const bool is_found = solve(problem, p, &effort);
  work_ += effort.spent;
  return is_found;
}

// Where friction drives a contact that slips into the other body (Painlevé), no force is large
// enough, but an impulse without restitution, that ends the slip.
bool ContactEvents::have_jam(Of<double>* hit) {
  Hits touching;
  for (std::size_t c = 0; c < equations_.contacts.size(); ++c) {
    const ContactMotion now = equations_.motion(equations_.contacts[c]);
    if (now.gap <= kTouching && now.gap_rate() <= kResting) touching.contacts.push_back(c);
  }
  if (touching.contacts.empty()) return false;
  ++impacts_;
  Of<char> rests(equations_.contacts.size(), equations_.coordinates.size());
  std::fill(rests.contacts.begin(), rests.contacts.end(), 1);
  std::fill(rests.coordinates.begin(), rests.coordinates.end(), 1);
  add_touching_limits(rests, true, &touching.limits);
  return have_impact(touching, rests, kJam, hit);
}

// Finds those that bounce too low to be seen.
bool ContactEvents::let_rest(const Of<double>& hit, Of<char>* rests, bool* is_settled) {
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
  const auto is_low = [](double gap, double speed, double fall) {
    return gap <= kTouching && speed > 0.0 && fall > 0.0 && speed * speed <= 2.0 * fall * kBounce;
  };
  for (std::size_t c = 0; c < hit.contacts.size(); ++c) {
    if (!is_bounce(c)) continue;
    const ContactMotion now = equations_.motion(equations_.contacts[c]);
    const double fall = -(now.n.dot(acceleration_[c]) + now.n_dot.dot(now.w));
    if (!is_low(now.gap, now.gap_rate(), fall)) continue;
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
    if (!is_low(direction * (now.q - at_limit.value), direction * (now.rate - at_limit.rate),
                -direction * (coordinate_acceleration_[c] - at_limit.acceleration)))
      continue;
    rests->coordinates[c] = 1;
    *is_settled = false;
  }
  return true;
}

}  // namespace constraint_sim::engine
