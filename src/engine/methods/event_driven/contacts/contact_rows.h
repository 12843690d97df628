#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>

#include "engine/constraints/joint.h"
#include "engine/math/least_norm_solver.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/contacts/group_bodies.h"

namespace constraint_sim::engine {

/// Two bodies in a row of a contact group: gradient, and accelerations by a unit force.
struct ContactRowPart {
  std::size_t a, b;
  Jacobian J, inv_M_F;

  /// Takes a force along the gradient.
  ContactRowPart(const GroupBodies& bodies, std::size_t body_a, std::size_t body_b,
                 const Jacobian& gradient)
      : a(body_a), b(body_b), J(gradient), inv_M_F(bodies.accelerations(a, b, J)) {}

  double times(const GroupMotions& motions, std::size_t movable) const;
  void push(double amount, std::size_t movable, GroupMotions* motions) const;
};

/// Row of a contact group: a rate J v that a force F per unit of a multiplier changes.
struct ContactRow : ContactRowPart {
  using ContactRowPart::ContactRowPart;

  std::optional<ContactRowPart> second;  ///< second joint of a coupling
  bool is_symmetric = true;              ///< whether F equals J
  double gamma = 0.0, value = 0.0, rate = 0.0, reference = 0.0;
  double share = 1.0;              ///< weight against rows that depend on this row
  int joint = -1, function = 0;    ///< joint and its function or kOfCoupling; -1: none
  int coordinate = -1;             ///< coordinate held by the row; -1: none
  int contact = -1;                ///< contact; -1: none
  bool is_normal = false;          ///< normal row of the contact
  Eigen::Vector3d along{0, 0, 0};  ///< force on A by a unit multiplier of a contact

  /// Returns J times the motions of `movable` bodies.
  double times(const GroupMotions& motions, std::size_t movable) const;
  /// Adds the accelerations of `movable` bodies by a force of `amount`.
  void push(double amount, std::size_t movable, GroupMotions* motions) const;
  /// Power of kinematic bodies on the others, by a unit force along the gradient.
  double driven_power(const GroupBodies& bodies) const;
};

/// Solves for the forces λ of the rows of a contact group, with dense matrices:
///   J M⁻¹ F λ = change of the rows.
/// Where rows depend on each other, λ has least norm relative to a reference.
class ContactRows {
 public:
  void clear() { rows_.clear(); }
  /// Adds a row with forces along its gradient.
  ContactRow& add(const GroupBodies& bodies, std::size_t a, std::size_t b, const Jacobian& J) {
    return rows_.emplace_back(bodies, a, b, J);
  }
  List<ContactRow>& list() { return rows_; }
  const List<ContactRow>& list() const { return rows_; }

  /// Factors the rows. Independence is tested with `asks_rank`, as at the start of a substep, and
  /// holds for all its stages.
  void factor(const GroupBodies& bodies, bool asks_rank);
  /// Replaces the changes of rows in `lambda` by their forces. Returns false where these are not
  /// finite.
  bool solve(std::size_t movable, List<double>* lambda);
  /// Computes the least change M⁻¹ Jᵀ λ of positions or velocities that removes the errors `by` of
  /// the rows.
  bool find_change(const GroupBodies& bodies, double ContactRow::*by, GroupMotions* change);

 private:
  List<ContactRow> rows_;
  List<double> weight_;           // per row: scales the diagonal to 1
  bool are_independent_ = false;  // whether rows are independent
  LeastNormSolver factors_;
  List<double> lambda_;     // scratch
  GroupMotions reference_;  // by reference forces; scratch
};

}  // namespace constraint_sim::engine
