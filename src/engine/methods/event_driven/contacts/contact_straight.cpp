// Slow slips of ContactEvents. Friction turns a slip w at a rate of μ N/(m ‖w‖), as fast as it
// would stop the slip. Where a body begins to slip or is about to stop, stages of any worthwhile
// length cannot follow. Then all slips keep their directions for a substep, held transversely by
// rows. With the share θ = f/μN of the transverse force f
//   the slip is off by θ ‖w‖ across, and friction along it is too large by μ N θ²/2,
// and both have to stay within the tolerance. Otherwise the substep is repeated as an ordinary one.

#include <algorithm>
#include <cmath>

#include "engine/methods/event_driven/contacts/contact_events.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kNoForce = 1e-12;  // share of the largest force; less is rounding

bool has_direction(const ContactEquations::Contact& of) {
  return of.acts == ContactEquations::Acts::kSlips && of.friction > 0.0 &&
         !of.direction.isZero(0.0);
}

}  // namespace

// Whether friction could stop a slip within h.
bool ContactEvents::turns_fast(double h) const {
  const double fall = h * equations_.gravity.norm();
  return std::any_of(equations_.contacts.begin(), equations_.contacts.end(),
                     [&](const auto& contact) {
                       return has_direction(contact) &&
                              equations_.motion(contact).slip().norm() < contact.friction * fall;
                     });
}

// Whether keeping all directions over a substep h was accurate to `tolerance` [m/s].
bool ContactEvents::was_straight(double h, double tolerance) const {
  const double least = kNoForce * equations_.largest_force(), g = equations_.gravity.norm();
  for (std::size_t c = 0; c < equations_.contacts.size(); ++c) {
    const ContactEquations::Contact& contact = equations_.contacts[c];
    if (!has_direction(contact)) continue;
    const ContactMotion now = equations_.motion(contact);
    const Vector3d across = now.n.cross(contact.direction);
    if (!(std::abs(across.dot(now.w)) <= tolerance)) return false;
    const double share = std::min(tolerance / std::max(now.slip().norm(), kSlipping),
                                  std::sqrt(4.0 * tolerance / (contact.friction * g * h)));
    const double most = contact.friction * equations_.normal_force(c, 0);
    if (!(std::abs(across.dot(equations_.force(c, 0))) <= share * most + least)) return false;
  }
  return true;
}

// Starts or ends straight slips. Returns false where no velocities meet the rows.
bool ContactEvents::go_straight(bool is_straight) {
  if (is_straight == equations_.is_straight) return true;
  equations_.is_straight = is_straight;
  return equations_.restart(numbers_.data(), derivative(), nullptr);
}

// Makes a substep from the saved state and derivative.
bool ContactEvents::take_first(Span* span, double* step) {
  const double tolerance = span->accuracy.tolerance, first = *step;
  if (equations_.is_straight) {
    const SubstepSpan start = span->left;
    if (take(span, &span->left, tolerance, step) &&
        was_straight(start.left - span->left.left, tolerance))
      return true;
    const auto n = static_cast<std::ptrdiff_t>(equations_.size());
    std::copy(kept_.begin(), kept_.begin() + n, numbers_.begin());
    equations_.restore();
    equations_.set_time(start.t);
    equations_.place(numbers_.data());
    span->left = start;
    span->progress.is_inconsistent = false;
    *step = first;
    if (!go_straight(false)) return false;
    watch(&watched_.before);
    std::copy(derivative(), derivative() + n, kept_.begin() + n);
  }
  return take(span, &span->left, tolerance, step);
}

}  // namespace constraint_sim::engine
