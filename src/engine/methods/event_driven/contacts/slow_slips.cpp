#include "engine/methods/event_driven/contacts/slow_slips.h"

#include <algorithm>
#include <cmath>

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kNoForce = 1e-12;  // share of the largest force; less is rounding

bool has_direction(const ContactEquations::Contact& of) {
  return of.acts == ContactEquations::Acts::kSlips && of.friction > 0.0 &&
         !of.direction.isZero(0.0);
}

}  // namespace

void set_directions(const ContactTolerances& within, ContactEquations* equations) {
  for (ContactEquations::Contact& contact : equations->contacts()) {
    if (contact.acts != ContactEquations::Acts::kSlips || contact.friction == 0.0) continue;
    const Vector3d slip = equations->motion(contact).slip();
    const double speed = slip.norm();
    if (speed > within.slipping) contact.direction = slip / speed;
  }
}

bool turns_fast(const ContactEquations& equations, double h) {
  const double fall = h * equations.bodies().gravity().norm();
  return std::any_of(equations.contacts().begin(), equations.contacts().end(),
                     [&](const auto& contact) {
                       return has_direction(contact) &&
                              equations.motion(contact).slip().norm() < contact.friction * fall;
                     });
}

bool was_straight(const ContactEquations& equations, const ContactTolerances& within, double h,
                  double tolerance) {
  const double least = kNoForce * equations.largest_force(),
               g = equations.bodies().gravity().norm();
  for (std::size_t c = 0; c < equations.contacts().size(); ++c) {
    const ContactEquations::Contact& contact = equations.contacts()[c];
    if (!has_direction(contact)) continue;
    const ContactMotion now = equations.motion(contact);
    const Vector3d across = now.n.cross(contact.direction);
    if (!(std::abs(across.dot(now.w)) <= tolerance)) return false;
    const double share = std::min(tolerance / std::max(now.slip().norm(), within.slipping),
                                  std::sqrt(4.0 * tolerance / (contact.friction * g * h)));
    const double most = contact.friction * equations.normal_force(c, 0);
    if (!(std::abs(across.dot(equations.force(c, 0))) <= share * most + least)) return false;
  }
  return true;
}

}  // namespace constraint_sim::engine
