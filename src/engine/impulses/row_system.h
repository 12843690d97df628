#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "constraint_sim/engine/body.h"
#include "engine/constraints/row.h"
#include "engine/math/disjoint_sets.h"
#include "engine/math/list.h"
#include "engine/model/mass_properties.h"
#include "engine/model/twist.h"

namespace constraint_sim::engine {

/// Response of one row: J and M⁻¹ Jᵀ of each body, K = J M⁻¹ Jᵀ, and 1/(K + softness).
struct RowResponse {
  Twist J_A, J_B, response_a, response_b;
  double K, effective_mass;
  int component;  ///< as RowSystem::component_of()
  bool corrects;  ///< whether any row of the component has a correction
};

/// Rate of a row at the velocities of all bodies.
[[gnu::always_inline]] inline double rate_of(const Row& row, const RowResponse& r,
                                             const List<Twist>& velocities) {
  const Twist* const v = velocities.data();
  return r.J_A.dot(v[row.body_a]) + r.J_B.dot(v[row.body_b]);
}

/// Adds M⁻¹ Jᵀ times the impulse of a row to the velocities of its bodies.
[[gnu::always_inline]] inline void push(const Row& row, const RowResponse& r, double impulse,
                                        List<Twist>* velocities) {
  Twist* const v = velocities->data();
  v[row.body_a] += impulse * r.response_a;
  v[row.body_b] += impulse * r.response_b;
}

/// Impulse of a row, so far and in total, that makes J V = target − softness·p.
inline double wanted_impulse(const Row& row, double impulse, double target, double J_V,
                             double effective_mass) {
  return impulse + (target - row.softness * impulse - J_V) * effective_mass;
}

/// Rows of a step at the positions before the step, and the bodies that they act on: velocities,
/// inertias, and components of bodies that rows connect. A component has the index of one of its
/// bodies. `moved`: indices of the bodies to advance.
class RowSystem {
 public:
  using Bodies = List<BodyState>;
  using Masses = List<MassProperties>;

  /// Notes the velocities at the start of the step, before wrenches act.
  void begin(const List<int>& moved, const Bodies& bodies);
  /// Reads bodies and rows, and adds h g to the velocities.
  void load(const List<int>& moved, const Bodies& bodies, const Masses& masses,
            const Eigen::Vector3d& gravity, double h, const List<Row>& rows);

  double h() const { return h_; }
  const RowResponse& response(std::size_t row) const { return responses_[row]; }
  const List<RowResponse>& responses() const { return responses_; }
  /// Whether any row has a correction.
  bool any_corrections() const { return any_corrections_; }
  /// Finds the components that have corrections, after these were changed.
  void find_corrections(const List<Row>& rows);

  // ---- bodies
  bool is_moved(int body) const { return inertias_[body].is_moved; }
  const List<Twist>& before() const { return before_; }  ///< v₀
  const List<Twist>& velocities() const { return velocities_; }
  List<Twist>& velocities() { return velocities_; }
  const List<Twist>& corrections() const { return corrections_; }
  List<Twist>& corrections() { return corrections_; }
  /// Velocities by some impulses alone: scratch, zero except in ImpulsePositions.
  const List<Twist>& effects() const { return effects_; }
  List<Twist>& effects() { return effects_; }
  Twist change(std::size_t body) const { return velocities_[body] - before_[body]; }
  /// Kinetic energy ½ vᵀ M v of a moved body [J].
  double kinetic_energy(int body, const Twist& velocity) const;
  /// Energy that a body gains where it moves by ½ (v₀ + v₁) instead of v₁ [J].
  double gain_by_mean(int body) const {
    return 0.5 * by_loads_[body].dot(change(to_index(body)).head<3>()) /
           inertias_[body].inverse_mass;
  }

  // ---- components; undefined without rows
  int component_of(int body) const { return connected_.root(body); }
  bool is_component(int body) const { return connected_.is_root(body); }
  bool corrects(int component) const { return components_[component].corrects; }
  /// Whether rows connect the component with a body that impulses do not move.
  bool is_attached(int component) const { return components_[component].is_attached; }

 private:
  struct Inertia {
    Eigen::Matrix3d R, inverse_W;  // values of bodies that can rotate
    Eigen::Vector3d principal;
    double inverse_mass;
    bool is_moved, can_turn;
  };
  struct Component {
    bool corrects = false, is_attached = false;
  };

  void prepare_bodies(const List<int>& moved, const Bodies& bodies, const Masses& masses,
                      const List<Row>& rows);
  void prepare_body(int body, bool is_moved, const Bodies& bodies, const Masses& masses);
  void connect(const List<Row>& rows);
  void respond(const List<Row>& rows);
  static void join_parts(const Row& first, const Row& second, RowResponse* of_second);

  List<Twist> before_, velocities_, corrections_, effects_;  // per body
  List<Eigen::Vector3d> by_loads_;  // change of the linear velocity by gravity and wrenches
  List<Inertia> inertias_;
  DisjointSets<int> connected_;  // bodies that rows connect; a root is a component
  List<Component> components_;
  List<RowResponse> responses_;  // per row
  double h_ = 0.0;
  bool any_corrections_ = false;
};

}  // namespace constraint_sim::engine
