#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "engine/collision/contact_feature.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/methods/event_driven/contacts/group_shapes.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {

/// Body of a contact group.
struct GroupBody {
  int index;  ///< index in the world
  MassProperties mass;
  Eigen::Vector3d force = Eigen::Vector3d::Zero(), torque = Eigen::Vector3d::Zero();
};

/// Motions of the bodies of a contact group, such as accelerations.
struct GroupMotions {
  List<Eigen::Vector3d> linear, angular;

  void set_zero(std::size_t bodies) {
    for (List<Eigen::Vector3d>* of : {&linear, &angular}) {
      of->resize(bodies);
      for (Eigen::Vector3d& motion : *of) motion.setZero();
    }
  }
};

/// Keeps the bodies of a contact group, movable bodies first, and places them by a state vector y:
/// x, v, q (x, y, z, w) and L of each movable body. Immovable bodies stay, kinematic bodies follow
/// the time.
class GroupBodies {
 public:
  /// Bodies of the group; set before gather().
  List<GroupBody>& list() { return list_; }
  const List<GroupBody>& list() const { return list_; }
  const GroupBody& operator[](std::size_t body) const { return list_[body]; }
  /// Shapes that may touch another; set before gather().
  GroupShapes& shapes() { return shapes_; }
  const GroupShapes& shapes() const { return shapes_; }
  void set_movable(std::size_t count) { movable_ = count; }
  std::size_t movable() const { return movable_; }

  /// Takes the start [simulated s], gravity [m/s²] and the loads of an interval. Times count from
  /// the start, so that results do not depend on absolute time.
  void begin_interval(double start, const Eigen::Vector3d& gravity,
                      const List<AppliedWrench>& loads);
  const Eigen::Vector3d& gravity() const { return gravity_; }

  // ---- state
  /// Reads the states of all bodies. States of kinematic bodies are `since_tick` old [s].
  void gather(const List<BodyState>& states, double since_tick);
  void scatter(List<BodyState>* states) const;
  /// Sets the states of movable bodies from y, and of kinematic bodies at time().
  void place(const double* y);
  /// Number of numbers in a state vector.
  std::size_t size() const { return (kNumbers * movable_ + 1) / 2 * 2; }
  List<double>& numbers() { return y_; }  ///< state vector that gather() wrote
  const List<double>& numbers() const { return y_; }
  /// Sets the time since the start of the interval [s]. Bodies move only in place().
  void set_time(double t) { t_ = t; }
  double time() const { return t_; }
  double clock() const { return start_ + t_; }  ///< simulated [s]
  const BodyState& state(std::size_t body) const { return states_[body]; }
  const List<BodyState>& states() const { return states_; }
  void set_states(const List<BodyState>& states);
  /// State of a shape, from which contact features are computed.
  const BodyState& shape_state(std::size_t shape) const { return shapes_.state(shape, states_); }
  bool has_movers() const { return !movers_.empty(); }  ///< whether there are kinematic bodies
  double kinetic_energy() const;
  /// Relative motion at a feature of two shapes, the first of body A, the second of body B.
  ContactMotion motion(std::size_t shape_a, std::size_t shape_b,
                       const ContactFeature& feature) const {
    return shapes_.motion(shape_a, shape_b, feature, states_);
  }

  /// Length that rounding is relative to [m].
  double scale() const { return scale_; }
  void enlarge_scale(double length);
  double rounding() const { return 4.0 * kEpsilon * scale_; }

  // ---- dynamics
  /// Computes the accelerations of movable bodies by gravity, loads and gyroscopic torques.
  void find_free_accelerations(const double* y, GroupMotions* accelerations) const;
  /// Writes the derivative of the placed y; `free`: accelerations by find_free_accelerations(),
  /// `pushed`: accelerations by all other forces.
  void write_derivative(const double* y, const GroupMotions& free, const GroupMotions& pushed,
                        double* dydt) const;
  /// Computes the accelerations by a derivative; zero for immovable bodies.
  void find_accelerations(const double* dydt, GroupMotions* rates) const;
  /// Returns M⁻¹ F of bodies A and B; zero for immovable bodies.
  Jacobian accelerations(std::size_t a, std::size_t b, const Jacobian& F) const;
  /// Power of kinematic bodies on the other bodies, by forces F on A and B.
  double driven_power(std::size_t a, std::size_t b, const Jacobian& F) const {
    return driven_power(a, F.j1, F.j2) + driven_power(b, F.j3, F.j4);
  }
  /// Adds a change of velocities to y.
  void add_velocities(const GroupMotions& change, double* y) const;
  /// Adds a displacement of a body, and its rotation vector, to y.
  static void displace(std::size_t body, const Eigen::Vector3d& moved,
                       const Eigen::Vector3d& turned, double* y);
  static bool normalize(std::size_t body, double* y);
  /// Whether a derivative is zero to rounding.
  bool is_still(const double* dydt) const;
  /// Squared size of a change of y over h, defined as in EquationsOfMotion.
  double squared_size_of(const double* dy, double h) const;

 private:
  // Offsets in the state, per body.
  static constexpr std::size_t kV = 3, kQ = 6, kL = 10, kNumbers = 13;
  /// Kinematic body.
  struct Mover {
    std::size_t body;
    BodyState start;  ///< state at the start of the tick
  };

  void place_movers();
  double driven_power(std::size_t body, const Eigen::Vector3d& force,
                      const Eigen::Vector3d& torque) const;

  List<GroupBody> list_;
  GroupShapes shapes_;
  std::size_t movable_ = 0;
  Eigen::Vector3d gravity_ = Eigen::Vector3d::Zero();
  List<double> y_;
  double start_ = 0.0, t_ = 0.0;
  List<BodyState> states_;
  List<Mover> movers_;
  double since_tick_ = 0.0;                // time from the start of the tick to t_ = 0 [s]
  List<Eigen::Matrix3d> rotations_;        // per movable body, into world axes
  List<Eigen::Matrix3d> inverse_inertia_;  // per body, world axes
  double scale_ = 0.0;
};

}  // namespace constraint_sim::engine
