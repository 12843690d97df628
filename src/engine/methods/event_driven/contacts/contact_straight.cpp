// Slow slips of ContactEvents. Friction turns a slip w as fast as it would stop it, at a rate of
// μ N/m ‖w‖: where a body just begins to slip, or is about to stop, that is beyond what stages of
// any worthwhile length can follow. There all slips keep their directions for a substep, held
// across by rows as what sticks is. That is right as long as friction has the force f across, for
// with its share θ = f/μN
//   the slip would be aside by θ ‖w‖, and friction along it is less by μ N θ²/2,
// and both have to stay within the tolerance. Where they do not the substep is taken as any other.

#include <algorithm>
#include <cmath>

#include "engine/methods/event_driven/contacts/contact_events.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kNoForce = 1e-12;  // of the largest: rounding

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

// Whether a substep of h that kept all directions was right to do so: `tolerance` in m/s.
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

// From here on, or not. False where no velocities meet the rows.
bool ContactEvents::go_straight(bool is_straight) {
  if (is_straight == equations_.is_straight) return true;
  equations_.is_straight = is_straight;
  return equations_.restart(numbers_.data(), derivative(), nullptr);
}

// A substep from where state and derivative are kept.
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
