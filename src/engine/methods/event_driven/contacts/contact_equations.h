#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <optional>
#include <utility>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/joint.h"
#include "engine/collision/contact_feature.h"
#include "engine/constraints/joint.h"
#include "engine/constraints/one_sided_law.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/turned_angles.h"
#include "engine/math/embedded_pairs.h"
#include "engine/math/least_norm_solver.h"
#include "engine/math/list.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {

/// Equations of a small group of touching bodies and the joints on them, as a System of integrate.h
/// with dense matrices. J: rows of joints, held coordinates and acting contacts; F: forces per unit
/// of each multiplier:
///   J M⁻¹ F λ = −γ − J a_free
/// F = J except for a slipping contact, which has one row along its normal and F = n − μ û, with û
/// the slip direction. Where rows depend on each other, λ has least norm relative to a reference.
/// State: x, v, q (x, y, z, w) and L, body by body.
class ContactEquations {
 public:
  enum class Acts : char { kOpen, kSticks, kSlips };  ///< kSlips includes contacts without friction

  struct Contact {
    std::size_t a, b;  ///< indices in bodies; b may be immovable
    double friction = 0.0, restitution = 0.0;
    ContactFeature feature;
    Acts acts = Acts::kOpen;
    Eigen::Vector3d direction = Eigen::Vector3d::Zero();  ///< û at the start of a substep; 0: none
    /// Admissible force, as reference of λ, world [N]
    Eigen::Vector3d reference = Eigen::Vector3d::Zero();
    /// Weights in the sharing of redundant contacts.
    double normal_share = 1.0, tangent_share = 1.0;
    Eigen::Vector3d impulse = Eigen::Vector3d::Zero();  ///< accumulated in the step, on A [N s]
    ContactFeature touched;                             ///< feature of the last impulse
  };
  struct Body {
    int index;  ///< index in the world
    MassProperties mass;
    Eigen::Vector3d force = Eigen::Vector3d::Zero(), torque = Eigen::Vector3d::Zero();
    std::optional<ShapePose> shape_pose;
  };
  struct BodyJoint {
    int index;         ///< index in the world
    std::size_t a, b;  ///< indices in bodies
    Joint joint;
    bool has_rows = true;  ///< rows of the kind; else coordinates only
    bool is_broken = false;
    bool was_saturated = false;  ///< value reported by the last step
    bool is_at_end = false;      ///< a winch at the end of its travel, in this interval
    PrescribedMotion course{};   ///< prescribed motion in this interval
    RowVector impulse = RowVector::Zero();
  };
  /// Coordinate of a joint, or length of a distance joint, on which a law acts.
  struct Coordinate {
    std::size_t joint;           ///< index in joints
    OneSidedLaw law;             ///< form, one-sided law and soft law of the coordinate
    bool is_prescribed = false;  ///< held by a motor without force limit
    bool is_one_sided = false;
    OneSidedState state;
    Motor motor{};   ///< demand in this interval; of laws with a drive
    int angle = -1;  ///< index in angles; -1: no angle
    /// Position where friction or a drive began to hold the coordinate [m or rad].
    double held = 0.0;
    double held_at = 0.0;  ///< time when the hold began, simulated [s]
    /// Displacement of a yielding limit of a length since the step began [m].
    double given_way = 0.0;
    double reference = 0.0;  ///< admissible force, as reference of λ [N or N m]
    double braking = 0.0;    ///< deceleration, see CoordinateState
    double until = 0.0;      ///< end of braking by the motor, simulated [s]
  };

  List<Body> bodies;  ///< movable bodies first, then immovable and kinematic bodies
  std::size_t movable = 0;
  List<BodyJoint> joints;
  List<Coordinate> coordinates;
  TurnedAngles angles;  ///< all angles of joints, numbered by joints and bodies
  List<Contact> contacts;
  /// Whether slips keep their directions at the start of the substep; rows hold them transversely.
  bool is_straight = false;
  Eigen::Vector3d gravity = Eigen::Vector3d::Zero();
  /// Start of the interval, simulated [s]. Times count from `origin`, so that results do not depend
  /// on absolute time.
  double origin = 0.0;

  /// Reads the states of all bodies. Kinematic bodies are given at a time `since_tick` ago [s].
  void gather_state(const List<BodyState>& states, double since_tick = 0.0);
  /// Allocates stages for contacts, coordinates and joints; called after all of them were added.
  void prepare_stages();
  void scatter_state(List<BodyState>* states) const;
  const BodyState& state(std::size_t body) const { return states_[body]; }
  const List<BodyState>& states() const { return states_; }
  void set_states(const List<BodyState>& states);
  /// State of the shape of a body, from which contact features are computed.
  const BodyState& shape_state(std::size_t body) const {
    return bodies[body].shape_pose ? shapes_[body] : states_[body];
  }
  /// Whether the centre of a body's shape is off its centre of mass.
  bool is_beside(std::size_t body) const {
    const std::optional<ShapePose>& pose = bodies[body].shape_pose;
    return pose && !pose->position.isZero(0.0);
  }
  List<double>& numbers() { return y_; }
  const List<double>& numbers() const { return y_; }
  /// Sets the states of movable bodies from the state vector y, and of kinematic bodies at time().
  void place(const double* y);
  /// Sets the time since `origin` [s]. Bodies move only in place().
  void set_time(double t) { t_ = t; }
  double time() const { return t_; }
  double clock() const { return origin + t_; }  ///< simulated [s]
  /// Whether any force or constraint depends on the time.
  bool is_moved_by_motors() const;
  bool has_movers() const { return !movers_.empty(); }  ///< whether there are kinematic bodies

  // ---- System
  std::size_t size() const { return (kNumbers * movable + 1) / 2 * 2; }
  void derivative(std::size_t stage, double t, const double* y, double* dydt);
  bool project(double t, double* y);
  template <class Pair>
  void accept(double h) {
    for (std::size_t j = 0; j < Pair::kStages; ++j)
      if (Pair::kA[Pair::kStages][j] != 0.0) add_impulses(h * Pair::kA[Pair::kStages][j], j);
  }
  /// Projects velocities and evaluates the derivative. `known`: the derivative, where already
  /// known.
  bool restart(double* y, double* dydt, const double* known = nullptr);
  double squared_size_of(const double* dy, double h) const;
  double rounding() const;

  /// Whether the derivative is zero to rounding.
  bool is_still(const double* dydt) const;
  /// Applies the current forces over an interval h without motion [s].
  void accept_stillness(double h) { add_impulses(h, 0); }

  // ---- queries at events: current pose, forces of restart()
  /// Accelerations of the bodies by a derivative; 0 for immovable bodies.
  struct Accelerations {
    List<Eigen::Vector3d> linear, angular;
  };
  void find_accelerations(const double* dydt, Accelerations* rates) const;
  /// Derivative ẇ of the relative velocity of a contact.
  static Eigen::Vector3d slip_acceleration(const ContactMotion& motion, const Contact& contact,
                                           const Accelerations& rates);
  ContactMotion motion(const Contact& contact) const { return motion(contact, contact.feature); }
  /// Relative motion at another feature of the pair of the contact.
  ContactMotion motion(const Contact& contact, const ContactFeature& feature) const;
  /// Force of a contact on A in a stage of the last substep [N]. Stage 0 is the current pose.
  const Eigen::Vector3d& force(std::size_t contact, std::size_t stage) const {
    return stages_[stage].contact[contact];
  }
  /// Normal force of a contact in a stage [N].
  double normal_force(std::size_t contact, std::size_t stage) const {
    return stages_[stage].normal[contact];
  }
  /// Force that holds a coordinate in a stage [N or N m].
  double held_force(std::size_t coordinate, std::size_t stage) const {
    return stages_[stage].coordinate[coordinate];
  }
  /// Force of a joint in a stage, by function of its kind.
  const RowVector& joint_force(std::size_t joint, std::size_t stage) const {
    return stages_[stage].joint[joint];
  }
  /// Coordinate at the current pose; `J`: its gradient.
  struct Reading {
    double q = 0.0, rate = 0.0, acceleration = 0.0;
    Jacobian J;
  };
  /// Reads a coordinate, with the given accelerations of bodies or with zero accelerations.
  Reading read(const Coordinate& coordinate, const Accelerations* rates) const;
  /// Returns position, rate and acceleration of the upper or lower limit of a coordinate.
  Prescribed limit(const Coordinate& coordinate, bool upper_one) const;
  /// Returns the rate and acceleration that the motor of a coordinate demands.
  Prescribed zeta(const Coordinate& coordinate) const;
  /// Rest position of a servo.
  Prescribed rest(const Coordinate& coordinate) const {
    return rest_of(coordinate.law, coordinate.law.is_distance
                                       ? joints[coordinate.joint].course.length(clock())
                                       : Prescribed{});
  }
  double scale() const { return scale_; }
  /// Removes all rows and laws of a joint.
  void break_joint(std::size_t joint);
  /// Saves impulses and stage 0, from which a repeated substep restarts together with the state
  /// vector.
  void keep();
  void restore();
  double largest_force() const;
  double driven_work = 0.0;  ///< work of kinematic bodies on the others [J]
  double kinetic_energy() const;
  double potential_energy() const;  ///< gravity and constant forces [J]

  /// Contact in a problem of impulses.
  struct Touching {
    std::size_t contact;
    ContactMotion motion;
    Eigen::Matrix3d frame;   ///< columns n, t1, t2; without friction n only
    std::size_t column = 0;  ///< first column of the contact
    bool is_rough = false;   ///< whether there is friction, and thus three columns
    /// Components of an impulse or rate along the frame, from the numbers of all columns.
    Eigen::Vector3d of(const double* all) const {
      return is_rough ? Eigen::Vector3d(all[column], all[column + 1], all[column + 2])
                      : Eigen::Vector3d(all[column], 0.0, 0.0);
    }
  };
  /// Responses to unit impulses while the joints hold. Columns: three per contact with friction,
  /// then one per other contact, then one per coordinate.
  struct Responses {
    List<Touching> contacts;
    List<std::size_t> coordinates;
    std::size_t columns = 0, of_contacts = 0;  ///< number in total, and of contacts
    List<char> is_free;                        ///< per coordinate: left free by the joints
    List<double> velocity;                     ///< per column: changes of (v, ω) of the bodies
    List<double> joints;                       ///< per column: impulses of rows of joints
    List<double> A;                            ///< per column: changes of the rates of all columns

    void clear() {
      contacts.clear();
      coordinates.clear();
    }
    void add(std::size_t contact, const ContactMotion& motion) {
      contacts.push_back({contact, motion, Eigen::Matrix3d::Zero()});
    }
  };
  /// Computes the responses for contacts and coordinates listed in `responses`, which have to stay
  /// until apply().
  void find_responses(Responses* responses);
  /// Adds impulses p, by the last find_responses(), to the velocities in y and to accumulated
  /// impulses.
  void apply(const Responses& responses, const double* p, double* y);
  /// Displaces bodies by p times the responses, as changes of position instead of velocity.
  void displace(const Responses& responses, const double* p, double* y);

 private:
  // Offsets in the state, per body.
  static constexpr std::size_t kV = 3, kQ = 6, kL = 10, kNumbers = 13;
  using Vector = Eigen::Map<Eigen::Vector3d>;
  using ConstVector = Eigen::Map<const Eigen::Vector3d>;
  static Eigen::Index index(std::size_t i) { return static_cast<Eigen::Index>(i); }

  struct Row {
    std::size_t a, b;
    Jacobian J;
    Jacobian inv_M_F;          // accelerations by a unit force
    bool is_symmetric = true;  // F equals J
    double gamma = 0.0, value = 0.0, rate = 0.0, reference = 0.0;
    double share = 1.0;              // weight against rows that depend on this row
    int joint = -1, function = 0;    // joint and its function; -1: none
    int coordinate = -1;             // coordinate held by the row; -1: none
    int contact = -1;                // contact; -1: none
    bool is_normal = false;          // normal row of the contact
    Eigen::Vector3d along{0, 0, 0};  // force on A by a unit multiplier of a contact
  };
  struct Stage {
    List<Eigen::Vector3d> contact;  // per contact, on A
    List<double> normal;            // per contact, along the normal
    List<double> coordinate;        // per coordinate, holding force
    List<RowVector> joint;
    double driven_power = 0.0;  // power of kinematic bodies on the others [W]

    void clear();
  };

  void place_shape(std::size_t body);
  void place_movers();
  double driven_power(std::size_t body, const Eigen::Vector3d& force,
                      const Eigen::Vector3d& torque) const;
  double driven_power(std::size_t a, std::size_t b, const Jacobian& F) const;
  double driven_power(const Row& row) const;
  void add_joint_rows();
  void add_coordinate_row(std::size_t coordinate, const Prescribed& target);
  void add_held_rows();
  void add_contact_rows(bool with_slip, bool with_tangents);
  void add_directions(Responses* responses);
  Row& add_row(std::size_t a, std::size_t b, const Jacobian& J);
  Jacobian accelerations(const Row& row, const Jacobian& F) const;
  double response(const Row& of, const Row& to) const;
  double along(const Row& row, const List<Eigen::Vector3d>& linear,
               const List<Eigen::Vector3d>& angular) const;
  void push(const Row& row, double amount, List<Eigen::Vector3d>* linear,
            List<Eigen::Vector3d>* angular) const;
  bool solve_rows(List<double>* lambda);
  void factor_rows(bool asks_rank);
  bool find_change(double Row::*by);
  Prescribed target(const Coordinate& coordinate) const;
  double free_force(const Coordinate& coordinate, const Reading& now) const;
  void pull_coordinates(Stage* told, List<Eigen::Vector3d>* linear,
                        List<Eigen::Vector3d>* angular) const;
  void clear_motion(List<Eigen::Vector3d>* linear, List<Eigen::Vector3d>* angular) const;
  void add_impulses(double weight, std::size_t stage);

  List<double> y_;
  double t_ = 0.0;  // time since origin [s]
  List<BodyState> states_;
  List<BodyState> shapes_;  // states of shapes with a pose
  struct Mover {
    std::size_t body;
    BodyState start;  // state at the start of the tick
  };
  List<Mover> movers_;                     // kinematic bodies
  double since_tick_ = 0.0;                // time from the start of the tick to t_ = 0 [s]
  List<Eigen::Matrix3d> inverse_inertia_;  // per body, world axes
  List<Row> rows_;
  List<Row> directions_;          // unit impulses
  List<double> weight_;           // per row: scales the diagonal to 1
  List<double> lambda_;           // forces of rows
  bool are_independent_ = false;  // whether rows are independent, as of restart()
  LeastNormSolver factors_;
  std::array<Stage, DormandPrince8::kStages + 1> stages_;
  double scale_ = 0.0;  // length that rounding is relative to [m]
  // Scratch: forces, free accelerations, reference forces.
  List<Eigen::Vector3d> linear_, angular_, free_linear_, free_angular_;
  List<Eigen::Vector3d> reference_linear_, reference_angular_;
  /// Values that keep() saved; impulses per contact and per joint.
  struct Kept {
    Stage stage;
    double work = 0.0;
    List<Eigen::Vector3d> contacts;
    List<ContactFeature> touched;  // per contact
    List<RowVector> joints;
  };
  Kept kept_;
};

}  // namespace constraint_sim::engine
