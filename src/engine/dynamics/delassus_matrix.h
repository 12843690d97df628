#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>

#include "engine/dynamics/island_model.h"
#include "engine/dynamics/kinematics.h"
#include "engine/math/list.h"
#include "engine/math/sparse_ldlt.h"

namespace constraint_sim::engine {

/// Delassus matrix A = G M⁻¹ Gᵀ of an island with its factors: maps forces of rows to
/// accelerations along rows. Redundant rows have no entries. Vectors by unknown are in the order of
/// the elimination, with redundant rows last.
class DelassusMatrix {
 public:
  /// Rows are independent where no pivot falls below this share of its diagonal entry: the pivot
  /// has kept half of its digits. A kernel leaves other matrices to the general equations, those of
  /// its own elimination included.
  static constexpr double kLeastPivot = 1e-8;

  /// Lists the entries of A with their sources. Without factors until factor().
  void compile(const IslandModel& island, const List<char>& is_redundant);
  /// Evaluates A at a pose.
  void evaluate(const Kinematics& kinematics);
  /// Factors A. Leaves out rows whose pivot falls below the share `least` of its diagonal entry.
  void factor(double least);
  void forget_factors() { has_factors_ = false; }
  bool has_factors() const { return has_factors_; }

  /// Index of the unknown of each row.
  const List<std::size_t>& unknown() const { return unknown_; }
  std::size_t redundant() const { return unknown_.size() - kept_; }
  /// Number of rows without a force in the current factors, except redundant rows.
  int left_out() const { return left_out_; }
  bool is_left_out(std::size_t row) const { return ldlt_.is_left_out(unknown_[row]); }
  /// Keeps a row in later factors whatever its pivot; keep_none() ends that for all rows.
  void keep(std::size_t row) { ldlt_.keep(unknown_[row]); }
  bool is_kept(std::size_t row) const { return ldlt_.is_kept(unknown_[row]); }
  void keep_none() { ldlt_.keep_none(); }
  void leave_out_none() { left_out_ = 0; }
  double smallest_pivot() const { return ldlt_.smallest_pivot(); }

  /// Replaces b by λ with A λ = b; rows without a force get 0.
  void solve(double* b);
  /// Adds A⁻¹ of the residual to λ of rows with a force. Overwrites the residual.
  void refine(double* residual, double* lambda) const;
  /// Computes b − A λ of all rows, redundant rows included.
  void find_residual(const IslandModel& island, const Kinematics& kinematics, const double* b,
                     const double* lambda, double* residual);
  /// Subtracts the share of the angular accelerations of rotating bodies in G a from b.
  void subtract_angular(const IslandModel& island, const Kinematics& kinematics,
                        const List<Eigen::Vector3d>& acceleration, double* b) const;
  /// Subtracts G M⁻¹ of forces per point and torques per rotating body from b.
  void subtract_accelerations(const IslandModel& island, const Kinematics& kinematics,
                              const List<Eigen::Vector3d>& force,
                              const List<Eigen::Vector3d>& torque, double* b) const;
  /// Computes Gᵀλ: forces on bodies and torques on rotating bodies.
  void apply_transpose(const IslandModel& island, const Kinematics& kinematics,
                       const double* lambda);
  /// Results of apply_transpose(): per point [N], and per rotating body [N m].
  const List<Eigen::Vector3d>& force() const { return force_; }
  const List<Eigen::Vector3d>& torque() const { return torque_; }

  /// Converts λ of rods to forces [N], or to impulses.
  void multipliers_to_forces(const IslandModel& island, const IntervalInputs& inputs,
                             double* lambda) const;

  /// Starts to count dependent rows anew.
  void begin_step() { dependent_ = 0; }
  void count_dependent() { dependent_ = std::max(dependent_, left_out_); }
  /// Largest number of dependent rows at one time since begin_step(), redundant rows included.
  int dependent() const { return dependent_ + static_cast<int>(redundant()); }

  template <class Self, class Visit>
  static void visit_factors(Self& self, Visit& visit) {
    SparseLdlt::visit_memory(self.ldlt_, visit);
  }
  template <class Self, class Visit>
  static void visit_left_out(Self& self, Visit& visit) {
    visit(self.left_out_);
  }
  template <class Self, class Visit>
  static void visit_has_factors(Self& self, Visit& visit) {
    visit(self.has_factors_);
  }

 private:
  /// Row or part that acts on a body; the sign is −1 where the body is end A.
  struct Pull {
    std::size_t row, unknown;
    double sign;
  };
  /// Two rows on one body, or one row twice. The inverse mass is negative where the body is A of
  /// one row and B of the other.
  struct LinearCoupling {
    std::size_t i, j;
    double inverse_mass;
    SparseLdlt::Slot slot;
  };
  struct AngularCoupling {
    std::size_t p, q;  // angular blocks
    SparseLdlt::Slot slot;
  };
  /// Part of a row that acts on a body.
  struct End {
    std::size_t part;
    double sign;
    int block;
  };

  void list_pulls(const IslandModel& island, const List<List<End>>& ends_on);
  void list_couplings(const IslandModel& island, const List<int>& number,
                      const List<List<End>>& kept_on);

  SparseLdlt ldlt_;
  List<LinearCoupling> linear_couplings_;
  List<AngularCoupling> angular_couplings_;
  List<std::size_t> unknown_;        // per row
  List<std::size_t> block_unknown_;  // per angular block
  List<Pull> pulls_;                 // grouped by body
  List<std::size_t> pulls_end_;      // per body
  std::size_t kept_ = 0;             // number of rows with a force
  int left_out_ = 0, dependent_ = 0;
  bool has_factors_ = false;
  List<Eigen::Vector3d> force_, torque_;
};

}  // namespace constraint_sim::engine
