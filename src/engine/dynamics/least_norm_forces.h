#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>

#include "constraint_sim/engine/body.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/math/list.h"
#include "engine/math/sparse_ldlt.h"

namespace constraint_sim::engine {

/// The impulses of an island with redundant rows, as they are reported. The motion asks for their
/// sum on each body alone, and many λ have that sum. The one told is that of least Σ a λ² over
/// all rigid rows, a the diagonal entry of G M⁻¹ Gᵀ, of a ball joint the mean of its three:
///   λ = D⁻¹ G z,  Gᵀ D⁻¹ G z = Gᵀ λ of the motion,  D = diag(a)
/// Joints that are alike share alike. Nothing here reaches the motion.
class LeastNormForces {
 public:
  explicit LeastNormForces(const EquationsOfMotion& equations);

  /// Shares out the impulses of `equations`, with the bodies where the step ends. Keeps those where
  /// no others of the same sum are found, as at mass ratios above 1e10.
  void share(const EquationsOfMotion& equations, const List<BodyState>& states);
  /// As EquationsOfMotion::impulse(), of joints()[l].
  RowVector impulse(const EquationsOfMotion& equations, std::size_t l) const;
  double coupled_impulse(const EquationsOfMotion& equations, std::size_t l) const;

 private:
  /// One rigid joint; slots_ has the lower triangle of its bodies' unknowns.
  struct Link {
    int rows;
    std::array<int, 2> unknown;  // first ones of its ends' bodies; -1 of a fixed point
    std::array<std::size_t, 2> unknowns;
    std::size_t first_row, first_slot;
  };
  /// What a unit impulse of a row does to its ends A and B: force and torque.
  using Row = std::array<std::array<double, 6>, 2>;

  /// A row of up to four bodies.
  struct CoupledRow {
    struct End {
      int unknown;
      std::size_t unknowns, point;
      std::array<double, 6> row;
    };
    List<End> ends;
    std::size_t first_slot = 0;
    double inverse_weight = 0.0, impulse = 0.0, share = 0.0;
  };

  void add_coupled(const EquationsOfMotion& equations, List<std::pair<int, int>>* pattern);
  template <class Visit>
  static void for_each_entry(const CoupledRow& coupled, Visit visit);
  void place(const EquationsOfMotion& equations, const List<BodyState>& states);
  void place_coupled(const EquationsOfMotion& equations, const List<BodyState>& states);
  JointVectors place_ends(const EquationsOfMotion& equations, const List<BodyState>& states,
                          std::size_t l, std::array<Eigen::Vector3d, 2>* arm,
                          Eigen::Vector3d* d) const;
  JointVectors vectors_of(const EquationsOfMotion& equations, const List<BodyState>& states,
                          std::size_t l, const std::array<Eigen::Vector3d, 2>& arm,
                          const Eigen::Vector3d& d) const;
  void factor();
  void gather_state(const EquationsOfMotion& equations);
  void find_shares();
  double find_missing();
  void add_shares();
  bool has_same_sum() const;
  template <class Visit>
  void for_each_entry(const Link& link, Visit visit) const;

  List<Link> links_;  // rigid ones, as joints()
  List<Row> rows_;
  List<CoupledRow> coupled_;      // as EquationsOfMotion::coupled_rows()
  List<double> inverse_weights_;  // 1/a of rows
  List<SparseLdlt::Slot> slots_, diagonal_;
  SparseLdlt ldlt_;         // of Gᵀ D⁻¹ G
  List<double> stiffness_;  // its diagonal
  List<double> missing_;    // Gᵀ of what is not shared out yet, then z; by unknown
  List<double> permuted_;   // the same, in the order of the elimination
  List<char> is_torque_;    // the same
  List<double> impulses_;   // of the motion: of rows, then of springs [N s]
  List<double> shares_;     // those reported, the same
};

}  // namespace constraint_sim::engine
