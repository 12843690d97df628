// What ContactEvents does at an event: contacts that are hit have impacts, and then the cone
// problem of the accelerations says what each contact does from there on.
//
// With w the rates of contacts along their normals and tangents, and A what impulses do to these
// while the rigid joints hold:
//   impacts    w⁺ = w + A p,  w_n⁺ + e w_n⁻ ≥ 0 and p_n ≥ 0, one of them 0, p in its cone
//   afterwards ẇ = b + A f of contacts that touch and do not part, f in its cone; along the slip of
//              those that slip

#include <algorithm>
#include <cmath>

#include "engine/linear/cone_problem.h"
#include "engine/methods/contact_events.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Index;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kNoWork = 1e-12;    // of the energy that impulses exchange: rounding
constexpr double kAtRest = 1e-8;     // of the largest acceleration: less is none
constexpr double kAtBound = 1e-6;    // of the force that gives way
constexpr double kSameTime = 1e-6;   // of a span
constexpr double kJam = 1e-9;        // [m/s] that what jams is taken to approach with
constexpr double kEndOfSlip = 1e-7;  // [m/s] a slip that ends there is off by no more than rounding
constexpr double kBounce = 1e-10;    // [m] of height: a lower bounce is none
constexpr int kMostImpacts = 2000;

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
  note_cone(*span, event);
  std::vector<double> hit(equations_.contacts.size(), 0.0);
  if ((jams && !have_jam(&hit)) || !have_impacts(&hit)) return false;
  if (!decide(event) && !(have_jam(&hit) && decide({}))) return false;
  const double kinetic = equations_.kinetic_energy(), potential = equations_.potential_energy();
  if (!equations_.project(span->left.t, y) || !equations_.restart(y, derivative())) return false;
  span->progress.projected += kinetic - equations_.kinetic_energy();
  span->progress.corrected += equations_.potential_energy() - potential;
  tell(span->left.t, before, hit, is_begin);
  return true;
}

// Contacts that share a force have their bounds at the same time: one after the other gives way,
// and none that has takes it up again.
void ContactEvents::note_cone(const Span& span, const Watched& event) {
  const double t = span.left.t;
  if (event.kind != Watched::Kind::kCone || t - at_cone_since_ > kSameTime * span.all.h)
    at_cone_.clear();
  if (event.kind != Watched::Kind::kCone) return;
  if (at_cone_.empty()) at_cone_since_ = t;
  at_cone_.push_back(event.contact);
}

// ---- impacts

// Impacts one after the other until nothing is hit any more. Contacts that would bounce too low to
// be seen have no restitution: then all is done again.
bool ContactEvents::have_impacts(std::vector<double>* hit) {
  const std::vector<double> start(numbers_.begin(), numbers_.begin() + index(equations_.size()));
  const std::vector<ContactEquations::Contact> contacts = equations_.contacts;
  const std::vector<ContactEquations::RigidJoint> joints = equations_.joints;
  std::vector<char> rests(contacts.size(), 0);
  for (bool is_settled = false; !is_settled;) {
    int count = 0;
    for (; count < kMostImpacts; ++count) {
      const std::vector<std::size_t> hits = find_hits(rests);
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
    equations_.place(numbers_.data());
    hit->assign(contacts.size(), 0.0);
  }
  return true;
}

// The contacts that take part in the next impact: of those with a restitution the one that is hit
// fastest with all others of the same pair, and all without. None where none is hit.
std::vector<std::size_t> ContactEvents::find_hits(const std::vector<char>& rests) const {
  std::vector<std::size_t> touching;
  double fastest_rate = -kResting;
  std::size_t fastest = pairs_.size();
  bool any_hit = false;
  for (std::size_t c = 0; c < equations_.contacts.size(); ++c) {
    const ContactEquations::Contact& contact = equations_.contacts[c];
    const ContactMotion now = equations_.motion(contact);
    if (now.gap > kTouching) continue;
    touching.push_back(c);
    any_hit = any_hit || now.gap_rate() < -kResting;
    const bool bounces = contact.restitution > 0.0 && !rests[c];
    if (!bounces || !(now.gap_rate() < fastest_rate)) continue;
    fastest_rate = now.gap_rate();
    fastest = pair_of_[c];
  }
  if (!any_hit) return {};
  const auto waits = [&](std::size_t c) {
    return equations_.contacts[c].restitution > 0.0 && !rests[c] && pair_of_[c] != fastest;
  };
  touching.erase(std::remove_if(touching.begin(), touching.end(), waits), touching.end());
  return touching;
}

// With less restitution where kinetic energy would rise, and where joints or friction leave no
// answer with it. `faster` [m/s] than they are, those at rest approach. False where there is none.
bool ContactEvents::have_impact(const std::vector<std::size_t>& hits,
                                const std::vector<char>& rests, double faster,
                                std::vector<double>* hit) {
  const ContactEquations::Responses responses = equations_.responses(hits);
  ConeProblem problem;
  problem.A = responses.A;
  VectorXd rate(3 * index(hits.size())), impulse;
  for (std::size_t i = 0; i < hits.size(); ++i) {
    const ContactEquations::Contact& contact = equations_.contacts[hits[i]];
    rate.segment<3>(3 * index(i)) = responses.frames[i].transpose() * equations_.motion(contact).w;
    problem.contacts.push_back({contact.friction, false, Eigen::Vector2d::Zero()});
  }
  for (const double share : {1.0, 0.5, 0.25, 0.0}) {
    problem.b = rate;
    for (std::size_t i = 0; i < hits.size(); ++i) {
      double& normal = problem.b[3 * index(i)];
      const double e = rests[hits[i]] ? 0.0 : equations_.contacts[hits[i]].restitution;
      if (normal < -kResting)
        normal *= 1.0 + share * e;
      else
        normal = std::max(normal, 0.0) - faster;
    }
    if (!solve(problem, &impulse)) {
      if (share == 0.0) return false;
      continue;
    }
    const VectorXd mean = rate + 0.5 * problem.A * impulse;
    if (impulse.dot(mean) <= kNoWork * impulse.cwiseAbs().dot(rate.cwiseAbs())) break;
  }
  equations_.apply(responses, impulse, numbers_.data());
  for (std::size_t i = 0; i < hits.size(); ++i) (*hit)[hits[i]] += impulse[3 * index(i)];
  return true;
}

// Where friction drives a contact that slips into the other body (Painlevé), no force is large
// enough, but an impulse without restitution, that ends the slip.
bool ContactEvents::have_jam(std::vector<double>* hit) {
  std::vector<std::size_t> touching;
  for (std::size_t c = 0; c < equations_.contacts.size(); ++c) {
    const ContactMotion now = equations_.motion(equations_.contacts[c]);
    if (now.gap <= kTouching && now.gap_rate() <= kResting) touching.push_back(c);
  }
  if (touching.empty()) return false;
  ++impacts_;
  return have_impact(touching, std::vector<char>(equations_.contacts.size(), 1), kJam, hit);
}

// Finds those that bounce too low to be seen.
bool ContactEvents::let_rest(const std::vector<double>& hit, std::vector<char>* rests,
                             bool* is_settled) {
  *is_settled = true;
  bool any = false;
  for (std::size_t c = 0; c < hit.size(); ++c)
    any = any || (hit[c] > 0.0 && equations_.contacts[c].restitution > 0.0 && !(*rests)[c]);
  if (!any) return true;
  if (!decide({})) return false;
  for (std::size_t c = 0; c < hit.size(); ++c) {
    const ContactEquations::Contact& contact = equations_.contacts[c];
    if (!(hit[c] > 0.0) || contact.restitution == 0.0 || (*rests)[c]) continue;
    const ContactMotion now = equations_.motion(contact);
    const double speed = now.gap_rate();
    const double fall = -(now.n.dot(acceleration_[c]) + now.n_dot.dot(now.w));
    if (now.gap > kTouching || speed <= 0.0 || fall <= 0.0 || speed * speed > 2.0 * fall * kBounce)
      continue;
    (*rests)[c] = 1;
    *is_settled = false;
  }
  return true;
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
  std::vector<double> free(equations_.size());
  equations_.derivative(0, 0.0, numbers_.data(), free.data());
  equations_.find_accelerations(free.data(), &rates_);
  const auto acceleration_of = [&](std::size_t c) {
    const ContactEquations::Contact& contact = equations_.contacts[c];
    return ContactEquations::slip_acceleration(equations_.motion(contact), contact, rates_);
  };
  acceleration_.clear();
  for (std::size_t c = 0; c < equations_.contacts.size(); ++c)
    acceleration_.push_back(acceleration_of(c));
  if (candidates.empty()) return true;

  const ContactEquations::Responses responses = equations_.responses(candidates);
  ConeProblem problem;
  problem.A = responses.A;
  problem.b.resize(3 * index(candidates.size()));
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
  VectorXd force;
  if (!solve(problem, &force)) return false;
  choose_acts(event, candidates, responses, problem, force);
  return true;
}

// By the solution of the problem of the accelerations; also finds these for all that touch.
void ContactEvents::choose_acts(const Watched& event, const std::vector<std::size_t>& candidates,
                                const ContactEquations::Responses& responses,
                                const ConeProblem& problem, const VectorXd& force) {
  const VectorXd a = problem.b + problem.A * force;
  const double scale = problem.b.lpNorm<Eigen::Infinity>();
  const double largest_force = equations_.largest_force();
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    const Vector3d f = force.segment<3>(3 * index(i));
    const Vector3d a_i = a.segment<3>(3 * index(i));
    ContactEquations::Contact& contact = equations_.contacts[candidates[i]];
    const ContactMotion now = equations_.motion(contact);
    acceleration_[candidates[i]] = responses.frames[i] * a_i - now.n * now.n_dot.dot(now.w);
    const bool gives_way = event.kind != Watched::Kind::kNothing && event.contact == candidates[i];
    if (f[0] == 0.0 && a_i[0] > kAtRest * scale) continue;
    if (gives_way && event.kind == Watched::Kind::kForce && f[0] <= kAtBound * largest_force)
      continue;
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
  if (is_within_bounds()) return;
  // the forces of least norm are not: those of the solution, and what is at its bound gives way
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    ContactEquations::Contact& contact = equations_.contacts[candidates[i]];
    if (contact.acts == Acts::kOpen) continue;
    const Vector3d f = force.segment<3>(3 * index(i));
    contact.reference = responses.frames[i] * f;
    const Eigen::Vector2d f_t = f.tail<2>();
    if (std::find(at_cone_.begin(), at_cone_.end(), candidates[i]) == at_cone_.end() ||
        contact.acts != Acts::kSticks ||
        !(f_t.norm() >= (1.0 - kAtBound) * contact.friction * f[0]))
      continue;
    contact.acts = Acts::kSlips;
    contact.direction = -(responses.frames[i].rightCols<2>() * f_t.normalized());
  }
}

// whether the forces of all that acts now are, to rounding
bool ContactEvents::is_within_bounds() {
  std::vector<double> unused(equations_.size());
  equations_.derivative(0, 0.0, numbers_.data(), unused.data());
  std::vector<Watched> forces;
  for (std::size_t c = 0; c < equations_.contacts.size(); ++c)
    if (equations_.contacts[c].acts != Acts::kOpen) watch_forces(c, &forces);
  return std::all_of(forces.begin(), forces.end(),
                     [](const Watched& watched) { return watched.value >= -watched.tolerance; });
}

// ---- what is told

void ContactEvents::tell(double t, const std::vector<Acts>& before, const std::vector<double>& hit,
                         bool is_begin) {
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
      impulse += hit[c];
    }
    if (is_begin && impulse > 0.0) was = false;
    if (!was && (is || impulse > 0.0)) told_.push_back({EventKind::kContactBegan, t, p, impulse});
    if (was && impulse > 0.0) told_.push_back({EventKind::kHit, t, p, impulse});
    if ((was || impulse > 0.0) && !is) told_.push_back({EventKind::kContactEnded, t, p, 0.0});
    if (was && is && stuck != sticks && pair.friction > 0.0)
      told_.push_back({sticks ? EventKind::kSticks : EventKind::kSlips, t, p, 0.0});
  }
}

}  // namespace constraint_sim::engine
