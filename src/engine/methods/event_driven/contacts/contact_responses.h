#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "engine/math/list.h"
#include "engine/methods/event_driven/contacts/contact_equations.h"
#include "engine/methods/event_driven/contacts/contact_rows.h"

namespace constraint_sim::engine {

/// Contact in a problem of impulses.
struct TouchingContact {
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

/// Computes the responses of a contact group to unit impulses while the joints hold. Columns: three
/// per contact with friction, then one per other contact, then one per coordinate.
class ContactResponses {
 public:
  /// Removes contacts and coordinates.
  void clear();
  void add(std::size_t contact, const ContactMotion& motion) {
    contacts_.push_back({contact, motion, Eigen::Matrix3d::Zero()});
  }
  /// Returns the contact that was added with the same bodies, place and normal, to `within` [m], as
  /// where corners of two boxes meet: its impulses are those of both. -1: none.
  std::ptrdiff_t find_twin(std::size_t contact, const ContactMotion& motion, double within,
                           const ContactEquations& equations) const;
  void add_coordinate(std::size_t coordinate) { coordinates_.push_back(coordinate); }
  const List<TouchingContact>& contacts() const { return contacts_; }
  const List<std::size_t>& coordinates() const { return coordinates_; }

  /// Computes the responses of the contacts and coordinates that were added.
  void find(const ContactEquations& equations);
  std::size_t columns() const { return columns_; }
  std::size_t of_contacts() const { return of_contacts_; }  ///< number of columns of contacts
  /// Whether the joints leave coordinate k of coordinates() free.
  bool is_free(std::size_t k) const { return is_free_[of_contacts_ + k] != 0; }
  /// Whether joints hold a column of a contact: no impulse along it moves anything.
  bool is_held(std::size_t column) const { return is_free_[column] == 0; }
  /// Changes of the rates of all columns, per column.
  const List<double>& A() const { return A_; }

  /// Adds impulses p to the velocities in y, and to the accumulated impulses.
  void apply(const double* p, ContactEquations* equations, double* y);
  /// Adds the forces of joints by forces p along the columns to the references of their rows.
  void refer_joints(const double* p, GroupJoints* joints) const;
  /// Displaces bodies by p times the responses, as changes of position instead of velocity.
  void displace(const double* p, ContactEquations* equations, double* y) const;

 private:
  void add_directions(const ContactEquations& equations);

  List<TouchingContact> contacts_;
  List<std::size_t> coordinates_;
  std::size_t columns_ = 0, of_contacts_ = 0;
  ContactRows directions_;   // unit impulses
  ContactRows held_;         // rows of joints
  List<char> is_free_;       // per column: whether the joints leave it free
  List<double> velocity_;    // per column: changes of (v, ω) of the bodies
  List<double> joints_;      // per column: impulses of held_
  List<double> A_, lambda_;  // lambda_: scratch
  GroupMotions motions_;     // scratch
};

}  // namespace constraint_sim::engine
