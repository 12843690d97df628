#include "engine/world/bounds.h"

#include <cmath>

#include "engine/constraints/joint_kinds.h"

namespace constraint_sim::engine {

// Sums over all bodies are enough in most steps; the bodies are checked one by one only where a sum
// is off.
Failure failure_of_motion(const Model& model, const State& state, const List<int>& awake_bodies,
                          std::optional<BodyId>* failed_body) {
  Eigen::Array2d squares(0.0, 0.0), off_unit(0.0, 0.0);
  double others = 0.0;
  for (const int i : awake_bodies) {
    const BodyState& body = state.states[static_cast<std::size_t>(i)];
    const Eigen::Vector3d& x = body.position;
    const Eigen::Vector3d& v = body.linear_velocity;
    const Eigen::Vector3d& w = body.angular_velocity;
    const Eigen::Vector4d& q = body.orientation.coeffs();
    squares +=
        x.head<2>().array().square() + v.head<2>().array().square() + w.head<2>().array().square();
    off_unit += q.head<2>().array().square() + q.tail<2>().array().square() - 0.5;
    others += x[2] * x[2] + v[2] * v[2] + w[2] * w[2];
  }
  if (squares.sum() + others <= kMostMagnitude * kMostMagnitude &&
      std::abs(off_unit.sum()) <= kMostOffUnit)
    return Failure::kNone;
  for (const int i : awake_bodies) {
    const Failure failure = failure_of(state.states[i]);
    if (failure == Failure::kNone) continue;
    *failed_body = model.body_ids[i];
    return failure;
  }
  return Failure::kNone;
}

// A single NaN or infinity makes a sum not finite. Squares of saved numbers are summed.
bool are_in_bounds(const Model& model, const State& state, const AwakeSets& awake,
                   const StepOutput& output) {
  const StepReport& report = output.report;
  double sum = report.local_error + report.energy.projected + report.energy.correction_work +
               report.energy.driven_work + report.contacts.solver_residual +
               report.contacts.max_penetration;
  double squares = 0.0;
  const auto save = [&](double number) { squares += number * number; };
  for (const int j : awake.joints) {
    const JointData& joint = state.joint_states[j];
    sum += joint.error + joint.error_rate + joint.angle_error + joint.force + joint.bias +
           joint.reached_rate;
    squares += joint.impulse.squaredNorm();
    save(joint.travel);
    save(joint.initial_error);
    const JointForms& kind = forms(model.joints[j].kind);
    for (std::size_t k = 0; k < to_index(kind.coordinates); ++k) {
      const CoordinateState& coordinate = joint.coordinates[k];
      sum += coordinate.velocity + coordinate.effort + coordinate.bias;
      save(coordinate.position);
      save(coordinate.held);
      save(coordinate.braking);
    }
    if (joint.closing) {
      const ErrorsToClose& errors = joint.to_close;
      for (const MovingStart& moving : errors.moving)
        for (const double number : {moving.offset, moving.rate, moving.acceleration}) save(number);
      squares +=
          errors.offset.squaredNorm() + errors.shift.squaredNorm() + errors.turn.squaredNorm();
      save(joint.closing_share);
      save(errors.coupling);
    }
    if (kind.couples) {
      sum += joint.coupling.value + joint.coupling.rate + joint.coupling.effort;
      save(joint.coupling_impulse);
    }
  }
  double forces = 0.0;
  for (std::size_t i = output.resting_contact_count; i < output.contacts.size(); ++i) {
    const Contact& contact = output.contacts[i];
    sum += contact.position.sum() + contact.normal.sum() + contact.depth + contact.normal_force;
    forces += contact.force.squaredNorm();
  }
  squares += forces * model.options.time_step * model.options.time_step;  // as impulses
  if (state.any_corrections)
    for (const int i : awake.bodies) squares += state.corrections[i].squaredNorm();
  return std::isfinite(sum) && squares <= kMostMagnitude * kMostMagnitude;
}

}  // namespace constraint_sim::engine
