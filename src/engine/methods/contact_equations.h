#pragma once

#include <Eigen/Core>
#include <Eigen/LU>
#include <Eigen/QR>
#include <array>
#include <cstddef>
#include <utility>
#include <vector>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/joint.h"
#include "engine/constraints/contact_feature.h"
#include "engine/constraints/joint.h"
#include "engine/constraints/one_sided_law.h"
#include "engine/mass_properties.h"
#include "engine/methods/embedded_pairs.h"
#include "engine/methods/equations_of_motion.h"

namespace constraint_sim::engine {

/// A few bodies that touch each other, and the joints on them, as a System of integrate.h with
/// dense matrices. With the rows J of joints, of coordinates that are held and of contacts that
/// act, and F the forces for a unit of each multiplier:
///   J M⁻¹ F λ = −γ − J a_free
/// F = J but for a contact that slips, which has one row, along its normal, and F = n − μ û with û
/// the direction of the slip. Where rows depend on each other λ is that of least norm, beside a
/// reference. The state: x, v, q (x, y, z, w) and L of one body after the other.
class ContactEquations {
 public:
  enum class Acts : char { kOpen, kSticks, kSlips };  ///< slips: also without friction

  struct Contact {
    std::size_t a, b;  ///< bodies here; the second one may be immovable
    double friction = 0.0, restitution = 0.0;
    ContactFeature feature;
    Acts acts = Acts::kOpen;
    Eigen::Vector3d direction = Eigen::Vector3d::Zero();  ///< û where a substep starts; 0: none
    Eigen::Vector3d reference = Eigen::Vector3d::Zero();  ///< a force that it can have, world [N]
    Eigen::Vector3d impulse = Eigen::Vector3d::Zero();    ///< since begin_step(), on A [N s]
    ContactFeature touched;                               ///< that the last impulse had
  };
  struct Body {
    int index;  ///< in the world
    MassProperties mass;
    Eigen::Vector3d force = Eigen::Vector3d::Zero(), torque = Eigen::Vector3d::Zero();
  };
  struct BodyJoint {
    int index;         ///< in the world
    std::size_t a, b;  ///< bodies here
    Joint joint;
    bool has_rows = true;  ///< those of its kind; else its coordinates alone
    bool is_broken = false;
    PrescribedMotion course{};  ///< in this span
    RowVector impulse = RowVector::Zero();
  };
  /// A coordinate of a joint, or the length of a distance joint, on which something acts.
  struct Coordinate {
    std::size_t joint;           ///< here
    OneSidedLaw law;             ///< its form, what acts one way, and the soft law beside
    bool is_prescribed = false;  ///< a motor holds it with any force
    bool is_one_sided = false;
    OneSidedState state;
    Motor motor{};           ///< in this span, of a law with a drive
    double position = 0.0;   ///< where a substep starts [m or rad]
    double held = 0.0;       ///< where friction or a drive began to hold it [m or rad],
    double held_at = 0.0;    ///< and when, simulated [s]
    double given_way = 0.0;  ///< by what a limit of a length has moved since the step began [m]
    double reference = 0.0;  ///< a force that it can have [N or N m]
    double braking = 0.0;    ///< as CoordinateState has it
    double until = 0.0;      ///< until when its motor brakes, simulated [s]
  };

  std::vector<Body> bodies;  ///< movable ones first
  std::size_t movable = 0;
  std::vector<BodyJoint> joints;
  std::vector<Coordinate> coordinates;
  std::vector<Contact> contacts;
  Eigen::Vector3d gravity = Eigen::Vector3d::Zero();
  /// Where the span begins, simulated [s]. Times are counted from there, so that it makes no
  /// difference how late it is.
  double origin = 0.0;

  /// Where all bodies are; of immovable ones for good.
  void gather_state(const std::vector<BodyState>& states);
  void scatter_state(std::vector<BodyState>* states) const;
  const BodyState& state(std::size_t body) const { return states_[body]; }
  std::vector<double>& numbers() { return y_; }
  /// Moves to these numbers.
  void place(const double* y);
  /// Moves to a time since `origin` [s], at which bodies stay where they are.
  void set_time(double t) { t_ = t; }
  double time() const { return t_; }
  double clock() const { return origin + t_; }  ///< simulated [s]
  /// Whether anything that acts depends on the time.
  bool is_moved_by_motors() const;

  // ---- a System
  std::size_t size() const { return (kNumbers * movable + 1) / 2 * 2; }
  void derivative(std::size_t stage, double t, const double* y, double* dydt);
  bool project(double t, double* y);
  template <class Pair>
  void accept(double h) {
    for (std::size_t j = 0; j < Pair::kStages; ++j)
      if (Pair::kA[Pair::kStages][j] != 0.0) add_impulses(h * Pair::kA[Pair::kStages][j], j);
  }
  bool restart(double* y, double* dydt);
  double squared_size_of(const double* dy, double h) const;
  double rounding() const;

  /// Whether a derivative says that nothing moves, to rounding.
  bool is_still(const double* dydt) const;
  /// Takes the forces that act now for h.
  void accept_stillness(double h) { add_impulses(h, 0); }

  // ---- for events, as the bodies lie and with what restart() found
  /// Accelerations of bodies in a derivative; of immovable ones 0.
  struct Accelerations {
    std::vector<Eigen::Vector3d> linear, angular;
  };
  void find_accelerations(const double* dydt, Accelerations* rates) const;
  /// ẇ of a contact.
  static Eigen::Vector3d slip_acceleration(const ContactMotion& motion, const Contact& contact,
                                           const Accelerations& rates);
  ContactMotion motion(const Contact& contact) const {
    return motion_of(contact.feature, states_[contact.a], states_[contact.b]);
  }
  /// Force of a contact on A in a stage of the last substep; stage 0 is where the bodies are now.
  const Eigen::Vector3d& force(std::size_t contact, std::size_t stage) const {
    return stages_[stage].contact[contact];
  }
  /// The same along its normal.
  double normal_force(std::size_t contact, std::size_t stage) const {
    return stages_[stage].normal[contact];
  }
  /// The same of what holds a coordinate.
  double held_force(std::size_t coordinate, std::size_t stage) const {
    return stages_[stage].coordinate[coordinate];
  }
  /// Force of a joint in a stage, along its functions.
  const RowVector& joint_force(std::size_t joint, std::size_t stage) const {
    return stages_[stage].joint[joint];
  }
  /// A coordinate now; `J` of its gradient.
  struct Reading {
    double q = 0.0, rate = 0.0, acceleration = 0.0;
    Jacobian J;
  };
  /// With accelerations of bodies, or none.
  Reading read(const Coordinate& coordinate, const Accelerations* rates) const;
  /// Where a limit of a coordinate is, and what its motor asks for, as `rate` and `acceleration`.
  Prescribed limit(const Coordinate& coordinate, bool upper_one) const;
  Prescribed zeta(const Coordinate& coordinate) const;
  /// Where a servo acts about.
  Prescribed rest(const Coordinate& coordinate) const {
    return rest_of(coordinate.law, coordinate.law.is_distance
                                       ? joints[coordinate.joint].course.length(clock())
                                       : Prescribed{});
  }
  double scale() const { return scale_; }
  /// From now on nothing of a joint acts.
  void break_joint(std::size_t joint);
  /// What a substep that is taken again goes on from, beside the numbers: impulses and stage 0.
  void keep();
  void restore();
  double largest_force() const;
  double kinetic_energy() const;
  double potential_energy() const;  ///< of gravity and of constant forces [J]

  /// What unit impulses do while the joints hold: three columns a contact, one a coordinate.
  struct Responses {
    std::vector<std::size_t> contacts, coordinates;
    std::vector<Eigen::Matrix3d> frames;  ///< of contacts: columns n, t1, t2
    std::vector<char> is_free;            ///< coordinates that the joints leave free
    Eigen::MatrixXd velocity;             ///< change of (v, ω) of bodies by unit impulses
    Eigen::MatrixXd joints;               ///< impulses of joints' rows by unit impulses
    std::vector<std::pair<std::size_t, int>> rows;  ///< joint and function of these
    Eigen::MatrixXd A;  ///< change of the rates of these, along the frames
  };
  Responses responses(const std::vector<std::size_t>& contacts,
                      const std::vector<std::size_t>& coordinates);
  /// Adds impulses p to velocities, and to those of joints.
  void apply(const Responses& responses, const Eigen::VectorXd& p, double* y);

 private:
  static constexpr std::size_t kV = 3, kQ = 6, kL = 10, kNumbers = 13;  // of a body, in the state
  using Vector = Eigen::Map<Eigen::Vector3d>;
  using ConstVector = Eigen::Map<const Eigen::Vector3d>;
  static Eigen::Index index(std::size_t i) { return static_cast<Eigen::Index>(i); }

  struct Row {
    std::size_t a, b;
    Jacobian J, F;
    double gamma = 0.0, value = 0.0, rate = 0.0, reference = 0.0;
    int joint = -1, function = 0;    // of a joint
    int coordinate = -1;             // that one holds, beside
    int contact = -1;                // or a contact
    bool is_normal = false;          // of it
    Eigen::Vector3d along{0, 0, 0};  // force of one unit on A, of a contact
  };
  struct Stage {
    std::vector<Eigen::Vector3d> contact;  // forces on A
    std::vector<double> normal;            // the same along normals
    std::vector<double> coordinate;        // what holds them
    std::vector<RowVector> joint;
  };

  void add_joint_rows();
  void add_coordinate_row(std::size_t coordinate, const Prescribed& target);
  void add_held_rows();
  void add_contact_rows(bool with_slip, bool with_tangents);
  double along(const Row& row, const Jacobian& J, const std::vector<Eigen::Vector3d>& linear,
               const std::vector<Eigen::Vector3d>& angular) const;
  void push(const Row& row, const Jacobian& F, double amount, std::vector<Eigen::Vector3d>* linear,
            std::vector<Eigen::Vector3d>* angular) const;
  bool solve_rows(const Eigen::VectorXd& right, Eigen::VectorXd* lambda);
  void factor_rows(bool asks_rank);
  bool find_change(double Row::*by, std::vector<Eigen::Vector3d>* linear,
                   std::vector<Eigen::Vector3d>* angular);
  Prescribed target(const Coordinate& coordinate) const;
  double free_force(const Coordinate& coordinate, const Reading& now) const;
  void pull_coordinates(Stage* told, std::vector<Eigen::Vector3d>* linear,
                        std::vector<Eigen::Vector3d>* angular) const;
  void clear_motion(std::vector<Eigen::Vector3d>* linear,
                    std::vector<Eigen::Vector3d>* angular) const;
  void add_impulses(double weight, std::size_t stage);

  std::vector<double> y_;
  double t_ = 0.0;  // [s] since origin
  std::vector<BodyState> states_;
  std::vector<Eigen::Matrix3d> inverse_inertia_;  // world
  std::vector<Row> rows_;
  Eigen::MatrixXd A_;
  Eigen::VectorXd weight_;        // that scale rows to a diagonal of one
  bool are_independent_ = false;  // rows, as restart() found them
  Eigen::PartialPivLU<Eigen::MatrixXd> lu_;
  Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> factors_;  // where they are not
  std::array<Stage, DormandPrince8::kStages + 1> stages_;
  double scale_ = 0.0;  // [m] that rounding goes by
  std::vector<Eigen::Vector3d> linear_, angular_, free_linear_, free_angular_;  // scratch
  Stage kept_;
  std::vector<Eigen::Vector3d> kept_contacts_;  // impulses
  std::vector<RowVector> kept_joints_;
};

}  // namespace constraint_sim::engine
