#include "engine/methods/event_driven/contacts/overlap_closing.h"

#include <algorithm>

#include "engine/collision/narrowphase.h"
#include "engine/math/numbers.h"
#include "engine/methods/event_driven/event_watch.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr int kMostClosingRounds = 10;  // each round leaves about the square of the overlap
constexpr int kMostMeetings = 2;        // rounds after that, which close gaps
// Multiple of the largest overlap; nearer points may be pushed into each other.
constexpr double kNear = 2.0;

// Makes contacts of all points with a gap up to `margin`, and returns the deepest overlap.
double find_overlaps(const List<ContactPair>& pairs, double margin, ContactEquations* equations) {
  const GroupBodies& bodies = equations->bodies();
  equations->contacts().clear();
  double deepest = 0.0;
  for (const ContactPair& pair : pairs) {
    const BodyState &a = bodies.shape_state(pair.shape_index_a),
                    &b = bodies.shape_state(pair.shape_index_b);
    const Manifold manifold = collide(pair.shape_a, a, pair.shape_b, b, margin);
    for (std::size_t k = 0; k < static_cast<std::size_t>(manifold.count); ++k) {
      const Manifold::Point& point = manifold.points[k];
      const Vector3d on_a = point.position - point.depth * manifold.normal;
      ContactEquations::Contact& contact = equations->contacts().emplace_back();
      contact.a = pair.a;
      contact.b = pair.b;
      contact.shape_index_a = pair.shape_index_a;
      contact.shape_index_b = pair.shape_index_b;
      contact.feature.on_a = a.orientation.conjugate() * (on_a - a.position);
      contact.feature.on_b = b.orientation.conjugate() * (point.position - b.position);
      contact.feature.axis = b.orientation.conjugate() * manifold.normal;
      deepest = std::max(deepest, point.depth);
    }
  }
  return deepest;
}

// Largest violation of a one-sided limit by a coordinate.
double beyond_limits(const ContactEquations& equations) {
  const GroupBodies& bodies = equations.bodies();
  const GroupJoints& joints = equations.joints();
  double most = 0.0;
  for (const GroupCoordinate& of : joints.coordinates()) {
    if (!of.is_one_sided) continue;
    const double q = joints.read(bodies, of, nullptr).q;
    most = std::max({most, joints.limit(bodies, of, false).value - q,
                     q - joints.limit(bodies, of, true).value});
  }
  return most;
}

}  // namespace

// Makes a round with the contacts of find_overlaps(). Closes overlaps, and with `met` also gaps.
bool OverlapClosing::close_found(bool met, CountedSolver* solver, ContactEquations* equations) {
  problem_.responses.clear();
  for (std::size_t c = 0; c < equations->contacts().size(); ++c)
    problem_.responses.add(c, equations->motion(equations->contacts()[c]));
  problem_.responses.find(*equations);
  problem_.cone.A = problem_.responses.A();
  problem_.cone.b.assign(problem_.responses.columns(), 0.0);
  problem_.cone.contacts.clear();
  problem_.cone.rows.assign(problem_.responses.columns(), {met ? -kInfinity : 0.0, kInfinity});
  for (const TouchingContact& touching : problem_.responses.contacts())
    problem_.cone.b[touching.column] = touching.motion.gap;
  if (!solver->solve(problem_.cone, &problem_.force)) return false;
  double* const y = equations->bodies().numbers().data();
  problem_.responses.displace(problem_.force.data(), equations, y);
  equations->contacts().clear();
  return equations->project(0.0, y);
}

bool OverlapClosing::close(const ContactPairs& pairs, CountedSolver* solver,
                           ContactEquations* equations, double* corrected) {
  const double before = equations->bodies().kinetic_energy() + equations->potential_energy();
  const double beyond = std::max(beyond_limits(*equations), kTouching);
  // Events close smaller overlaps themselves.
  const double closed_overlap = pairs.tolerances().missed;
  double deepest = find_overlaps(pairs.list(), 0.0, equations), last = 0.0;
  for (int round = 0; deepest > closed_overlap; ++round) {
    if (round == kMostClosingRounds || solver->is_stopped()) return false;
    last = deepest;
    find_overlaps(pairs.list(), kNear * last, equations);
    if (!close_found(false, solver, equations)) return false;
    deepest = find_overlaps(pairs.list(), 0.0, equations);
  }
  // Gaps of second order remain, from which bodies would fall and rattle.
  const List<double> closed = equations->bodies().numbers();
  for (int round = 0; round < kMostMeetings && last > 0.0; ++round) {
    find_overlaps(pairs.list(), kNear * last, equations);
    if (close_found(true, solver, equations) &&
        find_overlaps(pairs.list(), 0.0, equations) <= closed_overlap)
      continue;
    equations->bodies().numbers() = closed;
    equations->bodies().place(equations->bodies().numbers().data());
    break;
  }
  equations->contacts().clear();
  if (beyond_limits(*equations) > beyond) return false;
  *corrected += equations->bodies().kinetic_energy() + equations->potential_energy() - before;
  return true;
}

}  // namespace constraint_sim::engine
