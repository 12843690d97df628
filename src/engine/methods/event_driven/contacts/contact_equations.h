#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <optional>

#include "engine/collision/contact_feature.h"
#include "engine/constraints/joint.h"
#include "engine/math/embedded_pairs.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/contacts/contact_rows.h"
#include "engine/methods/event_driven/contacts/group_bodies.h"
#include "engine/methods/event_driven/contacts/group_joints.h"

namespace constraint_sim::engine {

/// Equations of a small group of touching bodies and the joints on them, as a System of integrate.h
/// with dense matrices. J: rows of joints, held coordinates and acting contacts; F: forces per unit
/// of each multiplier:
///   J M⁻¹ F λ = −γ − J a_free
/// F = J except for a slipping contact, which has one row along its normal and F = n − μ û, with û
/// the slip direction. Where rows depend on each other, λ has least norm relative to a reference.
class ContactEquations {
 public:
  enum class Acts : char { kOpen, kSticks, kSlips };  ///< kSlips includes contacts without friction

  struct Contact {
    std::size_t a, b;                          ///< indices in bodies().list(); b may be immovable
    std::size_t shape_index_a, shape_index_b;  ///< indices in bodies().shapes()
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

    /// Whether the contact acts now, or had an impulse in this step.
    bool has_touched() const { return acts != Acts::kOpen || !impulse.isZero(0.0); }
  };

  GroupBodies& bodies() { return bodies_; }
  const GroupBodies& bodies() const { return bodies_; }
  GroupJoints& joints() { return joints_; }
  const GroupJoints& joints() const { return joints_; }
  List<Contact>& contacts() { return contacts_; }
  const List<Contact>& contacts() const { return contacts_; }
  /// Whether each slip keeps, in the whole substep, the direction that it has at the start. A row
  /// per slip then holds the velocity across this direction.
  bool is_straight() const { return is_straight_; }
  void set_straight(bool is_straight) { is_straight_ = is_straight; }

  /// Allocates stages for contacts, coordinates and joints; called after all of them were added.
  void prepare_stages();

  // ---- System
  std::size_t size() const { return bodies_.size(); }
  void derivative(std::size_t stage, double t, const double* y, double* dydt);
  bool project(double t, double* y);
  template <class Pair>
  void accept(double h) {
    for (std::size_t j = 0; j < Pair::kStages; ++j)
      if (Pair::kA[Pair::kStages][j] != 0.0) add_impulses(h * Pair::kA[Pair::kStages][j], j);
  }
  /// Projects velocities onto the rows of joints and held coordinates where a rate is off by more
  /// than `least` [m/s or rad/s]. Returns the kinetic energy that is lost [J]; none where the rows
  /// have no solution.
  std::optional<double> fit_joints(double* y, double least);
  /// Projects velocities and evaluates the derivative. `known`: the derivative, where already
  /// known.
  bool restart(double* y, double* dydt, const double* known = nullptr);
  double squared_size_of(const double* dy, double h, bool /*is_of_rates*/ = false) const {
    return bodies_.squared_size_of(dy, h);
  }
  double rounding() const { return bodies_.rounding(); }

  /// Applies the current forces over an interval h without motion [s].
  void accept_without_motion(double h) { add_impulses(h, 0); }

  // ---- queries at the current pose
  /// Derivative ẇ of the relative velocity of a contact.
  static Eigen::Vector3d slip_acceleration(const ContactMotion& motion, const Contact& contact,
                                           const GroupMotions& rates);
  ContactMotion motion(const Contact& contact) const {
    return bodies_.motion(contact.shape_index_a, contact.shape_index_b, contact.feature);
  }
  double potential_energy() const;  ///< gravity and constant forces [J]

  // ---- forces in a stage of the last substep; stage 0 is the current pose
  /// Force of a contact on A [N].
  const Eigen::Vector3d& force(std::size_t contact, std::size_t stage) const {
    return stages_[stage].contact[contact];
  }
  /// Normal force of a contact [N].
  double normal_force(std::size_t contact, std::size_t stage) const {
    return stages_[stage].normal[contact];
  }
  /// Force that holds a coordinate [N or N m].
  double held_force(std::size_t coordinate, std::size_t stage) const {
    return stages_[stage].coordinate[coordinate];
  }
  /// Forces of a joint.
  const GroupForces& joint_force(std::size_t joint, std::size_t stage) const {
    return stages_[stage].joint[joint];
  }
  /// Whether the velocities bend no row that acts at the current pose: each γ is close to zero.
  bool are_rows_straight() const;
  /// Largest force of the group [N]; the share kForceShare of it counts as rounding.
  double largest_force() const;

  /// Work of kinematic bodies on the others [J].
  double driven_work() const { return driven_work_; }
  void set_driven_work(double work) { driven_work_ = work; }
  void add_driven_work(double work) { driven_work_ += work; }

  /// Saves impulses and stage 0, from which a repeated substep restarts together with the state
  /// vector.
  void keep();
  void restore();

 private:
  struct Stage {
    List<Eigen::Vector3d> contact;  // per contact, on A
    List<double> normal;            // per contact, along the normal
    List<double> coordinate;        // per coordinate, holding force
    List<GroupForces> joint;
    double driven_power = 0.0;  // power of kinematic bodies on the others [W]

    void clear();
  };
  /// Values that keep() saved; impulses per contact and per joint.
  struct Kept {
    Stage stage;
    double work = 0.0;
    List<Eigen::Vector3d> contacts;
    List<ContactFeature> touched;  // per contact
    List<GroupForces> joints;
  };

  void set_rows(bool with_slip, bool with_tangents);
  void add_contact_rows(std::size_t contact, bool with_slip, bool with_tangents);
  bool add_soft_forces(Stage* forces);
  void solve_forces(bool are_pushed, Stage* forces);
  double driven_power(const ContactRow& row) const;
  void add_impulses(double weight, std::size_t stage);

  GroupBodies bodies_;
  GroupJoints joints_;
  List<Contact> contacts_;
  bool is_straight_ = false;
  ContactRows rows_;
  std::array<Stage, DormandPrince8::kStages + 1> stages_;
  double driven_work_ = 0.0;
  GroupMotions free_, pushed_;  // accelerations without and by forces of rows and laws; scratch
  List<double> lambda_;         // scratch
  Kept kept_;
};

}  // namespace constraint_sim::engine
