#include "engine/methods/event_driven/joints/event_impacts.h"

#include <algorithm>
#include <cmath>

#include "engine/math/box_lcp.h"
#include "engine/math/dense.h"
#include "engine/math/numbers.h"
#include "engine/methods/event_driven/law_events.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

}  // namespace

List<EventHit> find_hits(const EventMotions& motions, const EventProblem& problem, double t,
                         const List<char>& rests) {
  const List<OneSidedLaw>& laws = motions.laws();
  List<EventHit> touching;
  const EventHit* fastest = nullptr;
  bool any_hit = false;
  for (std::size_t c = 0; c < laws.size(); ++c) {
    const OneSidedLaw& law = laws[c];
    if (motions.is_broken(law.joint) || std::isfinite(law.limit_force)) continue;
    for (const bool upper_one : {false, true}) {
      if (!std::isfinite(law.limit(upper_one))) continue;
      const Prescribed at_limit = motions.limit(c, upper_one, t);
      const double direction = upper_one ? -1.0 : 1.0;
      if (direction * (problem.reading(c).q - at_limit.value) > kTouching) continue;
      const double rate = direction * (problem.reading(c).rate - at_limit.rate);
      const bool is_hit = rate < -problem.resting();
      any_hit = any_hit || is_hit;
      const double restitution = rests[c] ? 0.0 : law.restitution;
      if (is_hit || (restitution == 0.0 && problem.is_free(c)))
        touching.push_back({c, direction, rate, is_hit ? restitution : 0.0});
    }
  }
  if (!any_hit) return {};
  for (const EventHit& hit : touching)
    if (hit.restitution > 0.0 && (fastest == nullptr || hit.rate < fastest->rate)) fastest = &hit;
  const auto ends = fastest != nullptr ? motions.joints().ends(laws[fastest->law].joint)
                                       : EventJoints::Ends::value_type{};
  const auto waits = [&](const EventHit& hit) {
    const auto [a, b] = motions.joints().ends(laws[hit.law].joint);
    return hit.restitution > 0.0 && std::minmax(a, b) != std::minmax(ends.first, ends.second);
  };
  touching.erase(std::remove_if(touching.begin(), touching.end(), waits), touching.end());
  return touching;
}

bool solve_impact(const EventProblem& rows, const List<EventHit>& hits, List<double>* impulses) {
  impulses->clear();
  const Index n = eigen_index(hits.size());
  BoxLcp problem{Eigen::MatrixXd(n, n), VectorXd(n), VectorXd::Zero(n),
                 VectorXd::Constant(n, kInfinity)};
  VectorXd rate(n), impulse;
  for (Index i = 0; i < n; ++i) {
    const EventHit& hit = hits[static_cast<std::size_t>(i)];
    // A rigid joint drives the coordinate into its limit.
    if (!rows.is_free(hit.law)) return false;
    rate[i] = hit.rate;
    for (Index j = 0; j < n; ++j) {
      const EventHit& other = hits[static_cast<std::size_t>(j)];
      problem.A(i, j) = hit.direction * other.direction * rows.A(hit.law, other.law);
    }
  }
  for (const double share : {1.0, 0.5, 0.25, 0.0}) {
    for (Index i = 0; i < n; ++i)
      problem.b[i] = (1.0 + share * hits[static_cast<std::size_t>(i)].restitution) * rate[i];
    if (!solve(problem, &impulse)) return false;
    const VectorXd mean = rate + 0.5 * math::product(problem.A, impulse);
    if (math::dot(impulse, mean) <= kNoWork * math::dot(impulse.cwiseAbs(), rate.cwiseAbs())) break;
  }
  for (Index i = 0; i < n; ++i)
    impulses->push_back(hits[static_cast<std::size_t>(i)].direction * impulse[i]);
  return true;
}

}  // namespace constraint_sim::engine
