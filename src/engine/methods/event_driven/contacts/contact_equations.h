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
#include "engine/math/embedded_pairs.h"
#include "engine/math/least_norm_solver.h"
#include "engine/math/list.h"
#include "engine/model/mass_properties.h"

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
    double normal_share = 1.0, tangent_share = 1.0;       ///< by which redundant contacts bear more
    Eigen::Vector3d impulse = Eigen::Vector3d::Zero();    ///< since begin_step(), on A [N s]
    ContactFeature touched;                               ///< that the last impulse had
  };
  struct Body {
    int index;  ///< in the world
    MassProperties mass;
    Eigen::Vector3d force = Eigen::Vector3d::Zero(), torque = Eigen::Vector3d::Zero();
    std::optional<ShapePose> shape_pose;
  };
  struct BodyJoint {
    int index;         ///< in the world
    std::size_t a, b;  ///< bodies here
    Joint joint;
    bool has_rows = true;  ///< those of its kind; else its coordinates alone
    bool is_broken = false;
    bool was_saturated = false;  ///< as the last step told
    bool is_at_end = false;      ///< a winch, of its travel, in this span
    PrescribedMotion course{};   ///< in this span
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

  List<Body> bodies;  ///< movable ones first, then those that stand, or move by themselves
  std::size_t movable = 0;
  List<BodyJoint> joints;
  List<Coordinate> coordinates;
  List<Contact> contacts;
  /// Slips keep the directions of where the substep starts: rows hold them across.
  bool is_straight = false;
  Eigen::Vector3d gravity = Eigen::Vector3d::Zero();
  /// Where the span begins, simulated [s]. Times are counted from there, so that it makes no
  /// difference how late it is.
  double origin = 0.0;

  /// Where all bodies are, those that move by themselves as they were so long ago [s].
  void gather_state(const List<BodyState>& states, double since_tick = 0.0);
  /// Room for what contacts, coordinates and joints do in stages; after the last one was added.
  void prepare_stages();
  void scatter_state(List<BodyState>* states) const;
  const BodyState& state(std::size_t body) const { return states_[body]; }
  const List<BodyState>& states() const { return states_; }
  void set_states(const List<BodyState>& states);
  /// Where the shape of a body is, and how it moves there: what features are found with.
  const BodyState& shape_state(std::size_t body) const {
    return bodies[body].shape_pose ? shapes_[body] : states_[body];
  }
  /// Whether the shape of a body has its middle beside the centre of mass.
  bool is_beside(std::size_t body) const {
    const std::optional<ShapePose>& pose = bodies[body].shape_pose;
    return pose && !pose->position.isZero(0.0);
  }
  List<double>& numbers() { return y_; }
  const List<double>& numbers() const { return y_; }
  /// Moves to these numbers.
  void place(const double* y);
  /// Moves to a time since `origin` [s], at which bodies stay where they are until place().
  void set_time(double t) { t_ = t; }
  double time() const { return t_; }
  double clock() const { return origin + t_; }  ///< simulated [s]
  /// Whether anything that acts depends on the time.
  bool is_moved_by_motors() const;
  bool has_movers() const { return !movers_.empty(); }  ///< bodies that move by themselves

  // ---- a System
  std::size_t size() const { return (kNumbers * movable + 1) / 2 * 2; }
  void derivative(std::size_t stage, double t, const double* y, double* dydt);
  bool project(double t, double* y);
  template <class Pair>
  void accept(double h) {
    for (std::size_t j = 0; j < Pair::kStages; ++j)
      if (Pair::kA[Pair::kStages][j] != 0.0) add_impulses(h * Pair::kA[Pair::kStages][j], j);
  }
  /// `known`: the derivative as things are, where it is known.
  bool restart(double* y, double* dydt, const double* known = nullptr);
  double squared_size_of(const double* dy, double h) const;
  double rounding() const;

  /// Whether a derivative says that nothing moves, to rounding.
  bool is_still(const double* dydt) const;
  /// Takes the forces that act now for h.
  void accept_stillness(double h) { add_impulses(h, 0); }

  // ---- for events, as the bodies lie and with what restart() found
  /// Accelerations of bodies in a derivative; of immovable ones 0.
  struct Accelerations {
    List<Eigen::Vector3d> linear, angular;
  };
  void find_accelerations(const double* dydt, Accelerations* rates) const;
  /// ẇ of a contact.
  static Eigen::Vector3d slip_acceleration(const ContactMotion& motion, const Contact& contact,
                                           const Accelerations& rates);
  ContactMotion motion(const Contact& contact) const { return motion(contact, contact.feature); }
  /// The same of another feature of its pair.
  ContactMotion motion(const Contact& contact, const ContactFeature& feature) const;
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
  double driven_work = 0.0;  ///< of bodies that move by themselves, on the others [J]
  double kinetic_energy() const;
  double potential_energy() const;  ///< of gravity and of constant forces [J]

  /// A contact that impulses act in.
  struct Touching {
    std::size_t contact;
    ContactMotion motion;
    Eigen::Matrix3d frame;   ///< columns n, t1, t2; of one without friction n alone
    std::size_t column = 0;  ///< of its first unit impulse
    bool is_rough = false;   ///< has friction, and three of them
    /// An impulse or a rate along the frame, of those of all columns.
    Eigen::Vector3d of(const double* all) const {
      return is_rough ? Eigen::Vector3d(all[column], all[column + 1], all[column + 2])
                      : Eigen::Vector3d(all[column], 0.0, 0.0);
    }
  };
  /// What unit impulses do while the joints hold: three columns for each contact with friction,
  /// then one for each of the others, then one for each coordinate.
  struct Responses {
    List<Touching> contacts;
    List<std::size_t> coordinates;
    std::size_t columns = 0, of_contacts = 0;  ///< of all, and of contacts
    List<char> is_free;                        ///< coordinates that the joints leave free
    List<double> velocity;                     ///< of each column, the change of (v, ω) of bodies
    List<double> joints;                       ///< and the impulses of joints' rows
    List<double> A;                            ///< and the change of the rates of all columns

    void clear() {
      contacts.clear();
      coordinates.clear();
    }
    void add(std::size_t contact, const ContactMotion& motion) {
      contacts.push_back({contact, motion, Eigen::Matrix3d::Zero()});
    }
  };
  /// Of the contacts and coordinates that are in it. These have to stay until apply().
  void find_responses(Responses* responses);
  /// Adds impulses p to velocities, and to those of joints: those that were found last.
  void apply(const Responses& responses, const double* p, double* y);
  /// Moves bodies by p of these changes, as places and not as velocities.
  void displace(const Responses& responses, const double* p, double* y);

 private:
  static constexpr std::size_t kV = 3, kQ = 6, kL = 10, kNumbers = 13;  // of a body, in the state
  using Vector = Eigen::Map<Eigen::Vector3d>;
  using ConstVector = Eigen::Map<const Eigen::Vector3d>;
  static Eigen::Index index(std::size_t i) { return static_cast<Eigen::Index>(i); }

  struct Row {
    std::size_t a, b;
    Jacobian J;
    Jacobian inv_M_F;          // what a force of one unit does
    bool is_symmetric = true;  // F is J
    double gamma = 0.0, value = 0.0, rate = 0.0, reference = 0.0;
    double share = 1.0;              // by which it bears more than other rows on which it depends
    int joint = -1, function = 0;    // of a joint
    int coordinate = -1;             // that one holds, beside
    int contact = -1;                // or a contact
    bool is_normal = false;          // of it
    Eigen::Vector3d along{0, 0, 0};  // force of one unit on A, of a contact
  };
  struct Stage {
    List<Eigen::Vector3d> contact;  // forces on A
    List<double> normal;            // the same along normals
    List<double> coordinate;        // what holds them
    List<RowVector> joint;
    double driven_power = 0.0;  // of bodies that move by themselves, on the others

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
  double t_ = 0.0;  // [s] since origin
  List<BodyState> states_;
  List<BodyState> shapes_;  // of bodies whose shape has a pose
  struct Mover {
    std::size_t body;
    BodyState start;  // of the tick
  };
  List<Mover> movers_;                     // bodies that move by themselves
  double since_tick_ = 0.0;                // of t_ = 0 [s]
  List<Eigen::Matrix3d> inverse_inertia_;  // world
  List<Row> rows_;
  List<Row> directions_;          // of unit impulses
  List<double> weight_;           // that scale rows to a diagonal of one
  List<double> lambda_;           // forces of rows
  bool are_independent_ = false;  // rows, as restart() found them
  LeastNormSolver factors_;
  std::array<Stage, DormandPrince8::kStages + 1> stages_;
  double scale_ = 0.0;  // [m] that rounding goes by
  // scratch: of forces, of what is free, and of references
  List<Eigen::Vector3d> linear_, angular_, free_linear_, free_angular_;
  List<Eigen::Vector3d> reference_linear_, reference_angular_;
  Stage kept_;
  double kept_work_ = 0.0;
  List<Eigen::Vector3d> kept_contacts_;  // impulses
  List<RowVector> kept_joints_;
};

}  // namespace constraint_sim::engine
