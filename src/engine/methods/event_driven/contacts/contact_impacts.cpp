#include "engine/methods/event_driven/contacts/contact_impacts.h"

#include <algorithm>
#include <cmath>

#include "engine/math/numbers.h"
#include "engine/methods/event_driven/law_events.h"

namespace constraint_sim::engine {
namespace {

std::pair<std::size_t, std::size_t> bodies_of(const ContactEquations& equations,
                                              std::size_t coordinate) {
  const GroupJoints& joints = equations.joints();
  const GroupJoint& joint = joints[joints.coordinates()[coordinate].joint];
  return std::minmax(joint.a, joint.b);
}

}  // namespace

void ContactImpacts::begin_event(const ContactEquations& equations) {
  results_.impulses.reset(equations);
  results_.rests_in.reset(equations);
  results_.indeterminate = 0.0;
}

void ContactImpacts::keep(const ContactEquations& equations, const double* y) {
  before_.numbers.assign(y, y + equations.size());
  before_.driven_work = equations.driven_work();
  before_.contacts = equations.contacts();
  before_.joints = equations.joints().list();
  before_.coordinates = equations.joints().coordinates();
}

void ContactImpacts::restore(ContactEquations* equations, double* y) const {
  std::copy(before_.numbers.begin(), before_.numbers.end(), y);
  equations->set_driven_work(before_.driven_work);
  equations->contacts() = before_.contacts;
  equations->joints().list() = before_.joints;
  equations->joints().coordinates() = before_.coordinates;
  equations->bodies().place(y);
}

bool ContactImpacts::have_impacts(const FollowedBounces& followed, bool begins,
                                  const ContactPairs& pairs, ContactStates* states,
                                  CountedSolver* solver, ContactEquations* equations, double* y) {
  rests_.reset(*equations);
  find_hits(begins, pairs, *equations);
  approach_ = hits_.approach;
  if (hits_.empty()) return true;
  keep(*equations, y);
  if (solve_impacts(followed, begins, pairs, states, solver, equations, y)) return true;
  start_again(equations, y);
  return false;
}

bool ContactImpacts::solve_impacts(const FollowedBounces& followed, bool begins,
                                   const ContactPairs& pairs, ContactStates* states,
                                   CountedSolver* solver, ContactEquations* equations, double* y) {
  for (bool is_settled = false;;) {
    for (int count = 0; !hits_.empty(); ++count) {
      if (count == kMostImpacts || !have_impact(0.0, pairs.tolerances(), solver, equations, y))
        return false;
      find_hits(begins, pairs, *equations);
    }
    ++count_;
    if (!let_rest(followed, pairs, states, solver, equations, y, &is_settled)) return false;
    if (is_settled) return true;
    start_again(equations, y);
    find_hits(begins, pairs, *equations);
  }
}

// Returns to the state before the impacts.
void ContactImpacts::start_again(ContactEquations* equations, double* y) {
  restore(equations, y);
  results_.impulses.reset(*equations);
  results_.indeterminate = 0.0;
}

// Lists limits that are reached and not left: hit limits, and limits without restitution.
// `only_slow`: no hit limits.
void ContactImpacts::add_touching_limits(bool only_slow, const ContactTolerances& within,
                                         const ContactEquations& equations) {
  const double resting = std::max(kResting, within.resting);
  const GroupBodies& bodies = equations.bodies();
  const GroupJoints& joints = equations.joints();
  for (std::size_t c = 0; c < joints.coordinates().size(); ++c) {
    const GroupCoordinate& of = joints.coordinates()[c];
    if (!of.is_one_sided || std::isfinite(of.law.limit_force)) continue;
    for (const bool upper_one : {false, true}) {
      if (!std::isfinite(of.law.limit(upper_one))) continue;
      const GroupJoints::Reading now = joints.read(bodies, of, nullptr);
      const Prescribed at_limit = joints.limit(bodies, of, upper_one);
      const double direction = upper_one ? -1.0 : 1.0;
      const double gap = direction * (now.q - at_limit.value);
      if (gap > kTouching) continue;
      const double rate = direction * (now.rate - at_limit.rate);
      const bool is_hit = rate < -resting;
      const double restitution = rests_.coordinates[c] ? 0.0 : of.law.restitution;
      if (only_slow ? rate > resting : !is_hit && restitution > 0.0) continue;
      hits_.limits.push_back({c, direction, gap, rate, is_hit ? restitution : 0.0});
    }
  }
}

// Lists the hits of the next impact: of contacts and limits with restitution the fastest hit, with
// all others between the same two bodies; and all without restitution. Empty where nothing is hit.
void ContactImpacts::find_hits(bool begins, const ContactPairs& pairs,
                               const ContactEquations& equations) {
  const ContactTolerances& within = pairs.tolerances();
  Hits& hits = hits_;
  hits.clear();
  double fastest_rate = -within.resting;
  std::pair<std::size_t, std::size_t> fastest;
  bool any_hit = false, any_bounce = false;
  const auto consider = [&](double gap, double rate, bool bounces, std::size_t a, std::size_t b) {
    any_hit = any_hit || (rate < -within.resting && (!begins || gap <= 0.0));
    hits.approach = std::max(hits.approach, -rate);
    if (!bounces || !(rate < fastest_rate)) return;
    any_bounce = true;
    fastest_rate = rate;
    fastest = std::minmax(a, b);
  };
  for (std::size_t c = 0; c < equations.contacts().size(); ++c) {
    const ContactEquations::Contact& contact = equations.contacts()[c];
    const ContactMotion now = equations.motion(contact);
    if (now.gap > within.touching) continue;
    hits.contacts.push_back({c, now});
    consider(now.gap, now.gap_rate(), contact.restitution > 0.0 && !rests_.contacts[c], contact.a,
             contact.b);
  }
  add_touching_limits(false, within, equations);
  for (const LimitHit& hit : hits.limits) {
    const auto [a, b] = bodies_of(equations, hit.coordinate);
    consider(hit.gap, hit.rate, hit.restitution > 0.0, a, b);
  }
  if (!any_hit) {
    hits.clear();
    return;
  }
  const auto waits = [&](const ContactHit& hit) {
    const ContactEquations::Contact& contact = equations.contacts()[hit.contact];
    return contact.restitution > 0.0 && !rests_.contacts[hit.contact] &&
           !(any_bounce &&
             std::minmax(contact.a, contact.b) == std::minmax(fastest.first, fastest.second));
  };
  hits.contacts.erase(std::remove_if(hits.contacts.begin(), hits.contacts.end(), waits),
                      hits.contacts.end());
  const auto limit_waits = [&](const LimitHit& hit) {
    return hit.restitution > 0.0 && bodies_of(equations, hit.coordinate) != fastest;
  };
  hits.limits.erase(std::remove_if(hits.limits.begin(), hits.limits.end(), limit_waits),
                    hits.limits.end());
}

// Solves an impact, with less restitution where kinetic energy would rise, or where joints or
// friction allow no solution. `faster`: approach speed added to contacts at rest [m/s]. Returns
// false where there is no solution.
bool ContactImpacts::have_impact(double faster, const ContactTolerances& within,
                                 CountedSolver* solver, ContactEquations* equations, double* y) {
  const Hits& hits = hits_;
  ContactResponses& responses = problem_.responses;
  responses.clear();
  for (const ContactHit& of : hits.contacts)
    if (responses.find_twin(of.contact, of.motion, within.touching, *equations) < 0)
      responses.add(of.contact, of.motion);
  for (const LimitHit& of : hits.limits) responses.add_coordinate(of.coordinate);
  responses.find(*equations);
  ConeProblem& problem = problem_.cone;
  problem_.begin(*equations);
  const std::size_t first = responses.of_contacts();
  rate_.resize(responses.columns());
  for (const TouchingContact& touching : responses.contacts())
    set_rate(touching, touching.frame.transpose() * touching.motion.w, &rate_);
  for (std::size_t k = 0; k < hits.limits.size(); ++k) {
    const LimitHit& of = hits.limits[k];
    rate_[first + k] = of.direction * of.rate;
    // Joints drive the coordinate into its limit.
    if (!responses.is_free(k) && of.rate < -std::max(kResting, within.resting)) return false;
    problem.rows.push_back(
        {of.direction > 0.0 ? 0.0 : -kInfinity, of.direction > 0.0 ? kInfinity : 0.0});
    if (!responses.is_free(k)) problem.rows.back() = {};
  }
  for (const double share : {1.0, 0.5, 0.25, 0.0}) {
    problem.b = rate_;
    for (const TouchingContact& touching : responses.contacts()) {
      double& normal = problem.b[touching.column];
      const std::size_t c = touching.contact;
      const double e = rests_.contacts[c] ? 0.0 : equations->contacts()[c].restitution;
      if (normal < -within.resting)
        normal *= 1.0 + share * e;
      else
        normal = std::max(normal, 0.0) - faster;
    }
    for (std::size_t k = 0; k < hits.limits.size(); ++k)
      problem.b[first + k] *= 1.0 + share * hits.limits[k].restitution;
    if (!solver->solve(problem, &problem_.force)) {
      if (share == 0.0) return false;
      continue;
    }
    if (!does_work()) break;
  }
  results_.indeterminate += sharing_.indeterminate_rate(problem, problem_.force);
  responses.apply(problem_.force.data(), equations, y);
  double largest = 0.0;
  for (const double impulse : problem_.force) largest = std::max(largest, std::abs(impulse));
  const auto note = [&](double impulse, double* sum) {
    if (std::abs(impulse) > kForceShare * largest) *sum += impulse;
  };
  for (const TouchingContact& touching : responses.contacts())
    note(problem_.force[touching.column], &results_.impulses.contacts[touching.contact]);
  for (std::size_t k = 0; k < hits.limits.size(); ++k)
    note(problem_.force[first + k], &results_.impulses.coordinates[hits.limits[k].coordinate]);
  return true;
}

// Whether the impulses add kinetic energy, by the means of rates before and after.
bool ContactImpacts::does_work() const {
  const ContactResponses& responses = problem_.responses;
  const List<double>& force = problem_.force;
  const std::size_t n = responses.columns();
  double work = 0.0, exchanged = 0.0;
  for (std::size_t j = 0; j < n; ++j) {
    double change = 0.0;
    for (std::size_t i = 0; i < n; ++i) change += responses.A()[n * j + i] * force[i];
    work += force[j] * (rate_[j] + 0.5 * change);
    exchanged += std::abs(force[j]) * std::abs(rate_[j]);
  }
  return !(work <= kNoWork * exchanged);
}

bool ContactImpacts::have_jam(const ContactPairs& pairs, CountedSolver* solver,
                              ContactEquations* equations, double* y) {
  const ContactTolerances& within = pairs.tolerances();
  hits_.clear();
  for (std::size_t c = 0; c < equations->contacts().size(); ++c) {
    const ContactMotion now = equations->motion(equations->contacts()[c]);
    if (now.gap <= within.touching && now.gap_rate() <= within.resting)
      hits_.contacts.push_back({c, now});
  }
  if (hits_.contacts.empty()) return false;
  ++count_;
  rests_.reset(*equations, 1);
  add_touching_limits(true, within, *equations);
  return have_impact(within.resting, within, solver, equations, y);
}

// Finds the contacts and limits whose bounces are too low to be followed.
bool ContactImpacts::let_rest(const FollowedBounces& followed, const ContactPairs& pairs,
                              ContactStates* states, CountedSolver* solver,
                              ContactEquations* equations, const double* y, bool* is_settled) {
  const GroupBodies& bodies = equations->bodies();
  GroupJoints& joints = equations->joints();
  const ContactTolerances& within = pairs.tolerances();
  const PerRow<double>& hit = results_.impulses;
  *is_settled = true;
  const auto is_bounce = [&](std::size_t c) {
    return hit.contacts[c] > 0.0 && equations->contacts()[c].restitution > 0.0 &&
           !rests_.contacts[c];
  };
  const auto is_limit_bounce = [&](std::size_t c) {
    return hit.coordinates[c] != 0.0 && joints.coordinates()[c].law.restitution > 0.0 &&
           !rests_.coordinates[c];
  };
  bool any = false;
  for (std::size_t c = 0; c < hit.contacts.size(); ++c)
    any = any || (is_bounce(c) &&
                  followed.may_leave_out(equations->motion(equations->contacts()[c]).gap_rate()));
  for (std::size_t c = 0; c < hit.coordinates.size(); ++c) any = any || is_limit_bounce(c);
  if (!any) return true;
  if (!states->decide({}, y, pairs, solver, equations)) return false;
  const GroupMotions& rates = states->accelerations(y, equations);
  for (std::size_t c = 0; c < hit.contacts.size(); ++c) {
    if (!is_bounce(c)) continue;
    const ContactMotion now = equations->motion(equations->contacts()[c]);
    if (now.gap > within.touching) continue;
    const ContactEquations::Contact& contact = equations->contacts()[c];
    const double fall =
        -now.n.dot(ContactEquations::slip_acceleration(now, contact, rates)) - now.n_dot.dot(now.w);
    const std::optional<double> rests_in =
        time_to_rest(now.gap_rate(), fall, contact.restitution, followed);
    if (!rests_in) continue;
    results_.rests_in.contacts[c] = *rests_in;
    rests_.contacts[c] = 1;
    *is_settled = false;
  }
  for (std::size_t c = 0; c < hit.coordinates.size(); ++c) {
    if (!is_limit_bounce(c)) continue;
    const GroupCoordinate& of = joints.coordinates()[c];
    const bool upper_one = hit.coordinates[c] < 0.0;
    const double direction = upper_one ? -1.0 : 1.0;
    const GroupJoints::Reading now = joints.read(bodies, of, &rates);
    const Prescribed at_limit = joints.limit(bodies, of, upper_one);
    if (direction * (now.q - at_limit.value) > kTouching) continue;
    const std::optional<double> rests_in = time_to_rest(
        direction * (now.rate - at_limit.rate),
        -direction * (now.acceleration - at_limit.acceleration), of.law.restitution, followed);
    if (!rests_in) continue;
    results_.rests_in.coordinates[c] = *rests_in;
    rests_.coordinates[c] = 1;
    *is_settled = false;
  }
  return true;
}

}  // namespace constraint_sim::engine
