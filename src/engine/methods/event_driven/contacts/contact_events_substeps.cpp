// Substeps of ContactEvents, which no event has ended yet.

#include <algorithm>

#include "engine/methods/event_driven/contacts/contact_events.h"
#include "engine/methods/event_driven/contacts/slow_slips.h"
#include "engine/methods/runge_kutta/integrate_by_order.h"

namespace constraint_sim::engine {
namespace {

// Whether no motion but that of the bodies decides their accelerations. Motors that oscillate, come
// to rest at a position or close a joint, kinematic bodies and forces of other packages could be
// equal at all three stages of order 3, and differ between them.
bool depend_on_state_alone(const ContactEquations& equations) {
  const auto has_rate = [](const GroupJoint& of) {
    const bool is_length = has_length(of.joint.kind) && !of.motion.is_closing();
    return of.motion.is_constant() || (is_length && of.joint.motor.amplitude == 0.0);
  };
  const auto is_uniform = [&](const GroupJoint& of) {
    return has_rate(of) && !is_custom_force(of.joint.kind);
  };
  const auto has_uniform_motor = [](const GroupCoordinate& of) {
    return of.motor.amplitude == 0.0 && !of.law.goal;
  };
  const List<GroupJoint>& joints = equations.joints().list();
  const List<GroupCoordinate>& coordinates = equations.joints().coordinates();
  return !equations.bodies().has_movers() &&
         std::all_of(joints.begin(), joints.end(), is_uniform) &&
         std::all_of(coordinates.begin(), coordinates.end(), has_uniform_motor);
}

}  // namespace

bool ContactEvents::take(int order, double tolerance, Run* run, RemainingInterval* left,
                         double* step) {
  order_ = order;
  const auto acting = static_cast<double>(
      std::count_if(equations_.contacts().begin(), equations_.contacts().end(),
                    [](const auto& contact) { return contact.acts != Acts::kOpen; }));
  solver_.add(1.0 + acting * acting / 16.0);
  const StageMemory memory(numbers_.data(), equations_.size());
  IntegratorOptions options = run->options;
  options.order = order;
  options.tolerance = tolerance;
  return take_substep_by_order(equations_, memory, options, run->interval.stop, left, step,
                               &run->progress);
}

// Whether rotations and their rates change no acceleration noticeably within h [s].
bool ContactEvents::rotate_little(double h) {
  constexpr double kLittle = 1e-4;  // [rad]
  const GroupBodies& bodies = equations_.bodies();
  bodies.find_accelerations(derivative(), &rates_);
  for (std::size_t i = 0; i < bodies.movable(); ++i)
    if (!(h * bodies.state(i).angular_velocity.norm() + h * h * rates_.angular[i].norm() < kLittle))
      return false;
  return true;
}

// Takes a substep by order 3 where its error is a small share of the tolerance, as where bodies
// slide or fall without rotating. Otherwise nothing has changed.
bool ContactEvents::take_uniform(Run* run, RemainingInterval* left, double* step) {
  // Share of the tolerance, since order 8 mostly errs by less.
  constexpr double kShareOfOrder3 = 1e-4;
  if (!may_be_uniform_ || !equations_.are_rows_straight() || !rotate_little(*step) ||
      !depend_on_state_alone(equations_))
    return false;
  const RemainingInterval start = *left;
  const int rejected = run->progress.rejected;
  double next = *step;
  may_be_uniform_ = take(3, kShareOfOrder3 * run->options.tolerance, run, left, &next);
  if (may_be_uniform_) {
    *step = std::max(*step, next);
    return true;
  }
  *left = start;
  run->progress.done = true;
  run->progress.rejected = rejected;
  return_to_start(start.t);
  return false;
}

// Returns to the start of the last substep, at time t.
void ContactEvents::return_to_start(double t) {
  const auto n = static_cast<std::ptrdiff_t>(equations_.size());
  std::copy(kept_.begin(), kept_.begin() + n, numbers_.begin());
  std::copy(kept_.begin() + n, kept_.end(), derivative());
  equations_.restore();
  equations_.bodies().set_time(t);
  equations_.bodies().place(numbers_.data());
}

// Repeats the last substep from its start at time t with length h; with h = 0 only returns there.
bool ContactEvents::repeat(Run* run, double t, double h) {
  if (solver_.is_used_up()) return false;
  return_to_start(t);
  if (h == 0.0) return true;
  RemainingInterval left(t, h);
  double step = h;
  const int rejected = run->progress.rejected;
  const double error = run->progress.local_error;
  const bool is_taken = take(order_, 0.0, run, &left, &step) && left.left == 0.0 &&
                        run->progress.rejected == rejected;
  error_ = run->progress.local_error - error;
  return is_taken;
}

// Starts or ends straight slips. Returns false where no velocities meet the rows.
bool ContactEvents::go_straight(bool is_straight) {
  if (is_straight == equations_.is_straight()) return true;
  equations_.set_straight(is_straight);
  return equations_.restart(numbers_.data(), derivative(), nullptr);
}

// Takes the substep in which events are then searched, from the state in kept_ on. Where slips were
// assumed straight and are not, takes it again with slips that turn.
bool ContactEvents::take_first(Run* run, RemainingInterval* left, double* step) {
  const double tolerance = run->options.tolerance, first = *step;
  const auto take_any = [&] {
    if (tolerance > 0.0 && take_uniform(run, left, step)) return true;
    return take(stepper_.of_substep(run->options).order, tolerance, run, left, step);
  };
  if (equations_.is_straight()) {
    const RemainingInterval start = *left;
    if (take_any() &&
        was_straight(equations_, pairs_.tolerances(), start.left - left->left, tolerance))
      return true;
    return_to_start(start.t);
    *left = start;
    run->progress.is_inconsistent = false;
    *step = first;
    if (!go_straight(false)) return false;
    watch(stepper_.before());
    std::copy(derivative(), derivative() + equations_.size(),
              kept_.begin() + static_cast<std::ptrdiff_t>(equations_.size()));
  }
  return take_any();
}

}  // namespace constraint_sim::engine
