// Closing of overlaps that another method has left, before a group is advanced by events: the least
// change Σ m ‖Δx‖² + Δφ·I Δφ of positions after which no shapes overlap and the joints hold. Each
// round linearizes the overlaps found by the narrowphase and solves the cone problem of impulses
// without friction, with gaps in place of velocities.

#include <algorithm>

#include "engine/collision/narrowphase.h"
#include "engine/math/cone_problem.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/methods/event_driven/contacts/contact_events.h"
#include "engine/methods/event_driven/joints/law_events.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr int kMostClosingRounds = 10;  // each round leaves about the square of the overlap
constexpr int kMostMeetings = 2;        // rounds after that, which close gaps
constexpr double kClosed = 1e-9;        // [m] events close such overlaps themselves
// Multiple of the largest overlap; nearer points may be pushed into each other.
constexpr double kNear = 2.0;

}  // namespace

double ContactEvents::find_overlaps(double margin) {
  equations_.contacts.clear();
  double deepest = 0.0;
  for (const ContactPair& pair : pairs_.list()) {
    const BodyState &a = equations_.shape_state(pair.a), &b = equations_.shape_state(pair.b);
    const Manifold manifold = collide(pair.shape_a, a, pair.shape_b, b, margin);
    for (std::size_t k = 0; k < static_cast<std::size_t>(manifold.count); ++k) {
      const Manifold::Point& point = manifold.points[k];
      const Vector3d on_a = point.position - point.depth * manifold.normal;
      ContactEquations::Contact& contact = equations_.contacts.emplace_back();
      contact.a = pair.a;
      contact.b = pair.b;
      contact.feature.on_a = a.orientation.conjugate() * (on_a - a.position);
      contact.feature.on_b = b.orientation.conjugate() * (point.position - b.position);
      contact.feature.axis = b.orientation.conjugate() * manifold.normal;
      deepest = std::max(deepest, point.depth);
    }
  }
  return deepest;
}

// Largest violation of a one-sided limit by a coordinate.
double ContactEvents::beyond_limits() const {
  double most = 0.0;
  for (const ContactEquations::Coordinate& of : equations_.coordinates) {
    if (!of.is_one_sided) continue;
    const double q = equations_.read(of, nullptr).q;
    most = std::max(
        {most, equations_.limit(of, false).value - q, q - equations_.limit(of, true).value});
  }
  return most;
}

// Makes a round with the contacts of find_overlaps(). Closes overlaps, and with `met` also gaps.
bool ContactEvents::close_found(bool met) {
  responses_.clear();
  for (std::size_t c = 0; c < equations_.contacts.size(); ++c)
    responses_.add(c, equations_.motion(equations_.contacts[c]));
  equations_.find_responses(&responses_);
  problem_.A = responses_.A;
  problem_.b.assign(responses_.columns, 0.0);
  problem_.contacts.clear();
  problem_.rows.assign(responses_.columns, {met ? -kInfinity : 0.0, kInfinity});
  for (const ContactEquations::Touching& touching : responses_.contacts)
    problem_.b[touching.column] = touching.motion.gap;
  if (!solve_counted()) return false;
  double* const y = equations_.numbers().data();
  equations_.displace(responses_, force_.data(), y);
  equations_.contacts.clear();
  return equations_.project(0.0, y);
}

// Closes all overlaps. Returns false where rounds do not converge, or would push a joint beyond its
// limits.
bool ContactEvents::close_overlaps(Span* span, List<BodyState>* states) {
  const double before = equations_.kinetic_energy() + equations_.potential_energy();
  const double beyond = std::max(beyond_limits(), kTouching);
  double deepest = find_overlaps(0.0), last = 0.0;
  for (int round = 0; deepest > kClosed; ++round) {
    if (round == kMostClosingRounds || is_set(span->all.stop)) return false;
    last = deepest;
    find_overlaps(kNear * last);
    if (!close_found(false)) return false;
    deepest = find_overlaps(0.0);
  }
  // Gaps of second order remain, from which bodies would fall and rattle.
  const List<double> closed = equations_.numbers();
  for (int round = 0; round < kMostMeetings && last > 0.0; ++round) {
    find_overlaps(kNear * last);
    if (close_found(true) && find_overlaps(0.0) <= kClosed) continue;
    equations_.numbers() = closed;
    equations_.place(equations_.numbers().data());
    break;
  }
  equations_.contacts.clear();
  if (beyond_limits() > beyond) return false;
  span->progress.corrected += equations_.kinetic_energy() + equations_.potential_energy() - before;
  equations_.scatter_state(states);
  return begin(*states, false);
}

}  // namespace constraint_sim::engine
