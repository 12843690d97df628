#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "constraint_sim/engine/body.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/method.h"
#include "engine/dynamics/regularized_rows.h"
#include "engine/dynamics/rigid_motion.h"
#include "engine/math/integrate.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Motion of an island whose rigid rows cannot all be met: positions of least Σ C²/a, a the
/// diagonal entry of G M⁻¹ Gᵀ, and velocities that meet the rates of motors by least squares. Each
/// step:
///   1. midpoint rule with the discrete gradients of implicit_step.h and impulses along Ḡ that lead
///      to the result of 2; conserves energy and both momenta
///   2. Levenberg & Marquardt on Σ C²/a from there, which moves positions only: rates of rows near
///      contradiction have no bound
///   3. projection of velocities onto the rates, which only removes energy
/// Where the impulses of 1 are not found, or add energy, 2 makes the whole correction.
class InconsistentMotion {
 public:
  // Defined in the .cpp file: copies of so many fields are compiled once.
  InconsistentMotion(const InconsistentMotion& other);
  InconsistentMotion(InconsistentMotion&& other) noexcept;
  InconsistentMotion& operator=(const InconsistentMotion& other);
  InconsistentMotion& operator=(InconsistentMotion&& other) noexcept;
  ~InconsistentMotion();

  explicit InconsistentMotion(const EquationsOfMotion& equations);

  /// Advances the island as method.h describes, without a tolerance: errors of unmet rows are
  /// larger.
  IntegrationResult advance(const Interval& span, EquationsOfMotion* equations,
                            List<BodyState>* states);
  /// Whether all rows and their rates could be met at the end of the last interval.
  bool can_be_met() const { return can_be_met_; }

 private:
  using Vector3d = Eigen::Vector3d;
  using Rows = RegularizedRows::Geometry;
  using Numbers = List<double>;  // one per row

  // Share of the weights on the diagonal where a right-hand side can be met.
  static constexpr double kLeastShare = 1e-11;
  // Share of the scene's size; a smaller change is rounding where it exceeds half of the change
  // before.
  static constexpr double kRounding = 1e-10;

  /// Targets of the rows by prescribed motions.
  struct Target {
    Numbers length;          // [m] length of a distance, component of a ball joint's offset
    Numbers rate;            // rates of these lengths [m/s]
    BodyVectors fixed;       // velocities of immovable points, zero elsewhere
    bool is_driven = false;  // whether targets may change with time
  };

  void gather_state(const List<BodyState>& states);
  void scatter_state(List<BodyState>* states) const;
  void ask(double t, EquationsOfMotion* equations, Configuration* configuration);
  Eigen::Vector3d ball_offset(std::size_t joint, const Configuration& configuration) const;
  int number_of_parts(double h) const;

  void step(double h, double energy_before, IntegrationResult* progress);
  bool midpoint(double h, IntegrationResult* progress);
  double find_missing(double h);
  void drift(double h);
  void turn(std::size_t body, double h, const Vector3d& torque);
  void explicit_step(double h, IntegrationResult* progress);
  void stop_against_correction();
  void restore_angular_momentum(double h);
  double most_added(double h) const;
  double hold_back(double energy_before, double allowed);
  void find_rigid_motion(BodyVectors* centre, BodyVectors* turning) const;
  RigidMotion as_one_body(const Configuration& configuration, const BodyVectors& velocity) const {
    return engine::as_one_body(mass_, inertia_, configuration.position, configuration.orientation,
                               velocity);
  }

  // ---- inconsistent_corrections.cpp
  void meet(Configuration* configuration, Rows* geometry, IntegrationResult* progress);
  void find_correction(double share);
  double displace(Configuration* configuration) const;
  double errors(const Rows& geometry, Numbers* values) const;
  double reading_of(std::size_t coupled, std::size_t term, const Rows& geometry) const;
  double general_error(std::size_t row, const Rows& geometry) const;
  static double largest(const Numbers& list);
  Vector3d components(const Numbers& list, std::size_t row) const;
  double share_off(std::size_t row, const Vector3d& d) const;

  void fit_velocities();
  void find_drive();
  void solve_drive(double share, const Numbers& rates);
  void cap_energy(double allowed, IntegrationResult* progress);
  void scale(const BodyVectors& part, double factor);
  void find_whether_met();

  double kinetic_energy(const BodyVectors& velocity) const;
  double spring_energy() const;
  double extent(std::size_t row, const Rows& geometry) const;
  double work_of_drives() const;
  double work_of_loads() const;
  double damped_energy(double h) const;
  double momentum_product(const BodyVectors& u, const BodyVectors& v) const;

  const EquationsOfMotion* equations_ = nullptr;  // equations of the interval
  List<int> body_indices_;
  std::size_t bodies_, rotating_, points_;
  bool is_free_;  // no point is fixed
  List<double> mass_;
  List<Vector3d> inertia_;
  List<double> radius_;                       // radius of gyration, per rotating body [m]
  List<double> stiffness_, damping_, force_;  // values of springs, by row
  List<double> least_given_;  // lower bound of h²k/4 + hc/2 by row, for constant forces [kg]
  RegularizedRows rows_;

  Configuration start_, end_, met_;
  Rows at_start_, at_end_, at_met_;
  BodyVectors velocity_, velocity_before_;
  BodyVectors displacement_;  // displacement by drift() from the start of the step
  BodyVectors change_;        // scratch
  Target target_;

  Numbers weights_, values_, b_, lambda_, compliance_;
  Numbers step_impulses_;               // impulses of all rows in one step [N s]
  Numbers impulses_;                    // sum of step_impulses_ since the start of the interval
  Numbers q_;                           // ½h times the impulses of a midpoint step
  BodyVectors drive_;                   // velocity of least kinetic energy that meets the rates
  Numbers drive_rates_, drive_before_;  // G drive_, now and at the start of the step
  double work_ = 0.0;                   // work of driven joints in one step [J]
  double spring_energy_ = 0.0;          // energy of springs at end_ [J]
  double scale_ = 1.0;                  // largest coordinate or length [m]
  bool can_be_met_ = false;
};

}  // namespace constraint_sim::engine
